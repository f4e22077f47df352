"""Refusals of the simulated bench: a sentence for a person, a code for a program."""

from __future__ import annotations

from enum import StrEnum

from drivers.errors import DeviceError


class SimulatorCode(StrEnum):
    """Stable codes; an answer on the control connection carries them as "code" beside "error"."""

    WRONG_REQUEST = "simulated_bench.wrong_request"
    WRONG_VALUE = "simulated_bench.wrong_value"
    WRONG_SETTING = "simulated_bench.wrong_setting"
    WRONG_FAULT = "simulated_bench.wrong_fault"
    WRONG_FAULT_PLAN = "simulated_bench.wrong_fault_plan"
    UNKNOWN_TRIAL = "simulated_bench.unknown_trial"
    UNKNOWN_PORT = "simulated_bench.unknown_port"
    CAPTURE_RUNNING = "simulated_bench.capture_running"
    NO_CAPTURE = "simulated_bench.no_capture"
    ATTACHED = "simulated_bench.attached"
    NOT_ATTACHED = "simulated_bench.not_attached"
    OPEN_JOINT = "simulated_bench.open_joint"


class SimulatorError(DeviceError, ValueError):
    """One sentence: the request to the simulated bench and the expected one."""

    def __init__(self, sentence: str, code: SimulatorCode) -> None:
        super().__init__(sentence, code)


def refusal(error: Exception) -> dict[str, str]:
    """The answer to a refused request."""
    return {"error": str(error), "code": getattr(error, "code", SimulatorCode.WRONG_REQUEST)}

"""Errors of QTM and of the connection to it, as codes and sentences for the operator."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from drivers.errors import DeviceCode, DeviceMisconfigured, DeviceUnavailable

PROTOCOL_VERSION = "1.25"
BUSY = {
    "capture_started": "is capturing",
    "waiting_for_trigger": "is waiting for the trigger of a capture",
    "calibration_started": "is being calibrated",
}
"""State in which QTM cannot start a capture → what it is doing."""

_ADVICE = {
    "QTM version": "check QTM",
    "protocol version": f"it may have ten clients already, or not support version {PROTOCOL_VERSION}",
    "control": "correct mocap.password, release control elsewhere, or save and close QTM's measurement",
    "settings": "open a measurement in QTM",
    "frames": "open a measurement in QTM",
}
"""Step of opening a connection → what to do if QTM refuses it."""


def text_of(answer: Any) -> str:
    """Text of an answer or a refusal of QTM."""
    value = getattr(answer, "value", answer)
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


def no_server(name: str, error: OSError) -> DeviceUnavailable:
    """Nothing listens at QTM's address."""
    reason = error.strerror or error
    return DeviceUnavailable(
        f"{name}: no QTM answers ({reason}); start QTM, or correct mocap.host and mocap.port", DeviceCode.NO_SERVER
    )


def no_answer(name: str, step: str) -> DeviceUnavailable:
    """The port is open, and a step of opening the connection timed out."""
    return DeviceUnavailable(
        f"{name} was asked for its {step} and did not answer in time; check that this is QTM's real-time port "
        "(mocap.port, by default 22223)",
        DeviceCode.NO_ANSWER,
    )


def refused_step(name: str, step: str, answer: Exception) -> DeviceMisconfigured:
    """QTM refused a step of opening the connection."""
    sentence = f'{name} was asked for its {step} and answered "{text_of(answer)}"; {_ADVICE[step]}'
    return DeviceMisconfigured(sentence, DeviceCode.REFUSED)


def refused_command(name: str, command: str, answer: Exception, *, has_control: bool) -> DeviceMisconfigured:
    """QTM refused a command, such as "start a capture"."""
    advice = "check QTM's measurement" if has_control else 'set mocap.control = "start"'
    sentence = f'{name} was asked to {command} and answered "{text_of(answer)}"; {advice}'
    return DeviceMisconfigured(sentence, DeviceCode.REFUSED)


def busy(name: str, state: str) -> DeviceUnavailable:
    """A capture or calibration runs that this station did not start."""
    return DeviceUnavailable(
        f"{name} {BUSY[state]}, and this station did not start it; end it in QTM, save it, and try again",
        DeviceCode.CAPTURE_NOT_OURS,
    )


def missing_markers(name: str, missing: Sequence[str], labels: Sequence[str]) -> DeviceMisconfigured:
    """The configuration names markers that QTM does not label."""
    return DeviceMisconfigured(
        f"{name} has no marker {', '.join(missing)}; it has {', '.join(labels)}; correct the labels in QTM or the "
        "markers in the configuration",
        DeviceCode.NO_MARKER,
    )

"""The driver of a DAQ that is wired as the simulated one: force on ai0, sync line on ai1."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from drivers.nidaq import AnalogInput, NiDaq
from drivers.simulators.settings import DaqClockSettings

FORCE, SYNC = AnalogInput("/force", "force", "ai0"), AnalogInput("/sync", "sync", "ai1")
WIRING: dict[str, Any] = {"device": "Dev1", "inputs": (FORCE, SYNC), "sample_rate_hz": 1000.0}
EXACT_CLOCK = DaqClockSettings(offset_ppm=0.0, drift_ppm_per_hour=0.0)


def daq(port: int, host_clock: Callable[[], int], **options: Any) -> NiDaq:
    """Not yet opened."""
    return NiDaq(host_clock=host_clock, **{**WIRING, "grpc_target": f"127.0.0.1:{port}", **options})

"""The drivers by name, each imported when it is first used."""

from __future__ import annotations

import time
from importlib import import_module
from typing import Any

from drivers.device import CaptureControl, Device, HostClock
from drivers.errors import DeviceCode, DeviceMisconfigured
from drivers.reconnecting import Reconnecting, ReconnectingCapture, Seconds

CATALOGUE = {
    "nidaq": "drivers.nidaq:NiDaq",
    "qualisys": "drivers.qualisys:Qualisys",
    "lsl": "drivers.lsl:LslEmg",
    "serial_load_cell": "drivers.serial_load_cell:SerialLoadCell",
}


def make_device(source: str, *, host_clock: HostClock, seconds: Seconds = time.perf_counter, **options: Any) -> Device:
    """A device, not yet opened, that reconnects when it is lost; the options are those of its class.

    seconds is the clock of the reconnection. Raises DeviceMisconfigured for a source without a driver.
    """
    if source not in CATALOGUE:
        sentence = f'no driver is named "{source}"; choose one of {", ".join(sorted(CATALOGUE))}'
        raise DeviceMisconfigured(sentence, DeviceCode.UNKNOWN_DRIVER)
    module, name = CATALOGUE[source].split(":")
    device = getattr(import_module(module), name)(host_clock=host_clock, **options)
    kind = ReconnectingCapture if isinstance(device, CaptureControl) else Reconnecting
    return kind(device, host_clock, seconds=seconds)

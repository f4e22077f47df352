"""The devices the station knows, loaded when asked, so that no wire costs anything until it is used."""

from __future__ import annotations

import time
from importlib import import_module
from typing import Any

from drivers.device import CaptureControl, Device, HostClock
from drivers.errors import DeviceMisconfigured
from drivers.reconnecting import Reconnecting, ReconnectingCapture, Seconds

CATALOGUE = {
    "nidaq": "drivers.nidaq:NiDaq",
    "qualisys": "drivers.qualisys:Qualisys",
    "serial_load_cell": "drivers.serial_load_cell:SerialLoadCell",
}


def make_device(source: str, *, host_clock: HostClock, seconds: Seconds = time.monotonic, **options: Any) -> Device:
    """The device called source, not yet opened, to be brought back when it is lost; the options are those of its class.

    seconds is the clock by which a lost device is tried again.

    Raises DeviceMisconfigured where the catalogue has no such source.
    """
    if source not in CATALOGUE:
        raise DeviceMisconfigured(f'no driver is called "{source}"; the catalogue has {", ".join(sorted(CATALOGUE))}')
    module, name = CATALOGUE[source].split(":")
    device = getattr(import_module(module), name)(host_clock=host_clock, **options)
    kind = ReconnectingCapture if isinstance(device, CaptureControl) else Reconnecting
    return kind(device, host_clock, seconds=seconds)

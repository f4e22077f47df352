"""The devices the station knows, loaded when asked, so that no wire costs anything until it is used."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from drivers.device import Device
from drivers.errors import DeviceMisconfigured

CATALOGUE = {
    "nidaq": "drivers.nidaq:NiDaq",
    "qualisys": "drivers.qualisys:Qualisys",
    "serial_load_cell": "drivers.serial_load_cell:SerialLoadCell",
}


def make_device(source: str, **options: Any) -> Device:
    """The device called source, not yet opened; the options are those of its class.

    Raises DeviceMisconfigured where the catalogue has no such source.
    """
    if source not in CATALOGUE:
        raise DeviceMisconfigured(f'no driver is called "{source}"; the catalogue has {", ".join(sorted(CATALOGUE))}')
    module, name = CATALOGUE[source].split(":")
    device: Device = getattr(import_module(module), name)(**options)
    return device

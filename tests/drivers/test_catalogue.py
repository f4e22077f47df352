from __future__ import annotations

from importlib import import_module

import pytest

from drivers.catalogue import CATALOGUE, make_device
from drivers.errors import DeviceCode
from tests.drivers.contract import raises_refusal


@pytest.mark.parametrize("source", sorted(CATALOGUE))
def test_every_entry_leads_to_a_class_that_can_open_read_and_close(source: str) -> None:
    module, name = CATALOGUE[source].split(":")
    device_class = getattr(import_module(module), name)
    assert all(callable(getattr(device_class, verb)) for verb in ("open", "resume", "read", "close"))
    assert isinstance(device_class.name, property)
    assert isinstance(device_class.streams, property)


def test_a_device_is_made_with_its_options_and_not_opened() -> None:
    device = make_device("serial_load_cell", port="COM3", baud_rate=9600, line_format="usb220", host_clock=lambda: 0)
    assert device.name == "load cell on COM3"
    assert device.streams == ()


def test_an_unknown_source_is_refused_with_the_known_ones() -> None:
    with raises_refusal(DeviceCode.UNKNOWN_DRIVER, naming="labjack"):
        make_device("labjack", host_clock=lambda: 0)

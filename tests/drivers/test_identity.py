"""What each device says of itself, asked over its own wire."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from serial.tools import list_ports

from drivers.serial_load_cell import SerialLoadCell
from drivers.simulators.daq_rpcs import NiDaqSimulator
from drivers.simulators.load_cell_port import SerialLoadCellSimulator
from recordings.samples import DeviceIdentity
from tests.drivers.other_qtm import OtherQtm, packet, proper
from tests.drivers.simulated_qtm import daq, driver, opened, simulator
from tests.drivers.stand_in_world import StandInWorld


@pytest.fixture
def world() -> StandInWorld:
    return StandInWorld()


def ask_nidaq(world: StandInWorld) -> DeviceIdentity:
    server = NiDaqSimulator(world)
    server.start()
    device = daq(server.port, world.utc_ns)
    try:
        device.open()
        return device.identity
    finally:
        device.close()
        server.stop()
        world.clock.stop()


def test_the_simulated_daq_is_identified_by_ni_s_own_property(world: StandInWorld) -> None:
    assert ask_nidaq(world) == DeviceIdentity("NI Dev1", "USB-6008 serial number 01C0FFEE", True)


@pytest.mark.parametrize("said", [True, False, None])
def test_a_daq_is_simulated_or_not_by_its_own_property_and_open_where_its_server_does_not_know_it(
    world: StandInWorld, monkeypatch: pytest.MonkeyPatch, said: bool | None
) -> None:
    """NI's property is DAQmx_Dev_IsSimulated, 0x22CA in NIDAQmx.h, whatever device answers."""
    import grpc
    from nidaqmx._stubs import nidaqmx_pb2 as wire

    from drivers.simulators import daq_rpcs as server

    asked: list[int] = []

    def answer(_service: object, request: object, context: grpc.ServicerContext) -> object:
        asked.append(request.attribute_raw)  # type: ignore[attr-defined]
        if said is None:
            return context.abort(grpc.StatusCode.UNIMPLEMENTED, "")
        return wire.GetDeviceAttributeBoolResponse(value=said)

    monkeypatch.setattr(server._Service, "GetDeviceAttributeBool", answer)
    assert ask_nidaq(world).is_simulated is said
    assert 0x22CA in asked


def test_the_simulated_and_another_qtm_are_identified_by_their_version_unless_they_refuse_the_question() -> None:
    with simulator() as qtm, opened(driver(qtm.port)) as device:
        assert device.identity.is_simulated is True
        assert device.identity.text.startswith("QTM Version is ")
    with OtherQtm(proper) as qtm, opened(driver(qtm.port)) as device:
        assert device.identity == DeviceIdentity(device.name, "QTM Version is 2.17 (build 3900)", False)
    refusal = packet(0, b"Parse error\0")
    with (
        OtherQtm(lambda command: refusal if command == b"qtmversion" else proper(command)) as qtm,
        opened(driver(qtm.port)) as device,
    ):
        assert device.identity == DeviceIdentity(device.name, "", None)


def test_a_serial_line_has_no_identity_and_its_usb_adapter_has_one(
    world: StandInWorld, monkeypatch: pytest.MonkeyPatch
) -> None:
    indicator = SerialLoadCellSimulator(world)
    indicator.start()
    device = SerialLoadCell(port=indicator.url, baud_rate=9600, line_format="usb220", host_clock=world.utc_ns)
    try:
        device.open()
        assert device.identity == DeviceIdentity(device.name, "", None)
        device.close()
        adapter = SimpleNamespace(
            device=indicator.url, vid=0x0403, manufacturer="FUTEK", product="USB220", serial_number="812345"
        )
        monkeypatch.setattr(list_ports, "comports", lambda: [adapter])
        device.open()
        assert device.identity == DeviceIdentity(device.name, "FUTEK USB220 serial number 812345", False)
    finally:
        device.close()
        indicator.stop()
        world.clock.stop()

"""The driver, through unmodified pyserial, against the simulated indicator, a bare socket and a pseudo-terminal."""

import os
import socket
import sys
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import DeviceCode
from drivers.serial_load_cell import LineFormat, SerialLoadCell, decode_usb220, decode_usb520
from drivers.simulators.load_cell_port import SerialLoadCellSimulator, encode_usb220, encode_usb520
from drivers.simulators.settings import SerialLineSettings
from recordings.samples import Item, Loss
from tests.drivers.contract import Bench, DeviceContract, blocks, raises_refusal, read_until
from tests.drivers.stand_in_world import StandInWorld

GOOD = b"+000001.5000  lbs\r\n"


@pytest.fixture
def world() -> Iterator[StandInWorld]:
    world = StandInWorld()
    yield world
    world.clock.stop()


@pytest.fixture
def indicator(world: StandInWorld) -> Iterator[SerialLoadCellSimulator]:
    indicator = SerialLoadCellSimulator(world)
    indicator.start()
    world.clock.follow(indicator)
    yield indicator
    indicator.stop()


@pytest.fixture
def listener() -> Iterator[socket.socket]:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        yield listener


def driver(port: str, line_format: LineFormat = "usb220") -> SerialLoadCell:
    ticks = iter(range(10**9))
    return SerialLoadCell(port=port, baud_rate=9600, line_format=line_format, host_clock=lambda: next(ticks))


def url(listener: socket.socket) -> str:
    return f"socket://127.0.0.1:{listener.getsockname()[1]}"


def delivered(listener: socket.socket, sent: bytes, lines: int) -> list[Item]:
    """What the driver makes of these bytes, until it has accounted for so many lines."""
    device = driver(url(listener))
    device.open()
    wire, _ = listener.accept()
    with wire:
        wire.sendall(sent)
        items = read_until(device, lambda items: _accounted(items) >= lines)
    device.close()
    return items


def _accounted(items: list[Item]) -> int:
    lost = sum(item.count for item in items if isinstance(item, Loss))
    return lost + sum(block.sample_numbers.size for block in blocks(items, "/force"))


class TestSerialLoadCellKeepsTheContract(DeviceContract):
    @pytest.fixture
    def bench(self, indicator: SerialLoadCellSimulator, listener: socket.socket) -> Bench:
        return Bench(
            device=lambda: driver(indicator.url),
            quiet_device=lambda: driver(url(listener)),
            unreachable_device=lambda: driver("socket://127.0.0.1:9"),
            lose=indicator.stop,
        )


def test_a_usb220_line_is_pounds_force_a_usb520_line_grams_force_and_a_garbled_one_no_number() -> None:
    assert decode_usb220(b"-00012.34560  lbs\r\n") == -12.3456
    assert len(encode_usb220(100.0)) == 18
    assert decode_usb220(encode_usb220(-100.0)) == pytest.approx(-22.4809, abs=1e-4)
    assert decode_usb520(b" 123.5 g\r\n") == 123.5
    assert decode_usb520(encode_usb520(9.80665)) == 1000.0
    garbled = (b"", b"\r\n", b"+1.2\r\n", b"+1.2 kg\r\n", b"++1.2 lbs\r\n", b"1.2.3 g\r\n", b"\xff\xfe\n")
    for line in (*garbled, b"+" + 200 * b"9" + b".0 lbs\r\n"):
        assert decode_usb220(line) is decode_usb520(line) is None, line


@given(st.binary(max_size=64))
def test_no_bytes_upset_the_decoders(line: bytes) -> None:
    assert isinstance(decode_usb220(line), float | None)
    assert isinstance(decode_usb520(line), float | None)


@pytest.mark.parametrize(("line_format", "unit", "value"), [("usb220", "lbf", 22.4809), ("usb520", "g", 10197.16)])
def test_the_world_s_force_arrives_in_the_unit_of_the_line(
    world: StandInWorld, line_format: LineFormat, unit: str, value: float
) -> None:
    indicator = SerialLoadCellSimulator(world, line=SerialLineSettings(line_format=line_format))
    indicator.start()
    world.clock.follow(indicator)
    device = driver(indicator.url, line_format)
    device.open()
    items = read_until(device, lambda items: bool(blocks(items, "/force")))
    device.close()
    indicator.stop()
    assert device.streams[0].unit == unit
    assert blocks(items, "/force")[0].values[0, 0] == pytest.approx(value, rel=1e-6)


def test_the_line_under_way_when_the_port_opens_is_not_counted(listener: socket.socket) -> None:
    items = delivered(listener, b".2500  lbs\r\n" + 2 * GOOD, lines=2)
    assert _accounted(items) == 2
    for block in blocks(items, "/force"):
        assert all(block.device_time_ns == block.host_time_ns), "the time of its arrival"
    assert not any(isinstance(item, Loss) for item in items)


def test_garbled_lines_are_a_loss_and_keep_their_numbers(listener: socket.socket) -> None:
    items = delivered(listener, 2 * GOOD + b"+00\x80rubbish\r\n+1 lbs\r\n" + GOOD, lines=4)
    numbers = [int(number) for block in blocks(items, "/force") for number in block.sample_numbers]
    losses = [item for item in items if isinstance(item, Loss)]
    assert numbers == [0, 3]
    assert sum(loss.count for loss in losses) == 2
    assert {loss.cause for loss in losses} == {"garbled"}
    assert losses[0].first_missing == 1


def test_endless_rubbish_without_a_line_is_a_loss_and_takes_no_memory(listener: socket.socket) -> None:
    items = delivered(listener, GOOD + 2000 * b"x", lines=2)
    assert any(isinstance(item, Loss) and item.cause == "garbled" for item in items)


def test_a_port_that_does_not_exist_is_refused_with_its_name() -> None:
    with raises_refusal(DeviceCode.NOT_FOUND, naming="/dev/none"):
        driver("/dev/none").open()


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")
def test_it_reads_a_terminal_and_notices_when_it_is_unplugged() -> None:
    instrument, terminal = os.openpty()
    device = driver(os.ttyname(terminal))
    device.open()
    os.write(instrument, 3 * GOOD)
    items = read_until(device, lambda items: _accounted(items) == 2)
    os.close(instrument)
    with raises_refusal(DeviceCode.DISCONNECTED):
        read_until(device, lambda _: False)
    device.close()
    os.close(terminal)
    assert blocks(items, "/force")[0].values[0, 0] == 1.5

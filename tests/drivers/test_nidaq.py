"""The driver, through unmodified nidaqmx, against the simulated server."""

import contextlib
import time
from collections.abc import Iterator
from typing import Any

import grpc
import numpy as np
import pytest

from drivers import nidaq
from drivers.device import Device, Resumable
from drivers.errors import DeviceCode, DeviceError, DeviceLost
from drivers.nidaq import AnalogInput, NiDaq
from drivers.simulators.daq_rpcs import NiDaqSimulator
from drivers.simulators.faults import Fault
from drivers.simulators.settings import EmgWire
from recordings.samples import Loss
from tests.drivers.contract import Bench, DeviceContract, blocks, is_one_sentence, raises_refusal, read_until
from tests.drivers.simulated_qtm import EXACT_CLOCK, SYNC, WIRING, daq, joined, opened
from tests.drivers.stand_in_world import StandInWorld


@pytest.fixture
def world() -> Iterator[StandInWorld]:
    world = StandInWorld()
    yield world
    world.clock.stop()


@contextlib.contextmanager
def standing() -> Iterator[tuple[StandInWorld, NiDaqSimulator]]:
    """A world whose time moves by advance() only."""
    world = StandInWorld(is_standing=True)
    server = NiDaqSimulator(world, clock=EXACT_CLOCK)
    server.start()
    yield world, server
    server.stop()


def driver(server: NiDaqSimulator, world: StandInWorld, **options: Any) -> NiDaq:
    return daq(server.port, world.utc_ns, **options)


def refusal(device: Device) -> DeviceError:
    with pytest.raises(DeviceError) as caught, opened(device):
        pass
    assert is_one_sentence(caught.value)
    return caught.value


class TestNiDaqKeepsTheContract(DeviceContract):
    @pytest.fixture
    def bench(self, server: NiDaqSimulator, world: StandInWorld, monkeypatch: pytest.MonkeyPatch) -> Bench:
        def unreachable() -> NiDaq:
            monkeypatch.setattr(nidaq, "CONNECT_TIMEOUT_S", 0.5)
            return driver(server, world, grpc_target="127.0.0.1:9")

        return Bench(
            device=lambda: driver(server, world),
            quiet_device=lambda: driver(server, world, start="pfi0"),
            unreachable_device=unreachable,
            lose=server.stop,
        )


@pytest.mark.hardware
class TestTheBenchKeepsTheContract(DeviceContract):
    """Dev1 at the local driver, ai0 and ai1 connected, nothing on PFI0."""

    @pytest.fixture
    def bench(self) -> Bench:
        def device(name: str = "Dev1", **options: Any) -> NiDaq:
            return NiDaq(host_clock=time.time_ns, **{**WIRING, "device": name, **options})

        return Bench(device, lambda: device(start="pfi0"), lambda: device("NoSuchDevice"), lose=None)


def test_further_inputs_are_columns_of_their_stream_with_the_numbers_of_force(world: StandInWorld) -> None:
    wires = {"deltoid": EmgWire(input="ai2"), "trapezius": EmgWire(input="ai3")}
    server = NiDaqSimulator(world, clock=EXACT_CLOCK, emg=wires)
    server.start()
    inputs = [AnalogInput("/emg", "trapezius", "ai3", 5.0), AnalogInput("/emg", "deltoid", "ai2", 5.0)]
    with opened(driver(server, world, inputs=(SYNC, *inputs))) as device:
        items = read_until(device, lambda items: len(blocks(items, "/emg")) >= 2)
    server.stop()
    sync, emg = device.streams
    assert (sync.labels, emg.labels, emg.unit) == (("sync",), ("trapezius", "deltoid"), "V")
    assert "Dev1/ai3, ai2" in emg.source
    values = np.concatenate([block.values for block in blocks(items, "/emg")])
    np.testing.assert_allclose(values, np.tile([2.0, 1.0], (len(values), 1)), atol=0.01)
    for one, other in zip(blocks(items, "/sync"), blocks(items, "/emg"), strict=True):
        np.testing.assert_array_equal(one.sample_numbers, other.sample_numbers)


def test_force_and_sync_come_from_one_task_at_the_volts_of_the_world(
    server: NiDaqSimulator, world: StandInWorld
) -> None:
    world.edge_s = world.now() + 30
    with opened(driver(server, world)) as device:
        items = read_until(device, lambda items: sum(b.sample_numbers.size for b in blocks(items, "/sync")) > 60_000)
        one, other = device.streams
    assert (one.name, other.name, one.unit, other.unit) == ("/force", "/sync", "V", "V")
    assert one.source == f"NI USB-6008 Dev1/ai0 at {server.target}"
    assert other.serial_number == "01C0FFEE"
    force_numbers = np.concatenate([block.sample_numbers for block in blocks(items, "/force")])
    assert np.array_equal(force_numbers, np.arange(force_numbers.size))
    for force, sync in zip(blocks(items, "/force"), blocks(items, "/sync"), strict=True):
        assert np.array_equal(force.sample_numbers, sync.sample_numbers)
        assert force.host_time_ns == sync.host_time_ns
    device_s, force_v = joined(items, "/force")
    sync_v = joined(items, "/sync")[1]
    edge = int(np.argmax(sync_v > 2.5))
    # Over device time the world's ramp rises by 10 mV/s, and at the edge it stands where the world's time says.
    slope, at_edge = np.polyfit(device_s - device_s[edge], force_v[:, 0], 1)
    assert slope == pytest.approx(0.01, rel=1e-3)
    assert at_edge == pytest.approx(1 + 0.01 * world.edge_s, abs=1e-3)
    assert set(np.round(sync_v[:, 0])) == {0.0, 5.0}


def test_a_sync_line_alone_may_take_the_whole_rate(server: NiDaqSimulator, world: StandInWorld) -> None:
    with opened(driver(server, world, inputs=(SYNC,), sample_rate_hz=10_000)) as device:
        items = read_until(device, lambda items: bool(blocks(items, "/sync")))
        assert [stream.name for stream in device.streams] == ["/sync"]
    assert not blocks(items, "/force")


def test_pfi0_starts_the_samples_at_the_edge(server: NiDaqSimulator, world: StandInWorld) -> None:
    with opened(driver(server, world, start="pfi0")) as device:
        assert device.read(0.02) == []
        world.edge_s = world.now() + 5
        items = read_until(device, lambda items: len(blocks(items, "/sync")) > 2)
    first = blocks(items, "/sync")[0]
    assert first.sample_numbers[0] == 0
    assert joined(items, "/sync")[1].min() > 4.9


def test_an_overrun_is_a_loss_of_known_length_and_the_stream_continues() -> None:
    with standing() as (world, server), opened(driver(server, world)) as device:
        world.advance(0.1)
        last = blocks(device.read(0.1), "/force")[0]
        world.advance(700)
        losses = [item for item in device.read(0.1) if isinstance(item, Loss)]
        world.advance(0.1)
        following = blocks(device.read(0.1), "/force")[0]
    assert [(loss.stream, loss.cause) for loss in losses] == [("/force", "overrun"), ("/sync", "overrun")]
    assert losses[0].first_missing == last.sample_numbers[-1] + 1
    assert losses[0].first_missing + losses[0].count == following.sample_numbers[0]
    assert losses[0].last_device_time_ns == last.device_time_ns[-1]
    # The numbers still tell the time, to a sample: 700 s lie between them, in which the ramp rose by 7 V.
    assert following.device_time_ns[0] - last.device_time_ns[-1] == pytest.approx(700e9, abs=2e6)
    assert following.values[0, 0] - last.values[-1, 0] == pytest.approx(7.0, abs=0.02)


def test_after_an_overrun_a_pfi0_task_does_not_wait_for_another_edge(
    server: NiDaqSimulator, world: StandInWorld
) -> None:
    with opened(driver(server, world, start="pfi0")) as device:
        world.edge_s = world.now() + 5
        read_until(device, lambda items: bool(blocks(items, "/force")))
        world.advance(700)
        after = read_until(device, lambda items: len(blocks(items, "/force")) > 1)
    assert any(isinstance(item, Loss) for item in after)


@pytest.mark.parametrize("fault", ["unplug", "transfer_aborted"])
def test_a_device_that_is_plugged_in_again_continues_with_numbers_that_match_the_time(fault: str) -> None:
    with standing() as (world, server), opened(driver(server, world)) as device:
        assert isinstance(device, Resumable)
        world.advance(0.1)
        last = blocks(device.read(0.1), "/force")[0]
        world.faults.inject(Fault("ni", fault, at_s=1.0, for_s=20.0))
        world.advance(2.0)
        with raises_refusal(DeviceCode.DISCONNECTED):
            device.read(0.1)
        with pytest.raises(DeviceError):
            device.resume()
        world.advance(20.0)
        device.resume()
        world.advance(0.1)
        following = blocks(device.read(0.1), "/force")[0]
    assert following.sample_numbers[0] - last.sample_numbers[-1] == pytest.approx(22_000, abs=2)
    assert following.device_time_ns[0] - last.device_time_ns[-1] == pytest.approx(22e9, abs=2e6)
    assert following.values[0, 0] - last.values[-1, 0] == pytest.approx(0.22, abs=0.02)  # the ramp rose by as much


def test_a_pfi0_task_that_is_resumed_waits_for_no_other_edge(server: NiDaqSimulator, world: StandInWorld) -> None:
    with opened(driver(server, world, start="pfi0")) as device:
        assert isinstance(device, Resumable)
        device.resume()  # nothing has come yet: the edge is still waited for
        assert device.read(0.02) == []
        world.edge_s = world.now() + 5
        read_until(device, lambda items: bool(blocks(items, "/force")))
        device.resume()
        assert read_until(device, lambda items: bool(blocks(items, "/force")))


@pytest.mark.parametrize(
    ("fault", "settings", "code", "naming"),
    [
        ("refuse", {}, DeviceCode.IN_USE, ("-50103",)),
        ("transfer_aborted", {}, DeviceCode.NO_TRANSFER, ("-50405",)),
        (None, {"sample_rate_hz": 6000}, DeviceCode.REFUSED, ("6000 Hz", "5000")),
        (None, {"device": "Dev7"}, DeviceCode.NOT_FOUND, ("NI Dev7", "daq.device")),
        (None, {"inputs": (AnalogInput("/force", "force", "ai9"), SYNC)}, DeviceCode.NO_CHANNEL, ("ai9",)),
    ],
    ids=["reserved by another program", "to be unplugged", "rate", "device", "channel"],
)
def test_a_device_that_cannot_be_opened_is_refused_with_its_cause(
    server: NiDaqSimulator,
    world: StandInWorld,
    fault: str | None,
    settings: dict[str, Any],
    code: DeviceCode,
    naming: tuple[str, ...],
) -> None:
    if fault:
        world.faults.inject(Fault("ni", fault, at_s=0.0, for_s=1e6))
    error = refusal(driver(server, world, **settings))
    assert error.code is code
    assert all(text in str(error) for text in naming)


def test_a_server_that_freezes_is_lost_and_closing_does_not_hang(server: NiDaqSimulator, world: StandInWorld) -> None:
    device = driver(server, world)
    device.open()
    device._opened.deadline_s = 0.5
    world.flows.clear()
    with pytest.raises(DeviceLost) as caught:
        read_until(device, lambda _: False)
    device.close()
    assert is_one_sentence(caught.value)


def test_a_server_that_cannot_tell_what_is_there_is_asked_for_what_is_due_so_that_no_backlog_stays(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("drivers.simulators.daq_rpcs._Service.GetReadAttributeUInt32", _unimplemented)
    with standing() as (world, server), opened(driver(server, world)) as device:
        world.advance(0.05)
        first = blocks(device.read(0.1), "/force")[0]
        world.advance(5.0)
        backlog = blocks(device.read(0.1), "/force")[0]
    assert first.sample_numbers.size == 50
    assert backlog.sample_numbers[0] == 50
    assert backlog.sample_numbers.size == pytest.approx(5000, abs=2)


def _unimplemented(_service: Any, _request: Any, context: grpc.ServicerContext) -> None:
    context.abort(grpc.StatusCode.UNIMPLEMENTED, "")


def test_without_the_driver_the_message_names_what_to_install(server: NiDaqSimulator, world: StandInWorld) -> None:
    import nidaqmx

    with contextlib.suppress(nidaqmx.errors.DaqNotFoundError):
        nidaqmx.system.System.local().driver_version  # noqa: B018
        pytest.skip("this computer has NI-DAQmx")
    assert refusal(driver(server, world, grpc_target=None)).code is DeviceCode.NO_DRIVER

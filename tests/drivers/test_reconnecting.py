"""A device that is lost and comes back, with clocks that stand still; faults of the simulated devices."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from importlib import import_module
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from drivers import nidaq, qualisys
from drivers.errors import DeviceCode, DeviceLost, DeviceUnavailable
from drivers.reconnecting import CATALOGUE, Reconnecting, make_device
from drivers.simulators.faults import FAULTS
from recordings.samples import Event, Item, Loss, Samples, Stream
from tests.drivers.contract import raises_refusal
from tests.drivers.fault_bench import CASES, STREAMS, Case, FaultBench, random_faults, unaccounted

Step = Sequence[Item] | Exception
GONE = DeviceLost("the device is gone; plug it in")
SOON_S = 3.0  # wall; a third of what the world takes at its pace until a device is lost for good


def scripted(reads: Sequence[Step], resumes: Sequence[Exception | None] = ()) -> Mock:
    """Delivers or raises what its script says, read by read; resume() has a script of its own."""
    streams = (Stream("/force", "V", ("force",), 10.0, "the device"),)
    device = Mock(spec=["name", "streams", "open", "close", "read", "resume"], streams=streams)
    device.read.side_effect, device.resume.side_effect = reads, resumes
    device.name = "the device"
    return device


class StandingClock:
    """Wall clock that advances only by sleep()."""

    def __init__(self) -> None:
        self.wall_s = 0.0

    def sleep(self, seconds: float) -> None:
        self.wall_s += seconds


def samples(first: int, count: int = 2, stream: str = "/force") -> Samples:
    numbers = np.arange(first, first + count, dtype=np.uint64)
    return Samples(stream, numbers, numbers.astype(np.int64) * 100, 7, np.zeros((count, 1)))


def opened(device: Mock, timeout_s: float = 10.0, clock: StandingClock | None = None) -> Reconnecting:
    clock = clock or StandingClock()
    reconnecting = Reconnecting(device, lambda: 42, timeout_s, lambda: clock.wall_s, clock.sleep)
    reconnecting.open()
    return reconnecting


def delivered(device: Reconnecting, reads: int) -> list[Item]:
    return [item for _ in range(reads) for item in device.read(10.0)]


def test_a_loss_is_reported_at_once_and_the_return_too_with_one_gap_between_them() -> None:
    device = opened(scripted([[samples(0)], GONE, [], [samples(9)]], [None]))
    _, lost, back, gap, after = delivered(device, 4)
    assert isinstance(lost, Event)
    assert isinstance(back, Event)
    assert (lost.kind, lost.host_time_ns) == ("connection_lost", 42)
    assert lost.text.startswith(str(GONE))
    assert (back.kind, back.host_time_ns) == ("connection_restored", 42)
    assert "0.1 s" in back.text
    assert gap == Loss("/force", "disconnected", 2, 7, last_device_time_ns=100, host_time_ns=7)
    assert isinstance(after, Samples)


OVERRUN = Loss("/force", "overrun", 5, 3, 400, 7)
LATER = [samples(5), samples(4, stream="/sync")]


@pytest.mark.parametrize(
    ("reads", "is_anew", "losses"),
    [
        ([[samples(0)], GONE, [samples(2)]], False, []),
        ([[samples(10)], GONE, [samples(1)]], True, []),
        (
            [[samples(0)], GONE, [OVERRUN, samples(8)]],
            False,
            [("/force", "disconnected", 2, 3), ("/force", "overrun", 5, 3)],
        ),
        (
            [[samples(0), samples(0, stream="/sync")], GONE, LATER, [samples(7), samples(6, stream="/sync")]],
            False,
            [("/force", "disconnected", 2, 3), ("/sync", "disconnected", 2, 2)],
        ),
    ],
    ids=["nothing missed", "numbers that restart", "counted by the device itself", "two streams"],
)
def test_every_interrupted_stream_gets_its_own_gap_once(
    reads: Sequence[Step], is_anew: bool, losses: list[tuple[str, str, int, int]]
) -> None:
    items = delivered(opened(scripted(reads, [None])), len(reads))
    found = [(item.stream, item.cause, item.first_missing, item.count) for item in items if isinstance(item, Loss)]
    assert found == losses
    kinds = [item.kind for item in items if isinstance(item, Event)]
    assert kinds == ["connection_lost", "connection_restored", *["numbering_restarted"] * is_anew]


def test_attempts_come_at_growing_intervals_until_patience_is_over() -> None:
    clock, attempts_s = StandingClock(), [0.0]

    def refuse() -> None:
        attempts_s.append(clock.wall_s)
        raise DeviceUnavailable("nothing there")

    device = scripted([[samples(0)], GONE])
    device.resume.side_effect = refuse
    with pytest.raises(DeviceLost) as caught:
        delivered(opened(device, 6.0, clock), 30)
    assert caught.value.code is DeviceCode.NOT_RECONNECTED
    assert np.diff(attempts_s) == pytest.approx([0.1, 0.2, 0.4, *[0.5] * 11])


def test_between_attempts_reading_returns_within_its_time_out() -> None:
    device = opened(scripted([GONE], []))
    assert [len(device.read(0.02)) for _ in range(4)] == [1, 0, 0, 0]


def test_a_device_that_is_lost_again_at_once_or_was_closed_is_not_reconnected() -> None:
    device = opened(scripted([[samples(0)], GONE, GONE, GONE, [samples(4)]], [None, None, None]))
    kinds = [item.kind for item in delivered(device, 5) if isinstance(item, Event)]
    assert kinds == ["connection_lost", "connection_restored"]
    device = opened(scripted([GONE]))
    device.close()
    with pytest.raises(DeviceLost) as caught:
        device.read(0.0)
    assert caught.value is GONE


@pytest.mark.parametrize("source", sorted(CATALOGUE))
def test_every_entry_leads_to_a_class_that_can_open_read_and_close(source: str) -> None:
    module, name = CATALOGUE[source].split(":")
    device_class = getattr(import_module(module), name)
    assert all(callable(getattr(device_class, verb)) for verb in ("open", "resume", "read", "close"))
    assert isinstance(device_class.name, property)
    assert isinstance(device_class.streams, property)


def test_a_device_is_made_with_its_options_and_not_opened_and_an_unknown_source_is_refused() -> None:
    device = make_device("serial_load_cell", port="COM3", baud_rate=9600, line_format="usb220", host_clock=lambda: 0)
    assert device.name == "load cell on COM3"
    assert device.streams == ()
    with raises_refusal(DeviceCode.UNKNOWN_DRIVER, naming="labjack"):
        make_device("labjack", host_clock=lambda: 0)


@pytest.fixture(scope="module")
def bench() -> Iterator[FaultBench]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(nidaq, "LONGEST_WAIT_S", 0.3)
        with FaultBench() as bench:
            yield bench


@pytest.mark.parametrize(
    "case",
    [pytest.param(case, marks=[pytest.mark.slow] * (case.wall_s > 1.0)) for case in CASES],
    ids=lambda case: case.name,
)
def test_a_fault_is_reported_and_counted_and_ends_and_affects_nothing_else(bench: FaultBench, case: Case) -> None:
    with impatient(bench) if case.fault in ("freeze", "silent") else nullcontext():
        aftermath = bench.suffer(case)
    causes = {item.cause for item in aftermath[case.device] if isinstance(item, Loss)}
    assert causes == case.causes
    for device, streams in STREAMS.items():
        items = aftermath[device]
        for stream in streams:
            assert unaccounted(items, stream) == []
            assert_device_time_goes_forward(items, stream)
        if device != case.device:
            assert [item for item in items if isinstance(item, Loss | Event)] == [], f"{device} suffered, too"
    if case.device == "qtm":
        assert_markers_are_where_they_belong(aftermath["qtm"], bench)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_under_random_faults_every_numbered_sample_was_received_or_counted_as_lost(
    bench: FaultBench, seed: int
) -> None:
    before = {name: len(listener.heard) for name, listener in bench.listeners.items()}
    with impatient(bench):
        bench.suffer_all(random_faults(seed, 20))
    for device, streams in STREAMS.items():
        items = bench.listeners[device].heard[before[device] :]
        for stream in streams:
            assert unaccounted(items, stream) == []
            assert any(isinstance(item, Loss) and item.stream == stream for item in items)


@contextmanager
def impatient(bench: FaultBench) -> Iterator[None]:
    """A device that does not answer soon is lost, or asked again, within this context."""
    ni: Any = bench.listeners["ni"].device
    qtm: Any = bench.listeners["qtm"].device
    try:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(ni.device._opened, "deadline_s", SOON_S)
            for name in ("CONNECT_TIMEOUT_S", "COMMAND_TIMEOUT_S"):
                patch.setattr(qualisys, name, SOON_S)
            qtm.device._connection._connection._timeout = SOON_S
            yield
    finally:  # the connection may be another one by now, and there is none if the device was lost for good
        if connection := qtm.device._connection:
            connection._connection._timeout = qualisys.COMMAND_TIMEOUT_S


def test_every_fault_of_a_device_has_its_case() -> None:
    assert {(case.device, case.fault) for case in CASES} == {
        (device, fault) for device in STREAMS for fault in FAULTS[device]
    }


def assert_device_time_goes_forward(items: list[Item], stream: str) -> None:
    latest = -1
    for item in items:
        if isinstance(item, Event) and item.kind in ("numbering_restarted", "capture_replaced"):
            latest = -1
        if isinstance(item, Samples) and item.stream == stream:
            assert np.all(np.diff(item.device_time_ns, prepend=latest) >= 0)
            latest = int(item.device_time_ns[-1])


def assert_markers_are_where_they_belong(items: list[Item], bench: FaultBench) -> None:
    """A marker is missing or at its own place: whatever was on the wire, nothing else is delivered as one."""
    now = np.array([bench.world.now()])
    places = bench.world.markers(now)[0]
    for item in items:
        if isinstance(item, Samples):
            away = np.linalg.norm(item.values[:, :, :3] - places, axis=2)
            assert np.all((away < 30.0) | np.isnan(away))

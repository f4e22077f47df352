"""A feed and its ledger: the file accounts for every sample that a device numbered."""

import json
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import pytest

import station.bench.feed
from drivers.errors import DeviceLost, DeviceUnavailable
from drivers.simulators.simulated_bench import Bench
from recordings.contents import read_contents
from recordings.reader import open_recording
from recordings.samples import DeviceIdentity, Event, Item, Samples, Stream
from station.bench.bench_clock import BenchClock
from station.bench.feed import (
    ROUND_TIMEOUT_S,
    DeviceFailed,
    DeviceFeed,
    DeviceOpened,
    FeedQueue,
    ItemsReceived,
    SteppedFeed,
)
from station.bench.trial_recorder import TrialRecorder, TrialResult
from station.files.info import show_contents
from station.messages.bench_messages import TrialCode
from station.protocol import TrialSpec
from tests.station.session.benched import config_at
from tests.timeout import scaled_timeout

MakeBench = Callable[..., Bench]
FAULTS = [
    {"device": "ni", "fault": "overrun", "at_s": 3.0},
    {"device": "qtm", "fault": "skip_frames", "at_s": 4.0, "for_s": 0.3},
    {"device": "qtm", "fault": "no_more_data", "at_s": 6.0, "for_s": 0.5},
    {"device": "ni", "fault": "unplug", "at_s": 9.0, "for_s": 4.0},
    {"device": "qtm", "fault": "restart", "at_s": 16.0, "for_s": 4.0},
    {"device": "ni", "fault": "transfer_aborted", "at_s": 24.0, "for_s": 2.0},
    {"device": "qtm", "fault": "half_packet", "at_s": 30.0},
]


def test_every_lost_sample_is_counted_under_many_faults(
    simulated_bench: MakeBench, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bench = simulated_bench(faults=FAULTS, protocol={"static": {"hold_s": 3.5}})
    result = recorded(bench, tmp_path)
    assert result.path is not None
    contents = read_contents(result.path)
    causes = {(gap.stream, gap.cause) for gap in contents.gaps}
    assert causes >= {("/force", "overrun"), ("/force", "disconnected"), ("/markers", "skipped")}
    assert not {cause for _, cause in causes} & {"unexplained", "numbers_went_back", "file_damage"}
    for name, stream in contents.streams.items():
        numbered = stream.last_sample_number - stream.first_sample_number + 1
        assert stream.samples + contents.lost(name) == numbered
    assert result.lost_samples == sum(contents.lost(name) for name in contents.streams)
    capsys.readouterr()
    assert show_contents(result.path, as_json=True) == 3
    found = json.loads(capsys.readouterr().out)
    assert {"connection_lost", "connection_restored", "no_more_data"} <= {event["kind"] for event in found["events"]}


@pytest.mark.parametrize(
    ("device", "fault", "missing", "rate_hz"),
    [("ni", "unplug", ("/force", "/sync"), 1000.0), ("qtm", "restart", ("/markers",), 100.0)],
)
def test_the_samples_of_a_lost_device_are_counted_up_to_the_end_of_the_trial(
    simulated_bench: MakeBench,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    device: str,
    fault: str,
    missing: tuple[str, ...],
    rate_hz: float,
) -> None:
    bench = simulated_bench(
        faults=[{"device": device, "fault": fault, "at_s": 6.0, "for_s": 1e6}], protocol={"static": {"hold_s": 60.0}}
    )
    result = recorded(bench, tmp_path)
    assert result.path is not None and not result.accepted
    assert [message.code for message in result.messages] == [TrialCode.DEVICE_LOST]
    contents = read_contents(result.path)
    items = list(open_recording(result.path).items())
    end_ns = next(item.host_time_ns for item in items if isinstance(item, Event) and item.kind == "device_lost")
    for stream in missing:
        last_ns = max(item.host_time_ns for item in items if isinstance(item, Samples) and item.stream == stream)
        assert (end_ns - last_ns) * 1e-9 > 10.0
        assert contents.lost(stream) == pytest.approx((end_ns - last_ns) * 1e-9 * rate_hz, rel=0.05)
    assert result.lost_samples == sum(contents.lost(stream) for stream in missing)
    assert show_contents(result.path, as_json=True) == 3
    found = {gap["stream"]: gap["count"] for gap in json.loads(capsys.readouterr().out)["gaps"]}
    assert found == {stream: contents.lost(stream) for stream in missing}


def recorded(bench: Bench, folder: Path) -> TrialResult:
    with BenchClock(bench.ports["clock"]) as clock:
        return TrialRecorder(config_at(bench.ports), clock).record(folder, TrialSpec("waist", "static", 1))


class Scripted:
    """A device that returns what the script says, one entry a read; an exception is raised."""

    name = "scripted"
    streams: tuple[Stream, ...] = ()
    identity = DeviceIdentity("scripted", "", None)

    def __init__(self, script: Sequence[Sequence[Item] | Exception], refuses: Exception | None = None) -> None:
        self._script, self._refuses = list(script), refuses
        self.closed = threading.Event()
        self.requests: list[str] = []

    def open(self) -> None:
        if self._refuses:
            raise self._refuses

    def read(self, timeout_s: float) -> Sequence[Item]:
        if not self._script:
            self.closed.wait(0.01)
            return []
        step = self._script.pop(0)
        if isinstance(step, Exception):
            raise step
        return step

    def start_capture(self) -> None:
        self.requests.append("start")

    def stop_capture(self) -> None:
        self.requests.append("stop")

    def close(self) -> None:
        self.closed.set()


def patience_s() -> float:
    """Bound on the wait for a message, which comes at once on an idle machine."""
    return scaled_timeout(30.0)


@contextmanager
def started(device: Scripted) -> Iterator[tuple[DeviceFeed, FeedQueue]]:
    """The feed of a device, which ends at last and closes it."""
    inbox = FeedQueue()
    feed = DeviceFeed(device, inbox)
    feed.start()
    yield feed, inbox
    feed.ask_to_stop()
    assert feed.has_ended(within_s=patience_s())
    assert device.closed.is_set()


def test_the_items_of_a_device_arrive_in_order() -> None:
    events = [Event(str(i), "", i, "x") for i in range(3)]
    with started(Scripted([[events[0]], [], events[1:]])) as (_, inbox):
        assert inbox.get(timeout=patience_s()) == DeviceOpened("scripted", (), Scripted.identity)
        assert inbox.get(timeout=patience_s()) == ItemsReceived("scripted", [events[0]])
        assert inbox.get(timeout=patience_s()) == ItemsReceived("scripted", events[1:])


@pytest.mark.parametrize(
    ("device", "cause"),
    [
        (Scripted([], refuses=DeviceUnavailable("no")), "no"),
        (Scripted([DeviceLost("gone")]), "gone"),
        (Scripted([ZeroDivisionError("oops")]), "ZeroDivisionError: oops"),
    ],
    ids=["not opened", "lost", "an error of its driver"],
)
def test_a_device_that_fails_is_reported_and_closed(device: Scripted, cause: str) -> None:
    with started(device) as (feed, inbox):
        message = inbox.get(timeout=patience_s())
        if isinstance(message, DeviceOpened):
            message = inbox.get(timeout=patience_s())
        assert isinstance(message, DeviceFailed) and cause in str(message.error)
        assert feed.has_ended(within_s=patience_s()), "without a request"


def test_capture_requests_are_done_by_the_device_s_own_thread_even_when_stopping() -> None:
    device = Scripted([])
    with started(device) as (feed, _):
        assert feed.can_control_capture
        feed.request_capture(start=True)
        feed.request_capture(start=False)
    assert device.requests == ["start", "stop"]


@pytest.mark.parametrize("is_read", [True, False])
def test_a_full_queue_pauses_the_device_without_a_loss_and_its_feed_ends(
    monkeypatch: pytest.MonkeyPatch, is_read: bool
) -> None:
    monkeypatch.setattr(station.bench.feed, "MOST_WAITING", 3)
    monkeypatch.setattr(station.bench.feed, "READ_TIMEOUT_S", 0.01)
    events = [Event(str(i), "", i, "x") for i in range(20)]
    device = Scripted([[event] for event in events])
    with started(device) as (_, inbox):
        while not inbox.full():
            device.closed.wait(0.001)
        assert len(device._script) >= 20 - 4
        taken = [inbox.get(timeout=patience_s()) for _ in range(21 * is_read)]
    assert [message.items[0] for message in taken if isinstance(message, ItemsReceived)] == events * is_read


def test_a_device_that_does_not_finish_a_round_no_longer_delays_later_rounds(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = [0.0]
    clock = SimpleNamespace(perf_counter=lambda: now_s[0], sleep=time.sleep)
    monkeypatch.setattr(station.bench.feed, "time", clock)
    device = Scripted([])
    monkeypatch.setattr(device, "read", lambda _: device.closed.wait() and [])  # it is frozen
    feed = SteppedFeed(device)
    feed.start()
    feed.begin_round({})
    assert not feed.is_round_over(0.0)
    now_s[0] = 1.01 * ROUND_TIMEOUT_S
    assert feed.is_round_over(0.0)
    feed.begin_round({})
    assert feed.is_round_over(0.0)
    device.closed.set()
    feed.ask_to_stop()
    assert feed.has_ended(within_s=patience_s())

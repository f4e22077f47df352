"""One trial from its devices to its file, and what ends it from outside."""

import os
import re
import shutil
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest
from rich.console import Console

from documents.message import Message
from drivers.device import Device
from drivers.errors import DeviceCode, DeviceUnavailable
from drivers.qualisys_wire import MarkerBlocks, MarkerFrame
from fitting.results.trial_codes import RejectionCode
from fitting.trial.trial import RejectedTrial, read_alone
from recordings import writer
from recordings.manifest import CuffSite
from recordings.reader import open_recording
from recordings.samples import Event, Item, Samples
from recordings.writer import BackgroundSync
from station.bench import feed, session_folder
from station.bench.live import LiveView
from station.bench.trial_recorder import TrialRecorder, TrialRefused, TrialResult
from station.bench.view import Snapshot, TrialState
from station.clock import Clock, ManualClock
from station.config import StationConfig, parse_config
from station.messages.bench_messages import RefusalCode, TrialCode
from station.protocol import TrialSpec
from station.verbs.bench import _exit_code, _stop_on_signals
from tests.refusals import raises_refusal
from tests.station.fake_devices import FakeCapture, FakeDaq, FakeMocap, view
from tests.timeout import scaled_timeout

SPEC = TrialSpec("hand", "static", 1)
CONFIG = parse_config(
    {
        "cuffs": {"hand": {"anchor_markers": ["anchor_1", "anchor_2", "anchor_3"], "cuff_markers": ["cuff_1"]}},
        "sync": {"timeout_s": 40},
    },
    "test",
)
ENDINGS = [signal.SIGINT, signal.SIGTERM] + ([] if sys.platform == "win32" else [signal.SIGHUP])


class Rig:
    """A recorder on fake devices; a capture of 6 s begins 20 s after they are made. `prepare` may spoil them."""

    def __init__(self, delay_s: float = 20.0, prepare: Callable[[FakeDaq], None] = lambda daq: None) -> None:
        self.clock = ManualClock()
        self._delay_s, self._prepare = delay_s, prepare
        self.made: list[Device] = []

    def devices(self, config: StationConfig, cuff: CuffSite | None, clock: Clock, folder: Path) -> list[Device]:
        capture = FakeCapture(clock, self._delay_s, 6.0)
        daq = FakeDaq(clock, capture)
        self._prepare(daq)
        self.made = [daq, FakeMocap(clock, capture)]
        return self.made

    def recorder(self, *views: object) -> TrialRecorder:
        return TrialRecorder(CONFIG, self.clock, views, make_devices=self.devices)  # type: ignore[arg-type]


def test_a_trial_is_recorded_from_before_the_edge_to_after_the_capture(tmp_path: Path) -> None:
    rig = Rig()
    result = rig.recorder().record(tmp_path, SPEC)
    assert result.accepted, result.sentence
    assert result.path == tmp_path / "cuff-hand_test-static_run-1.mcap"
    assert result.lost_samples == 0
    recording = open_recording(result.path)
    force, sync, markers = (recording.load(name) for name in ("/force", "/sync", "/markers"))
    edge = int((sync.values[:, 0] > 2.5).argmax())
    assert edge >= 2000, "two seconds from before the edge"
    assert len(markers.values) == 600
    assert (force.sample_numbers[1:] - force.sample_numbers[:-1] == 1).all()
    assert recording.manifest.cuff.anchor_markers == ("anchor_1", "anchor_2", "anchor_3")


def test_a_clock_set_back_between_two_trials_is_reported_and_keeps_their_order(tmp_path: Path) -> None:
    first = Rig().recorder().record(tmp_path, SPEC)
    assert first.path is not None and codes(first) == [TrialCode.CAPTURE_ENDED]
    an_hour_ahead_s = time.time() + 3600.0
    os.utime(first.path, (an_hour_ahead_s, an_hour_ahead_s))
    rig = Rig()
    rig.clock = ManualClock(ManualClock().utc_ns() - 3600 * 10**9)
    second = rig.recorder().record(tmp_path, SPEC)
    assert second.path == tmp_path / SPEC.file_name(2) and second.accepted
    assert codes(second) == [TrialCode.CAPTURE_ENDED, TrialCode.CLOCK_SET_BACK]
    recordings = [open_recording(path) for path in (first.path, second.path)]
    assert recordings[0].manifest.start_utc_ns < recordings[1].manifest.start_utc_ns
    assert "clock_set_back" in [event.kind for event in events_of(second.path)]


def test_no_edge_leaves_no_file(tmp_path: Path) -> None:
    result = Rig(delay_s=1000.0).recorder().record(tmp_path, SPEC)
    assert (result.path, result.accepted) == (None, False)
    assert codes(result) == [TrialCode.NO_SYNC_EDGE_LOW] and result.messages[0].figures["timeout_s"] == 40
    assert not list(tmp_path.glob("*.mcap"))


def test_the_operator_s_mark_is_in_the_file_and_a_stop_keeps_what_was_recorded(tmp_path: Path) -> None:
    def mark_and_stop(snapshot: Snapshot) -> None:
        if snapshot.state is TrialState.RECORDING and snapshot.recorded_s > 1.0 and not snapshot.marks:
            recorder.mark()
        if snapshot.marks and snapshot.recorded_s > 2.0:
            recorder.stop()

    recorder = Rig().recorder(view(mark_and_stop))
    result = recorder.record(tmp_path, SPEC)
    assert result.accepted and codes(result) == [TrialCode.OPERATOR_STOP] and result.path is not None
    assert [event.text for event in events_of(result.path) if event.kind == "mark"] == ["mark 1"]


def test_an_error_of_one_device_leaves_no_file_before_the_trial_and_a_readable_one_during_it(tmp_path: Path) -> None:
    unavailable = DeviceUnavailable("NI Fake1: no server answers at 127.0.0.1:1", DeviceCode.NO_SERVER)
    with raises_refusal(DeviceCode.NO_SERVER, kind=DeviceUnavailable):
        Rig(prepare=lambda daq: setattr(daq, "_fails", unavailable)).recorder().record(tmp_path, SPEC)
    assert not list(tmp_path.glob("*.mcap"))
    result = Rig(prepare=lambda daq: setattr(daq, "lost_after", 22_000)).recorder().record(tmp_path, SPEC)
    assert not result.accepted and result.path is not None
    assert codes(result) == [TrialCode.DEVICE_LOST]
    assert result.to_json()["codes"][0]["figures"]["reason_code"] == DeviceCode.LOST
    assert f"[{DeviceCode.LOST}]" in result.sentence
    assert len(open_recording(result.path).load("/force").values) > 3000


def test_a_frozen_device_is_detected_and_abandoned(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(feed, "ROUND_TIMEOUT_S", scaled_timeout(0.3))  # the other device answers within it

    def freeze(snapshot: Snapshot) -> None:
        if snapshot.recorded_s > 1.0:
            rig.made[0].hangs_on_read = True  # type: ignore[attr-defined]

    rig = Rig()
    recorder = rig.recorder(view(freeze))
    result = recorder.record(tmp_path, SPEC)
    assert not result.accepted and result.path is not None
    assert result.lost_samples > 0
    assert recorder.abandoned == ["NI Fake1"]


def test_a_file_as_the_session_and_a_full_disk_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    with raises_refusal(RefusalCode.FOLDER_NOT_MADE, kind=TrialRefused):
        Rig().recorder().record(tmp_path / "file", SPEC)
    monkeypatch.setattr(shutil, "disk_usage", lambda path: SimpleNamespace(free=5e6))
    with raises_refusal(RefusalCode.DISK_FULL, kind=TrialRefused):
        Rig().recorder().record(tmp_path, SPEC)


def test_a_disk_that_fills_ends_the_trial_before_it_is_full(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    free = 1e12
    monkeypatch.setattr(shutil, "disk_usage", lambda path: SimpleNamespace(free=free))
    monkeypatch.setattr(session_folder, "POLL_INTERVAL_S", 0.0)

    def fill(snapshot: Snapshot) -> None:
        nonlocal free
        if snapshot.recorded_s > 1.0:
            free = 1e6

    result = Rig().recorder(view(fill)).record(tmp_path, SPEC)
    assert not result.accepted and result.path is not None
    assert codes(result) == [TrialCode.DISK_NEARLY_FULL] and result.messages[0].figures["free_mb"] == 1.0
    recording = open_recording(result.path)
    assert recording.complete
    assert recording.outcome is not None and recording.outcome.sentence == result.sentence
    assert recording.outcome.codes == (TrialCode.DISK_NEARLY_FULL,)


@pytest.mark.skipif(sys.platform == "win32", reason="Windows sets no limit to the size of a file")
def test_a_file_that_may_not_grow_ends_the_trial_at_once_and_names_the_last_good_sample(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import resource

    monkeypatch.setattr(writer, "FLUSH_AFTER_S", 0.0)
    monkeypatch.setattr(writer, "SYNC_AFTER_S", 0.0)
    monkeypatch.setattr(BackgroundSync, "begin", BackgroundSync._run)  # at once, whatever the wall does

    sentences: list[str] = []

    def listen(snapshot: Snapshot) -> None:
        if snapshot.state is TrialState.FAILED:
            sentences.append(snapshot.sentence)

    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, before[1]))
    try:
        result = Rig().recorder(view(listen)).record(tmp_path, SPEC)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert not result.accepted and result.path is not None
    stored = re.search(r"\(File too large\): the last stored samples are /force (\d+), /sync \d+", sentences[0])
    assert stored is not None and result.sentence == sentences[0]
    recording = open_recording(result.path)
    assert not recording.complete
    assert recording.load("/force").sample_numbers[-1] >= int(stored[1])


def test_a_blocked_view_does_not_affect_the_recording(tmp_path: Path) -> None:
    released, rig, terminal = threading.Event(), Rig(), Console(force_terminal=False)
    terminal.print = lambda *_, **__: released.wait()  # type: ignore[method-assign]
    stuck = LiveView(rig.clock, "test", terminal)
    stuck.__enter__()
    result = rig.recorder(stuck).record(tmp_path, SPEC)
    released.set()  # a recorder that waited for the terminal would never come here
    stuck.__exit__(None, None, None)
    assert result.accepted and result.lost_samples == 0


def codes(result: TrialResult) -> list[TrialCode]:
    return [message.code for message in result.messages]


def events_of(path: Path) -> list[Event]:
    return [item for item in open_recording(path).items() if isinstance(item, Event)]


def recorded(
    folder: Path, make: type[FakeCapture], delay_s: float, mocap: Callable[..., FakeMocap], *views: object
) -> TrialResult:
    """A capture of 4 s, `delay_s` after its devices were made."""
    clock = ManualClock()
    capture = make(clock, delay_s, 4.0)
    devices = [FakeDaq(clock, capture), mocap(clock, capture)]
    return TrialRecorder(CONFIG, clock, views, make_devices=lambda *_: devices).record(folder, SPEC)  # type: ignore[arg-type,return-value]


@pytest.mark.skipif(sys.platform == "win32", reason="Windows deletes no open file")
def test_a_session_folder_removed_during_a_trial_is_reported_and_the_trial_not_accepted(tmp_path: Path) -> None:
    folder = tmp_path / "monday"

    def remove(snapshot: Snapshot) -> None:
        if snapshot.recorded_s > 1.0 and folder.exists():
            shutil.rmtree(folder)

    result = Rig().recorder(view(remove)).record(folder, SPEC)
    assert not result.accepted
    assert codes(result) == [TrialCode.RECORDING_MOVED]


class TwoPulses(FakeCapture):
    """The sync line is high once more after the capture."""

    def is_on_at(self, times_s: np.ndarray) -> np.ndarray:
        again_s = self._end_s + 0.1
        return super().is_on_at(times_s) | ((times_s >= again_s) & (times_s < again_s + 0.1))


def test_a_recording_that_the_fit_cannot_align_is_not_accepted(tmp_path: Path) -> None:
    result = recorded(tmp_path, TwoPulses, 5.0, FakeMocap)
    assert not result.accepted and result.path is not None
    assert codes(result) == [TrialCode.CAPTURE_ENDED, TrialCode.NOT_ALIGNED]
    assert result.messages[1].figures["reason_code"] == RejectionCode.SYNC_RISES_AGAIN
    outcome = open_recording(result.path).outcome
    assert outcome is not None and not outcome.accepted
    assert isinstance(read_alone(result.path), RejectedTrial)


class Renumbered(FakeMocap):
    """Frames with other numbers, through the assembly of the driver. numbering: (n,) counted from 1 → (n,)."""

    def __init__(self, clock: Clock, capture: FakeCapture, numbering: Callable[[np.ndarray], np.ndarray]) -> None:
        super().__init__(clock, capture, ("anchor_1", "anchor_2", "anchor_3", "cuff_1"))
        self._numbering, self._blocks = numbering, MarkerBlocks(self.streams[0].labels, 100.0, self.name)
        self._blocks.labels = self.streams[0].labels
        self._points = np.eye(4, dtype="<f4").tobytes()

    def read(self, timeout_s: float) -> Sequence[Item]:
        items: list[Item] = []
        for item in super().read(timeout_s):
            if isinstance(item, Samples):
                counted = item.sample_numbers.astype(np.int64)
                for number, time_ns in zip(self._numbering(counted), item.device_time_ns, strict=True):
                    frame = MarkerFrame(int(number), int(time_ns) // 1000, self._points, 0, 0)
                    self._blocks.add(frame, item.host_time_ns)
                items += self._blocks.take()
            else:
                items.append(item)
        return items


def test_a_capture_without_frame_numbers_is_recorded_to_its_end_and_has_two_lines_on_them(tmp_path: Path) -> None:
    shown: list[Item] = []
    offered = SimpleNamespace(offer=shown.append, show=lambda _: None)
    result = recorded(tmp_path, FakeCapture, 5.0, partial(Renumbered, numbering=np.ones_like), offered)
    assert not result.accepted and result.path is not None
    assert codes(result) == [TrialCode.CAPTURE_ENDED, TrialCode.FRAMES_RENUMBERED]
    events = [event.text for event in events_of(result.path) if event.kind == "numbering_restarted"]
    assert len(events) == 2 and events[1].startswith("399 times")
    assert sum(isinstance(item, Event) and item.kind == "numbering_restarted" for item in shown) == 1


NUMBERINGS: dict[str, tuple[Callable[[np.ndarray], np.ndarray], bool]] = {
    "counted": (lambda n: n, True),
    "every second frame": (lambda n: 2 * n - 1, False),
    "always 1": (np.ones_like, False),
    "always 0": (np.zeros_like, False),
    "every number twice": (lambda n: (n + 1) // 2, False),
    "backwards": (lambda n: 401 - n, False),
    "restarts": (lambda n: np.where(n > 200, n - 200, n), False),
    "restarts every 10 frames": (lambda n: (n - 1) % 10 + 1, False),
    "jumps ahead": (lambda n: np.where(n > 200, n + 1000, n), False),
    "jumps back": (lambda n: np.where(n > 200, n - 50, n), False),
    "jumps by 2^31": (lambda n: np.where(n > 200, n + 2**31, n), False),
    "goes on from a preview": (lambda n: n + 5000, True),
}


@pytest.mark.parametrize("name", NUMBERINGS)
def test_a_numbering_of_frames_is_accepted_exactly_if_the_fit_can_read_it(tmp_path: Path, name: str) -> None:
    """From the assembly of frames through recorder and file to the fit."""
    numbering, is_sound = NUMBERINGS[name]
    result = recorded(tmp_path, FakeCapture, 3.0, partial(Renumbered, numbering=numbering))
    assert result.path is not None and result.accepted == is_sound, result.sentence
    assert isinstance(read_alone(result.path), RejectedTrial) != is_sound
    assert result.lost_samples <= 400, "the rate allows no more in 4 s"
    assert sum(event.kind in ("numbering_restarted", "time_stamps_jumped") for event in events_of(result.path)) <= 4


@pytest.mark.skipif(sys.platform == "win32", reason="Windows does not rename a folder with an open file")
@pytest.mark.parametrize("is_copied", [False, True], ids=["renamed", "and replaced by a copy"])
@pytest.mark.parametrize("state", [TrialState.RECORDING, TrialState.CLOSING])
def test_a_trial_whose_folder_is_renamed_is_not_accepted_and_its_samples_are_kept(
    tmp_path: Path, state: TrialState, is_copied: bool
) -> None:
    session, renamed = tmp_path / "monday", tmp_path / "tuesday"

    def rename(snapshot: Snapshot) -> None:
        if snapshot.state is state and not renamed.exists():
            session.rename(renamed)
            if is_copied:
                shutil.copytree(renamed, session)

    result = Rig().recorder(view(rename)).record(session, SPEC)
    assert not result.accepted and result.path is None and session.exists() is is_copied
    assert TrialCode.RECORDING_MOVED in codes(result)
    outcome = open_recording(renamed / SPEC.file_name(1)).outcome
    assert outcome is not None and not outcome.accepted


@pytest.fixture
def daemon() -> Iterator[Mock]:
    signal.set_wakeup_fd(-1)  # an event loop of an earlier test leaves its closed socket on Windows
    before = {number: signal.getsignal(number) for number in ENDINGS}
    daemon = Mock(["stop"])
    _stop_on_signals(daemon)
    yield daemon
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("number", ENDINGS)
def test_ctrl_c_a_kill_and_a_closed_terminal_stop_the_trial_and_not_the_process(
    daemon: Mock, number: signal.Signals
) -> None:
    signal.raise_signal(number)
    daemon.stop.assert_called_once_with()


@pytest.mark.parametrize(
    ("reason", "is_accepted", "lost", "exit_code"),
    [
        (TrialCode.CAPTURE_ENDED, True, 0, 0),
        (TrialCode.DURATION_REACHED, True, 0, 0),
        (TrialCode.OPERATOR_STOP, True, 0, 3),
        (TrialCode.CAPTURE_ENDED, True, 7, 3),
        (TrialCode.DEVICE_LOST, False, 0, 3),
        (TrialCode.CANCELLED, False, 0, 1),
    ],
)
def test_a_trial_that_the_operator_stops_is_incomplete_and_one_without_a_capture_has_failed(
    reason: TrialCode, is_accepted: bool, lost: int, exit_code: int
) -> None:
    path = None if reason is TrialCode.CANCELLED else Path("a.mcap")
    assert _exit_code(TrialResult(path, lost, (Message(reason),), accepted=is_accepted)) == exit_code

"""Every state of a trial against everything that can happen to it."""

from collections.abc import Callable

import numpy as np
import pytest

from documents.message import Message
from drivers.errors import DeviceLost
from recordings.errors import RecordingError
from recordings.samples import Event, Loss
from station.bench.trial_state_machine import TrialStateMachine
from station.bench.view import Snapshot, TrialState
from station.messages.bench_messages import TrialCode
from tests.station.bench_by_hand import STREAMS, Bench


def test_a_trial_runs_from_the_edge_to_the_capture_s_end_and_is_accepted() -> None:
    bench = Bench().arm(3.0)
    assert bench.trial.state is TrialState.ARMED
    assert bench.writer.items == []
    bench.start_capture()
    bench.run(5.0)
    assert bench.trial.state is TrialState.RECORDING
    bench.stop_capture()
    assert bench.trial.state is TrialState.CLOSING
    bench.run(2.0)
    assert bench.trial.state is TrialState.CLOSED
    assert {"armed", "capture_started", "sync_edge", "capture_stopped", "capture_ended"} >= set(bench.writer.events())
    sync = np.concatenate([s.values[:, 0] for s in bench.writer.samples("/sync")])
    assert sync[-1] == 0.0, "the falling edge is recorded too"


def test_the_duration_counts_from_the_edge_on_the_daq_s_clock_unless_the_capture_ends_first() -> None:
    bench, ended = Bench(duration_s=4.0).record(4.5, armed_s=3.0), Bench(duration_s=100.0).record(3.0)
    assert bench.trial.state is TrialState.CLOSING
    bench.run(1.0)
    ended.stop_capture(2.0)
    assert bench.trial.state is ended.trial.state is TrialState.CLOSED
    assert bench.trial.messages == (Message(TrialCode.DURATION_REACHED, {"duration_s": 4.0}),)
    assert ended.codes == [TrialCode.CAPTURE_ENDED]


def test_without_events_a_capture_ends_by_line_and_silence_and_not_by_one_of_them() -> None:
    bench, pulse = Bench().arm(1.0), Bench().record(0.2)
    bench.level, bench.capturing, pulse.level = 5.0, True, 0.0
    bench.run(3.0)
    bench.stop_capture(4.0, with_event=False)
    pulse.run(5.0)
    assert (bench.trial.state, pulse.trial.state) == (TrialState.CLOSED, TrialState.RECORDING)


def test_frames_after_the_end_of_the_capture_are_not_recorded() -> None:
    bench = Bench().record(armed_s=3.0)
    bench.stop_capture()
    recorded = len(bench.writer.samples("/markers"))
    bench.frame = 1
    bench.send_frames(10)
    bench.trial.handle(Loss("/markers", "skipped", 11, 5, 0, bench.clock.utc_ns()))
    bench.run(2.0)
    assert (len(bench.writer.samples("/markers")), bench.trial.lost_samples) == (recorded, 0)


def test_a_dip_of_the_line_while_recording_is_noted_and_ignored() -> None:
    bench = Bench().record()
    dip = np.full(100, 5.0)
    dip[50:53] = 0.0
    bench.send_daq(dip)
    bench.run(1.0)
    bench.stop_capture(2.0)
    assert (bench.trial.state, bench.codes) == (TrialState.CLOSED, [TrialCode.CAPTURE_ENDED])
    assert "sync_glitch" in bench.writer.events()


def test_a_second_rise_is_reported_at_once_and_the_trial_is_recorded_to_its_end() -> None:
    bench = Bench().record(1.0)
    bench.send_daq(np.repeat([0.0, 5.0], 50))
    assert bench.trial.state is TrialState.RECORDING
    assert bench.codes == [TrialCode.RECORDING, TrialCode.SECOND_START]
    assert bench.trial.snapshot().messages[1].figures["after_s"] == pytest.approx(1.05, abs=0.002)
    bench.run(2.0)
    bench.stop_capture(2.0)
    assert bench.trial.state is TrialState.FAILED
    assert bench.codes == [TrialCode.CAPTURE_ENDED, TrialCode.SECOND_START]
    assert bench.writer.events().count("sync_double_edge") == 1
    assert sum(len(s.sample_numbers) for s in bench.writer.samples("/markers")) == 300, "nothing is thrown away"


def renumbered(seconds_before_end: float, *, with_event: bool = True, restarts: int = 1) -> Bench:
    """A capture of 4 s whose frame numbers restart before its end, and 3 s after its end."""
    bench = Bench().arm(1.0)
    bench.start_capture()
    bench.run(4.0 - seconds_before_end)
    for _ in range(restarts):
        bench.event("numbering_restarted")
    bench.frame = 1
    bench.run(seconds_before_end)
    bench.stop_capture(with_event=with_event)
    bench.capturing = not with_event
    bench.run(3.0)
    return bench


def test_frame_numbers_that_restart_during_a_capture_do_not_end_it_and_the_trial_is_not_accepted() -> None:
    """Nor do those that restart again and again before its end, as no preview does."""
    for bench in (renumbered(0.5, restarts=2), renumbered(2.0)):
        assert bench.codes == [TrialCode.CAPTURE_ENDED, TrialCode.FRAMES_RENUMBERED]
        assert bench.trial.state is TrialState.FAILED
    assert sum(len(s.sample_numbers) for s in bench.writer.samples("/markers")) == 400
    assert bench.writer.events().count("frames_renumbered") == 1


def test_frame_numbers_that_restart_just_before_the_capture_ends_are_those_of_a_preview() -> None:
    bench = renumbered(0.5)
    assert (bench.trial.state, bench.codes) == (TrialState.CLOSED, [TrialCode.CAPTURE_ENDED])
    bench = renumbered(0.5, with_event=False)
    assert (bench.trial.state, bench.codes) == (TrialState.CLOSED, [TrialCode.CAPTURE_ENDED_RENUMBERED])


def test_time_stamps_that_jump_during_a_capture_do_not_end_it_and_the_trial_is_not_accepted() -> None:
    bench = Bench().arm(1.0)
    bench.start_capture()
    for _ in range(3):
        bench.run(2.0)
        bench.event("time_stamps_jumped")
    bench.stop_capture(2.0)
    assert (bench.trial.state, bench.codes) == (TrialState.FAILED, [TrialCode.CAPTURE_ENDED, TrialCode.STAMPS_JUMPED])


@pytest.mark.parametrize(
    ("stream", "count", "is_accepted"),
    [
        ("/markers", 1, True),  # with every second block of ten frames: 9 % of the frames
        ("/markers", 10, True),  # half
        ("/markers", 11, False),
        ("/force", 40, True),  # 40 ms are interpolated, however often
        ("/force", 200, False),
        ("/sync", 200, True),  # its edges are there
    ],
)
def test_a_trial_that_lost_more_than_half_of_what_the_fit_needs_is_not_accepted(
    stream: str, count: int, is_accepted: bool
) -> None:
    bench = Bench().arm(2.5)
    bench.start_capture()
    for _ in range(20):
        bench.run(0.1)
        bench.trial.handle(Loss(stream, "skipped", 0, count, 0, bench.clock.utc_ns()))
    bench.stop_capture(2.0)
    assert (bench.trial.state is TrialState.CLOSED) == is_accepted
    assert (TrialCode.MOSTLY_LOST in bench.codes) != is_accepted


@pytest.mark.parametrize(("is_at_once", "is_accepted"), [(False, False), (True, True)])
def test_force_and_markers_must_be_there_together_in_half_of_the_trial(*, is_at_once: bool, is_accepted: bool) -> None:
    """40 % of either are lost: in the same seconds, or in others."""
    bench = Bench().record(0.1, armed_s=2.5)
    for i in range(20):
        bench.run(0.1)
        for stream, count in (("/markers", 14), ("/force", 140)):
            if i % 2 == (stream == "/force" and not is_at_once):
                bench.trial.handle(Loss(stream, "skipped", 0, count, 0, bench.clock.utc_ns()))
    bench.stop_capture(2.0)
    assert (bench.trial.state is TrialState.CLOSED) == is_accepted
    assert (bench.codes == [TrialCode.CAPTURE_ENDED]) == is_accepted
    assert (TrialCode.LITTLE_IN_COMMON in bench.codes) != is_accepted


@pytest.mark.parametrize(("is_needed", "state"), [(True, TrialState.FAILED), (False, TrialState.CLOSED)])
@pytest.mark.parametrize("silent_s", [0.8, 8.0])
def test_a_force_that_the_trial_does_not_need_does_not_end_it(
    *, is_needed: bool, state: TrialState, silent_s: float
) -> None:
    bench = Bench(force_device="indicator", is_force_needed=is_needed).record(2.0)
    bench.force_is_sent = False
    bench.run(silent_s)
    bench.stop_capture(6.0)
    assert bench.trial.state is state
    assert {TrialCode.DEVICE_SILENT, TrialCode.END_MISSING} & set(bench.codes), "said in any case"


def test_a_line_that_stays_high_after_the_capture_is_noted() -> None:
    bench = Bench().record()
    bench.stop_capture()
    bench.level = 5.0
    bench.run(2.0)
    assert bench.trial.state is TrialState.CLOSED
    assert bench.codes == [TrialCode.CAPTURE_ENDED, TrialCode.NO_STOP_EDGE]
    assert "no_stop_edge" in bench.writer.events()


def test_a_trial_that_is_cut_short_is_closed_well_and_not_accepted() -> None:
    bench = _recording()
    bench.trial.cut_short(FULL)
    assert bench.trial.state is TrialState.CLOSING
    bench.run(2.0)
    assert (bench.trial.state, bench.trial.messages) == (TrialState.FAILED, (FULL,))
    assert "disk_nearly_full" in bench.writer.events()


def test_a_mark_is_recorded_after_the_sync_edge() -> None:
    bench = Bench().arm()
    bench.trial.mark()
    bench.run(3.0)
    bench.start_capture()
    bench.run(1.0)
    bench.trial.mark()
    bench.trial.mark()
    marks = [item.text for item in bench.writer.items if isinstance(item, Event) and item.kind == "mark"]
    assert marks == ["mark 1", "mark 2"]
    assert bench.trial.snapshot().marks == 2


def test_a_snapshot_has_the_time_that_an_armed_trial_has_waited_and_what_is_left() -> None:
    bench = Bench(timeout_s=10.0)
    bench.clock.advance(100.0)
    assert bench.trial.snapshot() == Snapshot(TrialState.IDLE, bench.trial.messages)
    assert not bench.trial.wants_capture_start and not bench.trial.is_over
    bench.arm()
    bench.level = 0.3
    bench.run(1.5)
    assert not bench.trial.wants_capture_start
    bench.run(1.0)
    shot = bench.trial.snapshot()
    assert (shot.waited_s, shot.left_s, shot.recorded_s) == (pytest.approx(2.5), pytest.approx(7.5), 0.0)
    assert (shot.sync_level_v, shot.edge_device_ns, shot.streams) == (0.3, None, tuple(STREAMS))
    assert bench.trial.wants_capture_start and not bench.trial.has_edge
    bench.clock.advance(10.0)
    assert bench.trial.snapshot().left_s == 0.0


def test_a_snapshot_counts_the_recording_from_the_edge_on_the_daq_s_clock() -> None:
    bench = Bench().arm(3.0)
    edge_ns = bench.sample * 1_000_000
    bench.start_capture()
    bench.run(2.0)
    bench.trial.handle(Loss("/force", "overrun", 10_000, 3, 0, bench.clock.utc_ns()))
    shot = bench.trial.snapshot()
    assert bench.trial.has_edge and shot.edge_device_ns == edge_ns
    assert shot.recorded_s == pytest.approx((bench.sample * 1_000_000 - 1_000_000 - edge_ns) * 1e-9)
    assert (shot.waited_s, shot.left_s, shot.lost_samples) == (0.0, 0.0, 3)
    assert bench.trial.lost_samples == 3
    bench.sample = 0  # a DAQ that was reconnected counts from 0 again
    bench.send_daq(np.full(100, 5.0))
    assert bench.trial.snapshot().recorded_s == 0.0


@pytest.mark.parametrize(
    ("end", "message"),
    [
        (
            lambda trial: trial.fail(DeviceLost("NI Dev1 is gone"), "NI Dev1"),
            Message(TrialCode.DEVICE_LOST, {"reason": "NI Dev1 is gone", "reason_code": "device_lost"}),
        ),
        (
            lambda trial: trial.abandon(RecordingError("disk full")),
            Message(TrialCode.WRITE_FAILED, {"reason": "disk full", "reason_code": "recording_failed"}),
        ),
    ],
    ids=["device lost", "writing failed"],
)
def test_a_trial_that_cannot_go_on_is_over_with_the_cause(
    end: Callable[[TrialStateMachine], None], message: Message[TrialCode]
) -> None:
    bench = Bench().arm(1.0)
    assert not bench.trial.is_over
    end(bench.trial)
    assert (bench.trial.is_over, bench.trial.state, bench.trial.messages) == (True, TrialState.FAILED, (message,))
    assert bench.trial.sentence == str(message)


IDLE, ARMED, RECORDING, CLOSING, CLOSED, FAILED = TrialState
FULL = Message(TrialCode.DISK_NEARLY_FULL, {"folder": "monday", "free_mb": 40.0, "reserve_mb": 50.0})


def _recording() -> Bench:
    return Bench().record(1.0, armed_s=3.0)


def _ended(end: Callable[[TrialStateMachine], None]) -> Bench:
    bench = _recording()
    end(bench.trial)
    return bench


REACHED: dict[TrialState, Callable[[], Bench]] = {
    IDLE: Bench,
    ARMED: lambda: Bench().arm(),
    RECORDING: _recording,
    CLOSING: lambda: _ended(lambda trial: trial.stop()),
    CLOSED: lambda: _ended(lambda trial: trial.stop(at_once=True)),
    FAILED: lambda: _ended(lambda trial: trial.fail(DeviceLost("the load cell is gone"), "NI Dev1")),
}


Happening = Callable[[TrialStateMachine], None]
HAPPENINGS: dict[str, tuple[Happening, tuple[TrialState, ...]]] = {
    "stop": (lambda trial: trial.stop(), (FAILED, FAILED, CLOSING, CLOSING, CLOSED, FAILED)),
    "stop at once": (lambda trial: trial.stop(at_once=True), (FAILED, FAILED, CLOSED, CLOSED, CLOSED, FAILED)),
    "a device is lost": (
        lambda trial: trial.fail(DeviceLost("gone"), "QTM"),
        (FAILED, FAILED, FAILED, CLOSING, CLOSED, FAILED),
    ),
    "the disk is full": (lambda trial: trial.cut_short(FULL), (FAILED, FAILED, CLOSING, CLOSING, CLOSED, FAILED)),
    "the capture ends": (
        lambda trial: trial.handle(Event("capture_stopped", "", 0, "QTM")),
        (IDLE, ARMED, CLOSING, CLOSING, CLOSED, FAILED),
    ),
    "the capture is replaced": (
        lambda trial: trial.handle(Event("capture_replaced", "another's", 0, "QTM")),
        (IDLE, ARMED, CLOSING, CLOSING, CLOSED, FAILED),
    ),
    "the writer fails": (lambda trial: trial.abandon(RecordingError("the disk is gone")), (FAILED,) * 6),
    "a mark": (lambda trial: trial.mark(), tuple(TrialState)),
    "time": (lambda trial: trial.tick(), tuple(TrialState)),
}
"""What can happen → the state that follows on each of TrialState."""


@pytest.mark.parametrize("happening", HAPPENINGS)
@pytest.mark.parametrize("state", TrialState)
def test_every_method_of_a_state_returns_a_state(state: TrialState, happening: str) -> None:
    bench, (happens, following) = REACHED[state](), HAPPENINGS[happening]
    assert bench.trial.state is state
    happens(bench.trial)
    assert bench.trial.state is following[list(TrialState).index(state)]
    assert state is not ARMED or bench.writer.items == []


@pytest.mark.parametrize("state", [IDLE, CLOSED, FAILED])
def test_items_before_arming_and_after_the_end_are_not_recorded(state: TrialState) -> None:
    bench = REACHED[state]()
    recorded = len(bench.writer.items)
    bench.run(1.0)
    bench.trial.mark()
    assert (len(bench.writer.items), bench.trial.state) == (recorded, state)

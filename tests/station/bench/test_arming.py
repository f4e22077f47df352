"""Arming, missing first frames, live previews before a capture, and streams that fall silent."""

import numpy as np
import pytest

from documents.message import Message
from recordings.samples import Event, Loss, Samples
from station.bench.view import TrialState
from station.messages.bench_messages import TrialCode
from tests.station.bench_by_hand import Bench


def test_two_seconds_of_daq_samples_before_the_edge_are_kept() -> None:
    bench = Bench().record(0.1, armed_s=7.0)
    first = bench.writer.samples("/force")[0].sample_numbers[0]
    assert first == 5000


def test_marker_frames_that_came_before_the_block_with_the_edge_are_kept() -> None:
    bench = Bench().arm(3.0)
    bench.capturing = True
    for _ in range(5):  # frames arrive at once, the DAQ's block a good deal later
        bench.send_frames(10)
        bench.clock.advance(0.1)
    bench.send_daq(np.r_[np.zeros(50), np.full(50, 5.0)])
    assert bench.trial.state is TrialState.RECORDING
    assert sum(len(s.sample_numbers) for s in bench.writer.samples("/markers")) == 50


@pytest.mark.parametrize(
    ("level", "code"),
    [
        (0.0, TrialCode.NO_SYNC_EDGE_LOW),
        (5.0, TrialCode.NO_SYNC_EDGE_HIGH),
        (None, TrialCode.NO_SYNC_EDGE_NO_SAMPLES),  # before it is silent for so long that it is named
    ],
)
def test_no_edge_in_time_fails_with_the_level_of_the_line(level: float | None, code: TrialCode) -> None:
    bench = Bench(timeout_s=2.5).arm()
    bench.level, bench.daq_sends = level or 0.0, level is not None
    bench.run(3.0)
    (message,) = bench.trial.messages
    assert (message.code, message.figures.get("level_v")) == (code, level)
    assert (bench.trial.state, bench.trial.has_edge, bench.writer.items) == (TrialState.FAILED, False, [])


@pytest.mark.parametrize("cut", [43, 41])
def test_a_glitch_while_armed_starts_nothing_and_is_in_the_file(cut: int) -> None:
    bench = Bench().arm(2.5)
    spike = np.zeros(100)
    spike[40:43] = 5.0
    for part in np.split(spike, [cut]):
        bench.send_daq(part)
        assert bench.trial.state is TrialState.ARMED, "also where a block ends within it"
    bench.start_capture()
    bench.run(3.0)
    assert bench.trial.state is TrialState.RECORDING, "nor is the glitch's end taken for an inverted edge"
    assert "sync_glitch" in bench.writer.events()


def test_a_line_that_is_high_before_arming_is_a_running_capture_and_an_edge_at_the_end_of_a_block_is_not() -> None:
    bench = Bench().arm(2.5)
    bench.send_daq(np.r_[np.zeros(97), np.full(3, 5.0)])
    bench.trial.tick()
    assert bench.codes == [TrialCode.ARMED]
    bench.send_daq(np.full(100, 5.0))
    assert bench.trial.state is TrialState.RECORDING
    bench = Bench()
    bench.level = 5.0
    bench.arm().run(0.2)
    assert bench.codes == [TrialCode.CAPTURE_RUNNING]


def test_an_inverted_line_is_named_when_the_capture_starts() -> None:
    bench = Bench().arm()
    bench.level = 5.0
    bench.run(3.0)
    bench.level, bench.capturing = 0.0, True
    bench.event("capture_started")
    bench.run(2.0)
    assert bench.trial.state is TrialState.FAILED
    assert bench.trial.messages == (Message(TrialCode.WRONG_POLARITY, {"from_v": 5.0, "to_v": 0.0}),)


def test_the_end_of_an_earlier_capture_is_not_a_wrong_polarity() -> None:
    bench = Bench().arm()
    bench.level = 5.0
    bench.run(2.0)
    bench.level = 0.0
    bench.run(3.0)
    bench.start_capture()
    bench.run(3.0)
    assert bench.trial.state is TrialState.RECORDING


def test_the_hardware_trigger_starts_the_trial_with_the_first_sample() -> None:
    bench = Bench(start="pfi0").arm()
    bench.daq_sends = False
    bench.run(5.0)
    assert bench.trial.state is TrialState.ARMED
    bench.daq_sends = True
    bench.start_capture()
    bench.run(0.1)
    assert bench.trial.state is TrialState.RECORDING
    assert bench.writer.samples("/force")[0].sample_numbers[0] == 0


def test_a_silent_daq_is_reported_while_armed() -> None:
    bench = Bench(timeout_s=60.0).arm()
    bench.daq_sends = False
    bench.run(4.0)
    assert bench.trial.state is TrialState.FAILED
    (message,) = bench.trial.messages
    assert (message.code, message.figures["source"]) == (TrialCode.DEVICE_SILENT, "NI Dev1")


def _late(bench: Bench) -> list[Loss]:
    return [item for item in bench.writer.items if isinstance(item, Loss) and item.cause == "late"]


@pytest.mark.parametrize(
    ("has_preview", "late_s", "first", "missing"),
    [(False, 1.2, 121, 120), (False, 1.0, 1, 0), (True, 0.0, None, 0), (True, 0.5, 51, 50)],
    ids=["begin late", "a delayed first frame", "numbers of a preview go on", "numbers restart after a preview"],
)
def test_frames_that_begin_late_are_counted_as_lost(
    *, has_preview: bool, late_s: float, first: int | None, missing: int
) -> None:
    bench = Bench().arm()
    bench.capturing = has_preview
    bench.run(3.0)
    bench.start_capture()
    bench.mocap_sends = False
    bench.run(late_s)
    if has_preview and first:
        bench.event("numbering_restarted")
    bench.frame, bench.mocap_sends = first or bench.frame, True
    bench.run(2.0)
    bench.stop_capture(2.0)
    losses = [(loss.stream, loss.first_missing, loss.count) for loss in _late(bench)]
    assert losses == [("/markers", 1, missing)] * bool(missing)
    assert (bench.trial.state, bench.trial.lost_samples) == (TrialState.CLOSED, missing)


def test_frames_that_arrive_before_the_edge_is_settled_are_checked_then() -> None:
    bench = Bench().arm(3.0)
    bench.daq_sends = False
    bench.start_capture()
    bench.frame = 4
    bench.run(0.1)
    assert not _late(bench)
    bench.daq_sends = True
    bench.run(0.5)
    assert bench.trial.state is TrialState.RECORDING
    assert [loss.count for loss in _late(bench)] == [3]


def test_numbers_that_restart_within_a_capture_add_no_loss() -> None:
    bench = Bench().record(1.0, armed_s=3.0)
    for _ in range(3):
        bench.event("numbering_restarted")
        bench.frame = 90
        bench.run(0.1)
    assert not _late(bench)


@pytest.mark.parametrize(
    ("which", "missing"), [("daq_sends", {"/force": 3000, "/sync": 3000}), ("mocap_sends", {"/markers": 300})]
)
def test_a_device_that_falls_silent_while_recording_ends_the_trial_with_a_loss_of_each_stream(
    which: str, missing: dict[str, int]
) -> None:
    bench = Bench().record()
    setattr(bench, which, False)
    bench.run(4.0)
    assert bench.trial.state is TrialState.FAILED
    assert bench.trial.has_edge and bench.trial.lost_samples > 0
    losses = [i for i in bench.writer.items if isinstance(i, Loss)]
    assert {x.cause for x in losses} == {"silent"}
    assert {x.stream: x.count for x in losses} == pytest.approx(missing, rel=0.05)
    for loss in losses:
        assert loss.first_missing == bench.writer.samples(loss.stream)[-1].sample_numbers[-1] + 1


@pytest.mark.parametrize("has_preview", [False, True])
def test_a_short_capture_without_a_frame_is_not_accepted(has_preview: bool) -> None:
    bench = Bench().arm(1.0)
    if has_preview:
        bench.send_frames(10)
        bench.run(0.5)
    bench.mocap_sends = False
    bench.start_capture()
    bench.run(2.0)
    bench.stop_capture(2.0)
    assert bench.trial.state is TrialState.FAILED
    assert bench.codes == [TrialCode.CAPTURE_ENDED, TrialCode.EMPTY_CAPTURE]
    assert bench.trial.messages[1].figures == {"source": "QTM 127.0.0.1:22223"}
    losses = [(i.stream, i.count) for i in bench.writer.items if isinstance(i, Loss)]
    assert losses == [("/markers", pytest.approx(200, abs=10))]


def test_a_daq_that_froze_before_the_capture_ended_is_not_accepted_and_the_missing_end_is_counted() -> None:
    bench = Bench().record()
    bench.daq_sends = False
    bench.run(1.0)
    bench.stop_capture(1.5)
    assert bench.trial.state is TrialState.CLOSING, "a busy machine may still bring them"
    bench.run(2.5)
    assert bench.trial.state is TrialState.FAILED
    assert bench.codes == [TrialCode.END_MISSING, TrialCode.NO_STOP_EDGE]
    assert bench.trial.messages[0].figures["missing_s"] == pytest.approx(1.0, abs=0.01)
    losses = {i.stream: i.count for i in bench.writer.items if isinstance(i, Loss)}
    assert losses == {"/force": pytest.approx(1000, abs=1), "/sync": pytest.approx(1000, abs=1)}


def test_a_daq_that_is_silent_after_the_end_of_the_capture_loses_no_samples() -> None:
    bench = Bench().record()
    bench.stop_capture()
    bench.daq_sends = False
    bench.run(2.0)
    assert (bench.trial.state, bench.trial.lost_samples) == (TrialState.CLOSED, 0)


def test_closing_waits_for_a_backlog_of_the_daq() -> None:
    bench = Bench().record()
    backlog = [np.full(100, 5.0)] * 20
    bench.daq_sends = False
    bench.run(2.0)
    bench.stop_capture()
    for volts in backlog:
        assert bench.trial.state is TrialState.CLOSING
        bench.run(0.1)
        bench.send_daq(volts)
    bench.daq_sends = True
    bench.run(6.0)
    assert (bench.trial.state, bench.trial.lost_samples) == (TrialState.CLOSED, 0)


def test_a_disconnected_device_may_be_silent_and_no_other() -> None:
    one, other = (Bench().record(1.0, armed_s=3.0) for _ in range(2))
    for bench in (one, other):
        bench.trial.handle(Event("connection_lost", "gone", bench.clock.utc_ns(), "NI Dev1"))
        bench.daq_sends = False
    one.run(8.0)
    assert one.trial.state is TrialState.RECORDING
    one.trial.handle(Event("connection_restored", "back", one.clock.utc_ns(), "NI Dev1"))
    one.run(2.0)
    assert one.trial.state is TrialState.RECORDING
    one.run(2.0)
    other.mocap_sends = False
    other.run(4.0)
    for bench, stream in ((one, "/force"), (other, "/markers")):
        (message,) = bench.trial.messages
        assert (bench.trial.state, message.code) == (TrialState.FAILED, TrialCode.DEVICE_SILENT)
        assert message.figures["stream"] == stream


def test_after_a_stall_of_the_station_no_device_is_silent_and_the_backlog_is_recorded() -> None:
    bench = Bench().record()
    bench.clock.advance(60.0)
    bench.trial.tick()
    bench.run(2.0)
    assert bench.trial.state is TrialState.RECORDING and bench.trial.lost_samples == 0
    (paused,) = (i for i in bench.writer.items if isinstance(i, Event) and i.kind == "station_paused")
    assert "60.0 s" in paused.text
    bench.mocap_sends = False
    bench.run(4.0)
    assert bench.trial.state is TrialState.FAILED, "a device that falls silent afterwards is reported"


def test_a_replaced_capture_ends_the_trial_without_acceptance() -> None:
    bench = Bench().record()
    before = len(bench.writer.samples("/markers"))
    bench.event("capture_replaced")
    bench.run(2.0)
    assert bench.trial.state is TrialState.FAILED
    assert len(bench.writer.samples("/markers")) == before, "the frames of the other capture are not ours"


def test_a_slow_computer_and_samples_that_wait_are_an_overload_during_the_trial_and_in_its_result() -> None:
    bench = Bench().record()
    bench.trial.handle(Loss("/force", "overrun", 10_000, 250, 0, bench.clock.utc_ns()))
    bench.run(1.0)
    bench.trial.handle(Loss("/sync", "queue_overflow", 10_000, 50, 0, bench.clock.utc_ns()))
    bench.stop_capture(3.0)
    assert bench.writer.events().count("overloaded") == 1
    assert bench.codes == [TrialCode.CAPTURE_ENDED, TrialCode.OVERWRITTEN]
    assert bench.trial.messages[1].figures == {"samples": 300}
    assert bench.trial.state is TrialState.CLOSED
    bench = Bench().record()
    late = next(i for i in reversed(bench.writer.items) if isinstance(i, Samples) and i.stream == "/force")
    bench.clock.advance(3.0)
    bench.trial.handle(late)
    (overloaded,) = (item for item in bench.writer.items if isinstance(item, Event) and item.kind == "overloaded")
    assert "3.0 s" in overloaded.text

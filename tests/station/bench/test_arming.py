"""Arming, and missing first frames of a capture; a live preview before it is not a capture."""

from __future__ import annotations

import numpy as np
import pytest

from recordings.samples import Loss
from station.bench.view import TrialState
from station.messages.codes import TrialCode
from station.messages.message import Message
from tests.station.bench_by_hand import Bench


def test_two_seconds_of_daq_samples_before_the_edge_are_kept() -> None:
    bench = Bench().arm()
    bench.run(7.0)
    bench.start_capture()
    bench.run(0.1)
    first = bench.writer.samples("/force")[0].sample_numbers[0]
    assert first == 5000


def test_marker_frames_that_came_before_the_block_with_the_edge_are_kept() -> None:
    bench = Bench().arm()
    bench.run(3.0)
    bench.capturing = True
    for _ in range(5):  # frames arrive at once, the DAQ's block a good deal later
        bench.send_frames(10)
        bench.clock.advance(0.1)
    bench.send_daq(np.r_[np.zeros(50), np.full(50, 5.0)])
    assert bench.trial.state is TrialState.RECORDING
    assert sum(len(s.sample_numbers) for s in bench.writer.samples("/markers")) == 50


@pytest.mark.parametrize(("level", "code"), [(0.0, TrialCode.NO_SYNC_EDGE_LOW), (5.0, TrialCode.NO_SYNC_EDGE_HIGH)])
def test_no_edge_in_time_fails_with_the_level_of_the_line(level: float, code: TrialCode) -> None:
    bench = Bench(timeout_s=6.0).arm()
    bench.level = level
    bench.run(6.5)
    assert bench.trial.state is TrialState.FAILED
    assert not bench.trial.has_edge
    (message,) = bench.trial.messages
    assert (message.code, message.figures["level_v"]) == (code, level)
    assert bench.writer.items == []


def test_a_time_out_without_samples_of_the_line_has_its_own_code() -> None:
    bench = Bench(timeout_s=1.0).arm()
    bench.daq_sends = False
    bench.run(1.5)
    assert bench.codes == [TrialCode.NO_SYNC_EDGE_NO_SAMPLES]


@pytest.mark.parametrize("cut", [43, 41])
def test_a_glitch_while_armed_starts_nothing_and_is_in_the_file(cut: int) -> None:
    bench = Bench().arm()
    bench.run(2.5)
    spike = np.zeros(100)
    spike[40:43] = 5.0
    for part in np.split(spike, [cut]):
        bench.send_daq(part)
        assert bench.trial.state is TrialState.ARMED, "also where a block ends within it"
    bench.start_capture()
    bench.run(3.0)
    assert bench.trial.state is TrialState.RECORDING, "nor is the glitch's end taken for an inverted edge"
    assert "sync_glitch" in bench.writer.events()


def test_an_edge_at_the_end_of_a_block_is_not_a_running_capture() -> None:
    bench = Bench().arm()
    bench.run(2.5)
    bench.send_daq(np.r_[np.zeros(97), np.full(3, 5.0)])
    bench.trial.tick()
    assert bench.codes == [TrialCode.ARMED]
    bench.send_daq(np.full(100, 5.0))
    assert bench.trial.state is TrialState.RECORDING


def test_a_line_that_is_high_before_arming_is_a_running_capture() -> None:
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


def test_an_armed_trial_shows_level_and_time_left() -> None:
    bench = Bench(timeout_s=10.0).arm()
    bench.level = 0.3
    bench.run(4.0)
    armed = bench.trial.snapshot()
    assert (armed.sync_level_v, armed.waited_s, armed.left_s) == pytest.approx((0.3, 4.0, 6.0))
    bench.level, bench.capturing = 5.0, True
    bench.run(1.0)
    assert bench.trial.snapshot().left_s == 0.0


def test_cancelling_while_armed_records_nothing() -> None:
    bench = Bench().arm()
    bench.run(3.0)
    bench.trial.stop()
    assert bench.trial.state is TrialState.FAILED
    assert bench.writer.items == []


def test_a_silent_daq_is_reported_while_armed() -> None:
    bench = Bench(timeout_s=60.0).arm()
    bench.daq_sends = False
    bench.run(4.0)
    assert bench.trial.state is TrialState.FAILED
    (message,) = bench.trial.messages
    assert (message.code, message.figures["source"]) == (TrialCode.DEVICE_SILENT, "NI Dev1")


def test_a_trial_that_is_cut_short_while_armed_records_nothing() -> None:
    bench = Bench().arm()
    bench.run(1.0)
    bench.trial.cut_short(Message(TrialCode.DISK_NEARLY_FULL))
    assert (bench.trial.state, bench.writer.items) == (TrialState.FAILED, [])


def test_the_capture_is_wanted_only_after_the_pre_roll() -> None:
    bench = Bench().arm()
    bench.run(1.5)
    assert not bench.trial.wants_capture_start
    bench.run(1.0)
    assert bench.trial.wants_capture_start


def _late(bench: Bench) -> list[Loss]:
    return [item for item in bench.writer.items if isinstance(item, Loss) and item.cause == "late"]


def test_frames_that_begin_late_are_counted_as_lost() -> None:
    bench = Bench().arm()
    bench.run(3.0)
    bench.mocap_sends = False
    bench.start_capture()
    bench.run(1.2)
    bench.frame, bench.mocap_sends = 121, True
    bench.run(2.0)
    bench.stop_capture()
    bench.run(2.0)
    (loss,) = _late(bench)
    assert (loss.stream, loss.first_missing, loss.count) == ("/markers", 1, 120)
    assert bench.trial.lost_samples == 120
    assert bench.trial.state is TrialState.CLOSED


def test_frames_that_arrive_before_the_edge_is_settled_are_checked_then() -> None:
    bench = Bench().arm()
    bench.run(3.0)
    bench.daq_sends = False
    bench.start_capture()
    bench.frame = 4
    bench.run(0.1)
    assert not _late(bench)
    bench.daq_sends = True
    bench.run(0.5)
    assert bench.trial.state is TrialState.RECORDING
    assert [loss.count for loss in _late(bench)] == [3]


def test_a_preview_with_continued_numbers_has_no_late_frames() -> None:
    bench = Bench().arm()
    bench.capturing = True
    bench.run(3.0)
    bench.start_capture()
    bench.run(2.0)
    assert not _late(bench)


def test_numbers_that_restart_after_a_preview_belong_to_a_capture() -> None:
    bench = Bench().arm()
    bench.capturing = True
    bench.run(3.0)
    bench.start_capture()
    bench.mocap_sends = False
    bench.run(0.5)
    bench.event("numbering_restarted")
    bench.frame, bench.mocap_sends = 51, True
    bench.run(1.0)
    assert [loss.count for loss in _late(bench)] == [50]


def test_numbers_that_restart_within_a_capture_add_no_loss() -> None:
    bench = Bench().arm()
    bench.run(3.0)
    bench.start_capture()
    bench.run(1.0)
    for _ in range(3):
        bench.event("numbering_restarted")
        bench.frame = 90
        bench.run(0.1)
    assert not _late(bench)


def test_a_delayed_first_frame_is_not_a_loss() -> None:
    bench = Bench().arm()
    bench.run(3.0)
    bench.mocap_sends = False
    bench.start_capture()
    bench.run(1.0)
    bench.frame, bench.mocap_sends = 1, True
    bench.run(1.0)
    assert not _late(bench)

"""Missing first frames of a capture are counted; a live preview before it is not a capture."""

from __future__ import annotations

from recordings.samples import Loss
from station.bench.snapshot import TrialState
from tests.station.bench_by_hand import Bench


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


def test_a_delayed_first_frame_is_not_a_loss() -> None:
    bench = Bench().arm()
    bench.run(3.0)
    bench.mocap_sends = False
    bench.start_capture()
    bench.run(1.0)
    bench.frame, bench.mocap_sends = 1, True
    bench.run(1.0)
    assert not _late(bench)

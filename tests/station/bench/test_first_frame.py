"""A capture whose first frames never came is told, by how many; live preview before it is not taken for one."""

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


def test_a_capture_that_is_heard_before_its_edge_is_settled_is_judged_then() -> None:
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


def test_preview_before_the_edge_and_numbers_that_run_on_are_no_late_capture() -> None:
    bench = Bench().arm()
    bench.capturing = True
    bench.run(3.0)
    bench.start_capture()
    bench.run(2.0)
    assert not _late(bench)


def test_numbers_that_start_again_after_preview_are_a_capture_s() -> None:
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


def test_a_capture_whose_first_frame_travels_long_has_lost_nothing() -> None:
    bench = Bench().arm()
    bench.run(3.0)
    bench.mocap_sends = False
    bench.start_capture()
    bench.run(1.0)
    bench.frame, bench.mocap_sends = 1, True
    bench.run(1.0)
    assert not _late(bench)

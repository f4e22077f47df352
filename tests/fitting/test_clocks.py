"""The edge, the capture's frames, and one clock against the other."""

from __future__ import annotations

import numpy as np
import pytest

from fitting.clocks import DRIFT_PRIOR_SD, LagUncertainty, SyncEdges, capture_frames, clock_ratio, find_edges
from fitting.quality import UnusableTrial

time = np.arange(4000) / 1000


def _line(*pulses: tuple[float, float]) -> np.ndarray:
    return sum((5.0 * ((time >= start) & (time < end)) for start, end in pulses), np.zeros(len(time)))


def test_the_edge_lies_between_the_two_samples_around_it() -> None:
    edges = find_edges(time, _line((1.0, 3.0)), 2.5)
    assert edges.rising == pytest.approx(0.9995)
    assert edges.rising_sd == pytest.approx(1e-3 / np.sqrt(12))
    assert edges.falling == pytest.approx(2.9995)


def test_a_line_that_never_falls_has_no_second_edge() -> None:
    assert find_edges(time, _line((1.0, 9.0)), 2.5).falling is None


def test_a_bouncing_contact_is_one_edge() -> None:
    assert find_edges(time, _line((1.0, 1.003), (1.005, 3.0)), 2.5).rising == pytest.approx(0.9995)


@pytest.mark.parametrize(
    ("level", "sentence"),
    [
        (_line(), "never rises"),
        (5.0 - _line((1.0, 3.0)), r"starts at 5\.00 V"),
        (_line((1.0, 1.5), (2.0, 3.0)), "rises 2 times"),
        (np.full(len(time), np.nan), "no finite samples"),
    ],
)
def test_a_sync_line_that_tells_no_single_start_is_refused_in_a_sentence(level: np.ndarray, sentence: str) -> None:
    with pytest.raises(UnusableTrial, match=sentence):
        find_edges(time, level, 2.5)


def _capture(numbers: list[int], stamps: list[float], arrival: list[float], edge: float = 0.0) -> slice:
    """Numbers, stamps in frames, and arrival in frames, at 100 Hz."""
    seconds = [np.array(frames, float) / 100 for frames in (stamps, arrival)]
    return capture_frames(np.array(numbers), *seconds, 100.0, edge)


def test_frames_whose_numbers_step_like_their_stamps_are_one_capture() -> None:
    assert _capture([1, 2, 5, 6], [70, 71, 74, 75], [0, 1, 4, 5]) == slice(0, 4)


@pytest.mark.parametrize("after", [[900, 901], [2, 3]], ids=["forward", "backward"])
def test_numbers_that_jump_while_the_stamps_go_on_are_preview(after: list[int]) -> None:
    numbers = [811, 812, 813, 1, 2, 3, 4, *after]
    arrival = list(range(-3, 6))
    assert _capture(numbers, list(range(50, 59)), arrival) == slice(3, 7)


def test_stamps_that_start_anew_with_the_capture_separate_it_too() -> None:
    assert _capture([811, 812, 1, 2, 3, 901], [50, 51, 0, 1, 2, 54], [-2, -1, 0, 1, 2, 3]) == slice(2, 5)


def test_stamps_that_stand_still_leave_the_numbers_alone_to_tell() -> None:
    assert _capture([811, 812, 1, 2, 9, 10], [0] * 6, [-2, -1, 0, 1, 8, 9]) == slice(2, 6)


def test_of_two_captures_the_one_at_the_edge_counts() -> None:
    assert _capture([1, 2, 3, 1, 2], [1, 2, 3, 4, 5], [0, 1, 2, 300, 301], edge=3.0) == slice(3, 5)


def test_a_fall_where_the_capture_ends_gives_the_clock_ratio() -> None:
    ratio, sd = clock_ratio(SyncEdges(2.0, 1e-3 / np.sqrt(12), 2.0 + 30.0 * (1 + 40e-6)), 3000, 100.0)
    assert ratio - 1 == pytest.approx(40e-6, abs=4e-6)
    assert sd < DRIFT_PRIOR_SD / 3


def test_a_fall_elsewhere_is_not_the_end_of_the_capture() -> None:
    assert clock_ratio(SyncEdges(2.0, 3e-4, 2.1), 3000, 100.0) == (1.0, DRIFT_PRIOR_SD)
    assert clock_ratio(SyncEdges(2.0, 3e-4, None), 3000, 100.0) == (1.0, DRIFT_PRIOR_SD)


def test_the_lag_of_a_record_grows_with_its_time() -> None:
    lag = LagUncertainty(edge=3e-4, declared=4e-4, drift=50e-6)
    assert lag.common(0.0) == pytest.approx(4e-4)
    assert lag.total(0.0) == pytest.approx(5e-4)
    assert lag.total(20.0) == pytest.approx(np.sqrt(25e-8 + 1e-6))

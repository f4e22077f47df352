"""The edge, the capture's frames, and one clock against the other."""

from __future__ import annotations

import numpy as np
import pytest

from fitting.results.codes import RejectionCode
from fitting.trial.clock_fit import early_edge, fit_clock, stop_window
from fitting.trial.clocks import DRIFT_PRIOR_SD, LARGEST_DRIFT, LagUncertainty, SyncEdges, capture_frames
from fitting.trial.sync_line import find_edges, find_fall
from recordings.manifest import Timing
from tests.fitting.refusals import raises_refusal

time = np.arange(4000) / 1000
END_OF_FRAME = stop_window(Timing(stop_edge="end_of_frame"), 0.01)


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
    ("level", "code"),
    [
        (_line(), RejectionCode.SYNC_NEVER_RISES),
        (5.0 - _line((1.0, 3.0)), RejectionCode.SYNC_INVERTED),
        (_line((1.0, 1.5), (2.0, 3.0)), RejectionCode.SYNC_RISES_AGAIN),
        (np.full(len(time), np.nan), RejectionCode.SYNC_NOT_FINITE),
    ],
)
def test_a_sync_line_without_a_single_start_is_refused(level: np.ndarray, code: RejectionCode) -> None:
    with raises_refusal(code):
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


def test_with_constant_stamps_the_numbers_alone_decide() -> None:
    assert _capture([811, 812, 1, 2, 9, 10], [0] * 6, [-2, -1, 0, 1, 8, 9]) == slice(2, 6)


def test_of_two_captures_the_one_at_the_edge_counts() -> None:
    assert _capture([1, 2, 3, 1, 2], [1, 2, 3, 4, 5], [0, 1, 2, 300, 301], edge=3.0) == slice(3, 5)


def _seen(start: float, ratio: float, capture: float, interval: float) -> SyncEdges:
    """Both edges as a DAQ sees them that samples every `interval` [s]."""
    middle = interval * (np.floor(np.array([start, start + ratio * capture]) / interval) + 0.5)
    sd = interval / np.sqrt(12)
    return SyncEdges(float(middle[0]), sd, float(middle[1]), sd)


def test_a_fall_where_the_capture_ends_gives_the_clock_ratio() -> None:
    clock = fit_clock(_seen(2.0001, 1 + 40e-6, 30.0, 1e-3), 30.0, END_OF_FRAME)
    assert clock.has_both_edges
    assert clock.ratio - 1 == pytest.approx(40e-6, abs=3 * np.sqrt(clock.covariance[1, 1]))
    assert np.sqrt(clock.covariance[1, 1]) < DRIFT_PRIOR_SD / 3


@pytest.mark.parametrize(("interval", "capture"), [(1e-3, 30.0), (0.05, 30.013), (1e-5, 30.0)])
def test_session_time_is_as_uncertain_as_the_clock_says(interval: float, capture: float) -> None:
    random, off = np.random.default_rng(3), []
    for _ in range(200):
        start, ratio = random.uniform(0, 9), 1 + LARGEST_DRIFT * random.uniform(-1, 0.2)  # no frame may be missing
        clock = fit_clock(_seen(start, ratio, capture, interval), capture, END_OF_FRAME)
        for time in (0.0, capture / 2, capture):
            moment = clock.session_time(np.array([start + ratio * time]))[0] - time
            off.append(moment / clock.time_sd(time))
    assert np.sqrt(np.mean(np.square(off))) == pytest.approx(1.0, abs=0.12)


def test_a_capture_of_no_whole_number_of_samples_pins_the_edge_between_them() -> None:
    """At 20 Hz either edge alone leaves 14 ms; a capture that ends 0.025 s into a sample leaves less."""
    clock = fit_clock(_seen(2.04, 1.0, 30.025, 0.05), 30.025, END_OF_FRAME)
    assert clock.time_sd(15.0) < 0.75 * 0.05 / np.sqrt(12)
    assert not clock.is_identified, "a sample of 50 ms is 1667 ppm of 30 s"


@pytest.mark.parametrize("falling", [2.1, None])
def test_a_fall_elsewhere_is_not_the_end_of_the_capture(falling: float | None) -> None:
    clock = fit_clock(SyncEdges(2.0, 3e-4, falling, 3e-4), 30.0, END_OF_FRAME)
    assert (clock.start, clock.ratio, clock.has_both_edges) == (2.0, 1.0, False)
    assert clock.time_sd(20.0) == pytest.approx(np.hypot(3e-4, 20 * DRIFT_PRIOR_SD))


def test_an_edge_that_starts_the_acquisition_is_sample_zero_and_its_fall_is_seen() -> None:
    edges = find_fall(time, _line((-1.0, 3.0)), 2.5)
    assert (edges.rising, edges.rising_sd, edges.falling) == (0.0, 0.0, pytest.approx(2.9995))
    assert find_fall(time, _line((-1.0, 9.0)), 2.5).falling is None
    clock = fit_clock(edges, 3.0, END_OF_FRAME)
    assert clock.has_both_edges
    assert clock.start == pytest.approx(0.0, abs=1e-9)


def test_the_uncertainty_of_time_is_stated_in_newtons_and_metres() -> None:
    clock = fit_clock(SyncEdges(0.0, 3e-4, None), None, END_OF_FRAME)
    errors = clock.errors(20.0, force_rate=75.0, speed=0.01)
    assert errors.time == pytest.approx(np.hypot(3e-4, 1e-3))
    assert errors.force == pytest.approx(75 * errors.time)
    assert errors.displacement == pytest.approx(0.01 * errors.time)


def test_the_lag_of_a_record_grows_with_its_time() -> None:
    lag = LagUncertainty(edge=3e-4, declared=4e-4, drift=50e-6)
    assert lag.common(0.0) == pytest.approx(4e-4)
    assert lag.total(0.0) == pytest.approx(5e-4)
    assert lag.total(20.0) == pytest.approx(np.sqrt(25e-8 + 1e-6))


def test_drift_counts_from_where_the_lag_was_calibrated() -> None:
    lag = LagUncertainty(edge=0.0, declared=1e-4, drift=50e-6, since=15.0)
    assert lag.common(15.0) == pytest.approx(1e-4)
    assert lag.common(5.0) == lag.common(25.0)


@pytest.mark.parametrize(
    ("falling", "late", "early"),
    [
        (10.3, 0.29, 0.3),  # frames fall short of the pulse by what the host saw frame 1 come late
        (10.3, 0.01, 0.0),  # they are missing at the end
        (10.003, 0.05, 0.0),  # clocks 200 ppm apart explain it, and half a frame is nothing
        (10.0, 0.2, 0.0),  # the host was late, the frames were not
        (None, 0.3, 0.0),
    ],
)
def test_an_edge_before_the_first_frame_takes_two_witnesses(falling: float | None, late: float, early: float) -> None:
    edges = SyncEdges(0.0, 3e-4, falling, 3e-4)
    assert early_edge(edges, 10.0, 0.01, late) == pytest.approx(early)

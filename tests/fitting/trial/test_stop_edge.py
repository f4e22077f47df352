"""The interval of the clock ratio covers, wherever the line falls in the last frame and whichever clock drifts."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.stop_edge import DRIFTS_PPM, coverage
from fitting.trial.clock_fit import fit_clock, stop_window
from fitting.trial.clocks import LARGEST_DRIFT
from recordings.manifest import Timing
from tests.fitting.trial.stopped_capture import STOPS, Stop, stopped_capture

TRIALS = 100


@pytest.mark.parametrize("stop", STOPS)
def test_a_declared_stop_edge_is_covered_as_stated(stop: Stop) -> None:
    cells = [coverage(stop, daq, camera, TRIALS, is_declared=True) for daq, camera in DRIFTS_PPM]
    assert 0.93 <= np.mean([cell.covered for cell in cells]) <= 0.97
    assert min(cell.covered for cell in cells) >= 0.86, "four standard errors of a hundred trials"


@pytest.mark.parametrize("stop", STOPS)
def test_an_unknown_stop_edge_is_covered_at_least_as_stated(stop: Stop) -> None:
    cells = [coverage(stop, daq, camera, TRIALS, is_declared=False) for daq, camera in DRIFTS_PPM]
    assert np.mean([cell.covered for cell in cells]) >= 0.93
    assert min(cell.covered for cell in cells) >= 0.86
    assert max(cell.worst for cell in cells) < 4.0, "standard uncertainties"


def test_a_wrong_declaration_is_not_covered() -> None:
    """So that the tests above can fail."""
    random, covered = np.random.default_rng(5), 0
    for _ in range(TRIALS):
        capture = stopped_capture(random, "anywhere")
        clock = fit_clock(capture.edges, capture.duration, stop_window(Timing(stop_edge="end_of_frame"), capture.frame))
        low, high = clock.drift_ci95 or (0.0, 0.0)
        covered += low <= capture.drift <= high
    assert covered < 0.5 * TRIALS


@pytest.mark.parametrize("stop", STOPS)
def test_clocks_of_crystals_are_identified_where_the_stop_edge_is_declared(stop: Stop) -> None:
    cells = [coverage(stop, daq, camera, 30, is_declared=True) for daq, camera in DRIFTS_PPM[:3]]
    assert all(cell.identified > 0.95 for cell in cells)


def test_a_ratio_cut_by_the_largest_possible_drift_is_not_identified() -> None:
    """5 s of a line that falls 3 ms before its frame ends: -600 to +1400 ppm are possible."""
    random = np.random.default_rng(1)
    while (capture := stopped_capture(random, "end_of_frame")).frame != 0.01:
        pass
    edges = capture.edges
    short = type(edges)(edges.rising, edges.rising_sd, edges.rising + 4.997, edges.falling_sd)
    clock = fit_clock(short, 5.0, stop_window(Timing(), 0.01))
    assert not clock.is_identified
    assert clock.drift_ci95 == (-LARGEST_DRIFT, LARGEST_DRIFT)
    declared = fit_clock(short, 5.0, stop_window(Timing(stop_edge="end_of_exposure", exposure_s=7e-3), 0.01))
    assert declared.is_identified
    assert declared.drift_ci95 is not None
    assert declared.drift_ci95[0] < 0 < declared.drift_ci95[1]


def test_a_drift_beyond_crystals_is_not_identified_where_one_missing_frame_explains_it() -> None:
    """300 ppm of 30 s are 9 ms; the camera could as well have taken 3001 frames."""
    random = np.random.default_rng(2)
    edges = stopped_capture(random, "end_of_frame").edges
    later = type(edges)(edges.rising, edges.rising_sd, edges.rising + 30.009, edges.falling_sd)
    clock = fit_clock(later, 30.0, stop_window(Timing(stop_edge="end_of_frame"), 0.01))
    assert (clock.is_identified, clock.missing_frames) == (False, 1)
    low, high = clock.drift_ci95 or (0.0, 0.0)
    assert low < -33e-6 and high > 300e-6
    earlier = type(edges)(edges.rising, edges.rising_sd, edges.rising + 29.991, edges.falling_sd)
    assert fit_clock(earlier, 30.0, stop_window(Timing(stop_edge="end_of_frame"), 0.01)).is_identified

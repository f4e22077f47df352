"""The interval of the clock ratio covers, wherever the line falls in the last frame and whichever clock drifts.

Captures are independent of the estimator: everything happens on a third, true time axis, on which both quartz clocks
run fast or slow. The camera counts its own seconds, the DAQ samples the line's voltage by its own, and only those
samples and the number of frames are handed on.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import pytest

from fitting.trial.clock_fit import fit_clock, stop_window
from fitting.trial.clocks import LARGEST_DRIFT, SyncEdges
from fitting.trial.sync_line import find_edges
from recordings.manifest import Timing

Stop = Literal["end_of_frame", "end_of_exposure", "anywhere"]
STOPS: tuple[Stop, ...] = ("end_of_frame", "end_of_exposure", "anywhere")
EXPOSURE = 4e-4
SAMPLE_RATE = 1000.0
FRAME_RATES = (85.0, 100.0, 120.0, 179.0, 200.0)
"""QTM takes any whole number; most of these do not divide the DAQ's samples evenly."""
TEMPERATURE_SD = 3e-6
"""Seconds a second by which a quartz changes from one trial to the next."""
TRIALS = 100
DRIFTS_PPM = ((0, 0), (50, 0), (0, 50), (300, 0), (0, 300))
"""Of the DAQ's clock and of the camera's."""


@dataclass(frozen=True)
class Cell:
    """Parts of the trials whose interval held the truth, and whose ratio was identified; largest error in standard
    uncertainties.
    """

    covered: float
    identified: float
    worst: float


@dataclass(frozen=True)
class StoppedCapture:
    """What the DAQ saw, how many frames of which length came, and the true drift of the DAQ against the camera."""

    edges: SyncEdges
    frames: int
    frame: float
    drift: float

    @property
    def duration(self) -> float:
        """[s] of the camera's clock that the frames last."""
        return self.frames * self.frame


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


def coverage(stop: Stop, daq_ppm: float, camera_ppm: float, trials: int, *, is_declared: bool) -> Cell:
    """Coverage over a number of simulated trials."""
    random = np.random.default_rng([STOPS.index(stop), int(daq_ppm), int(camera_ppm)])
    timing = Timing(stop_edge=stop, exposure_s=EXPOSURE) if is_declared else Timing()
    covered, identified, errors = [], [], []
    for _ in range(trials):
        capture = stopped_capture(random, stop, daq_ppm, camera_ppm)
        clock = fit_clock(capture.edges, capture.duration, stop_window(timing, capture.frame))
        low, high = clock.drift_ci95 or (np.nan, np.nan)
        covered.append(low <= capture.drift <= high)
        identified.append(clock.is_identified)
        errors.append(abs(clock.ratio - 1 - capture.drift) / np.sqrt(clock.covariance[1, 1]))
    return Cell(float(np.mean(covered)), float(np.mean(identified)), float(np.max(errors)))


def stopped_capture(
    random: np.random.Generator, stop: Stop, daq_ppm: float = 0.0, camera_ppm: float = 0.0
) -> StoppedCapture:
    """One trial of 20 to 70 s; both clocks run fast by their parts per million."""
    daq, camera = (1 + 1e-6 * ppm + random.normal(0, TEMPERATURE_SD) for ppm in (daq_ppm, camera_ppm))
    rate = float(random.choice(FRAME_RATES))
    count = int(random.uniform(20, 70) * rate)
    last_exposure_begins = (count - 1) / rate
    high_for = {
        "end_of_frame": count / rate,
        "end_of_exposure": last_exposure_begins + EXPOSURE,
        "anywhere": last_exposure_begins + random.uniform(0, 1 / rate),
    }[stop]
    rises = random.uniform(2.0, 2.5)
    falls = rises + high_for / camera
    near = [np.arange(at * daq * SAMPLE_RATE - 60, at * daq * SAMPLE_RATE + 60) // 1 for at in (rises, falls)]
    numbers = np.concatenate(([0.0], *near))  # the samples between are high, and change nothing
    is_high = (numbers / SAMPLE_RATE / daq >= rises) & (numbers / SAMPLE_RATE / daq < falls)
    volts = 5.0 * is_high + random.normal(0, 5e-3, len(numbers))
    return StoppedCapture(find_edges(numbers / SAMPLE_RATE, volts, 2.5), count, 1 / rate, daq / camera - 1)

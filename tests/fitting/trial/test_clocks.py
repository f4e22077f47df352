"""The edge, the capture's frames, one clock against the other, and coverage of the interval of the clock ratio.

Captures are independent of the estimator: everything happens on a third, true time axis, on which both quartz clocks
run fast or slow. The camera counts its own seconds, the DAQ samples the line's voltage by its own, and only those
samples and the number of frames are handed on.
"""

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
import pytest

from fitting.results.trial_codes import TrialNoteCode
from fitting.trial.clocks import (
    DRIFT_PRIOR_SD,
    LARGEST_DRIFT,
    ClockFit,
    LagUncertainty,
    StopWindow,
    SyncEdges,
    capture_frames,
    early_edge,
    early_notes,
    find_edges,
    fit_clock,
    stop_contradiction,
    stop_notes,
    stop_window,
)
from recordings.manifest import Timing

END_OF_FRAME = stop_window(Timing(stop_edge="end_of_frame"), 0.01)
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


def _capture(numbers: list[int], stamps: list[float], arrival: list[float], edge: float = 0.0) -> slice:
    """Numbers, stamps in frames, and arrival in frames, at 100 Hz."""
    seconds = [np.array(frames, float) / 100 for frames in (stamps, arrival)]
    return capture_frames(np.array(numbers), *seconds, 100.0, edge)


@pytest.mark.parametrize(
    ("numbers", "stamps", "arrival", "edge", "expected"),
    [
        ([1, 2, 5, 6], [70, 71, 74, 75], [0, 1, 4, 5], 0.0, slice(0, 4)),
        ([811, 812, 1, 2, 3, 901], [50, 51, 0, 1, 2, 54], [-2, -1, 0, 1, 2, 3], 0.0, slice(2, 5)),
        ([811, 812, 1, 2, 9, 10], [0] * 6, [-2, -1, 0, 1, 8, 9], 0.0, slice(2, 6)),
        ([1, 2, 3, 1, 2], [1, 2, 3, 4, 5], [0, 1, 2, 300, 301], 3.0, slice(3, 5)),
        ([811, 812, 813, 1, 2, 3, 4, 900, 901], [*range(50, 59)], [*range(-3, 6)], 0.0, slice(3, 7)),
        ([811, 812, 813, 1, 2, 3, 4, 2, 3], [*range(50, 59)], [*range(-3, 6)], 0.0, slice(3, 7)),
        ([1, 2, 2, 3], [1, 2, 2, 3], [0, 1, 1, 2], 0.0, slice(0, 4)),
        ([1, 2, 3, 4, 5], [1, 2, 3, 5.5, 6.5], [0, 1, 2, 3, 4], 0.0, slice(0, 5)),
        ([1, 2, 3, 4, 5], [1, 2, 3, 6, 7], [0, 1, 2, 3, 4], 0.0, slice(0, 3)),
    ],
    ids=[
        "numbers step like stamps",
        "stamps start anew",
        "constant stamps",
        "the second of two, at the edge",
        "preview after it, numbers jump forward",
        "preview after it, numbers jump backward",
        "a frame sent twice",
        "stamps ahead by 1.5 frames",
        "stamps ahead by 2 frames",
    ],
)
def test_the_frames_of_a_capture_are_those_whose_numbers_step_like_their_stamps(
    numbers: list[int], stamps: list[float], arrival: list[float], edge: float, expected: slice
) -> None:
    assert _capture(numbers, stamps, arrival, edge) == expected


def _seen(start: float, ratio: float, capture: float, interval: float) -> SyncEdges:
    """Both edges as a DAQ sees them that samples every `interval` [s]."""
    middle = interval * (np.floor(np.array([start, start + ratio * capture]) / interval) + 0.5)
    sd = interval / np.sqrt(12)
    return SyncEdges(float(middle[0]), sd, float(middle[1]), sd)


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
    assert (clock.start, clock.ratio, clock.has_both_edges, clock.is_identified) == (2.0, 1.0, False, False)
    assert clock.time_sd(20.0) == pytest.approx(np.hypot(3e-4, 20 * DRIFT_PRIOR_SD))
    assert LagUncertainty(0.0, 0.0, 0.0).value == 0.0
    assert (clock.common_drift, clock.missing_frames, SyncEdges(5.0, 3e-4, None).falling_sd) == (0.0, 0, 0.0)


def test_the_lag_of_a_record_grows_with_its_time() -> None:
    lag = LagUncertainty(edge=3e-4, declared=4e-4, drift=50e-6)
    assert lag.common(0.0) == pytest.approx(4e-4)
    assert lag.total(0.0) == pytest.approx(5e-4)
    assert lag.total(20.0) == pytest.approx(np.sqrt(25e-8 + 1e-6))
    calibrated = LagUncertainty(edge=0.0, declared=1e-4, drift=50e-6, since=15.0)
    assert calibrated.common(15.0) == pytest.approx(1e-4)
    assert calibrated.common(5.0) == calibrated.common(25.0)


RISE, FALL, CAPTURE = 1e-3, 2e-3, 40.0
"""Sampling intervals at the two edges, and the duration of the frames [s]."""


def pulse(excess: float, capture: float = CAPTURE) -> SyncEdges:
    """A pulse that is longer than the frames by excess [s]."""
    return SyncEdges(5.0, RISE / 12**0.5, 5.0 + capture + excess, FALL / 12**0.5)


def triangle(part: float, half_width: float) -> float:
    """Quantile of the sum of two equal uniform variables."""
    return half_width * ((2 * part) ** 0.5 - 1)


@pytest.mark.parametrize("width", [0.0, 0.01])
def test_start_and_ratio_have_the_moments_of_edges_between_two_samples(width: float) -> None:
    """drift × capture = excess + fall − start − stop, all three uniform and independent."""
    clock = fit_clock(pulse(8e-4), CAPTURE, StopWindow(-width, 0.0, 0.01, is_declared=True))
    assert clock.start == pytest.approx(5.0, abs=1e-8)
    assert clock.ratio - 1 == pytest.approx((8e-4 + width / 2) / CAPTURE, abs=1.1e-6 / CAPTURE)
    spread = np.array([RISE**2, RISE**2 + FALL**2 + width**2]) / 12
    assert clock.covariance[0, 0] == pytest.approx(spread[0], rel=1e-6)
    assert clock.covariance[1, 1] == pytest.approx(spread[1] / CAPTURE**2, rel=2e-5)
    assert clock.covariance[0, 1] == clock.covariance[1, 0] == pytest.approx(-spread[0] / CAPTURE, rel=1e-4)
    assert (clock.common_drift, clock.missing_frames, clock.is_identified) == (0.0, 0, True)


@pytest.mark.parametrize("is_declared", [True, False])
def test_the_interval_of_the_drift_has_the_quantiles_of_both_edges(is_declared: bool) -> None:
    """Without a declaration it covers both ends of the last frame, with 95 % for either."""
    edges = SyncEdges(5.0, RISE / 12**0.5, 5.0 + CAPTURE + 8e-4, RISE / 12**0.5)
    clock = fit_clock(edges, CAPTURE, StopWindow(0.0 if is_declared else -0.01, 0.0, 0.01, is_declared))
    assert clock.drift_ci95 is not None
    low, high = (8e-4 + triangle(0.025 if is_declared else 0.05, RISE) * sign for sign in (1, -1))
    expected = np.array([low, high if is_declared else high + 0.01]) / CAPTURE
    np.testing.assert_allclose(clock.drift_ci95, expected, atol=2e-6 / CAPTURE)
    assert clock.common_drift == pytest.approx(0.0 if is_declared else 0.01 / CAPTURE / 12**0.5)


def test_the_common_part_of_a_drift_that_is_cut_is_at_most_the_whole() -> None:
    clock = fit_clock(pulse(0.0, 2.0), 2.0, StopWindow(-0.01, 0.0, 0.01, is_declared=False))
    assert clock.common_drift == pytest.approx(np.sqrt(clock.covariance[1, 1]))
    assert not clock.is_identified


def test_a_drift_that_is_cut_on_one_side_is_not_identified() -> None:
    clock = fit_clock(pulse(-1e-4, 0.5), 0.5, END_OF_FRAME)
    assert clock.drift_ci95 == (-LARGEST_DRIFT, LARGEST_DRIFT) and not clock.is_identified
    edges = SyncEdges(5.0, 1e-5, 5.0 + 0.5 - 2.4e-4, 1e-5)
    clock = fit_clock(edges, 0.5, END_OF_FRAME)
    assert clock.has_both_edges and not clock.is_identified
    assert clock.drift_ci95 is not None and clock.drift_ci95[0] == -LARGEST_DRIFT < clock.drift_ci95[1] < LARGEST_DRIFT


def test_as_many_frames_are_missing_as_crystals_need() -> None:
    """21 ms of 60 s are 350 ppm, with one frame of 10 ms more 183, with two 17; crystals differ by up to 150."""
    assert fit_clock(pulse(0.021, 60.0), 60.0, END_OF_FRAME).missing_frames == 2
    sharp = SyncEdges(5.0, 1e-6, 5.0 + 30.015, 1e-6)
    assert fit_clock(sharp, 30.0, END_OF_FRAME).missing_frames == 0, "1 leaves 167 ppm, 2 leave -167"
    clock = fit_clock(pulse(0.009, 30.0), 30.0, END_OF_FRAME)
    assert (clock.is_identified, clock.missing_frames) == (False, 1), "300 ppm of 30 s are 9 ms"
    assert clock.drift_ci95 is not None and clock.drift_ci95[0] < -33e-6 and clock.drift_ci95[1] > 300e-6
    assert fit_clock(pulse(-0.009, 30.0), 30.0, END_OF_FRAME).is_identified, "the line does not fall before its frames"


def test_the_largest_error_of_time_may_be_that_of_the_start() -> None:
    clock = ClockFit(0.0, 1.0, np.array([[1e-6, -9e-7], [-9e-7, 1e-6]]), has_both_edges=True)
    assert clock.largest_time_sd(1.0) == pytest.approx(1e-3)
    clock = fit_clock(SyncEdges(0.0, 3e-4, None), None, END_OF_FRAME)
    assert clock.largest_time_sd(20.0) == pytest.approx(np.hypot(3e-4, 1e-3)), "or that of the end, if it may drift"


@pytest.mark.parametrize(
    ("timing", "expected"),
    [
        (Timing(stop_edge="end_of_frame"), StopWindow(0.0, 0.0, 0.01, is_declared=True)),
        (Timing(stop_edge="end_of_exposure", exposure_s=0.004), StopWindow(-0.006, -0.006, 0.01, is_declared=True)),
        (Timing(stop_edge="anywhere"), StopWindow(-0.01, 0.0, 0.01, is_declared=True)),
        (Timing(), StopWindow(-0.01, 0.0, 0.01, is_declared=False)),
    ],
)
def test_the_window_of_the_stop_edge_is_as_declared(timing: Timing, expected: StopWindow) -> None:
    assert stop_window(timing, 0.01) == expected


EXPLAINED = 10.0 * LARGEST_DRIFT + (RISE + FALL) / 2
"""What drift and sampling explain in 10 s [s]."""
JUST = 1e-7


@pytest.mark.parametrize(
    ("excess", "contradiction"),
    [
        (EXPLAINED - JUST, 0.0),
        (EXPLAINED + JUST, EXPLAINED + JUST),
        (0.1 + EXPLAINED - JUST, 0.0),  # a whole frame more
        (0.12, 0.02),
        (-0.1 - EXPLAINED + JUST, 0.0),
        (-0.1 - EXPLAINED - JUST, -0.1 - EXPLAINED - JUST),
    ],
)
def test_a_stop_edge_contradicts_the_frames_beyond_drift_sampling_and_its_window(
    excess: float, contradiction: float
) -> None:
    stop = StopWindow(-0.1, 0.0, 0.1, is_declared=False)
    assert stop_contradiction(pulse(excess, 10.0), 10.0, stop) == pytest.approx(contradiction, abs=1e-12)
    assert stop_contradiction(SyncEdges(5.0, 0.0, None), 10.0, stop) == 0.0


@pytest.mark.parametrize(
    ("short", "frame", "late", "is_early"),
    [
        (0.05 + JUST, 0.1, 0.03, True),
        (0.05 - JUST, 0.1, 0.03, False),
        (EXPLAINED + JUST, 0.01, 0.03, True),
        (EXPLAINED - JUST, 0.01, 0.03, False),
        (0.08, 0.01, 0.04 + JUST, True),
        (0.08, 0.01, 0.04 - JUST, False),
    ],
)
def test_frames_are_missing_at_the_start_beyond_half_a_frame_drift_and_half_the_delay(
    short: float, frame: float, late: float, is_early: bool
) -> None:
    assert early_edge(SyncEdges(5.0, 0.0, None), 10.0, frame, 9.0) == 0.0
    found = early_edge(pulse(short, 10.0), 10.0, frame, late)
    assert found == pytest.approx(short if is_early else 0.0, abs=1e-12)


def test_notes_on_the_sync_line_have_their_figures() -> None:
    (early,) = early_notes(0.3)
    assert (early.code, early.figures) == (TrialNoteCode.SYNC_BEFORE_FRAMES, {"early_s": 0.3}) and not early_notes(0.0)
    cut = fit_clock(pulse(0.0, 2.0), 2.0, StopWindow(-0.01, 0.0, 0.01, is_declared=False))
    (open_,) = stop_notes(7.0, cut, 0.0)
    assert (open_.code, open_.figures) == (TrialNoteCode.CLOCKS_OPEN, {"limit": LARGEST_DRIFT})
    for contradiction, name in ((-0.2, "before_end_s"), (0.2, "between_frames_s")):
        (note,) = stop_notes(7.0, cut, contradiction)
        assert (note.code, note.figures) == (TrialNoteCode.SYNC_CONTRADICTION, {name: 0.2, "limit": LARGEST_DRIFT})
    assert stop_notes(None, cut, 0.2) == ()


class StoppedCapture(NamedTuple):
    """What the DAQ saw, how long all frames and one last [s], and the true drift of the DAQ against the camera."""

    edges: SyncEdges
    duration: float
    frame: float
    drift: float


@pytest.mark.slow
@pytest.mark.parametrize("stop", STOPS)
def test_a_declared_stop_edge_is_covered_as_stated(stop: Stop) -> None:
    covered, *_ = coverage(stop, DRIFTS_PPM, TRIALS, is_declared=True)
    assert 0.93 <= covered.mean() <= 0.97
    assert covered.min() >= 0.86, "four standard errors of a hundred trials"


@pytest.mark.slow
@pytest.mark.parametrize("stop", STOPS)
def test_an_unknown_stop_edge_is_covered_at_least_as_stated(stop: Stop) -> None:
    covered, _, errors = coverage(stop, DRIFTS_PPM, TRIALS, is_declared=False)
    assert covered.mean() >= 0.93 and covered.min() >= 0.86
    assert errors.max() < 4.0, "standard uncertainties"


@pytest.mark.slow
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
    covered, identified, _ = coverage(stop, DRIFTS_PPM[:3], 30, is_declared=True)
    assert identified.min() > 0.95
    assert covered.mean() >= 0.88, "three standard errors of 90 trials"


@pytest.mark.parametrize("late_s", [0.02, 0.045])
def test_edges_between_samples_at_twenty_hertz_are_no_sign_of_missing_frames(late_s: float) -> None:
    """Both edges may be half a sample, 25 ms, away from their middle, together the duration of five frames."""
    edges = stopped_capture(np.random.default_rng(2), "end_of_frame").edges
    coarse = type(edges)(edges.rising, 0.05 / 12**0.5, edges.rising + 30.0 + late_s, 0.05 / 12**0.5)
    clock = fit_clock(coarse, 30.0, stop_window(Timing(stop_edge="end_of_frame"), 0.01))
    assert (clock.is_identified, clock.missing_frames) == (False, 0)


def coverage(stop: Stop, drifts: Sequence[tuple[int, int]], trials: int, *, is_declared: bool) -> np.ndarray:
    """(3, drifts): parts of the trials whose interval held the truth and whose ratio was identified; largest error in
    standard uncertainties.
    """
    timing = Timing(stop_edge=stop, exposure_s=EXPOSURE) if is_declared else Timing()
    found = np.empty((3, len(drifts), trials))
    for i, ppm in enumerate(drifts):
        random = np.random.default_rng([STOPS.index(stop), *ppm])
        for trial in range(trials):
            capture = stopped_capture(random, stop, *ppm)
            clock = fit_clock(capture.edges, capture.duration, stop_window(timing, capture.frame))
            low, high = clock.drift_ci95 or (np.nan, np.nan)
            error = abs(clock.ratio - 1 - capture.drift) / np.sqrt(clock.covariance[1, 1])
            found[:, i, trial] = low <= capture.drift <= high, clock.is_identified, error
    return np.vstack((found[:2].mean(axis=-1), found[2:].max(axis=-1)))


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
    edges = find_edges(numbers / SAMPLE_RATE, volts, 2.5)
    return StoppedCapture(edges, count / rate, 1 / rate, daq / camera - 1)

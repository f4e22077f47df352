"""Fit the DAQ's clock to the mocap system's from the start and the stop edge of the sync line, with notes on
both edges.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fitting.results.codes import TrialNoteCode
from fitting.results.rendering import Note
from fitting.trial.clocks import CRYSTAL_LIMIT, DRIFT_PRIOR_SD, LARGEST_DRIFT, SyncEdges
from recordings.manifest import Timing

DRIFT_CELLS, START_CELLS = 800, 64
"""Cells of the grid on which the posterior is evaluated; this resolves 0.1 % of a sample."""


@dataclass(frozen=True)
class StopWindow:
    """The interval in which the stop edge lies, in seconds from the end of the last frame, with a uniform density.

    earliest, latest  [s] negative before the end of the frame
    frame             [s] the frame period
    is_declared       whether the configuration states the position; otherwise every position in the interval is equally
                      likely, and may be the same in all trials
    """

    earliest: float
    latest: float
    frame: float
    is_declared: bool

    def shifted(self, frames: int) -> StopWindow:
        """The same window, `frames` frames later."""
        later = frames * self.frame
        return replace(self, earliest=self.earliest + later, latest=self.latest + later)


def stop_window(timing: Timing, frame: float) -> StopWindow:
    """The window that the manifest declares, for a frame period of `frame` [s].

    Qualisys documents that the output MEASUREMENT TIME stays high "until the end of the last frame", which may be the
    end of its exposure or of its period. So any position in the last frame is possible, unless sync.stop_edge is set.
    """
    if timing.stop_edge == "end_of_frame":
        return StopWindow(0.0, 0.0, frame, is_declared=True)
    if timing.stop_edge == "end_of_exposure" and timing.exposure_s is not None:
        before_end = timing.exposure_s - frame
        return StopWindow(before_end, before_end, frame, is_declared=True)
    if timing.stop_edge == "anywhere":
        return StopWindow(-frame, 0.0, frame, is_declared=True)
    return StopWindow(-frame, 0.0, frame, is_declared=False)


@dataclass(frozen=True)
class SyncErrors:
    """Largest error of the time in a trial, and the resulting errors at the highest rates of change.

    time [s], force [N], displacement [m]: standard uncertainties
    """

    time: float
    force: float
    displacement: float


@dataclass(frozen=True)
class ClockFit:
    """The DAQ's clock relative to the mocap system's: DAQ time = start + ratio × session time.

    start           [s] of the DAQ's clock when the capture began
    ratio           DAQ seconds per mocap second
    covariance      (2, 2) of (start, ratio)
    has_both_edges  whether the stop edge was used
    drift_ci95      95 % interval of ratio − 1; None if the stop edge was not used
    is_identified   whether this interval is measured, and not limited by the largest possible drift
    common_drift    part of the ratio's standard uncertainty that may be common to all trials
    missing_frames  frames possibly missing at the end, if the ratio would otherwise exceed that of crystals
    """

    start: float
    ratio: float
    covariance: NDArray[np.float64]
    has_both_edges: bool
    drift_ci95: tuple[float, float] | None = None
    is_identified: bool = False
    common_drift: float = 0.0
    missing_frames: int = 0

    def session_time(self, daq_time: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n,) [s] on the DAQ's clock → (n,) s since the edge on the mocap system's."""
        return np.asarray((daq_time - self.start) / self.ratio)

    def time_sd(self, time: float) -> float:
        """Standard uncertainty [s] of a session time [s] that was read from the DAQ's clock."""
        lever = np.array([1.0, time])
        return math.sqrt(max(0.0, float(lever @ self.covariance @ lever)))

    def errors(self, duration: float, force_rate: float, speed: float) -> SyncErrors:
        """Errors in a trial of `duration` [s] with the highest rates `force_rate` [N/s] and `speed` [m/s]."""
        worst = max(self.time_sd(0.0), self.time_sd(duration))
        return SyncErrors(worst, worst * force_rate, worst * speed)


def fit_clock(edges: SyncEdges, capture: float | None, stop: StopWindow) -> ClockFit:
    """Start of the capture and rate of the DAQ's clock.

    capture [s] is the duration of the received frames on the mocap system's clock, None if unknown. Priors are uniform:
    the edges between two samples, the stop edge in its window, the drift up to LARGEST_DRIFT. Without a stop edge, or
    with one that no possible drift explains, the drift is assumed to be 0 ± DRIFT_PRIOR_SD.
    """
    if edges.falling is None or not capture or capture < 0:
        return _one_edge(edges)
    record = _Record(edges, capture, edges.falling - edges.rising - capture)
    interval = _interval(record, stop, 0)
    if interval[0] >= LARGEST_DRIFT or interval[1] <= -LARGEST_DRIFT:
        return _one_edge(edges)
    if missing := _missing_frames(record, stop):
        interval = _interval(record, stop, missing)
    is_cut = interval[0] < -LARGEST_DRIFT or interval[1] > LARGEST_DRIFT
    interval = max(interval[0], -LARGEST_DRIFT), min(interval[1], LARGEST_DRIFT)
    window = replace(stop, latest=stop.shifted(missing).latest)
    fit = record.moments(window)
    shared = 0.0 if stop.is_declared and not missing else (window.latest - window.earliest) / capture / math.sqrt(12)
    return replace(
        fit,
        drift_ci95=interval,
        is_identified=not is_cut and not missing,
        common_drift=min(shared, math.sqrt(fit.covariance[1, 1])),
        missing_frames=missing,
    )


def stop_contradiction(edges: SyncEdges, capture: float, stop: StopWindow) -> float:
    """Seconds by which the stop edge contradicts frames that last `capture` [s]; 0 without a contradiction.

    A contradiction is not explained by any drift up to LARGEST_DRIFT. It is negative if the line fell before the last
    frame was taken. If it fell later, whole frames may be missing, and only the remainder is a contradiction.
    """
    if edges.falling is None:
        return 0.0
    excess = edges.falling - edges.rising - capture
    tolerance = LARGEST_DRIFT * capture + math.sqrt(3) * (edges.rising_sd + edges.falling_sd)
    if excess > stop.latest + tolerance:
        excess -= stop.frame * round(excess / stop.frame)
    return excess if not stop.earliest - tolerance <= excess <= stop.latest + tolerance else 0.0


def early_edge(edges: SyncEdges, capture: float, frame: float, late: float) -> float:
    """Seconds by which the line rose before frame 1 was exposed; 0 without an indication of it.

    The frames, with a period of `frame` [s], last `capture` [s]. If this is shorter than the pulse, frames are missing
    at its start or its end. They are missing at the start if frame 1 arrived at the host late [s] by more than half of
    the difference. A difference that drift explains does not count.
    """
    short = 0.0 if edges.falling is None else edges.falling - edges.rising - capture
    explained = LARGEST_DRIFT * capture + math.sqrt(3) * (edges.rising_sd + edges.falling_sd)
    return short if short > max(frame / 2, explained) and late > short / 2 else 0.0


def _one_edge(edges: SyncEdges) -> ClockFit:
    return ClockFit(edges.rising, 1.0, np.diag([edges.rising_sd**2, DRIFT_PRIOR_SD**2]), has_both_edges=False)


def _missing_frames(record: _Record, stop: StopWindow) -> int:
    """Least number of missing frames with which the drift is that of crystals; 0 if none are needed or none suffice."""
    lowest, _ = record.support(stop)
    count = math.ceil((lowest - CRYSTAL_LIMIT) * record.capture / stop.frame)
    _, highest = record.support(stop.shifted(count))
    return count if count > 0 and highest >= -CRYSTAL_LIMIT else 0


@dataclass(frozen=True)
class _Record:
    """Both edges, the duration of the frames [s], and duration of the pulse minus that of the frames [s]."""

    edges: SyncEdges
    capture: float
    excess: float

    @property
    def _widths(self) -> tuple[float, float]:
        """Sampling intervals around the rising and the falling edge [s]."""
        return math.sqrt(12) * self.edges.rising_sd, max(math.sqrt(12) * self.edges.falling_sd, 1e-9)

    def support(self, stop: StopWindow) -> tuple[float, float]:
        """Lowest and highest drift that is compatible with the edges."""
        reach = sum(self._widths) / 2
        return (self.excess - stop.latest - reach) / self.capture, (self.excess - stop.earliest + reach) / self.capture

    def moments(self, stop: StopWindow) -> ClockFit:
        """Posterior means and covariance of start and ratio, with the drift within LARGEST_DRIFT."""
        low, high = (min(max(end, -LARGEST_DRIFT), LARGEST_DRIFT) for end in self.support(stop))
        drifts, starts, density = self._posterior(stop, low, high)
        of_drift, of_start = density.sum(axis=1), density.sum(axis=0)
        drift, start = float(of_drift @ drifts), float(of_start @ starts)
        off_drift, off_start = drifts - drift, starts - start
        shared = float(off_drift @ density @ off_start)
        cells = (high - low) / DRIFT_CELLS, self._widths[0] / START_CELLS
        variances = [float(of_start @ off_start**2) + cells[1] ** 2 / 12, float(of_drift @ off_drift**2)]
        covariance = np.array([[variances[0], shared], [shared, variances[1] + cells[0] ** 2 / 12]])
        return ClockFit(self.edges.rising + start, 1 + drift, covariance, has_both_edges=True)

    def quantiles(self, stop: StopWindow, *parts: float) -> tuple[float, ...]:
        """Quantiles of the posterior of the drift."""
        low, high = self.support(stop)
        _, _, density = self._posterior(stop, low, high)
        cumulated = np.append(0.0, np.cumsum(density.sum(axis=1)))
        return tuple(np.interp(parts, cumulated, np.linspace(low, high, DRIFT_CELLS + 1)).tolist())

    def _posterior(
        self, stop: StopWindow, low: float, high: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Drifts (n,), starts (m,) [s] after the middle of the rising edge, and their probabilities (n, m).

        excess + fall − start = drift capture + stop, where fall is the position of the stop edge between its two
        samples, and stop its position in the window. The density is the length of the intersection of both intervals.
        """
        rise, fall = self._widths
        drifts = low + (np.arange(DRIFT_CELLS) + 0.5) / DRIFT_CELLS * (high - low)
        starts = rise * ((np.arange(START_CELLS) + 0.5) / START_CELLS - 0.5)
        stops = self.excess - starts[None, :] - drifts[:, None] * self.capture  # for a fall at its middle
        latest = max(
            stop.latest, stop.earliest + 1e-3 * fall
        )  # a window without width becomes a thousandth of a sample
        density = np.minimum(latest, stops + fall / 2) - np.maximum(stop.earliest, stops - fall / 2)
        density = np.maximum(density, 0.0)
        return drifts, starts, density / density.sum()


def _interval(record: _Record, stop: StopWindow, missing: int) -> tuple[float, float]:
    """95 % interval of the drift.

    Central for a declared window. If two positions of the stop edge cannot be distinguished (both ends of a window that
    is not declared, or all frames received and some missing), the interval covers both, with 95 % for either.
    """
    early, late = stop, stop.shifted(missing)
    if not stop.is_declared:
        early, late = replace(early, latest=early.earliest), replace(late, earliest=late.latest)
    if early == late:
        low, high = record.quantiles(stop, 0.025, 0.975)
    else:
        (low,), (high,) = record.quantiles(late, 0.05), record.quantiles(early, 0.95)
    return low, high


def early_notes(early: float) -> tuple[Note, ...]:
    """A note if the sync line rose `early` [s] before the first frame was exposed."""
    return (Note(TrialNoteCode.SYNC_BEFORE_FRAMES, {"early_s": early}),) if early else ()


def stop_notes(falling: float | None, clock: ClockFit, contradiction: float) -> tuple[Note, ...]:
    """A note if the stop edge does not determine the clock ratio, or contradicts the number of frames [s]."""
    if falling is None:
        return ()
    if contradiction:
        name = "before_end_s" if contradiction < 0 else "between_frames_s"
        return (Note(TrialNoteCode.SYNC_CONTRADICTION, {name: abs(contradiction), "limit": LARGEST_DRIFT}),)
    if not clock.has_both_edges:
        return (Note(TrialNoteCode.SYNC_MISSING_FRAMES),)
    if clock.missing_frames:
        figures = {"limit": CRYSTAL_LIMIT, "frames": clock.missing_frames}
        return (Note(TrialNoteCode.CLOCKS_OR_FRAMES, figures),)
    if not clock.is_identified:
        return (Note(TrialNoteCode.CLOCKS_OPEN, {"limit": LARGEST_DRIFT}),)
    return ()

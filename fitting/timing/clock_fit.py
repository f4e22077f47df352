"""The DAQ's clock against the mocap system's, from the start and the stop edge of the sync line."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fitting.timing.clocks import CRYSTAL_LIMIT, DRIFT_PRIOR_SD, LARGEST_DRIFT, SyncEdges
from fitting.timing.stop_edge import StopWindow

DRIFT_CELLS, START_CELLS = 800, 64
"""Cells of the grid on which the posterior is summed: 0.1 % of a sample."""


@dataclass(frozen=True)
class SyncErrors:
    """Error of the time at the worst moment of a trial, and what it makes of the fastest samples.

    time [s], force [N], displacement [m]: standard uncertainties
    """

    time: float
    force: float
    displacement: float


@dataclass(frozen=True)
class ClockFit:
    """The DAQ's clock against the mocap system's: DAQ time = start + ratio × session time.

    start           [s] of the DAQ's clock when the capture began
    ratio           DAQ seconds in a mocap second
    covariance      (2, 2) of (start, ratio)
    has_both_edges  whether the stop edge was used
    drift_ci95      95 % interval of ratio − 1; None where the stop edge was not used
    is_identified   whether that interval is measured, and not cut by the largest drift that is taken to be possible
    common_drift    part of the ratio's standard uncertainty that may be the same in all trials
    missing_frames  how many frames may be missing at the end, as the ratio alone would be beyond crystals
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
        """Of a trial of `duration` [s] with the highest rates `force_rate` [N/s] and `speed` [m/s]."""
        worst = max(self.time_sd(0.0), self.time_sd(duration))
        return SyncErrors(worst, worst * force_rate, worst * speed)


def fit_clock(edges: SyncEdges, capture: float | None, stop: StopWindow) -> ClockFit:
    """Start of the capture and rate of the DAQ's clock.

    capture [s] is the duration of the received frames on the mocap system's clock, None if that is not known. Each
    edge lies anywhere between two samples, the stop edge anywhere in its window, and every drift up to LARGEST_DRIFT
    is as likely as the others: the estimate is the data's alone. Without a stop edge, or with one that no drift
    explains, the drift is 0 ± DRIFT_PRIOR_SD by assumption.
    """
    if edges.falling is None or not capture or capture < 0:
        return _one_edge(edges)
    record = _Record(edges, capture, edges.falling - edges.rising - capture)
    interval = _interval(record, stop, 0)
    if interval[0] >= LARGEST_DRIFT or interval[1] <= -LARGEST_DRIFT:
        return _one_edge(edges)
    missing = _missing_frames(record, stop)
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


def _one_edge(edges: SyncEdges) -> ClockFit:
    return ClockFit(edges.rising, 1.0, np.diag([edges.rising_sd**2, DRIFT_PRIOR_SD**2]), has_both_edges=False)


def _missing_frames(record: _Record, stop: StopWindow) -> int:
    """Least number of missing frames with which crystals explain the stop edge; 0 where none are needed, or none do."""
    tolerance = CRYSTAL_LIMIT * record.capture
    count = math.ceil((record.excess - stop.latest - tolerance) / stop.frame)
    explains = record.excess - stop.shifted(count).earliest >= -tolerance
    return count if count > 0 and explains else 0


@dataclass(frozen=True)
class _Record:
    """Both edges, the duration of the frames [s], and by how much the pulse is longer [s]."""

    edges: SyncEdges
    capture: float
    excess: float

    @property
    def _widths(self) -> tuple[float, float]:
        """Of the intervals between the two samples around either edge [s]."""
        return math.sqrt(12) * self.edges.rising_sd, max(math.sqrt(12) * self.edges.falling_sd, 1e-9)

    def support(self, stop: StopWindow) -> tuple[float, float]:
        """Lowest and highest drift that the edges leave possible."""
        reach = sum(self._widths) / 2
        return (self.excess - stop.latest - reach) / self.capture, (self.excess - stop.earliest + reach) / self.capture

    def moments(self, stop: StopWindow) -> ClockFit:
        """Means and covariance of start and ratio, with the drift within LARGEST_DRIFT."""
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

    def quantile(self, stop: StopWindow, part: float) -> float:
        """The drift below which `part` of its distribution lies."""
        low, high = self.support(stop)
        _, _, density = self._posterior(stop, low, high)
        cumulated = np.append(0.0, np.cumsum(density.sum(axis=1)))
        return float(np.interp(part, cumulated, np.linspace(low, high, DRIFT_CELLS + 1)))

    def _posterior(
        self, stop: StopWindow, low: float, high: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Drifts (n,), starts (m,) [s] after the middle of the rising edge, and their probabilities (n, m).

        excess + fall − start = drift capture + stop, where fall is the stop edge's place between its two samples, and
        stop its place in the window: the density is the length of the window that both leave.
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

    Central for a declared window. Where two positions of the stop edge cannot be distinguished (the two ends of a
    window that is not declared, or all frames received and some missing), the interval holds both, with 95 % for each.
    """
    early, late = stop, stop.shifted(missing)
    if not stop.is_declared:
        early, late = replace(early, latest=early.earliest), replace(late, earliest=late.latest)
    if early == late:
        return record.quantile(stop, 0.025), record.quantile(stop, 0.975)
    return record.quantile(late, 0.05), record.quantile(early, 0.95)

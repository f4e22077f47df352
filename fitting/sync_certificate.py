"""How well the two edges of a trial tie force to markers: offset, clock ratio, and the error left in N and m."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fitting.clocks import SyncErrors
from fitting.timeline import Timeline

BIN = 0.05
"""Seconds over which force and position are averaged before their rates are taken: the pulls are far slower."""


@dataclass(frozen=True)
class SyncCertificate:
    """What the recorded sync line is worth. Standard uncertainties throughout.

    offset, offset_sd  [s] of the DAQ's clock when the capture began
    drift, drift_sd    the DAQ's seconds in a mocap second, less 1; the prior of 50 ppm where there is one edge only
    has_both_edges     whether the stop edge was used
    contradiction      [s] by which the stop edge contradicts the number of frames; the trial's lag is that uncertain
    force_rate, speed  [N/s], [m/s] the trial's highest
    errors             at its worst moment, and what that makes of these rates
    findings           what was odd about the line, in sentences
    """

    offset: float
    offset_sd: float
    drift: float
    drift_sd: float
    has_both_edges: bool
    contradiction: float
    force_rate: float
    speed: float
    errors: SyncErrors
    findings: tuple[str, ...] = ()

    @property
    def sentence(self) -> str:
        edges = "start and stop edge" if self.has_both_edges else "start edge alone"
        return (
            f"{edges}: offset {self.offset:.4f} s ± {1e3 * self.offset_sd:.2f} ms, clock ratio "
            f"{1e6 * self.drift:+.0f} ± {1e6 * self.drift_sd:.0f} ppm; time good to {1e3 * self.errors.time:.2f} ms: "
            f"{self.errors.force:.2f} N at {self.force_rate:.0f} N/s, or {1e3 * self.errors.displacement:.3f} mm at "
            f"{1e3 * self.speed:.0f} mm/s"
        )


def certify(line: Timeline, pulled: NDArray[np.float64]) -> SyncCertificate:
    """Of a trial's timeline, in which the pulled point moved along (frames, 3) [m]."""
    duration = float(line.marker_time[-1])
    worst = max(line.clock.errors(duration, 0.0, 0.0).time, line.lag.edge)  # the lag knows of frames that contradict
    force_rate, speed = peak_rate(line.force_time, line.force[:, None]), peak_rate(line.marker_time, pulled)
    return SyncCertificate(
        offset=line.clock.start,
        offset_sd=line.clock.time_sd(0.0),
        drift=line.clock.ratio - 1,
        drift_sd=math.sqrt(float(line.clock.covariance[1, 1])),
        has_both_edges=line.clock.has_both_edges,
        contradiction=line.stop_contradiction,
        force_rate=force_rate,
        speed=speed,
        errors=SyncErrors(worst, worst * force_rate, worst * speed),
        findings=line.sync_findings,
    )


def peak_rate(time: NDArray[np.float64], values: NDArray[np.float64]) -> float:
    """The highest rate of values (n, axes) between neighbouring means over BIN, per second; NaN is left out."""
    seen = np.isfinite(values).all(axis=1)
    bins = ((time[seen] - time[0]) / BIN).astype(np.int64)
    names, index, count = np.unique(bins, return_inverse=True, return_counts=True)
    if len(names) < 2:
        return 0.0
    means = np.column_stack([np.bincount(index, axis) / count for axis in values[seen].T])
    middles = np.bincount(index, time[seen]) / count
    rates = np.linalg.norm(np.diff(means, axis=0), axis=1) / np.diff(middles)
    return float(rates[np.diff(names) == 1].max(initial=0.0))

"""Two clocks made one: session time 0 is the rising edge of /sync, and seconds are those of the mocap system."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

DECLARED_LAG_SD = 0.5e-3
"""Seconds: amplifier, exposure and conversion, where neither a bounce trial nor the configuration says better."""
DECLARED = "declared"
DRIFT_PRIOR_SD = 50e-6
"""A crystal's rate against another's, when nothing measures it."""
PRIOR_REACH = 4.0
"""Standard deviations of that prior within which a fall is believed to be the capture's end."""
FAR_APART = 500e-6
"""Rate of one clock against the other beyond any crystal's that somebody may have all the same, as of a DAQ without
one: it looks like a frame that is missing, which is far more likely."""
HOST_TOLERANCE = 0.5
"""Seconds by which host arrival may contradict frame numbers; a 30× simulation makes 10 ms of wall time 0.3 s."""
HOST_ALIGNMENT_SD = 0.05
STAMP_TOLERANCE = 1.5
"""Frames by which the step of a frame's number and that of its time stamp may differ within a capture."""


@dataclass(frozen=True)
class SyncEdges:
    """The capture as the DAQ saw it, in seconds of the DAQ clock.

    rising_sd and falling_sd are the standard uncertainties of the edges' places, between two samples: a uniform
    distribution as wide as √12 of them. falling is None if it never fell. findings are what was odd about the line.
    """

    rising: float
    rising_sd: float
    falling: float | None
    falling_sd: float = 0.0
    findings: tuple[str, ...] = ()


@dataclass(frozen=True)
class SyncErrors:
    """What is not known of the time at the worst moment of a trial, and what that makes of the fastest samples.

    time [s], force [N], displacement [m]: standard uncertainties
    """

    time: float
    force: float
    displacement: float


@dataclass(frozen=True)
class ClockFit:
    """The DAQ's clock against the mocap system's: DAQ time = start + ratio × session time.

    start       [s] of the DAQ's clock when the capture began
    ratio       DAQ seconds in a mocap second
    covariance  (2, 2) of (start, ratio)
    """

    start: float
    ratio: float
    covariance: NDArray[np.float64]
    has_both_edges: bool

    def session_time(self, daq_time: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n,) [s] on the DAQ's clock → (n,) s since the edge on the mocap system's."""
        return np.asarray((daq_time - self.start) / self.ratio)

    def time_sd(self, time: float) -> float:
        """Standard uncertainty [s] of a session time [s] that was read from the DAQ's clock."""
        lever = np.array([1.0, time])
        return math.sqrt(max(0.0, float(lever @ self.covariance @ lever)))

    def errors(self, duration: float, force_rate: float, speed: float) -> SyncErrors:
        """What a trial of so many seconds suffers whose force changes by up to N/s and whose cuff moves by m/s."""
        worst = max(self.time_sd(0.0), self.time_sd(duration))
        return SyncErrors(worst, worst * force_rate, worst * speed)


@dataclass(frozen=True)
class LagUncertainty:
    """The lag of force against markers, by which the force's times were moved, and its standard uncertainty.

    edge      [s] new in every trial: where between two samples its edges were, at the middle of the trial
    declared  [s] the same in all trials: delays, as declared or as a bounce trial calibrated them
    drift     [s/s] the same in all trials: rate of one clock against the other, 0 where two edges measured it
    since     [s] session time from which drift counts: the edge, or the middle of the bounce trial
    value     [s] a force sample stamped t was taken at t + value; already in the trial's times
    source    who says so: "declared", or the bounce trials' files
    """

    edge: float
    declared: float
    drift: float
    since: float = 0.0
    value: float = 0.0
    source: str = DECLARED

    def common(self, time: float) -> float:
        """What all trials share [s], for a record centred at session time `time` [s]."""
        return math.hypot(self.declared, self.drift * (time - self.since))

    def total(self, time: float) -> float:
        """All of it [s], for a record centred at session time `time` [s]."""
        return math.hypot(self.edge, self.common(time))


def capture_frames(
    numbers: NDArray[np.int64],
    device_time: NDArray[np.float64],
    host_time: NDArray[np.float64],
    rate: float,
    edge_host: float,
) -> slice:
    """Which of the received frames (n,) are the capture; those before and after it are live preview.

    QTM numbers its frames anew when a capture starts and jumps, either way, when it ends, while its time stamps
    [s] go on or start anew in their own way. So the frames fall into runs in which numbers and stamps step alike, and
    the capture is the run whose frame 1, counted back from its numbers, arrived nearest to the edge by the host's
    clock [s].
    """
    bounds = [0, *_breaks(numbers, device_time * rate), len(numbers)]
    runs = [slice(first, last) for first, last in pairwise(bounds)]
    return min(runs, key=lambda run: abs(arrival_offset(host_time[run], (numbers[run] - 1) / rate) - edge_host))


def fit_clock(edges: SyncEdges, capture: float | None) -> ClockFit:
    """The capture's start and the DAQ clock's rate from one edge or two.

    capture [s] is how long the mocap system says that it captured, None if that is not known. The edges lie anywhere
    between the samples around them, and the rate is 1 ± DRIFT_PRIOR_SD beforehand; what both leave possible is
    averaged over. A fall that is not where the capture ended says nothing.
    """
    width, fall_width = edges.rising_sd * math.sqrt(12), edges.falling_sd * math.sqrt(12)
    if edges.falling is not None and capture is not None and capture > 0 and fall_width > 0:
        excess, reach = edges.falling - edges.rising - capture, (width + fall_width) / 2
        low = max(-PRIOR_REACH * DRIFT_PRIOR_SD, (excess - reach) / capture)
        high = min(PRIOR_REACH * DRIFT_PRIOR_SD, (excess + reach) / capture)
        if low < high:
            return _both_edges(edges, np.linspace(low, high, 401), capture, (width, fall_width))
    return ClockFit(edges.rising, 1.0, np.diag([edges.rising_sd**2, DRIFT_PRIOR_SD**2]), False)


def stop_contradiction(edges: SyncEdges, capture: float, frame: float) -> float:
    """Seconds by which the stop edge contradicts frames that last `capture` [s], `frame` [s] each; 0 where it does not.

    All of it where edges between samples and drifting clocks cannot explain it: then neither can be believed.
    Negative where the line fell before the last frame was taken. A line that falls later leaves room for whole frames
    that were not received, and one that falls a frame earlier ends with the last exposure and not with its frame; what
    is left of the nearest number of frames contradicts.
    """
    if edges.falling is None:
        return 0.0
    excess = edges.falling - edges.rising - capture
    if (whole := round(excess / frame)) >= -1:
        excess -= frame * whole
    return excess if abs(excess) > _explained(edges, capture) else 0.0


def rate_instead(edges: SyncEdges, capture: float) -> float:
    """Rate [s/s] of the DAQ's clock against the mocap's that would explain a stop edge which the prior does not.

    0 where nothing is to be explained, or no clock is so far off.
    """
    excess = 0.0 if edges.falling is None else edges.falling - edges.rising - capture
    return excess / capture if _explained(edges, capture) < abs(excess) <= FAR_APART * capture else 0.0


def early_edge(edges: SyncEdges, capture: float, frame: float, late: float) -> float:
    """Seconds by which the line rose before frame 1 was exposed; 0 where nothing says so.

    Frames that last `capture` [s], `frame` [s] each, and fall short of the pulse are missing at its start or at its
    end. Where the host saw frame 1 arrive late [s] by more than half of that, it is the start.
    """
    short = 0.0 if edges.falling is None else edges.falling - edges.rising - capture
    return short if short > max(frame / 2, _explained(edges, capture)) and late > short / 2 else 0.0


def arrival_offset(host_time: NDArray[np.float64], device_time: NDArray[np.float64]) -> float:
    """Host time minus device time [s] of the sample that travelled fastest: one moment seen by both clocks."""
    return float(np.min(host_time - device_time))


def _explained(edges: SyncEdges, capture: float) -> float:
    """Seconds by which pulse and frames may differ: clocks that drift, and edges anywhere between two samples."""
    return PRIOR_REACH * DRIFT_PRIOR_SD * capture + math.sqrt(3) * (edges.rising_sd + edges.falling_sd)


def _both_edges(edges: SyncEdges, drifts: NDArray[np.float64], capture: float, widths: tuple[float, float]) -> ClockFit:
    """Means and covariance of start and rate: for each rate (n,), 1 + drift, the start is anywhere that fits both."""
    ends = (edges.falling or 0.0) - edges.rising - (1 + drifts) * capture  # of the start, as the fall tells it
    low = np.maximum(-widths[0] / 2, ends - widths[1] / 2)
    high = np.minimum(widths[0] / 2, ends + widths[1] / 2)
    length = np.maximum(high - low, 0.0 if widths[0] > 0 else 1e-12)
    weight = length * np.exp(-0.5 * (drifts / DRIFT_PRIOR_SD) ** 2)
    weight /= weight.sum()
    middle = (low + high) / 2
    start, drift = float(weight @ middle), float(weight @ drifts)
    off_start, off_drift = middle - start, drifts - drift
    shared = float(weight @ (off_start * off_drift))
    variances = float(weight @ (off_start**2 + length**2 / 12)), float(weight @ off_drift**2)
    covariance = np.array([[variances[0], shared], [shared, variances[1]]])
    return ClockFit(edges.rising + start, 1 + drift, covariance, True)


def _breaks(numbers: NDArray[np.int64], stamps: NDArray[np.float64]) -> list[int]:
    """Where a new run begins: numbers go back, or step otherwise than the stamps (n,) [frames], if those progress."""
    number_steps, stamp_steps = np.diff(numbers), np.diff(stamps)
    apart = np.abs(number_steps - stamp_steps)
    is_break = number_steps < 0
    if len(apart) and np.median(apart) < 0.5:  # else the stamps stand still, or count something else
        is_break |= apart > STAMP_TOLERANCE
    return [int(index) + 1 for index in np.flatnonzero(is_break)]

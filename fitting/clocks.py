"""Two clocks made one: session time 0 is the rising edge of /sync, and seconds are those of the mocap system."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fitting.quality import UnusableTrial

DECLARED_LAG_SD = 0.5e-3
"""Seconds: amplifier, exposure and conversion, as long as no calibration says better."""
DRIFT_PRIOR_SD = 50e-6
"""A crystal's rate against another's, when nothing measures it."""
HOST_TOLERANCE = 0.5
"""Seconds by which host arrival may contradict frame numbers; a 30× simulation makes 10 ms of wall time 0.3 s."""
HOST_ALIGNMENT_SD = 0.05
STAMP_TOLERANCE = 1.5
"""Frames by which the step of a frame's number and that of its time stamp may differ within a capture."""
BOUNCE = 0.02
"""Seconds within which several crossings of the threshold are one edge."""


@dataclass(frozen=True)
class SyncEdges:
    """The capture as the DAQ saw it, in seconds of the DAQ clock.

    rising_sd is the standard uncertainty of the edge's place between two samples; falling is None if it never fell.
    """

    rising: float
    rising_sd: float
    falling: float | None


@dataclass(frozen=True)
class LagUncertainty:
    """Standard uncertainty of the lag of force against markers.

    edge      [s] new in every trial: where between two samples the edge was
    declared  [s] the same in all trials: delays nobody calibrated
    drift     [s/s] the same in all trials: rate of one clock against the other
    """

    edge: float
    declared: float
    drift: float

    def common(self, time: float) -> float:
        """What all trials share [s], for a record centred at session time `time` [s]."""
        return math.hypot(self.declared, self.drift * time)

    def total(self, time: float) -> float:
        """All of it [s], for a record centred at session time `time` [s]."""
        return math.hypot(self.edge, self.common(time))


def find_edges(time: NDArray[np.float64], level: NDArray[np.float64], threshold: float) -> SyncEdges:
    """The rising edge of the sync line, and the fall after it.

    time (n,) [s] on the DAQ clock, level (n,) and threshold in volts. Raises UnusableTrial if there is no rising
    edge, if the line starts high, or if it rises again later.
    """
    if not len(level) or not np.isfinite(level).all():
        raise UnusableTrial("the sync line holds no finite samples; check the sync channel's wiring and record again")
    is_high = level >= threshold
    if is_high[0]:
        raise UnusableTrial(
            f"the sync line starts at {level[0]:.2f} V, expected below {threshold:g} V until the capture starts; "
            "check that QTM's output is active high and that the station is armed before the capture"
        )
    crossings = np.flatnonzero(np.diff(is_high.astype(np.int8))) + 1
    rises = _separate(time, crossings[is_high[crossings]])
    if not len(rises):
        raise UnusableTrial(
            f"the sync line never rises above {threshold:g} V (highest {level.max():.2f} V); check the cable from "
            "QTM's sync output and sync.threshold_v"
        )
    if len(rises) > 1:
        raise UnusableTrial(
            f"the sync line rises {len(rises)} times, expected once; set QTM's output to one pulse for the whole "
            "capture and record again"
        )
    falls = crossings[~is_high[crossings]]
    late_falls = falls[time[falls] > time[rises[0]] + BOUNCE]
    rising, interval = _between_samples(time, rises[0])
    falling = _between_samples(time, late_falls[0])[0] if len(late_falls) else None
    return SyncEdges(rising, interval / math.sqrt(12), falling)


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


def clock_ratio(edges: SyncEdges, last_frame: int, frame_rate: float) -> tuple[float, float]:
    """DAQ seconds per mocap second, and its standard uncertainty.

    A capture of n frames lasts n / frame_rate and holds the sync line high meanwhile. The fall is believed only if
    it is where n frames end, within a sample and the crystals' tolerance; the prior 1 ± 50e-6 stays in.
    """
    capture = last_frame / frame_rate
    sample = edges.rising_sd * math.sqrt(12)
    if edges.falling is None or capture <= 0 or sample <= 0:
        return 1.0, DRIFT_PRIOR_SD
    excess = edges.falling - edges.rising - capture
    if abs(excess) > sample + DRIFT_PRIOR_SD * capture:
        return 1.0, DRIFT_PRIOR_SD
    measured, measured_sd = excess / capture, sample / math.sqrt(6) / capture
    weight = DRIFT_PRIOR_SD**2 / (DRIFT_PRIOR_SD**2 + measured_sd**2)
    return 1.0 + weight * measured, math.sqrt(weight) * measured_sd


def arrival_offset(host_time: NDArray[np.float64], device_time: NDArray[np.float64]) -> float:
    """Host time minus device time [s] of the sample that travelled fastest: one moment seen by both clocks."""
    return float(np.min(host_time - device_time))


def _breaks(numbers: NDArray[np.int64], stamps: NDArray[np.float64]) -> list[int]:
    """Where a new run begins: numbers go back, or step otherwise than the stamps (n,) [frames], if those progress."""
    number_steps, stamp_steps = np.diff(numbers), np.diff(stamps)
    apart = np.abs(number_steps - stamp_steps)
    is_break = number_steps < 0
    if len(apart) and np.median(apart) < 0.5:  # else the stamps stand still, or count something else
        is_break |= apart > STAMP_TOLERANCE
    return [int(index) + 1 for index in np.flatnonzero(is_break)]


def _separate(time: NDArray[np.float64], crossings: NDArray[np.intp]) -> NDArray[np.intp]:
    """Crossings without those that only repeat the one before, as a bouncing contact does."""
    if len(crossings) < 2:
        return crossings
    return crossings[np.concatenate(([True], np.diff(time[crossings]) > BOUNCE))]


def _between_samples(time: NDArray[np.float64], first_after: np.intp) -> tuple[float, float]:
    before, after = float(time[first_after - 1]), float(time[first_after])
    return (before + after) / 2, after - before

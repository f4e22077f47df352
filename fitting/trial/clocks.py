"""Common clock of both devices: session time 0 is the rising edge of /sync, in seconds of the mocap system."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fitting.results.rendering import Note

DECLARED = "declared"
DRIFT_PRIOR_SD = 50e-6
"""Standard uncertainty of the ratio of two clocks with crystals, assumed if it is not measured."""
CRYSTAL_LIMIT = 3 * DRIFT_PRIOR_SD
"""Largest drift of two crystals. If the stop edge needs more, missing frames are considered too."""
LARGEST_DRIFT = 500e-6
"""Largest possible drift, for example of a DAQ without a crystal. Estimates are limited to it."""
HOST_TOLERANCE = 0.5
"""Tolerance of host arrival against frame numbers [s]; a 30× simulation turns 10 ms of wall time into 0.3 s."""
HOST_ALIGNMENT_SD = 0.05
STAMP_TOLERANCE = 1.5
"""Tolerated difference between the steps of frame number and time stamp within a capture [frames]."""


@dataclass(frozen=True)
class SyncEdges:
    """The edges of the capture on the sync line, in seconds of the DAQ clock.

    rising_sd and falling_sd are the standard uncertainties of the edges, which lie between two samples: a uniform
    distribution √12 times as wide. falling is None if the line never fell. findings are irregularities of the line.
    """

    rising: float
    rising_sd: float
    falling: float | None
    falling_sd: float = 0.0
    findings: tuple[Note, ...] = ()


@dataclass(frozen=True)
class LagUncertainty:
    """Lag of force against markers, already applied to the times of the force, and its standard uncertainty.

    edge      [s] independent in every trial: position of its edges between two samples, at the middle of the trial
    declared  [s] common to all trials: delays, as declared or as calibrated by a bounce trial
    drift     [s/s] common to all trials: ratio of the clocks, 0 if two edges measured it
    since     [s] session time at which drift has no effect: the edge, or the middle of the bounce trial
    value     [s] a force sample stamped t was taken at t + value; already in the trial's times
    source    of the value: "declared", or the bounce trials' files
    """

    edge: float
    declared: float
    drift: float
    since: float = 0.0
    value: float = 0.0
    source: str = DECLARED

    def common(self, time: float) -> float:
        """The part common to all trials [s], for a record centred at session time `time` [s]."""
        return math.hypot(self.declared, self.drift * (time - self.since))

    def total(self, time: float) -> float:
        """The whole standard uncertainty [s], for a record centred at session time `time` [s]."""
        return math.hypot(self.edge, self.common(time))


def capture_frames(
    numbers: NDArray[np.int64],
    device_time: NDArray[np.float64],
    host_time: NDArray[np.float64],
    rate: float,
    edge_host: float,
) -> slice:
    """The received frames (n,) that are the capture; those before and after it are live preview.

    QTM restarts its frame numbers when a capture starts, and they jump when it ends, while its time stamps [s] may
    continue or restart. So the frames are divided into runs in which the steps of numbers and stamps agree. The capture
    is the run whose frame 1, extrapolated from its numbers, arrived nearest to the edge on the host's clock [s].
    """
    bounds = [0, *_breaks(numbers, device_time * rate), len(numbers)]
    runs = [slice(first, last) for first, last in pairwise(bounds)]
    return min(runs, key=lambda run: abs(arrival_offset(host_time[run], (numbers[run] - 1) / rate) - edge_host))


def arrival_offset(host_time: NDArray[np.float64], device_time: NDArray[np.float64]) -> float:
    """Host time minus device time [s] of the sample with the least delay."""
    return float(np.min(host_time - device_time))


def _breaks(numbers: NDArray[np.int64], stamps: NDArray[np.float64]) -> list[int]:
    """Indices at which a new run begins: numbers decrease, or their steps differ from those of the stamps [frames]."""
    number_steps, stamp_steps = np.diff(numbers), np.diff(stamps)
    apart = np.abs(number_steps - stamp_steps)
    is_break = number_steps < 0
    if len(apart) and np.median(apart) < 0.5:  # otherwise the stamps are constant or have another unit
        is_break |= apart > STAMP_TOLERANCE
    return [int(index) + 1 for index in np.flatnonzero(is_break)]

"""Common time of both devices: session time 0 is the rising edge of /sync, in seconds of the mocap system."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fitting.timing.stop_edge import StopWindow

DECLARED = "declared"
DRIFT_PRIOR_SD = 50e-6
"""Standard uncertainty of one clock's rate against the other's, assumed where nothing measures it: two crystals."""
CRYSTAL_LIMIT = 3 * DRIFT_PRIOR_SD
"""Drift that two crystals explain. Where the stop edge needs more, a missing frame is considered, too."""
LARGEST_DRIFT = 500e-6
"""Drift that is taken to be possible at all, as of a DAQ without a crystal. An estimate that needs more is cut here."""
HOST_TOLERANCE = 0.5
"""Seconds by which host arrival may contradict frame numbers; a 30× simulation makes 10 ms of wall time 0.3 s."""
HOST_ALIGNMENT_SD = 0.05
STAMP_TOLERANCE = 1.5
"""Frames by which the step of a frame's number and that of its time stamp may differ within a capture."""


@dataclass(frozen=True)
class SyncEdges:
    """The capture as the DAQ saw it, in seconds of the DAQ clock.

    rising_sd and falling_sd are the standard uncertainties of the edges, which lie between two samples: a uniform
    distribution √12 times as wide. falling is None if the line never fell. findings are irregularities of the line.
    """

    rising: float
    rising_sd: float
    falling: float | None
    falling_sd: float = 0.0
    findings: tuple[str, ...] = ()


@dataclass(frozen=True)
class LagUncertainty:
    """The lag of force against markers, by which the force's times were moved, and its standard uncertainty.

    edge      [s] independent in every trial: position of its edges between two samples, at the middle of the trial
    declared  [s] common to all trials: delays, as declared or as a bounce trial calibrated them
    drift     [s/s] common to all trials: rate of one clock against the other, 0 where two edges measured it
    since     [s] session time from which drift counts: the edge, or the middle of the bounce trial
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


def stop_contradiction(edges: SyncEdges, capture: float, stop: StopWindow) -> float:
    """Seconds by which the stop edge contradicts frames that last `capture` [s]; 0 where it does not.

    A contradiction is what no drift up to LARGEST_DRIFT explains. Negative where the line fell before the last frame
    was taken. Where it falls later, whole frames may be missing, and the remainder contradicts.
    """
    if edges.falling is None:
        return 0.0
    excess = edges.falling - edges.rising - capture
    tolerance = LARGEST_DRIFT * capture + math.sqrt(3) * (edges.rising_sd + edges.falling_sd)
    if excess > stop.latest + tolerance:
        excess -= stop.frame * round(excess / stop.frame)
    return excess if not stop.earliest - tolerance <= excess <= stop.latest + tolerance else 0.0


def early_edge(edges: SyncEdges, capture: float, frame: float, late: float) -> float:
    """Seconds by which the line rose before frame 1 was exposed; 0 where nothing indicates it.

    Frames that last `capture` [s], `frame` [s] each, and are shorter than the pulse are missing at its start or at its
    end. Where frame 1 arrived at the host late [s] by more than half of that, it is the start. Drift does both, too.
    """
    short = 0.0 if edges.falling is None else edges.falling - edges.rising - capture
    explained = LARGEST_DRIFT * capture + math.sqrt(3) * (edges.rising_sd + edges.falling_sd)
    return short if short > max(frame / 2, explained) and late > short / 2 else 0.0


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

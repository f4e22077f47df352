"""Frames without a posture: short gaps are interpolated, and a motion ends at a long one."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from solver.errors import MotionError, SolverCode
from solver.inverse_kinematics.solve import InverseKinematics, PostureOutcome
from solver.model import Model
from solver.motion import Motion

Array = NDArray[np.float64]

LONGEST_GAP = 0.25
"""Seconds; the published motions are filtered at 3 Hz, whose period is longer."""
SHORTEST_MOTION = 1.0
"""Seconds, below which the filter's ends reach into each other."""


@dataclass(frozen=True, eq=False)
class WholeMotion:
    """motion has a posture in every frame; start is its first frame in the trial.

    interpolated is the number of frames that were interpolated, left_out that of frames before and after the motion.
    """

    motion: Motion
    start: int
    interpolated: int
    left_out: int


def longest_whole_motion(model: Model, time: Array, solution: InverseKinematics) -> WholeMotion:
    """The longest part of a trial whose gaps last at most LONGEST_GAP; these are interpolated (PCHIP).

    time (frames,) [s], evenly spaced. Raises MotionError where that part is shorter than SHORTEST_MOTION.
    """
    interval = float(time[-1] - time[0]) / (len(time) - 1)
    solved = np.flatnonzero([outcome == PostureOutcome.SOLVED for outcome in solution.outcomes])
    breaks = np.flatnonzero(np.diff(solved) > math.floor(LONGEST_GAP / interval) + 1)
    parts = np.split(solved, breaks + 1)
    longest = max(parts, key=lambda part: part[-1] - part[0] if len(part) else -1)
    if len(longest) < 2 or (longest[-1] - longest[0]) * interval < SHORTEST_MOTION:
        raise MotionError(
            f"the markers should determine the posture for at least {SHORTEST_MOTION:g} s without a gap of more than "
            f"{LONGEST_GAP:g} s, and do in {len(solved)} of {len(time)} frames; record the trial again",
            SolverCode.NOT_COVERED,
        )
    start, end = int(longest[0]), int(longest[-1]) + 1
    whole = scipy.interpolate.PchipInterpolator(time[longest], solution.coordinates[longest])(time[start:end])
    motion = Motion(model.coordinate_names, time[start:end], whole)
    return WholeMotion(motion, start, end - start - len(longest), len(time) - (end - start))

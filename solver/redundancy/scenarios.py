"""Scenarios of a motion that differ in their loads: what the loads change, and the solutions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LoadResponse:
    """Changes by additional loads at x = 0, per scenario and frame.

    acceleration  (scenarios, frames, coordinates) [rad/s², m/s²]
    reaction      (scenarios, frames, 6) moment [N m], force [N] on the scapula in ground
    """

    acceleration: Array
    reaction: Array


@dataclass(frozen=True, eq=False)
class ScenarioSolutions:
    """x (scenarios, frames, controls), NaN where infeasible or not finite, with outcomes and residuals.

    In INFEASIBLE frames residual, reaction and slack are those of the point of least violation, in NOT_FINITE ones NaN.

    outcomes           (scenarios, frames) of FrameOutcome
    equality_residual  (scenarios, frames) largest |A x − b| [rad/s² or m/s²], the unreachable part included
    residual_coordinate  (scenarios, frames) index of the coordinate whose acceleration it is
    reaction           (scenarios, frames, 6) moment [N m], force [N] on the scapula in ground
    cone_slack         (scenarios, frames) s − |v| [N], negative outside; infinite without the glenoid
    """

    controls: Array
    outcomes: NDArray[np.object_]
    equality_residual: Array
    residual_coordinate: NDArray[np.intp]
    reaction: Array
    cone_slack: Array

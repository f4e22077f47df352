"""Where force and cuff are while nothing pulls: at the start of a swing's record, at the ends of held loads."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fitting.curves import TrialCurves
from fitting.static.plateaus import Plateau

LEAD_IN = 1.0
STEADY = 1.0
"""N within which the quarters of the lead-in must agree."""
SWAY = 0.02e-3
"""m that the place keeps beside its noise: what a slowly moving body leaves after its sway is taken off."""


@dataclass(frozen=True)
class Level:
    """Mean force [N] and displacement [m] of a stretch without load, with standard errors."""

    force: float
    force_sd: float
    displacement: float
    displacement_sd: float


def start_level(curves: TrialCurves) -> Level | None:
    """The first second of a dynamic record if it is steady and below the swing, else None."""
    fit = curves.dynamic
    if fit is None:
        return None
    in_force = curves.force_time <= curves.force_time[0] + LEAD_IN
    in_frames = (curves.marker_time <= curves.force_time[0] + LEAD_IN) & np.isfinite(curves.displacement)
    if np.count_nonzero(in_force) < 8 or np.count_nonzero(in_frames) < 20:
        return None
    force, way = curves.force[in_force], curves.displacement[in_frames]
    quarters = [float(part.mean()) for part in np.array_split(force, 4)]
    noise = float(np.std(force)) / math.sqrt(len(force) / 4)
    below = swing_force(curves) - 0.8 * fit.oscillation.amplitude
    if max(quarters) - min(quarters) > STEADY + 4 * noise or np.mean(force) > below:
        return None
    return Level(*_mean(force), *_mean(way, SWAY))


def held_level(plateau: Plateau) -> Level:
    """A held load as a level."""
    return Level(plateau.force, plateau.force_sd, plateau.displacement, math.hypot(plateau.displacement_sd, SWAY))


def swing_force(curves: TrialCurves) -> float:
    """Mean force [N] of the swing."""
    if curves.dynamic is None:
        raise ValueError("a trial without a fitted swing has no mean force of it")
    swing = curves.dynamic.oscillation
    inside = (curves.force_time >= swing.start) & (curves.force_time <= swing.end)
    return float(np.mean(curves.force[inside]))


def _mean(values: NDArray[np.float64], floor: float = 0.0) -> tuple[float, float]:
    return float(np.mean(values)), math.hypot(float(np.std(values)) / math.sqrt(len(values)), floor)

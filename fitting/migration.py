"""Migration: what did not come back, x at the end of the last static trial minus x at the start of the first."""

from __future__ import annotations

import math
from collections.abc import Sequence

from fitting.plateaus import Plateau
from fitting.uncertainty import NORMAL_95, Estimate

UNLOADED = 0.1
"""A plateau is unloaded if its force is within this part of the load range, or 3 N, of the first plateau's."""
MIN_TOLERANCE = 3.0


def fit_migration(trials: Sequence[Sequence[Plateau]]) -> Estimate | None:
    """Migration [m] over static trials in time order, all in one reference posture; one trial is a sequence of one.

    None if the first does not start, or the last does not end, unloaded.
    """
    held = [plateaus for plateaus in trials if plateaus]
    if not held:
        return None
    first, last = held[0][0], held[-1][-1]
    loads = [plateau.force for plateaus in held for plateau in plateaus]
    tolerance = max(UNLOADED * (max(loads) - min(loads)), MIN_TOLERANCE)
    if first is last or max(first.force, last.force) > min(loads) + tolerance:
        return None
    value = last.displacement - first.displacement
    error = math.hypot(first.displacement_sd, last.displacement_sd)
    return Estimate(value, error, (value - NORMAL_95 * error, value + NORMAL_95 * error))

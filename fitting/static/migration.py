"""Migration: what did not come back, x at the end of the last static trial minus x at the start of the first.

Of what is still away when the last trial ends, creep will come back and slip will not. Migration is the slip: where
creep is measured, what it has left to recover is taken off, with its uncertainty.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from fitting.static.creep import Creep
from fitting.static.plateaus import Plateau
from fitting.uncertainty import NORMAL_95, Estimate

UNLOADED = 0.1
"""A plateau is unloaded if its force is within this part of the load range, or 3 N, of the lowest."""
MIN_TOLERANCE = 3.0
RECOVERY_SD = 0.3
"""Relative: a cuff seldom recovers along the one exponential that its creep was fitted with."""


def fit_migration(trials: Sequence[Sequence[Plateau]], creep: Creep | None = None) -> Estimate | None:
    """Migration [m] over static trials in time order, all in one reference posture; one trial is a sequence of one.

    creep is that of the same trials. None if the first does not start, or the last does not end, unloaded.
    """
    held = [plateaus for plateaus in trials if plateaus]
    if not held:
        return None
    first, last = held[0][0], held[-1][-1]
    all_loads = [plateau for plateaus in held for plateau in plateaus]
    if first is last or not is_unloaded(first, all_loads) or not is_unloaded(last, all_loads):
        return None
    value, noise = last.displacement - first.displacement, math.hypot(first.displacement_sd, last.displacement_sd)
    if creep is None or not creep.is_measured:
        return _estimate(value, {"noise": noise})
    recovery = creep.recovery(len(trials) - 1)
    relative = math.hypot(RECOVERY_SD, creep.fraction.standard_error / creep.fraction.value)
    return _estimate(value + recovery, {"noise": noise, "creep": abs(recovery) * relative})


def is_unloaded(plateau: Plateau, loads: Sequence[Plateau]) -> bool:
    """Whether nothing but the hook hangs on, among all loads of the trial."""
    forces = [each.force for each in loads]
    return plateau.force <= min(forces) + max(UNLOADED * (max(forces) - min(forces)), MIN_TOLERANCE)


def _estimate(value: float, parts: dict[str, float]) -> Estimate:
    error = math.hypot(*parts.values())
    return Estimate(value, error, (value - NORMAL_95 * error, value + NORMAL_95 * error), parts)

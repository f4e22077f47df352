"""Migration: permanent displacement, x at the end of the last static trial minus x at the start of the first.

Creep recovers after the last trial, slip does not. Migration is the slip: if creep is measured, the recovery still to
come is subtracted, with its uncertainty.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from fitting.pull.plateaus import Plateau, is_unloaded
from fitting.static.creep import Creep
from fitting.uncertainty import NORMAL_95, Estimate

RECOVERY_SD = 0.3
"""Relative standard uncertainty of the recovery: it rarely follows the single exponential of the fitted creep."""


def fit_migration(trials: Sequence[Sequence[Plateau]], creep: Creep | None = None) -> Estimate | None:
    """Migration [m] over static trials in time order, all relative to one reference posture: (5) of the source study.

    creep is that of the same trials. None if the first trial does not start unloaded or the last does not end unloaded.
    """
    held = [number for number, plateaus in enumerate(trials) if plateaus]
    if not held:
        return None
    first, last = trials[held[0]][0], trials[held[-1]][-1]
    all_loads = [plateau for plateaus in trials for plateau in plateaus]
    if first is last or not is_unloaded(first, all_loads) or not is_unloaded(last, all_loads):
        return None
    value, noise = last.displacement - first.displacement, math.hypot(first.displacement_sd, last.displacement_sd)
    if creep is None or not creep.is_measured:
        settling = {"settling": abs(last.unsettled)} if last.unsettled else {}
        return _estimate(value, {"noise": noise, **settling})
    recovery = creep.recovery(held[-1])
    relative = math.hypot(RECOVERY_SD, creep.fraction.standard_error / creep.fraction.value)
    return _estimate(value + recovery, {"noise": noise, "creep": abs(recovery) * relative})


def _estimate(value: float, parts: dict[str, float]) -> Estimate:
    error = math.hypot(*parts.values())
    return Estimate(value, error, (value - NORMAL_95 * error, value + NORMAL_95 * error), parts)

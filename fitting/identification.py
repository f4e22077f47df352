"""Which quantities of a donning are identified: the figure that is given, and the verdict on it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from fitting.dynamic.damping import DampingFit
from fitting.outcome import FitOutcome
from fitting.results.codes import Verdict
from fitting.spatial.reduction import ReducedTrial
from fitting.static.creep import Creep
from fitting.static.migration import fit_migration
from fitting.static.stiffness import StiffnessFit
from fitting.uncertainty import Estimate, combine

MIN_LOADS = 3
"""Held loads without which a donning has no stiffness."""
WIDE_ANGLE, CLEAR = math.radians(2.5), 0.15
"""Of the loss angle at the swing's frequency, ωc/k, that noise and lag may leave open: the published cuffs have 2.5 to
20 degrees. And the part of c below which they may leave more. Noise in c alone then decides nothing about it."""


def judge_stiffness(static: Sequence[ReducedTrial], fit: StiffnessFit) -> tuple[Estimate | None, Verdict | None]:
    """The stiffness of held loads; None where it is not identified."""
    stiffness = fit.stiffness
    if not static:
        return None, Verdict.NO_STATIC
    if sum(len(each.plateaus) for each in static) < MIN_LOADS:
        return None, Verdict.FEW_LOADS
    if stiffness is None:
        return None, Verdict.ONLY_ROSE
    if fit.outcome is not FitOutcome.CONVERGED:
        return None, Verdict.STIFFNESS_NOT_CONVERGED
    if stiffness.is_open or stiffness.value < 0 or not math.isfinite(stiffness.ci95[1]):
        return None, Verdict.STIFFNESS_UNCERTAIN
    return stiffness, None


def judge_damping(fits: Sequence[DampingFit]) -> tuple[Estimate | None, Verdict | None]:
    """The damping, also where it is not identified: chosen by its value, c would come out too large."""
    if not fits:
        return None, Verdict.NO_DYNAMIC
    damping = combine([fit.damping for fit in fits])
    if any(fit.outcome is not FitOutcome.CONVERGED for fit in fits):
        return damping, Verdict.DAMPING_NOT_CONVERGED
    noise = float(np.linalg.norm([fit.noise for fit in fits])) / len(fits)
    with_lag = math.hypot(
        float(np.linalg.norm([fit.damping.noise for fit in fits])) / len(fits), max(fit.damping.common for fit in fits)
    )
    omega = 2 * math.pi * float(np.mean([fit.oscillation.frequency for fit in fits]))
    angle = omega * with_lag / float(np.mean([fit.stiffness.value for fit in fits]))
    is_wide = angle > WIDE_ANGLE and with_lag > CLEAR * abs(damping.value)
    if not damping.is_open and not is_wide:
        return damping, None if damping.value > 0 else Verdict.NEGATIVE
    return damping, Verdict.LAG if with_lag > math.sqrt(2) * noise else Verdict.DAMPING_UNCERTAIN


def judge_migration(
    static: Sequence[ReducedTrial], creep: Creep | None, before: Sequence[str]
) -> tuple[Estimate | None, Verdict | None]:
    """The migration; before names static recordings that are lost and in which the cuff may have migrated."""
    migration = fit_migration([each.plateaus for each in static], creep)
    if migration is None:
        return None, Verdict.NOT_UNLOADED if static else None
    return (None, Verdict.MIGRATED_BEFORE) if before else (migration, None)

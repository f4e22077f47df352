"""Decide which quantities of a donning are identified: figures and verdicts."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fitting.dynamic.damping import DampingFit
from fitting.dynamic.swings import Swings
from fitting.pull.pull import Pull
from fitting.results.codes import Verdict
from fitting.results.outcome import FitOutcome, worst
from fitting.results.rendering import Note
from fitting.static.creep import Creep
from fitting.static.held_loads import HeldLoads
from fitting.static.migration import fit_migration
from fitting.static.stiffness import StiffnessFit
from fitting.trial.trial import RejectedTrial, Trial
from fitting.uncertainty import Estimate, combine

MIN_LOADS = 3
"""Held loads without which a donning has no stiffness."""
WIDE_ANGLE, CLEAR = math.radians(2.5), 0.15
"""Largest uncertainty of the loss angle ωc/k at the swing's frequency due to noise and lag (published cuffs have 2.5 to
20 degrees), unless it is below 15 % of c. With both limits, noise of the estimate of c does not decide on its own."""


@dataclass(frozen=True)
class Identified:
    """The figures of a donning, None if there is none, and the verdicts on them.

    damping is given even if it is not identified: a selection by its value would bias c upward.
    """

    stiffness: Estimate | None
    damping: Estimate | None
    migration: Estimate | None
    verdicts: tuple[Verdict, ...]

    @property
    def estimates(self) -> tuple[Estimate | None, ...]:
        """In the order of CuffParameters' covariance."""
        return self.stiffness, self.damping, self.migration


def identify(
    static: Sequence[Pull],
    all_static: Sequence[Pull],
    held: HeldLoads,
    swings: Swings,
    before: Sequence[str],
    *,
    has_friction: bool = False,
) -> Identified:
    """Figures and verdicts of a donning.

    static are the pulls of the held loads, all_static those of all runs; before lists unreadable static recordings in
    which the cuff may have migrated; has_friction is whether the comparison of laws chose friction.
    """
    stiffness, of_stiffness = _judge_stiffness(static, held.stiffness)
    damping, of_damping = _judge_damping(swings.fits, has_friction=has_friction)
    creep = held.creep if list(static) == list(all_static) else None
    migration, of_migration = _judge_migration(all_static, creep, before)
    verdicts = tuple(verdict for verdict in (of_stiffness, of_damping, of_migration) if verdict)
    return Identified(stiffness, damping, migration, verdicts or (Verdict.IDENTIFIED,))


def started_before(
    static: Sequence[Pull],
    trials: Sequence[Trial],
    rejected: Sequence[RejectedTrial],
    reasons: Mapping[str, Note],
) -> list[str]:
    """Unreadable static recordings earlier than the first static trial, in which the cuff may have migrated."""
    if not static:
        return []
    first = static[0].trial.start_utc_ns
    begun = [(trial.file, trial.test, trial.start_utc_ns) for trial in trials if trial.file in reasons]
    begun += [
        (trial.file, trial.capture.test, trial.capture.start_utc_ns) for trial in rejected if trial.capture is not None
    ]
    return [file for file, test, start in begun if test == "static" and start < first]


def _judge_stiffness(static: Sequence[Pull], fit: StiffnessFit) -> tuple[Estimate | None, Verdict | None]:
    """The stiffness of held loads; None if it is not identified."""
    stiffness = fit.stiffness
    if not static:
        return None, Verdict.NO_STATIC
    if sum(len(pull.plateaus) for pull in static) < MIN_LOADS:
        return None, Verdict.FEW_LOADS
    if stiffness is None:
        return None, Verdict.ONLY_ROSE
    if fit.outcome is not FitOutcome.CONVERGED:
        return None, Verdict.STIFFNESS_NOT_CONVERGED
    # The interval of a reciprocal, or of few loads, is wider than its standard error says.
    if stiffness.is_too_wide or not (stiffness.ci95[1] - stiffness.ci95[0]) / 2 < stiffness.value:
        return None, Verdict.STIFFNESS_UNCERTAIN
    return stiffness, None


def _judge_damping(fits: Sequence[DampingFit], *, has_friction: bool) -> tuple[Estimate | None, Verdict | None]:
    """The damping, even if it is not identified: a selection by its value would bias c upward."""
    if not fits:
        return None, Verdict.NO_DYNAMIC
    damping = combine([fit.damping for fit in fits])
    if worst((damping.outcome, *(fit.outcome for fit in fits))) is not FitOutcome.CONVERGED:
        return damping, Verdict.DAMPING_NOT_CONVERGED
    if has_friction:  # it dissipates, too, and c includes that
        return damping, Verdict.FRICTION
    noise = float(np.linalg.norm([fit.noise for fit in fits])) / len(fits)
    with_lag = math.hypot(
        float(np.linalg.norm([fit.damping.noise for fit in fits])) / len(fits), max(fit.damping.common for fit in fits)
    )
    omega = 2 * math.pi * float(np.mean([fit.oscillation.frequency for fit in fits]))
    angle = omega * with_lag / float(np.mean([fit.stiffness.value for fit in fits]))
    is_wide = angle > WIDE_ANGLE and with_lag > CLEAR * abs(damping.value)
    if not damping.is_too_wide and not is_wide:
        return damping, None if damping.value > 0 else Verdict.NEGATIVE
    return damping, Verdict.LAG if with_lag > math.sqrt(2) * noise else Verdict.DAMPING_UNCERTAIN


def _judge_migration(
    static: Sequence[Pull], creep: Creep | None, before: Sequence[str]
) -> tuple[Estimate | None, Verdict | None]:
    """The migration; before lists unreadable static recordings in which the cuff may have migrated."""
    migration = fit_migration([pull.plateaus for pull in static], creep)
    if migration is None:
        return None, Verdict.NOT_UNLOADED if static else None
    return (None, Verdict.MIGRATED_BEFORE) if before else (migration, None)

"""The use of a recording in the fit of a donning, and its own estimates."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from documents.interval import with_error
from documents.results import EqualByFields
from fitting.diagnosis.fitted_pull import FittedPull
from fitting.dynamic.damping import DampingFit
from fitting.pull.pull import Pull
from fitting.results.codes import RejectionCode, TrialNoteCode
from fitting.results.rendering import Note
from fitting.static.migration import fit_migration
from fitting.static.stiffness import trial_stiffness
from fitting.trial.force_quality import damage_figures
from fitting.trial.sync_certificate import SyncCertificate
from fitting.trial.trial import Trial
from fitting.uncertainty import Estimate
from recordings.manifest import DataOrigin
from solver.cuff import CuffParameters

State = Literal["used", "superseded", "unusable"]


@dataclass(frozen=True, eq=False)
class TrialFit(EqualByFields):
    """The use of one recording in a fit: "used", "superseded" by a later run, or "unusable" with the reason.

    The estimates are from this trial alone, None if it does not determine them; swing is the fit of a dynamic trial.
    sync        certificate of the sync line, None without one
    origin      measured or simulated, as the devices report
    zero_drift  [N] change of the force at rest from start to end, None if the trial does not rest at both
    damage      of the file, beyond a cut end; then the trial has no other notes
    """

    file: str
    test: str
    repeat: int
    run: int
    state: State
    reason: Note | None = None
    notes: tuple[Note, ...] = ()
    stiffness: Estimate | None = None
    damping: Estimate | None = None
    migration: Estimate | None = None
    swing: DampingFit | None = None
    sync: SyncCertificate | None = None
    zero_drift: float | None = None
    origin: DataOrigin = DataOrigin.UNKNOWN
    damage: tuple[str, ...] = ()

    def __repr__(self) -> str:
        found = {name: (getattr(self, name), unit) for name, unit in CuffParameters.UNITS.items()}
        values = [
            f"{name} {with_error(one.value, one.standard_error)} {unit}" for name, (one, unit) in found.items() if one
        ]
        return f"TrialFit {self.file}: {', '.join([self.state, *values])}" + (
            f"; {self.reason.code}" if self.reason else ""
        )


def list_trials(
    trials: Sequence[Trial],
    pulls: Sequence[Pull],
    used: Mapping[str, Pull],
    fitted: Mapping[str, FittedPull],
    if_friction: Estimate | None,
    refused: Mapping[str, Note],
) -> tuple[TrialFit, ...]:
    """Every recording of a donning with its use in the fit; used, fitted and refused are by file."""
    numbers = {pull.trial.file: pull.direction_number for pull in pulls}
    counting = {(pull.trial.test, pull.trial.repeat, pull.direction_number): file for file, pull in used.items()}
    listed = []
    for trial in trials:
        again = counting.get((trial.test, trial.repeat, numbers.get(trial.file, 0)), trial.file)
        superseded = None if trial.file in used else Note(RejectionCode.RECORDED_AGAIN, {"file": again})
        reason = refused.get(trial.file, superseded)
        state: State = "used" if trial.file in used else "unusable" if trial.file in refused else "superseded"
        fit = TrialFit(
            file=trial.file,
            test=trial.test,
            repeat=trial.repeat,
            run=trial.run,
            state=state,
            reason=reason,
            notes=trial.notes,
            sync=trial.sync,
            zero_drift=trial.zero_drift,
            origin=trial.origin,
        )
        if trial.file in used:
            fit = _with_estimates(fit, used[trial.file], fitted.get(trial.file), if_friction)
        listed.append(_with_damage(fit, trial.damage) if trial.damage else fit)
    return tuple(listed)


def _with_estimates(fit: TrialFit, pull: Pull, fitted: FittedPull | None, if_friction: Estimate | None) -> TrialFit:
    """Add the estimates from this trial alone, and the notes on them."""
    static, swing = (fitted.static, fitted.dynamic) if fitted else (None, None)
    return replace(
        fit,
        notes=pull.notes
        + (swing.notes if swing else ())
        + ((Note(TrialNoteCode.ONE_BRANCH),) if if_friction and static else ()),
        stiffness=trial_stiffness(static, if_friction) if static else None,
        damping=swing.damping.estimate if swing else None,
        swing=swing,
        migration=fit_migration([pull.plateaus]),
    )


def _with_damage(fit: TrialFit, damage: tuple[str, ...]) -> TrialFit:
    """Replace the notes on a damaged file by its damage."""
    figures = damage_figures(damage)
    reason = fit.reason and Note(RejectionCode.DAMAGED, figures)
    return replace(fit, notes=(Note(TrialNoteCode.DAMAGED, figures),), reason=reason, damage=damage)


COMPARED: tuple[Literal["stiffness", "damping"], ...] = ("stiffness", "damping")
OUTLYING = 3.0
"""Combined standard errors from which a repeat differs from the others."""
SLIPPED = 0.025
"""Metres of migration in one trial; published cuffs migrated by at most 22 mm in a session."""
LEAST_ERROR = 1e-12


@dataclass(frozen=True)
class Outlier:
    """A quantity of one repeat [SI], the mean of the other repeats, and their distance in combined standard errors."""

    quantity: Literal["stiffness", "damping"]
    value: float
    mean: float
    distance: float


def find_outliers(trial: TrialFit, others: Sequence[TrialFit]) -> tuple[Outlier, ...]:
    """Stiffness and damping of a trial that differ from those of the other repeats of the donning."""
    found = []
    for quantity in COMPARED:
        this = getattr(trial, quantity)
        rest = [estimate for other in others if (estimate := getattr(other, quantity)) is not None]
        if this is None or not rest:
            continue
        mean, error = _pooled(rest)
        distance = abs(this.value - mean) / max(math.hypot(this.standard_error, error), LEAST_ERROR)
        if distance > OUTLYING:
            found.append(Outlier(quantity, this.value, mean, distance))
    return tuple(found)


def has_slipped(trial: TrialFit) -> bool:
    """Whether the cuff migrated by more than SLIPPED in this trial."""
    return trial.migration is not None and trial.migration.value > SLIPPED


def _pooled(estimates: Sequence[Estimate]) -> tuple[float, float]:
    """Mean of some estimates and its standard error, from their spread or their own errors, whichever is larger."""
    values = np.array([estimate.value for estimate in estimates])
    own = float(np.sqrt(np.mean([estimate.standard_error**2 for estimate in estimates])))
    spread = float(values.std(ddof=1)) if len(values) > 1 else 0.0
    return float(values.mean()), max(own, spread)

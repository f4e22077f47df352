"""Fit every cuff of a session, donning by donning; donnings are never pooled."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from fitting.cuffs.cuff_fit import CuffFit, SessionFit
from fitting.diagnosis.identification import MIN_LOADS
from fitting.donning import fit_donning
from fitting.dynamic.damping import fit_damping
from fitting.errors import UnusableTrial
from fitting.pull.pull import Pull, make_pulls
from fitting.results.codes import RejectionCode
from fitting.results.rendering import Note
from fitting.static.migration import fit_migration
from fitting.trial.bounce import BounceTrial, calibrate
from fitting.trial.force_quality import damage_figures
from fitting.trial.reader import TrialReading
from fitting.trial.trial import RejectedTrial, Trial


def fit_session(
    trials: Sequence[Trial],
    rejected: Sequence[RejectedTrial] = (),
    progress: Callable[[int, int], None] = lambda *_: None,
) -> SessionFit:
    """Fit every cuff of a session.

    An unusable trial is listed with the reason under its cuff, and the other trials are fitted. rejected are recordings
    that cannot be read as trials; they are listed with their reasons. progress(done, total) counts donnings.
    """
    trials_of: dict[tuple[str, str], list[Trial]] = {}
    for trial in sorted(trials, key=lambda trial: (trial.start_utc_ns, trial.file)):
        trials_of.setdefault((trial.cuff.name, trial.donning), []).append(trial)
    donnings: dict[str, dict[str, CuffFit]] = {}
    for done, ((cuff, donning), donning_trials) in enumerate(trials_of.items()):
        progress(done, len(trials_of))
        donning_rejected = [
            trial
            for trial in rejected
            if trial.capture
            and trial.capture.cuff
            and (trial.capture.cuff.name, trial.capture.donning) == (cuff, donning)
        ]
        donnings.setdefault(cuff, {})[donning] = fit_donning(donning_trials, donning_rejected)
    progress(len(trials_of), len(trials_of))
    calibration = next((trial.calibration for trial in trials if trial.calibration), None)
    return SessionFit(donnings, tuple(rejected), calibration)


def find_rejection(reading: TrialReading) -> Note | None:
    """Why a trial cannot be used, judged from this trial alone; None if it can be used.

    It is called while the cuff is still on, so that the trial can be repeated. A static trial has to start and end
    unloaded, because migration is the difference between the first and the last plateau of a donning. The fit of a
    donning reports more.
    """
    if isinstance(reading, RejectedTrial):
        return reading.reason
    if isinstance(reading, BounceTrial):
        _, refused = calibrate([reading])
        return refused.get(reading.file)
    pulls, refused = make_pulls([reading])
    reason = refused.get(reading.file) if refused else _reject_pull(pulls[0])
    return Note(RejectionCode.DAMAGED, damage_figures(reading.damage)) if reason and reading.damage else reason


def _reject_pull(pull: Pull) -> Note | None:
    if pull.trial.test == "static" and len(pull.plateaus) < MIN_LOADS:
        return Note(RejectionCode.FEW_LOADS)
    if pull.trial.test == "static" and fit_migration([pull.plateaus]) is None:
        return Note(RejectionCode.NOT_UNLOADED)
    if pull.trial.test == "dynamic":
        try:
            fit_damping(pull)
        except UnusableTrial as error:
            return error.reason
    return None

"""Fit every cuff of a session, donning by donning; donnings are never pooled.

Composition only: the steps are in the other folders.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from fitting.cuffs.cuff_fit import CuffFit, SessionFit, TrialFit, estimate_lag, list_trials
from fitting.cuffs.published_method import published_notes
from fitting.cuffs.wearable_cuff import joint_covariance
from fitting.diagnosis.causes import diagnose
from fitting.diagnosis.identification import (
    MIN_LOADS,
    FittedPull,
    along_unknown_rope,
    fitted_pulls,
    identify,
    notes_on,
    shows_rope,
    started_before,
    used_pulls,
)
from fitting.dynamic.damping import fit_damping, fit_swings
from fitting.errors import UnusableTrial
from fitting.laws.model_class import FRICTION, compare_classes, sample_pull
from fitting.pull.pull import Pull, make_pulls, newest_first, of_test
from fitting.results.codes import CauseCode, Verdict
from fitting.results.sentences import Note
from fitting.results.trial_codes import RejectionCode, TrialNoteCode
from fitting.spatial.tensors import fit_tensors
from fitting.static.held_loads import fit_held_loads, fit_migration
from fitting.trial.bounce import BounceTrial, calibrate
from fitting.trial.timeline import damage_figures
from fitting.trial.trial import RejectedTrial, Trial, TrialReading, calibrated_by, data_origins
from recordings.manifest import DataOrigin


def fit_session(
    trials: Sequence[Trial],
    rejected: Sequence[RejectedTrial] = (),
    progress: Callable[[int, int], None] = lambda *_: None,
) -> SessionFit:
    """Fit every cuff of a session.

    An unusable trial is listed with the reason under its cuff, and the other trials are fitted. rejected are recordings
    that cannot be read as trials; they are listed with their reasons. progress(done, total) counts donnings.
    """
    trials_by_donning: dict[tuple[str, str], list[Trial]] = {}
    for trial in sorted(trials, key=lambda trial: (trial.start_utc_ns, trial.file)):
        trials_by_donning.setdefault((trial.cuff.name, trial.donning), []).append(trial)
    donnings: dict[str, dict[str, CuffFit]] = {}
    for done, ((cuff, donning), donning_trials) in enumerate(trials_by_donning.items()):
        progress(done, len(trials_by_donning))
        donning_rejected = [
            trial
            for trial in rejected
            if trial.capture
            and trial.capture.cuff
            and (trial.capture.cuff.name, trial.capture.donning) == (cuff, donning)
        ]
        donnings.setdefault(cuff, {})[donning] = fit_donning(donning_trials, donning_rejected)
    progress(len(trials_by_donning), len(trials_by_donning))
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


def fit_donning(trials: Sequence[Trial], rejected: Sequence[RejectedTrial] = ()) -> CuffFit:
    """The fit of one donning from its trials in time order.

    If a repeat was recorded several times, the highest usable run is used. Migration is measured from the first static
    trial of the donning, even if that repeat was recorded again. rejected are recordings of the donning that cannot be
    read as trials; if a static one of them is earlier, migration is not identified.
    """
    first = trials[0]
    pulls, refused = make_pulls(trials)
    along_line = [pull for pull in pulls if not pull.is_along_another_line]
    all_static = of_test(along_line, "static")
    static = [runs[0] for runs in newest_first(all_static)]
    held = fit_held_loads(static, max(trial.gain_sd for trial in trials))
    swings = fit_swings(of_test(along_line, "dynamic"), held.stiffness.stiffness, first.cuff_mass, first.gain_sd)
    refused |= swings.refused
    fitted = fitted_pulls(along_line, static, held, swings)
    used = used_pulls(fitted, pulls)
    before = started_before(all_static, trials, rejected, refused)
    in_order = _undamaged(fitted)
    classes = compare_classes([sample_pull(used.pull, used.plateaus, used.oscillation) for used in in_order])
    has_friction = classes is not None and FRICTION in classes.chosen
    if has_friction:
        held = replace(held, stiffness=held.stiffness.with_friction())
    identified = identify(static, all_static, held, swings, before, has_friction=has_friction)
    fit = CuffFit(
        name=first.cuff.name,
        site=first.cuff.site,
        donning=first.donning,
        stiffness=identified.stiffness,
        damping=identified.damping,
        migration=identified.migration,
        verdicts=identified.verdicts,
        covariance=joint_covariance(identified.estimates),
        sources={pull.trial.file: pull.trial.sha256 for pull in (*used.values(), *all_static[:1])}
        | calibrated_by(trials),
        lag=estimate_lag([fitted_pull.pull.trial for fitted_pull in fitted.values()] or trials),
        trials=list_trials(trials, pulls, used, fitted, held.stiffness.if_friction, refused),
        notes=notes_on(trials, all_static, held, swings, identified, before) + published_notes(list(fitted.values())),
        held=held,
        diagnostics=({"slip_m": held.stiffness.slip} if held.stiffness.stiffness else {}) | swings.means,
        energy=swings.energy,
        complex_stiffness=swings.complex_stiffness,
        tensors=fit_tensors(list(used.values()), swings.oscillations),
        origin=DataOrigin.joined(data_origins(trials)),
        pulls=fitted,
        classes=classes,
    )
    return _with_direction_error(_diagnosed(fit, in_order) if in_order else fit, along_line)


def _with_direction_error(fit: CuffFit, along_line: Sequence[Pull]) -> CuffFit:
    """The fit whose k and c include that the direction of the rope is unknown, if no markers show it.

    The diagnosis compares the trials along their common displacement, without this error.
    """
    if shows_rope(of_test(along_line, "static")):
        return fit
    stiffness, damping = along_unknown_rope(fit.stiffness), fit.damping
    if not shows_rope(along_line):
        damping = along_unknown_rope(damping)
    covariance = joint_covariance((stiffness, damping, fit.migration))
    return replace(fit, stiffness=stiffness, damping=damping, covariance=covariance)


def _undamaged(fitted: Mapping[str, FittedPull]) -> list[FittedPull]:
    """The pulls whose files are not damaged, in time order."""
    undamaged = [used for used in fitted.values() if not used.pull.trial.damage]
    return sorted(undamaged, key=lambda used: (used.pull.trial.start_utc_ns, used.pull.trial.file))


def _diagnosed(fit: CuffFit, in_order: Sequence[FittedPull]) -> CuffFit:
    """The fit with its diagnosis."""
    creeps = fit.held is None or fit.held.creep is None or fit.held.creep.is_seen
    diagnosis = diagnose(in_order, fit.stiffness, fit.complex_stiffness, fit.classes, creeps=creeps)
    verdicts = {CauseCode.GAIN: Verdict.SCALE, CauseCode.LOADS: Verdict.SCALE, CauseCode.SKIN: Verdict.SKIN}
    wrong = tuple(verdicts[cause.code] for cause in diagnosis.causes if cause.code in verdicts)
    kept = tuple(verdict for verdict in fit.verdicts if not (wrong and verdict is Verdict.IDENTIFIED))
    trials = tuple(_without_misfit(trial) for trial in fit.trials) if fit.classes and fit.classes.chosen else fit.trials
    return replace(fit, verdicts=kept + wrong, classes=diagnosis.classes, diagnosis=diagnosis, trials=trials)


def _without_misfit(trial: TrialFit) -> TrialFit:
    """Without the note on correlated marker noise: another law explains the residual of a spring and a damper."""
    return replace(trial, notes=tuple(note for note in trial.notes if note.code is not TrialNoteCode.COLOURED))

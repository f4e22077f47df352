"""All trials of a session → the fit of every cuff, donning by donning; donnings are never pooled."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from fitting.curves import TrialCurves
from fitting.donning import fit_donning
from fitting.laws.diagnosis import diagnose
from fitting.laws.history import history_of
from fitting.laws.model_class import compare_classes
from fitting.quality import damage_sentence
from fitting.result import CuffFit, SessionFit, with_diagnosis
from fitting.trial import RejectedTrial, Trial


def fit_session(
    trials: Sequence[Trial],
    rejected: Sequence[RejectedTrial] = (),
    progress: Callable[[int, int], None] = lambda *_: None,
) -> SessionFit:
    """Fits every cuff of a session; `rejected` are recordings that were none, and are listed with their reason.

    A trial that cannot be used is listed with its reason under its cuff, and the others are fitted. progress(done,
    total) counts donnings.
    """
    together: dict[tuple[str, str], list[Trial]] = {}
    for trial in sorted(trials, key=lambda trial: (trial.start_utc_ns, trial.file)):
        together.setdefault((trial.cuff.name, trial.donning), []).append(trial)
    donnings: dict[str, dict[str, CuffFit]] = {}
    curves: dict[str, TrialCurves] = {}
    for done, ((cuff, donning), of_donning) in enumerate(together.items()):
        progress(done, len(together))
        lost = [
            each
            for each in rejected
            if each.capture and each.capture.cuff and (each.capture.cuff.name, each.capture.donning) == (cuff, donning)
        ]
        fit, drawn = fit_donning(of_donning, lost)
        sound = [curves for curves in drawn.values() if not curves.trial.damage]
        damage = {trial.file: trial.damage for trial in of_donning if trial.damage}
        donnings.setdefault(cuff, {})[donning] = _diagnosed(_with_damage(fit, damage), sound)
        curves |= drawn
    progress(len(together), len(together))
    calibration = next((trial.calibration for trial in trials if trial.calibration), None)
    return SessionFit(donnings, tuple(rejected), curves, calibration)


def _with_damage(fit: CuffFit, damage: Mapping[str, tuple[str, ...]]) -> CuffFit:
    """The fit with nothing said of damaged files but their damage."""
    trials = tuple(
        replace(trial, notes=(damage_sentence(found),), reason=trial.reason and damage_sentence(found), damage=found)
        if (found := damage.get(trial.file))
        else trial
        for trial in fit.trials
    )
    return replace(fit, trials=trials)


def _diagnosed(fit: CuffFit, curves: Sequence[TrialCurves]) -> CuffFit:
    """The fit with its comparison of laws and its diagnosis, of trials whose files are sound."""
    if not curves:
        return fit
    in_order = sorted(curves, key=lambda each: (each.trial.start_utc_ns, each.trial.file))
    classes = compare_classes([history_of(each) for each in in_order])
    creeps = fit.held.get("creep", {"is_seen": True})["is_seen"]
    diagnosis = diagnose(in_order, fit.stiffness, fit.complex_stiffness, classes, creeps=creeps)
    return with_diagnosis(fit, diagnosis)

"""Whether a trial can be used, told from it alone, so that it can be recorded again while the cuff is still on.

A fit of the whole donning says more; what is refused here, no fit can use.
"""

from __future__ import annotations

from fitting.bounce import BounceTrial, calibrate
from fitting.dynamic.damping import fit_damping
from fitting.identification import MIN_LOADS
from fitting.quality import UnusableTrial, damage_sentence
from fitting.results.codes import Verdict
from fitting.results.rendering import sentence_of
from fitting.spatial.reduction import ReducedTrial, reduce_trials
from fitting.static.migration import fit_migration
from fitting.trial import RejectedTrial, Trial, TrialReading


def why_unusable(reading: TrialReading) -> str:
    """A sentence, empty for a trial that can be used.

    A static trial has to start and to end unloaded: of the first and the last of a donning migration is the difference.
    """
    if isinstance(reading, RejectedTrial):
        return reading.reason
    if isinstance(reading, BounceTrial):
        _, refused = calibrate([reading])
        return "; ".join(refused.values())
    reduced, reasons = reduce_trials([reading])
    reason = "; ".join(reasons.values()) or _why_not_fitted(reduced[0], reading)
    return damage_sentence(reading.damage) if reason and reading.damage else reason


def _why_not_fitted(reduced: ReducedTrial, trial: Trial) -> str:
    if trial.test == "static" and len(reduced.plateaus) < MIN_LOADS:
        return sentence_of(Verdict.FEW_LOADS)
    if trial.test == "static" and fit_migration([reduced.plateaus]) is None:
        return "the static trial does not start, or does not end, unloaded, so that migration is not known from it"
    if trial.test == "dynamic":
        try:
            fit_damping(trial, reduced.displacement)
        except UnusableTrial as error:
            return str(error)
    return ""

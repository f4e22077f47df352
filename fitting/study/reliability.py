"""Reliability of one measurement: intraclass correlation, standard error of measurement, minimal detectable change.

    ICC(2,1) = σ²_volunteer / (σ²_volunteer + σ²_error)      (Shrout and Fleiss 1979, Psychol. Bull. 86:420)
    SEM = σ_error,   MDC = 1.96 √2 SEM                        (Weir 2005, J. Strength Cond. Res. 19:231)

σ²_error is the sum of all other components and of the known noise: absolute agreement of single measurements.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from fitting.study.profile import ratio_interval
from fitting.study.variance_components import ComponentOutcome, MixedModel
from fitting.uncertainty import NORMAL_95

DETECTABLE = NORMAL_95 * math.sqrt(2.0)
"""MDC over SEM: two measurements of the same volunteer differ by more in 5 % of cases, though nothing has changed."""


class ReliabilityOutcome(StrEnum):
    """What the design allows to estimate.

    COMPLETE        all sources of error vary
    LESS_OPERATOR   one operator: the error between operators is not included
    NO_DONNINGS     every volunteer was measured in one donning: the error is not separated from the volunteers
    ONE_VOLUNTEER   SEM and MDC of this volunteer; an ICC needs several
    """

    COMPLETE = "complete"
    LESS_OPERATOR = "without_operator"
    NO_DONNINGS = "no_repeated_donnings"
    ONE_VOLUNTEER = "one_volunteer"


@dataclass(frozen=True)
class Measure:
    """A number with its 95 % interval; NaN where the design does not give it."""

    value: float = math.nan
    ci95: tuple[float, float] = (math.nan, math.nan)


@dataclass(frozen=True)
class Reliability:
    """ICC(2,1), SEM and MDC (unit of the values) of one repeat in one donning by any operator."""

    outcome: ReliabilityOutcome
    icc: Measure = Measure()
    sem: Measure = Measure()
    mdc: Measure = Measure()


def estimate_reliability(model: MixedModel, subject: str, donning: str, operator: str) -> Reliability:
    """Reliability from a fitted model; subject, donning and operator are the names of its components.

    The interval of the ICC is that of the profile likelihood. That of the SEM combines the intervals of the components
    (method of variance estimates recovery, Zou and Donner 2008, Stat. Med. 27:1693).
    """
    outcome = _outcome(model, subject, donning, operator)
    if outcome is ReliabilityOutcome.NO_DONNINGS:
        return Reliability(outcome)
    sem = _standard_error(model, subject)
    mdc = Measure(DETECTABLE * sem.value, (DETECTABLE * sem.ci95[0], DETECTABLE * sem.ci95[1]))
    if outcome is ReliabilityOutcome.ONE_VOLUNTEER:
        return Reliability(outcome, sem=sem, mdc=mdc)
    return Reliability(outcome, _correlation(model, subject), sem, mdc)


def _outcome(model: MixedModel, subject: str, donning: str, operator: str) -> ReliabilityOutcome:
    subjects = model.components[subject].outcome
    if not model.components[donning].is_estimated:
        return ReliabilityOutcome.NO_DONNINGS
    if subjects is ComponentOutcome.ONE_LEVEL:
        return ReliabilityOutcome.ONE_VOLUNTEER
    return ReliabilityOutcome.COMPLETE if model.components[operator].is_estimated else ReliabilityOutcome.LESS_OPERATOR


def _standard_error(model: MixedModel, subject: str) -> Measure:
    errors = [component for component in model.estimated if component.name != subject]
    estimates = np.array([component.variance for component in errors])
    ends = np.array([component.ci95 for component in errors])
    variance = float(estimates.sum()) + model.noise
    low = variance - float(np.linalg.norm(estimates - ends[:, 0]))
    high = variance + float(np.linalg.norm(ends[:, 1] - estimates))
    return Measure(math.sqrt(variance), (math.sqrt(max(0.0, low)), math.sqrt(high)))


def _correlation(model: MixedModel, subject: str) -> Measure:
    names = [component.name for component in model.estimated]
    index, noise = names.index(subject), model.noise / model.contrasts.scale**2
    total = float(model.solution.theta.sum()) + noise
    dof = min(component.levels for component in model.estimated) - 1
    ends = ratio_interval(model.contrasts, model.solution, index, noise, dof)
    return Measure(float(model.solution.theta[index]) / total, ends)

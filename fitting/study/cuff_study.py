"""One quantity of one cuff over the volunteers of a study, and two cuffs compared."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from itertools import combinations

import numpy as np

from fitting.results.outcome import FitOutcome
from fitting.study.agreement import Agreement, agree
from fitting.study.fixed_effects import FixedEffect, estimate_effect, predict_observation
from fitting.study.measurements import (
    DONNING,
    OPERATOR,
    REPEAT,
    VOLUNTEER,
    Observation,
    known_covariance,
    study_factors,
    values_of,
)
from fitting.study.reliability import Reliability, estimate_reliability
from fitting.study.reml import Array
from fitting.study.variance_components import MixedModel, TooFewObservations, fit_components
from fitting.uncertainty import NORMAL_95


class StudyOutcome(StrEnum):
    """What a study gives for a quantity.

    COMPLETE        mean over volunteers with a prediction interval
    ONE_VOLUNTEER   the mean is that of one volunteer: no prediction
    TOO_FEW         fewer than two measurements, or no spread and no known noise
    NOT_CONVERGED   the REML iteration did not converge: no figure can be used
    """

    COMPLETE = "complete"
    ONE_VOLUNTEER = "one_volunteer"
    TOO_FEW = "too_few_measurements"
    NOT_CONVERGED = "not_converged"


class ComparisonOutcome(StrEnum):
    """Whether two cuffs can be compared over volunteers."""

    COMPARED = "compared"
    FEW_COMMON = "fewer_than_two_common_volunteers"
    NOT_CONVERGED = "not_converged"


@dataclass(frozen=True)
class VolunteerMean:
    """Mean over the donnings of a volunteer, and its 95 % interval."""

    volunteer: str
    value: float
    ci95: tuple[float, float]
    donnings: int


@dataclass(frozen=True)
class CuffStudy:
    """Statistics of a quantity, in its unit; a field is None where the outcome does not give it.

    repeats     in a donning, the median: `prediction` is that of the mean of so many in a new donning
    agreements  "donnings": first and second donning of every volunteer; "A to B": two operators
    """

    outcome: StudyOutcome
    measurements: tuple[Observation, ...]
    repeats: int = 1
    model: MixedModel | None = None
    mean: FixedEffect | None = None
    prediction: FixedEffect | None = None
    reliability: Reliability | None = None
    volunteers: tuple[VolunteerMean, ...] = ()
    agreements: Mapping[str, Agreement] = field(default_factory=dict)


@dataclass(frozen=True)
class CuffComparison:
    """second − first over the volunteers that wore both, None where it cannot be estimated."""

    first: str
    second: str
    volunteers: int
    outcome: ComparisonOutcome
    difference: FixedEffect | None = None


def analyse(measurements: Sequence[Observation]) -> CuffStudy:
    """Variance components, mean, prediction, reliability and agreement of one quantity of one cuff."""
    measurements = tuple(measurements)
    repeats = _median_repeats(measurements)
    try:
        model = fit_components(values_of(measurements), study_factors(measurements), known_covariance(measurements))
    except TooFewObservations:
        return CuffStudy(StudyOutcome.TOO_FEW, measurements, repeats)
    if model.outcome is not FitOutcome.CONVERGED:
        return CuffStudy(StudyOutcome.NOT_CONVERGED, measurements, repeats)
    has_several = model.components[VOLUNTEER].is_estimated
    return CuffStudy(
        outcome=StudyOutcome.COMPLETE if has_several else StudyOutcome.ONE_VOLUNTEER,
        measurements=measurements,
        repeats=repeats,
        model=model,
        mean=estimate_effect(model, np.ones(1), model.components[VOLUNTEER].levels - 1 if has_several else math.inf),
        prediction=_predict(model, repeats) if has_several else None,
        reliability=estimate_reliability(model, VOLUNTEER, DONNING, OPERATOR),
        volunteers=tuple(_volunteer_means(model, measurements)),
        agreements=_agreements(measurements),
    )


def compare(measurements: Sequence[Observation], first: str, second: str) -> CuffComparison:
    """Difference of two cuffs over the volunteers who wore both, with the interval of Kenward and Roger."""
    worn = {cuff: {one.volunteer for one in measurements if one.cuff == cuff} for cuff in (first, second)}
    common = worn[first] & worn[second]
    if len(common) < 2:
        return CuffComparison(first, second, len(common), ComparisonOutcome.FEW_COMMON)
    kept = [one for one in measurements if one.volunteer in common and one.cuff in (first, second)]
    is_second = np.array([float(one.cuff == second) for one in kept])
    fixed = np.column_stack([np.ones(len(kept)), is_second])
    try:
        model = fit_components(
            values_of(kept), study_factors(kept), known_covariance(kept), fixed, with_intervals=False
        )
    except TooFewObservations:
        return CuffComparison(first, second, len(common), ComparisonOutcome.FEW_COMMON)
    if model.outcome is not FitOutcome.CONVERGED:
        return CuffComparison(first, second, len(common), ComparisonOutcome.NOT_CONVERGED)
    difference = estimate_effect(model, np.array([0.0, 1.0]), len(common) - 1)
    return CuffComparison(first, second, len(common), ComparisonOutcome.COMPARED, difference)


def _median_repeats(measurements: Sequence[Observation]) -> int:
    counts: dict[str, int] = {}
    for one in measurements:
        counts[one.donning_key] = counts.get(one.donning_key, 0) + 1
    return round(float(np.median(list(counts.values())))) if counts else 1


def _predict(model: MixedModel, repeats: int) -> FixedEffect:
    shares = np.array([1 / repeats if one.name == REPEAT else 1.0 for one in model.estimated])
    return predict_observation(model, shares, model.noise / repeats, model.components[VOLUNTEER].levels - 1)


def _volunteer_means(model: MixedModel, measurements: Sequence[Observation]) -> list[VolunteerMean]:
    """Equal weights of donnings, and of repeats in a donning. The interval holds the errors, not the volunteers."""
    names = [one.name for one in model.estimated]
    errors = model.covariance()
    if VOLUNTEER in names:
        place = names.index(VOLUNTEER)
        errors = errors - model.theta[place] * model.matrices[place]
    found = []
    for volunteer in dict.fromkeys(one.volunteer for one in measurements):
        weights, donnings = _weights(measurements, volunteer)
        value, reach = float(weights @ model.values), NORMAL_95 * math.sqrt(float(weights @ errors @ weights))
        found.append(VolunteerMean(volunteer, value, (value - reach, value + reach), donnings))
    return found


def _weights(measurements: Sequence[Observation], volunteer: str) -> tuple[Array, int]:
    keys = [one.donning_key if one.volunteer == volunteer else "" for one in measurements]
    donnings = len(set(keys) - {""})
    return np.array([1 / (donnings * keys.count(key)) if key else 0.0 for key in keys]), donnings


def _agreements(measurements: Sequence[Observation]) -> dict[str, Agreement]:
    """Of the first two donnings of every volunteer, and of every two operators over the volunteers of both."""
    by_donning: dict[str, dict[str, list[float]]] = {}
    by_operator: dict[str, dict[str, list[float]]] = {}
    for one in measurements:
        by_donning.setdefault(one.volunteer, {}).setdefault(one.donning_key, []).append(one.value)
        by_operator.setdefault(one.operator, {}).setdefault(one.volunteer, []).append(one.value)
    twice = [list(donnings.values())[:2] for donnings in by_donning.values() if len(donnings) > 1]
    found = {"donnings": _agree([(np.mean(first), np.mean(second)) for first, second in twice])}
    for first, second in combinations(sorted(by_operator), 2):
        common = by_operator[first].keys() & by_operator[second].keys()
        pairs = [(np.mean(by_operator[first][one]), np.mean(by_operator[second][one])) for one in sorted(common)]
        found[f"{first} to {second}"] = _agree(pairs)
    return {name: agreement for name, agreement in found.items() if agreement.differences.size}


def _agree(pairs: Sequence[tuple[np.floating, np.floating]]) -> Agreement:
    return agree(np.array(pairs, dtype=np.float64).reshape(-1, 2))

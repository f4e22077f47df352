"""One quantity of one cuff, measured repeatedly over the volunteers of a study, and two cuffs compared.

Fixed effects in small samples: Kenward and Roger 1997, Biometrics 53:983. For one linear function l'β their F statistic
is t² with ν degrees of freedom, and their scale factor is 1:

    Φ = (X'V⁻¹X)⁻¹,  P_i = −X'V⁻¹V_iV⁻¹X,  Q_ij = X'V⁻¹V_iV⁻¹V_jV⁻¹X,  W = covariance of θ̂
    Φ_A = Φ + 2 Φ {Σ_ij W_ij (Q_ij − P_i Φ P_j)} Φ
    ν = 2 (l'Φl)² / Σ_ij W_ij (l'ΦP_iΦl) (l'ΦP_jΦl)

Reliability of one measurement: intraclass correlation, standard error of measurement, minimal detectable change.

    ICC(2,1) = σ²_volunteer / (σ²_volunteer + σ²_error)      (Shrout and Fleiss 1979, Psychol. Bull. 86:420)
    SEM = σ_error,   MDC = 1.96 √2 SEM                        (Weir 2005, J. Strength Cond. Res. 19:231)

σ²_error is the sum of all other components and of the known noise: absolute agreement of single measurements.

Agreement of pairs of measurements (Bland and Altman 1999, Stat. Methods Med. Res. 8:135).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from itertools import combinations

import numpy as np
import scipy

from fitting.results.codes import FitOutcome
from fitting.study.restricted_likelihood import Array
from fitting.study.variance_components import (
    Component,
    ComponentOutcome,
    Factor,
    MixedModel,
    TooFewObservations,
    fit_components,
    ratio_interval,
)
from fitting.uncertainty import NORMAL_95


@dataclass(frozen=True)
class Observation:
    """One value, its standard error of its own (noise), and the one that its session shares (lag, gain).

    donning and repeat are numbered within the session.
    """

    value: float
    noise: float
    shared: float
    volunteer: str
    operator: str
    session: str
    donning: str
    repeat: int
    cuff: str = ""

    @property
    def donning_key(self) -> str:
        """The donning, unique in the study."""
        return f"{self.session} {self.cuff} {self.donning}"


LARGE_DOF = 1e6  # above, and where no variance is estimated, the interval is the normal one
DETECTABLE = NORMAL_95 * math.sqrt(2.0)
"""MDC over SEM: two measurements of the same volunteer differ by more in 5 % of cases, though nothing has changed."""
FEWEST_PAIRS = 3


class StudyOutcome(StrEnum):
    """Outcome of the analysis of a quantity.

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

    measurements  their number
    repeats       in a donning, the median: `prediction` is that of the mean of so many in a new donning
    noise_sd      mean known standard error of one repeat
    agreements    "donnings": first and second donning of every volunteer; "A to B": two operators
    """

    outcome: StudyOutcome
    measurements: int
    repeats: int = 1
    noise_sd: float | None = None
    mean: FixedEffect | None = None
    prediction: FixedEffect | None = None
    components: Mapping[str, ComponentSpread] = field(default_factory=dict)
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
    counts = Counter(one.donning_key for one in measurements)
    repeats = round(float(np.median(list(counts.values())))) if counts else 1
    model = fit_model(measurements, _study_factors(measurements))
    if model is None:
        return CuffStudy(StudyOutcome.TOO_FEW, len(measurements), repeats)
    if model.outcome is not FitOutcome.CONVERGED:
        return CuffStudy(StudyOutcome.NOT_CONVERGED, len(measurements), repeats)
    has_several = model.components[VOLUNTEER].is_estimated
    return CuffStudy(
        outcome=StudyOutcome.COMPLETE if has_several else StudyOutcome.ONE_VOLUNTEER,
        measurements=len(measurements),
        repeats=repeats,
        noise_sd=math.sqrt(model.noise),
        mean=estimate_effect(model, np.ones(1), model.components[VOLUNTEER].levels - 1 if has_several else math.inf),
        prediction=_predict(model, repeats) if has_several else None,
        components={name: _spread(component) for name, component in model.components.items()},
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
    model = fit_model(
        kept, _study_factors(kept), np.column_stack([np.ones(len(kept)), is_second]), with_intervals=False
    )
    if model is None:
        return CuffComparison(first, second, len(common), ComparisonOutcome.FEW_COMMON)
    if model.outcome is not FitOutcome.CONVERGED:
        return CuffComparison(first, second, len(common), ComparisonOutcome.NOT_CONVERGED)
    difference = estimate_effect(model, np.array([0.0, 1.0]), len(common) - 1)
    return CuffComparison(first, second, len(common), ComparisonOutcome.COMPARED, difference)


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
    pairs = {"donnings": [(np.mean(first), np.mean(second)) for first, second in twice]}
    for first, second in combinations(sorted(by_operator), 2):
        common = by_operator[first].keys() & by_operator[second].keys()
        both = [(np.mean(by_operator[first][one]), np.mean(by_operator[second][one])) for one in sorted(common)]
        pairs[f"{first} to {second}"] = both
    return {name: agree(np.array(found, dtype=np.float64)) for name, found in pairs.items() if found}


@dataclass(frozen=True)
class FixedEffect:
    """A mean, difference or prediction l'β in the unit of the values; ci95 of a prediction is its 95 % interval.

    dof  degrees of freedom, of Kenward and Roger; of a prediction, of Satterthwaite
    """

    value: float
    standard_error: float
    dof: float
    ci95: tuple[float, float]


@dataclass(frozen=True)
class _Adjusted:
    beta: Array
    covariance: Array  # Φ
    adjusted: Array  # Φ_A
    first: Array  # (components, p, p): P_i


def estimate_effect(model: MixedModel, weights: Array, most_dof: float = math.inf) -> FixedEffect:
    """l'β of the model for weights l (p,).

    most_dof limits the degrees of freedom: a variance that is estimated as zero is not known to be zero.
    """
    found = _adjust(model)
    dof = min(most_dof, _dof(float(weights @ found.covariance @ weights), _slopes(found, weights), model))
    return _effect(float(weights @ found.beta), float(weights @ found.adjusted @ weights), dof)


def predict_observation(model: MixedModel, shares: Array, noise: float, most_dof: float = math.inf) -> FixedEffect:
    """95 % prediction interval of a new measurement about the mean of a model without other fixed effects.

    shares (components,): the part of each variance that it carries, as 1/r of that between r repeats; noise: variance
    of its known error. The degrees of freedom are those of Satterthwaite for the sum of all variances, limited as in
    estimate_effect.
    """
    found, weights = _adjust(model), np.ones(1)
    variance = float(shares @ model.theta) + noise + float(found.adjusted[0, 0])
    dof = min(most_dof, _dof(variance, shares + _slopes(found, weights), model))
    return _effect(float(found.beta[0]), variance, dof)


def _effect(value: float, variance: float, dof: float) -> FixedEffect:
    error = math.sqrt(variance)
    reach = quantile(dof) * error
    return FixedEffect(value, error, dof, (value - reach, value + reach))


def quantile(dof: float) -> float:
    """97.5 % quantile of Student's t."""
    return float(scipy.stats.t.ppf(0.975, dof)) if dof < LARGE_DOF else NORMAL_95


def _adjust(model: MixedModel) -> _Adjusted:
    factor = scipy.linalg.cho_factor(model.covariance())
    whitened = scipy.linalg.cho_solve(factor, model.fixed)  # V⁻¹X
    phi: Array = np.linalg.inv(model.fixed.T @ whitened).astype(np.float64)
    beta = phi @ whitened.T @ model.values
    turned = model.matrices @ whitened  # V_iV⁻¹X
    first = -np.einsum("np,inq->ipq", whitened, turned)
    solved = np.array([scipy.linalg.cho_solve(factor, matrix) for matrix in turned]).reshape(turned.shape)
    second = np.einsum("inp,jnq->ijpq", turned, solved)
    weights = model.theta_covariance()
    excess = np.einsum("ij,ijpq->pq", weights, second - np.einsum("ipr,rs,jsq->ijpq", first, phi, first))
    return _Adjusted(beta, phi, phi + 2 * phi @ excess @ phi, first)


def _slopes(found: _Adjusted, weights: Array) -> Array:
    """∂ l'Φl / ∂θ_i (components,)."""
    reached = found.covariance @ weights
    return np.asarray(-np.einsum("p,ipq,q->i", reached, found.first, reached))


def _dof(variance: float, slopes: Array, model: MixedModel) -> float:
    spread = float(slopes @ model.theta_covariance() @ slopes)
    return max(1.0, 2 * variance**2 / spread) if spread > 2 * variance**2 / LARGE_DOF else LARGE_DOF


class ReliabilityOutcome(StrEnum):
    """Which errors the design can estimate.

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
    """A number with its 95 % interval; None where the design does not give it."""

    value: float | None = None
    ci95: tuple[float | None, float | None] | None = None


def _measure(value: float, low: float, high: float) -> Measure:
    """None for a number that is not finite."""
    known, *ends = (float(number) if math.isfinite(number) else None for number in (value, low, high))
    return Measure(known, None if ends == [None, None] else (ends[0], ends[1]))


@dataclass(frozen=True)
class ComponentSpread:
    """A variance component as standard deviation; confounded_with: components whose estimates include it."""

    outcome: ComponentOutcome
    levels: int
    sd: Measure = Measure()
    confounded_with: tuple[str, ...] = ()


def _spread(component: Component) -> ComponentSpread:
    sd = Measure()
    if component.is_estimated:
        sd = _measure(*map(math.sqrt, (component.variance, *component.ci95)))
    return ComponentSpread(component.outcome, component.levels, sd, component.confounded_with)


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
    error = _standard_error(model, subject)
    sem, mdc = _measure(*error), _measure(*(DETECTABLE * end for end in error))
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


def _standard_error(model: MixedModel, subject: str) -> tuple[float, float, float]:
    """SEM and the ends of its interval."""
    errors = [component for component in model.estimated if component.name != subject]
    estimates = np.array([component.variance for component in errors])
    ends = np.array([component.ci95 for component in errors])
    variance = float(estimates.sum()) + model.noise
    low = variance - float(np.linalg.norm(estimates - ends[:, 0]))
    high = variance + float(np.linalg.norm(ends[:, 1] - estimates))
    return math.sqrt(variance), math.sqrt(max(0.0, low)), math.sqrt(high)


def _correlation(model: MixedModel, subject: str) -> Measure:
    names = [component.name for component in model.estimated]
    index, noise = names.index(subject), model.noise / model.contrasts.scale**2
    total = float(model.solution.theta.sum()) + noise
    dof = min(component.levels for component in model.estimated) - 1
    ends = ratio_interval(model.contrasts, model.solution, index, noise, dof)
    return _measure(float(model.solution.theta[index]) / total, *ends)


@dataclass(frozen=True)
class Agreement:
    """Bland–Altman analysis in the unit of the pairs: bias (second − first) and 95 % limits of agreement.

    means and differences of the pairs; the limits are unknown for fewer than three pairs.
    """

    means: tuple[float, ...]
    differences: tuple[float, ...]
    bias: Measure
    lower_limit: Measure = Measure()
    upper_limit: Measure = Measure()


def agree(pairs: Array) -> Agreement:
    """Bland–Altman analysis of independent pairs (pairs, 2).

    The interval of a limit is t √(1/n + 1.96²/(2 (n − 1))) standard deviations of the differences, as in section 2.2.
    """
    differences = pairs[:, 1] - pairs[:, 0]
    count = len(differences)
    of_pairs = tuple(pairs.mean(axis=1).tolist()), tuple(differences.tolist())
    bias = float(differences.mean()) if count else math.nan
    if count < FEWEST_PAIRS:
        return Agreement(*of_pairs, _measure(bias, math.nan, math.nan))
    spread, t = float(differences.std(ddof=1)), quantile(count - 1)
    reach = t * spread / math.sqrt(count)
    half = t * spread * math.sqrt(1 / count + NORMAL_95**2 / (2 * (count - 1)))
    limits = (
        _measure(limit, limit - half, limit + half) for limit in (bias - NORMAL_95 * spread, bias + NORMAL_95 * spread)
    )
    return Agreement(*of_pairs, _measure(bias, bias - reach, bias + reach), *limits)


# names of the variance components
VOLUNTEER, OPERATOR, DONNING, REPEAT, INTERACTION = "volunteer", "operator", "donning", "repeat", "volunteer_by_cuff"


def fit_model(
    measurements: Sequence[Observation],
    factors: Sequence[Factor],
    fixed: Array | None = None,
    *,
    with_intervals: bool = True,
) -> MixedModel | None:
    """The model with the known errors of the fits, noise of each value and common errors of a session; None where there
    are too few observations.
    """
    values, noise, shared = (
        np.array([getattr(one, name) for one in measurements], dtype=np.float64)
        for name in ("value", "noise", "shared")
    )
    sessions = Factor("session", [one.session for one in measurements]).incidence()
    known = np.diag(noise**2) + (sessions @ sessions.T) * np.outer(shared, shared)
    try:
        return fit_components(values, factors, known, fixed, with_intervals=with_intervals)
    except TooFewObservations:
        return None


def _study_factors(measurements: Sequence[Observation]) -> list[Factor]:
    """Random effects of a study; of those that its design does not separate, the first keeps the estimate.

    Donnings are nested in volunteers, repeats in donnings; operators are crossed with volunteers.
    """
    pairs = [f"{one.volunteer} {one.cuff}" for one in measurements]
    has_several = len({one.cuff for one in measurements}) > 1
    return [
        Factor(VOLUNTEER, [one.volunteer for one in measurements]),
        *([Factor(INTERACTION, pairs)] if has_several else []),
        Factor(DONNING, [one.donning_key for one in measurements]),
        Factor(REPEAT, range(len(measurements))),
        Factor(OPERATOR, [one.operator for one in measurements]),
    ]

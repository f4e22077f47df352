"""Stiffness from held loads: the slope of force over displacement between slips.

A cuff slips when the load exceeds all previous loads, and not below. So the plateaus of a trial are divided into
segments with separate offsets; a new segment begins when the load exceeds all previous loads of the donning. The slope
within the segments is the stiffness, and the distance between their offsets is slip.

Tangent stiffness over the load by the exponential law:

    F − F_z = (k0/b) (e^(b y) − 1), so dF/dx = k0 + b (F − F_z): the tangent stiffness is linear in F, and the zero F_z
    of the cell need not be known. Integrated from a load F_r with tangent κ, and ρ = b/κ,

    x = ln(1 + ρ (F − F_r)) / (ρ κ) + a,   with one offset a for every stretch without slip

Law: Schiebl et al. 2025, Sensors 25(15) 4605, who found exponentials for the upper arm.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise
from typing import Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from documents.results import EqualByFields
from fitting.pull.plateaus import SAME_LOAD, Plateau
from fitting.results.codes import NEGLIGIBLE, FitOutcome, worst
from fitting.uncertainty import (
    NORMAL_95,
    Estimate,
    Repeat,
    as_inverse,
    chi_square_limit,
    combine,
    normal_estimate,
    student_estimate,
)
from solver.cuff import KelvinVoigt

Array = NDArray[np.float64]

SOFTEST, STIFFEST = -0.9, 20.0  # of ρ × range of loads: tangent at the highest load over that at the lowest, minus 1
MAX_STEPS = 500  # of the search for the growth
MIN_STRAIGHT = 2  # degrees of freedom that a line through the plateaus must have before slip is excluded
INCONSISTENT = 3.0  # combined standard errors between unloading and reloading; beyond, the cuff slips in reloading too
MOST_FRICTION = 0.1
"""Largest friction, as part of the load, that is considered as an alternative to slip. More would resist half of the
force of a usual swing."""
ROUNDS, MAX_ROUNDS = 4, 40  # of reweighting, least and most; they end when the compliance has converged
LEAST_SD = 1e-7  # standard error of a displacement [m], for a marker stream without noise


@dataclass(frozen=True)
class HeldPoints:
    """Held loads of a donning: force [N], displacement and its standard error [m], number of the offset; all (n,).

    The error of the force is included in that of the displacement, through the stiffness.
    """

    force: Array
    x: Array
    x_sd: Array
    group: NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class TangentLaw(EqualByFields):
    """Tangent stiffness k(F) = κ (1 + ρ (F − F_r)): slope 1/κ [m/N], growth ρ [1/N], their (2, 2) covariance.

    gain_sd is the relative standard uncertainty of the load cell's scale, common to all tangents; outcome is that of
    the search for the growth.
    """

    reference_force: float
    slope: float
    growth: float
    covariance: Array
    chi_square: float
    dof: int
    gain_sd: float
    outcome: FitOutcome = FitOutcome.CONVERGED

    @property
    def significance(self) -> float:
        """Curvature of the law in standard errors; negative if the cuff softens."""
        return self.growth / math.sqrt(self.covariance[1, 1])

    @property
    def stiffening(self) -> Estimate:
        """b [1/m] of the exponential law."""
        gradient = np.array([-self.growth / self.slope**2, 1 / self.slope])
        return normal_estimate(self.growth / self.slope, _error(gradient, self.covariance))

    def tangent(self, force: float) -> Estimate:
        """k [N/m] at a reading of the load cell [N]."""
        k = (1 + self.growth * (force - self.reference_force)) / self.slope
        gradient = np.array([-k / self.slope, (force - self.reference_force) / self.slope])
        noise = _error(gradient, self.covariance)
        alone = student_estimate(k, noise, self.dof) if self.dof < 30 else normal_estimate(k, noise)
        return alone.widened({"gain": self.gain_sd * k})


def fit_law(points: HeldPoints, gain_sd: float = 0.0) -> TangentLaw | None:
    """The exponential law through held loads, None for too few different loads."""
    groups = np.unique(points.group)
    dof = len(points.force) - len(groups) - 2
    if dof < 1 or np.bincount(points.group).max() < 3 or (span := float(np.ptp(points.force))) <= 0:
        return None
    weight = points.x_sd**-2.0
    load = points.force - points.force.min()

    def fit_slope(growth: float) -> tuple[float, float]:
        bent = within(_bent(load, growth), points.group, weight)
        displacement = within(points.x, points.group, weight)
        slope = float(weight @ (bent * displacement)) / float(weight @ bent**2)
        return slope, float(weight @ (displacement - slope * bent) ** 2)

    found = scipy.optimize.minimize_scalar(
        lambda growth: fit_slope(growth)[1],
        bounds=(SOFTEST / span, STIFFEST / span),
        method="bounded",
        options={"xatol": 1e-6 / span, "maxiter": MAX_STEPS},
    )
    growth = float(found.x)
    slope, chi_square = fit_slope(growth)
    if slope <= 0:
        return None
    step = 1e-4 / span
    bending = slope * (_bent(load, growth + step) - _bent(load, growth - step)) / (2 * step)
    columns = np.column_stack([within(column, points.group, weight) for column in (_bent(load, growth), bending)])
    covariance = np.asarray(np.linalg.inv((columns.T * weight) @ columns) * max(1.0, chi_square / dof), np.float64)
    outcome = FitOutcome.CONVERGED if found.success else FitOutcome.NOT_CONVERGED
    return TangentLaw(float(points.force.min()), slope, growth, covariance, chi_square, dof, gain_sd, outcome)


def within(values: Array, group: NDArray[np.intp], weight: Array) -> Array:
    """Values (n,) minus their weighted mean in their group."""
    total = np.bincount(group, weight)
    mean = np.bincount(group, weight * values) / np.where(total > 0, total, 1.0)
    return np.asarray(values - mean[group])


def _bent(load: Array, growth: float) -> Array:
    """ln(1 + ρ load)/ρ; its limit for ρ = 0."""
    return np.asarray(np.log1p(growth * load) / growth) if growth else load


def _error(gradient: Array, covariance: Array) -> float:
    return math.sqrt(float(gradient @ covariance @ gradient))


@dataclass(frozen=True, eq=False)
class StaticFit(EqualByFields):
    """Regression of one static trial.

    plateaus  in time order
    segment   (plateaus,) number of the segment
    offset    (plateaus,) N: force = k x + offset in the segment
    repeat    compliance 1/k [m/N] of this trial, None if no segment has two different loads
    x, x_sd   (plateaus,) m: displacement, and its standard error including that of the force
    outcome   of the reweighting rounds
    """

    plateaus: tuple[Plateau, ...]
    segment: NDArray[np.intp]
    offset: Array
    repeat: Repeat | None
    x: Array
    x_sd: Array
    outcome: FitOutcome = FitOutcome.CONVERGED


@dataclass(frozen=True, eq=False)
class StiffnessFit(EqualByFields):
    """k [N/m] of a donning from all its static trials, None if the load only rose and the cuff may have slipped.

    slip         m of slip while the load rose, summed over the donning
    slips_again  whether the cuff also slipped at previous loads, so that only unloading was used
    progressive_slip  m by which the displacement at the same load then increases from the first to the last trial
    friction     N of Coulomb friction, half the difference of the forces in loading and unloading; 0 without friction
    only_rose    whether no load was removed or added again
    law          tangent stiffness over the load, None for too few loads
    if_friction  k [N/m] for friction without slip, if the two cannot be distinguished; the interval includes it
    loading      k [N/m] of the loading branch, if all weights were removed at once
    if_slip      k [N/m] for slip without friction, where if_friction is given
    outcome      of all iterations for k
    """

    stiffness: Estimate | None
    trials: tuple[StaticFit, ...]
    slip: float
    slips_again: bool
    progressive_slip: float
    friction: float
    only_rose: bool
    law: TangentLaw | None
    if_friction: Estimate | None = None
    loading: Estimate | None = None
    if_slip: Estimate | None = None
    outcome: FitOutcome = FitOutcome.CONVERGED

    def with_friction(self) -> StiffnessFit:
        """For a cuff with friction: k is that of loading, not of a single unloading branch; its interval has both."""
        if self.stiffness is None or self.loading is None:
            return self
        wide = _with_friction_part(self.loading, self.stiffness.value - self.loading.value)
        low, high = (choose(ends) for choose, *ends in zip((min, max), wide.ci95, self.stiffness.ci95, strict=True))
        return replace(
            self,
            stiffness=replace(wide, ci95=(low, high)),
            if_friction=self.loading,
            if_slip=self.if_slip or self.stiffness,
            slips_again=False,
        )


def fit_stiffness(
    trials: Sequence[Sequence[Plateau]], gain_sd: float, drift_sd: float = 0.0, *, creeps: bool = False
) -> StiffnessFit:
    """k of one donning from the plateaus of its static trials in time order: (2) of the source study, F = k x, with an
    offset for every part of a trial between slips.

    gain_sd is the relative standard uncertainty of the load cell's scale, drift_sd [N/s] that of the drift of its zero.
    creeps states that deviations from the line are creep, not slip.
    """
    fits = _fit_trials(trials, gain_sd, drift_sd, "above all before")
    every_rise = _fit_trials(trials, gain_sd, drift_sd, "every rise")
    unslipped = _fit_trials(trials, gain_sd, drift_sd, "nowhere")
    turned = _fit_trials(trials, gain_sd, drift_sd, "at turns")
    slips_again, friction = _contradict(fits, every_rise), 0.0
    fits = every_rise if slips_again else fits
    only_rose = not any(fit.repeat for fit in fits)
    if_friction = loading = None
    if creeps or _retraces(unslipped) or _has_one_curve(unslipped, fit_law(_points(unslipped)), only_rose=only_rose):
        fits, slips_again = unslipped, False
    elif _is_straight(turned) and (friction := _friction(turned)) > 0:
        fits, slips_again = turned, False
    elif (loading := _loading_stiffness(fits, turned)) and _may_be_friction(fits, turned, loading):
        if_friction = loading
    repeats = _repeats(fits)
    k = as_inverse(combine(repeats)) if repeats else None
    slip = sum(_slip(fit, k.value) for fit in fits) if k and not friction else 0.0
    law = fit_law(_points(fits), gain_sd) if repeats else None
    progressive = _progressive_slip(trials, k.value) if slips_again and k else 0.0
    if_slip = k if if_friction else None
    if k and if_friction:
        k = _extend_interval(k, if_friction)
    outcome = worst([part.outcome for part in (*fits, law, k) if part])
    return StiffnessFit(
        k, tuple(fits), slip, slips_again, progressive, friction, only_rose, law, if_friction, loading, if_slip, outcome
    )


def trial_stiffness(fit: StaticFit, if_friction: Estimate | None = None) -> Estimate | None:
    """k [N/m] from this trial alone, None if its interval is unbounded; if_friction is that of the StiffnessFit."""
    stiffness = as_inverse(fit.repeat.estimate) if fit.repeat else None
    if stiffness is None or not math.isfinite(stiffness.ci95[1]):
        return None
    return _extend_interval(stiffness, if_friction) if if_friction else stiffness


def _fit_trials(
    trials: Sequence[Sequence[Plateau]],
    gain_sd: float,
    drift_sd: float,
    slips: Literal["nowhere", "above all before", "every rise", "at turns"],
) -> list[StaticFit]:
    """Every trial with new segments where the cuff is assumed to slip; a trial's first plateau begins no new one.

    "at turns": where loading changes to unloading or back, as for a cuff with friction.
    """
    highest = -math.inf
    fits = []
    for plateaus in trials:
        begins = np.zeros(len(plateaus), bool)
        direction = np.sign(np.diff([plateau.force for plateau in plateaus]))
        for i, plateau in enumerate(plateaus):
            if slips == "at turns":
                begins[i] = i == 1 or (i > 1 and direction[i - 1] != direction[i - 2])
                continue
            before = {"nowhere": math.inf, "above all before": highest, "every rise": plateaus[i - 1].force}[slips]
            begins[i] = i > 0 and plateau.force > before + SAME_LOAD
            highest = max(highest, plateau.force)
        fits.append(_fit_trial(tuple(plateaus), begins, gain_sd, drift_sd))
    return fits


def _has_one_curve(unslipped: Sequence[StaticFit], law: TangentLaw | None, *, only_rose: bool) -> bool:
    """Whether the loads are on one line or one exponential within their errors: then the cuff did not slip.

    If the load only rose, a softening curve is not accepted, because slip has the same effect.
    """
    if sum(repeat.dof for repeat in _repeats(unslipped)) < MIN_STRAIGHT:
        return False
    if _is_straight(unslipped):
        return True
    if law is None or law.outcome is not FitOutcome.CONVERGED:
        return False
    return law.chi_square < chi_square_limit(law.dof) and (not only_rose or law.growth > 0)


def _is_straight(fits: Sequence[StaticFit]) -> bool:
    """Whether the loads of every segment are on a line within their errors."""
    dof = sum(repeat.dof for repeat in _repeats(fits))
    return dof >= MIN_STRAIGHT and sum(repeat.chi_square for repeat in _repeats(fits)) < chi_square_limit(dof)


def _friction(turned: Sequence[StaticFit]) -> float:
    """Half the difference of the offsets of loading and unloading [N]; 0 unless it is positive in every trial.

    Each branch needs two loads: a single unloading branch may also be that of a cuff that slipped.
    """
    found = []
    for fit in turned:
        is_rising = np.diff([plateau.force for plateau in fit.plateaus], prepend=np.nan) > 0
        rising, falling = fit.offset[1:][is_rising[1:]], fit.offset[1:][~is_rising[1:]]
        if min(len(rising), len(falling)) < 2:
            return 0.0
        found.append(float(rising.mean() - falling.mean()) / 2)
    return float(np.mean(found)) if found and min(found) > 0 else 0.0


def _loading_stiffness(fits: Sequence[StaticFit], turned: Sequence[StaticFit]) -> Estimate | None:
    """k [N/m] of the loading branch if all weights are removed at once, so that there is one unloading branch.

    After slip the unloading branch has the slope k; with friction, which changes sign, it is steeper.
    """
    fall_counts = [sum(b.force < a.force - SAME_LOAD for a, b in pairwise(fit.plateaus)) for fit in fits]
    loading = _repeats(turned)
    return as_inverse(combine(loading)) if loading and max(fall_counts) <= 1 else None


def _may_be_friction(fits: Sequence[StaticFit], turned: Sequence[StaticFit], loading: Estimate) -> bool:
    """Whether friction explains a single unloading branch as well as slip.

    Slip is certain if previous loads are on one line with the unloading branch, if the loading branch is curved, or if
    it is far less steep.
    """
    found, rising = _repeats(fits), _repeats(turned)
    dof, chi_square = sum(repeat.dof for repeat in rising), sum(repeat.chi_square for repeat in rising)
    if not found or _is_straight(fits) or chi_square > chi_square_limit(dof):
        return False
    slipped = as_inverse(combine(found)).value
    return slipped * (1 - 2 * MOST_FRICTION) < loading.value < slipped


def _extend_interval(stiffness: Estimate, other: Estimate) -> Estimate:
    """The stiffness with an interval that includes the other value; any value between the two is possible."""
    low = min(stiffness.ci95[0], other.value - NORMAL_95 * other.standard_error)
    return replace(_with_friction_part(stiffness, stiffness.value - other.value), ci95=(low, stiffness.ci95[1]))


def _with_friction_part(stiffness: Estimate, difference: float) -> Estimate:
    """With the standard error of a value anywhere between k and k less a difference, if that is positive."""
    part = max(0.0, difference) / math.sqrt(3)
    error = math.hypot(stiffness.standard_error, part)
    return replace(stiffness, standard_error=error, parts={**stiffness.parts, "friction": part})


def _repeats(fits: Sequence[StaticFit]) -> list[Repeat]:
    return [fit.repeat for fit in fits if fit.repeat is not None]


def _progressive_slip(trials: Sequence[Sequence[Plateau]], stiffness: float) -> float:
    """Increase of the displacement at the highest common load from the first to the last trial [m].

    0 unless it is significant.
    """
    held = [plateaus for plateaus in trials if plateaus]
    top = min(max(plateau.force for plateau in plateaus) for plateaus in held)
    first, last = (min(plateaus, key=lambda plateau: abs(plateau.force - top)) for plateaus in (held[0], held[-1]))
    spring = KelvinVoigt(stiffness)
    increase = last.late[0] - first.late[0] - spring.equilibrium(last.force - first.force)
    error = math.hypot(first.late[1], last.late[1])
    return increase if increase > INCONSISTENT * error else 0.0


def _retraces(unslipped: Sequence[StaticFit]) -> bool:
    """Whether displacements at the same load agree in loading and unloading: then the cuff is elastic, if nonlinear."""
    chi_square, count = 0.0, 0
    for fit in unslipped:
        force = np.array([plateau.force for plateau in fit.plateaus])
        pairs = [(i, j) for i, j in combinations(range(len(force)), 2) if _returns(force[i : j + 1])]
        if fit.repeat is None or not pairs:
            return False
        for i, j in pairs:
            difference = fit.x[j] - fit.x[i] - fit.repeat.value * (force[j] - force[i])
            chi_square += float(difference**2 / (fit.x_sd[i] ** 2 + fit.x_sd[j] ** 2))
        count += len(pairs)
    return chi_square < chi_square_limit(count)


def _returns(force: Array) -> bool:
    """Whether loads (n,) [N] return to the first load after a rise, without falling below it."""
    first, last = force[0], force[-1]
    return bool(
        abs(last - first) < SAME_LOAD and force.max() > max(first, last) + SAME_LOAD and force.min() > first - SAME_LOAD
    )


def _points(fits: Sequence[StaticFit]) -> HeldPoints:
    """The plateaus of all trials; every segment of every trial has its own offset."""
    firsts = np.cumsum([0, *(int(fit.segment.max(initial=-1)) + 1 for fit in fits)])
    groups = [fit.segment + first for fit, first in zip(fits, firsts, strict=False)]
    forces = [np.array([plateau.force for plateau in fit.plateaus]) for fit in fits]
    columns = (forces, [fit.x for fit in fits], [fit.x_sd for fit in fits], groups)
    force, x, x_sd, group = (np.concatenate([*column, np.zeros(0)]) for column in columns)
    return HeldPoints(force, x, x_sd, group.astype(np.intp))


def _fit_trial(plateaus: tuple[Plateau, ...], begins: NDArray[np.bool_], gain_sd: float, drift_sd: float) -> StaticFit:
    """Weighted regression of displacement on force within segments, because force is known more precisely.

    The weights are those of the effective variance u(x)² + u(F)²/k² (York), with 1/k of the previous round.
    """
    segment = np.cumsum(begins, dtype=np.intp)
    force = np.array([plateau.force for plateau in plateaus])
    force_sd = np.array([plateau.force_sd for plateau in plateaus])
    whole, late = ((p.displacement, p.displacement_sd) for p in plateaus), (p.late for p in plateaus)
    x, x_sd = np.where(begins[:, None], [*late], [*whole]).reshape(len(plateaus), 2).T
    x_sd = np.maximum(x_sd, LEAST_SD)
    if not any(np.ptp(force[segment == s]) > SAME_LOAD for s in np.unique(segment)):
        return StaticFit(plateaus, segment, np.full(len(plateaus), np.nan), None, x, x_sd)
    line = _fit_line(x, x_sd, force, force_sd, segment)
    chi_square = float(line.weight @ (line.x - line.compliance * line.force) ** 2)
    dof = len(plateaus) - len(np.unique(segment)) - 1
    causes = _causes(plateaus, line, gain_sd, drift_sd)
    codes = np.array([plateau.codes for plateau in plateaus])
    white = 1 / (x_sd**2 + line.compliance**2 * (force_sd**2 - codes**2))
    noise = 1 / math.sqrt(float(white @ within(force, segment, white) ** 2))
    causes = {"codes": math.sqrt(max(0.0, 1 / line.information - noise**2)), **causes}
    repeat = Repeat(line.compliance, noise, math.hypot(*causes.values()), chi_square, dof, causes)
    offset = (force - line.force) - (x - line.x) / line.compliance
    return StaticFit(plateaus, segment, offset, repeat, x, np.hypot(x_sd, line.compliance * force_sd), line.outcome)


@dataclass(frozen=True)
class _Line:
    """Weights (plateaus,) [1/m²], displacement [m] and force [N] without segment means, compliance [m/N]."""

    segment: NDArray[np.intp]
    weight: Array
    x: Array
    force: Array
    compliance: float
    information: float
    outcome: FitOutcome


def _fit_line(x: Array, x_sd: Array, force: Array, force_sd: Array, segment: NDArray[np.intp]) -> _Line:
    compliance, outcome = 0.0, FitOutcome.NOT_CONVERGED
    for count in range(1, MAX_ROUNDS + 1):
        weight = 1 / (x_sd**2 + (compliance * force_sd) ** 2)
        displacement, load = within(x, segment, weight), within(force, segment, weight)
        information = float(weight @ load**2)
        before, compliance = compliance, float(weight @ (load * displacement)) / information
        if count >= ROUNDS and (compliance - before) ** 2 * information <= NEGLIGIBLE**2:
            outcome = FitOutcome.CONVERGED
            break
    return _Line(segment, weight, displacement, load, compliance, information, outcome)


def _causes(plateaus: tuple[Plateau, ...], line: _Line, gain_sd: float, drift_sd: float) -> dict[str, float]:
    """Errors of the compliance that are common to all trials.

    A zero drift d [N/s] adds d t to the load, and so d Σ w load t / Σ w load² (relative) to the compliance. In a short
    hold the cuff may still move: its displacement at the end gives another compliance.
    """
    middle = np.array([(plateau.start + plateau.end) / 2 for plateau in plateaus])
    unsettled = np.array([plateau.unsettled for plateau in plateaus])
    drift, settling = (
        abs(float(line.weight @ (line.force * within(values, line.segment, line.weight)))) / line.information
        for values in (middle, unsettled)
    )
    compliance = abs(line.compliance)
    return {"gain": gain_sd * compliance, "drift": drift_sd * drift * compliance, "settling": settling}


def _contradict(above_all: list[StaticFit], every_rise: list[StaticFit]) -> bool:
    """Whether reloading up to previous loads gives another compliance than unloading (Hausman's test)."""
    efficient, consistent = _repeats(above_all), _repeats(every_rise)
    if not efficient or not consistent:
        return False
    one, other = combine(efficient), combine(consistent)
    error = math.sqrt(max(other.standard_error**2 - one.standard_error**2, (0.3 * other.standard_error) ** 2))
    return abs(one.value - other.value) > INCONSISTENT * error


def _slip(fit: StaticFit, stiffness: float) -> float:
    """Slip in a trial [m]: sum of the steps between the offsets of its segments."""
    spring = KelvinVoigt(stiffness)
    x = np.array([plateau.late[0] - spring.equilibrium(plateau.force) for plateau in fit.plateaus])
    return float(sum(x[i] - x[i - 1] for i in np.flatnonzero(np.diff(fit.segment)) + 1))

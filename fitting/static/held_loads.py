"""Results of the held loads: stiffness, creep, migration, tangent stiffness, drift of the zero, energy of a cycle.

Creep is displacement that increases under a held load and recovers after unloading.

    x = C [F + φ y] + a,   ẏ = (F − y)/T      C: instantaneous compliance, C (1 + φ): at rest, T: time constant

y is the force filtered by a first-order low-pass, so the whole loading history matters. Slip does not recover: every
stretch between two slips has its own offset a.

Migration is permanent displacement, x at the end of the last static trial minus x at the start of the first. Creep
recovers after the last trial, slip does not. Migration is the slip: if creep is measured, the recovery still to
come is subtracted, with its uncertainty.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from documents.results import EqualByFields
from fitting.pull.plateaus import Plateau, is_unloaded
from fitting.pull.pull import Pull
from fitting.results.codes import FitOutcome, NoteCode, worst
from fitting.results.sentences import Note
from fitting.static.stiffness import LEAST_SD, StaticFit, StiffnessFit, fit_stiffness, within
from fitting.uncertainty import NORMAL_95, Estimate, chi_square_limit, normal_estimate

BIN = 0.5
MIN_BINS = 20
LEAST_DETERMINANT = 1e-12
"""Of the normal matrix of C and C φ over the squared sum of weighted squares of the loads, from which the two are
identified: below it is rounding. The loads include the zero of the load cell."""
STEP = 0.05
LOG_STEP = 1e-6
"""Of the logarithm of the time constant, for the derivative with respect to it."""
MAX_ROUNDS = 500
"""Of the search for the time constant."""
TIME_CONSTANTS = np.geomspace(2.0, 60.0, 12)
CREEP_SIGNIFICANCE = 4.0
"""Standard errors from which creep is significant; more than three, because the time constant is selected."""
IN_HOLDS, IN_HOLDS_ALONE = 2.0, 3.0
"""Standard errors by which the displacement must increase within the holds, if creep explains the holds and if not.
Friction also separates the displacements at the same load, but not within a hold."""
LEAST = 0.01
"""Creep over elastic displacement below which it is not reported."""


@dataclass(frozen=True)
class Creep:
    """fraction φ, time_constant T [s], stiffness_at_rest 1/(C (1 + φ)) [N/m]; χ² of the fit and degrees of freedom.

    significance     standard errors by which creep improves the fit of the holds
    in_holds         standard errors by which the displacement increases within the holds alone
    remaining_force  N: force − y in the last hold of the donning
    outcome          of the search for the time constant
    """

    fraction: Estimate
    time_constant: float
    compliance: float
    stiffness_at_rest: Estimate
    significance: float
    in_holds: float
    chi_square: float
    dof: int
    remaining_force: float
    outcome: FitOutcome = FitOutcome.CONVERGED

    @property
    def is_seen(self) -> bool:
        """Whether creep is significant."""
        enough = IN_HOLDS if self.explains else IN_HOLDS_ALONE
        return self.significance > CREEP_SIGNIFICANCE and self.fraction.value > LEAST and self.in_holds > enough

    @property
    def is_measured(self) -> bool:
        """Whether creep is significant and explains the holds, so that its figures are identified."""
        return self.is_seen and self.explains

    @property
    def explains(self) -> bool:
        """Whether the residual with creep is that of noise."""
        return self.chi_square < chi_square_limit(self.dof)

    @property
    def recovery(self) -> float:
        """Displacement [m] still to come after the last hold; negative after unloading."""
        return self.compliance * self.fraction.value * self.remaining_force


def fit_creep(pulls: Sequence[Pull], fits: Sequence[StaticFit]) -> Creep | None:
    """Creep of one donning from its static pulls; None for too few holds, or one load in every segment.

    The segments of the fits are the stretches without slip.
    """
    held = [(pull, fit) for pull, fit in zip(pulls, fits, strict=True) if fit.plateaus]
    bins = [_binned(pull, fit) for pull, fit in held]
    if sum(len(trial.time) for trial in bins) < MIN_BINS:
        return None
    problem = _problem(held, bins)
    logs = np.log(TIME_CONSTANTS)
    tried = [problem.solve(float(log))[1] for log in logs]
    best = int(np.argmin(tried))
    if not math.isfinite(tried[best]):
        return None
    bounds = float(logs[max(best - 1, 0)]), float(logs[min(best + 1, len(logs) - 1)])
    found = scipy.optimize.minimize_scalar(
        lambda log: problem.solve(log)[1], bounds=bounds, method="bounded", options={"maxiter": MAX_ROUNDS}
    )
    log = float(found.x)
    (compliance, extra), chi_square = problem.solve(log)
    if not compliance > 0:  # or not identified
        return None
    dof = len(problem.x) - len(np.unique(problem.group)) - 3
    scale = max(1.0, chi_square / max(dof, 1))
    covariance = problem.covariance(log) * scale
    of_fraction = np.array([-extra / compliance**2, 1 / compliance])
    rest, rest_sd = compliance + extra, math.sqrt(float(covariance.sum()))
    return Creep(
        fraction=normal_estimate(extra / compliance, math.sqrt(float(of_fraction @ covariance @ of_fraction))),
        time_constant=math.exp(log),
        compliance=compliance,
        stiffness_at_rest=normal_estimate(1 / rest, rest_sd / rest**2),
        significance=math.sqrt(max(0.0, problem.without() - chi_square) / scale),
        in_holds=problem.in_holds(log),
        chi_square=chi_square,
        dof=dof,
        remaining_force=_remaining_force(*held[-1], math.exp(log)),
        outcome=FitOutcome.CONVERGED if found.success else FitOutcome.NOT_CONVERGED,
    )


@dataclass(frozen=True)
class _Problem:
    """All bins of a donning: x [m] and load [N] without the mean of their group, with weights (bins,) [1/m²].

    hold is the number of the held load; square: that of the loads themselves, weighted and summed [N²/m²].
    """

    held: Sequence[tuple[Pull, StaticFit]]
    bins: Sequence[_Bins]
    group: NDArray[np.intp]
    hold: NDArray[np.intp]
    weight: NDArray[np.float64]
    x: NDArray[np.float64]
    load: NDArray[np.float64]
    square: float

    def solve(self, log: float) -> tuple[tuple[float, float], float]:
        """C and C φ [m/N] for the logarithm of a time constant, and χ²: NaN and infinite if they are not identified."""
        columns = np.column_stack((self.load, self._lagged(log)))
        normal = (columns.T * self.weight) @ columns
        if np.linalg.det(normal) <= LEAST_DETERMINANT * self.square**2:
            return (math.nan, math.nan), math.inf
        compliance, extra = np.linalg.solve(normal, columns.T @ (self.weight * self.x))
        residual = self.x - compliance * self.load - extra * columns[:, 1]
        return (float(compliance), float(extra)), float(self.weight @ residual**2)

    def without(self) -> float:
        """χ² without creep."""
        compliance = float(self.weight @ (self.load * self.x)) / float(self.weight @ self.load**2)
        return float(self.weight @ (self.x - compliance * self.load) ** 2)

    def in_holds(self, log: float) -> float:
        """Slope of x over y within the holds, in standard errors."""
        x, y = (within(values, self.hold, self.weight) for values in (self.x, self._lagged(log)))
        information = float(self.weight @ y**2)
        if information == 0:
            return 0.0
        follows = float(self.weight @ (x * y)) / information
        dof = max(1, len(x) - len(np.unique(self.hold)) - 1)
        scale = max(1.0, float(self.weight @ (x - follows * y) ** 2) / dof)
        return follows * math.sqrt(information / scale)

    def covariance(self, log: float) -> NDArray[np.float64]:
        """(2, 2) of C and C φ, with an unknown time constant."""
        lagged = self._lagged(log)
        columns = np.column_stack((self.load, lagged, self._lagged(log + LOG_STEP) - lagged))
        columns *= np.sqrt(self.weight)[:, None]
        scale = np.linalg.norm(columns, axis=0)
        inverse = np.linalg.pinv(columns / scale, rcond=1e-5) / scale[:, None]
        return np.asarray((inverse @ inverse.T)[:2, :2])

    def _lagged(self, log: float) -> NDArray[np.float64]:
        pairs = zip(self.held, self.bins, strict=True)
        y = [np.interp(bins.time, *_lagged(*trial, math.exp(log))) for trial, bins in pairs]
        return within(np.concatenate(y), self.group, self.weight)


def _problem(held: Sequence[tuple[Pull, StaticFit]], bins: Sequence[_Bins]) -> _Problem:
    group, hold = _numbered([trial.segment for trial in bins]), _numbered([trial.hold for trial in bins])
    weight = np.maximum(np.concatenate([trial.sd for trial in bins]), LEAST_SD) ** -2.0
    x, load = (np.concatenate([getattr(trial, name) for trial in bins]) for name in ("x", "force"))
    square = float(weight @ load**2)
    return _Problem(held, bins, group, hold, weight, within(x, group, weight), within(load, group, weight), square)


def _numbered(numbers: Sequence[NDArray[np.intp]]) -> NDArray[np.intp]:
    """Numbers (bins,) within each trial, made unique over all trials."""
    pairs = [np.column_stack((np.full(len(number), trial), number)) for trial, number in enumerate(numbers)]
    return np.unique(np.concatenate(pairs), axis=0, return_inverse=True)[1]


@dataclass(frozen=True)
class _Bins:
    """Half seconds of the holds: time [s], force [N], x and its standard error [m], segment, hold; all (bins,)."""

    time: NDArray[np.float64]
    force: NDArray[np.float64]
    x: NDArray[np.float64]
    sd: NDArray[np.float64]
    segment: NDArray[np.intp]
    hold: NDArray[np.intp]


def _binned(pull: Pull, fit: StaticFit) -> _Bins:
    rows = []
    seen = np.isfinite(pull.displacement)
    for hold, (plateau, segment) in enumerate(zip(fit.plateaus, fit.segment, strict=True)):
        inside = seen & (pull.marker_time >= plateau.start) & (pull.marker_time <= plateau.end)
        time, x = pull.marker_time[inside], pull.displacement[inside]
        index = ((time - plateau.start) / BIN).astype(np.intp)
        count = np.bincount(index)
        full = count > 0.5 * count.max()
        time, x = (np.bincount(index, values)[full] / count[full] for values in (time, x))
        sd = plateau.displacement_sd * np.sqrt(np.count_nonzero(inside) / count[full])
        same = [np.full(len(x), value) for value in (plateau.force, segment, hold)]
        rows.append((time, same[0], x, sd, *same[1:]))
    return _Bins(*(np.concatenate(column) for column in zip(*rows, strict=True)))


def _lagged(pull: Pull, fit: StaticFit, time_constant: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times (n,) [s] and y (n,) [N]. Before the trial the cuff is assumed to be at rest under the first load."""
    time = np.arange(pull.force_time[0], pull.force_time[-1], STEP)
    first = fit.plateaus[0].force
    decay = math.exp(-STEP / time_constant)
    above = np.interp(time, pull.force_time, pull.force) - first
    return time, first + scipy.signal.lfilter([0.0, 1 - decay], [1.0, -decay], above)


def _remaining_force(pull: Pull, fit: StaticFit, time_constant: float) -> float:
    """Force − y [N] in the last hold."""
    time, y = _lagged(pull, fit, time_constant)
    last = fit.plateaus[-1]
    return last.force - float(np.mean(y[(time >= last.start) & (time <= last.end)]))


RECOVERY_SD = 0.3
"""Relative standard uncertainty of the recovery: it rarely follows the single exponential of the fitted creep."""


def fit_migration(trials: Sequence[Sequence[Plateau]], creep: Creep | None = None) -> Estimate | None:
    """Migration [m] over static trials in time order, all relative to one reference posture: (5) of the source study.

    creep is that of the same trials. None if the first trial does not start unloaded or the last does not end unloaded.
    """
    held = [number for number, plateaus in enumerate(trials) if plateaus]
    if not held:
        return None
    first, last = trials[held[0]][0], trials[held[-1]][-1]
    all_loads = [plateau for plateaus in trials for plateau in plateaus]
    if first is last or not is_unloaded(first, all_loads) or not is_unloaded(last, all_loads):
        return None
    value, noise = last.displacement - first.displacement, math.hypot(first.displacement_sd, last.displacement_sd)
    if creep is None or not creep.is_measured:
        settling = {"settling": abs(last.unsettled)} if last.unsettled else {}
        return _estimate(value, {"noise": noise, **settling})
    recovery = creep.recovery
    relative = math.hypot(RECOVERY_SD, creep.fraction.standard_error / creep.fraction.value)
    return _estimate(value + recovery, {"noise": noise, "creep": abs(recovery) * relative})


def _estimate(value: float, parts: dict[str, float]) -> Estimate:
    error = math.hypot(*parts.values())
    return Estimate(value, error, (value - NORMAL_95 * error, value + NORMAL_95 * error), parts)


SIGNIFICANCE = 3.0
DRIFT_NOTE = 1.0 / 60
"""Drift of the zero [N/s] from which it is reported."""
TANGENTS = 5
LEAST_HOLD = 4.0
"""Seconds of a hold that suffice for a cuff to rest and for the noise of its mean."""


@dataclass(frozen=True, eq=False)
class HeldLoads(EqualByFields):
    """Results of the static trials of one donning; None if their protocol does not determine a quantity.

    stiffness  k, slip and friction
    hold       s after a step at which the displacement is read, on average: k is the stiffness after this time
    drift      N/s of the cell's zero, from the bare hook before and after a trial; removed if significant
    creep      of the cuff under held loads
    energy     J dissipated by slip, creep and friction in one cycle of loading and unloading
    steps      file → times [s] of the detected steps of the load, as in protocol.toml
    duration   s of a hold, the median; infinite without a step
    """

    stiffness: StiffnessFit
    hold: float = 0.0
    drift: Estimate | None = None
    creep: Creep | None = None
    energy: Estimate | None = None
    steps: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    duration: float = math.inf

    @property
    def has_loads(self) -> bool:
        """Whether any load was held."""
        return any(fit.plateaus for fit in self.stiffness.trials)

    @property
    def highest(self) -> float:
        """The highest held load [N]."""
        return max(plateau.force for fit in self.stiffness.trials for plateau in fit.plateaus)

    @property
    def tangents(self) -> tuple[tuple[float, Estimate], ...]:
        """Loads [N] above the lowest held one, that of the bare hook, with their tangent stiffness [N/m].

        Not readings, as the cell's zero is not removed from those. Empty without a law.
        """
        law = self.stiffness.law
        if law is None:
            return ()
        loads = np.linspace(0.0, self.highest - law.reference_force, TANGENTS).tolist()
        return tuple((load, law.tangent(law.reference_force + load)) for load in loads)


def fit_held_loads(static: Sequence[Pull], gain_sd: float) -> HeldLoads:
    """Stiffness, drift, creep and energy from the static trials of a donning in time order."""
    drift = _drift([pull.plateaus for pull in static])
    rate = drift_sd = 0.0
    if drift is not None and abs(drift.value) > SIGNIFICANCE * drift.standard_error:
        rate, drift_sd = drift.value, drift.standard_error
    trials = [_without_drift(pull.plateaus, rate) for pull in static]
    stiffness = fit_stiffness(trials, gain_sd, drift_sd)
    # If creep explains the holds, the cuff has not slipped, although the loads are not on a line.
    creep = fit_creep(static, [replace(fit, segment=0 * fit.segment) for fit in stiffness.trials])
    if creep is not None and creep.is_measured:
        stiffness = fit_stiffness(trials, gain_sd, drift_sd, creeps=True)
    else:
        creep = fit_creep(static, stiffness.trials)
    if creep is not None:
        stiffness = replace(stiffness, outcome=worst((stiffness.outcome, creep.outcome)))
    if not any(trials):
        return HeldLoads(stiffness)
    after_step = [
        (plateau.hold, (plateau.start + plateau.end) / 2 - plateau.step)
        for plateaus in trials
        for plateau in plateaus
        if plateau.step is not None
    ]
    durations, read_after = zip(*after_step, strict=True) if after_step else ((math.inf,), (0.0,))
    steps = {pull.trial.file: tuple(round(p.step, 2) for p in pull.plateaus if p.step is not None) for pull in static}
    return HeldLoads(
        stiffness, float(np.mean(read_after)), drift, creep, _energy(trials), steps, float(np.median(durations))
    )


def held_load_notes(held: HeldLoads) -> tuple[Note, ...]:
    """Notes on the held loads."""
    if not held.has_loads:
        return ()
    notes = [Note(NoteCode.SHORT_HOLDS, {"hold_s": held.duration})] if held.duration < LEAST_HOLD else []
    if held.creep is not None and held.creep.is_measured:
        rest, fraction = held.creep.stiffness_at_rest, held.creep.fraction
        figures = {
            "fraction": fraction.value,
            "fraction_half_width": 1.96 * fraction.standard_error,
            "time_constant_s": held.creep.time_constant,
            "hold_s": held.hold,
            "rest_n_per_m": rest.value,
            "rest_half_width_n_per_m": 1.96 * rest.standard_error,
        }
        notes.append(Note(NoteCode.CREEPS, figures))
    elif held.creep is not None and held.creep.is_seen:
        notes.append(Note(NoteCode.YIELDS, {"hold_s": held.hold}))
    law = held.stiffness.law
    if law is not None and abs(law.significance) > SIGNIFICANCE:
        low, high = law.tangent(law.reference_force), law.tangent(held.highest)
        code = NoteCode.STIFFENS if law.growth > 0 else NoteCode.SOFTENS
        notes.append(Note(code, {"lowest_n_per_m": low.value, "highest_n_per_m": high.value}))
    if held.drift is not None and abs(held.drift.value) > max(SIGNIFICANCE * held.drift.standard_error, DRIFT_NOTE):
        notes.append(Note(NoteCode.ZERO_DRIFT, {"drift_n_per_s": held.drift.value}))
    return tuple(notes)


def _drift(trials: Sequence[Sequence[Plateau]]) -> Estimate | None:
    """Drift of the zero [N/s] from trials that start and end with the bare hook."""
    found = []
    for plateaus in trials:
        if len(plateaus) < 3 or not is_unloaded(plateaus[0], plateaus) or not is_unloaded(plateaus[-1], plateaus):
            continue
        span = (plateaus[-1].start + plateaus[-1].end - plateaus[0].start - plateaus[0].end) / 2
        sd = math.hypot(plateaus[0].force_sd, plateaus[-1].force_sd)
        if sd > 0:  # 0 at the end of a range without visible codes; a quiet force at one code has that code's error
            found.append(((plateaus[-1].force - plateaus[0].force) / span, sd / span))
    if not found:
        return None
    rates, sds = np.array(found).T
    weights = sds**-2.0
    mean = float(weights @ rates / weights.sum())
    spread = float(np.std(rates, ddof=1)) / math.sqrt(len(rates)) if len(rates) > 1 else 0.0
    return normal_estimate(mean, max(float(weights.sum() ** -0.5), spread))


def _without_drift(plateaus: Sequence[Plateau], rate: float) -> tuple[Plateau, ...]:
    """The plateaus with forces corrected for the drift since the first hold."""
    middles = [(plateau.start + plateau.end) / 2 for plateau in plateaus]
    return tuple(
        replace(plateau, force=plateau.force - rate * (middle - middles[0]))
        for plateau, middle in zip(plateaus, middles, strict=True)
    )


def _energy(trials: Sequence[Sequence[Plateau]]) -> Estimate | None:
    """∮ F dx of the plateaus above the hook's load, averaged over the trials that start and end unloaded."""
    works = []
    for plateaus in trials:
        if len(plateaus) < 3 or not is_unloaded(plateaus[0], plateaus) or not is_unloaded(plateaus[-1], plateaus):
            continue
        force = np.array([plateau.force for plateau in plateaus]) - plateaus[0].force
        x = np.array([plateau.displacement for plateau in plateaus])
        by_force, by_x = np.gradient(x) * _ends(len(x)), np.gradient(force) * _ends(len(x))
        force_sd = np.array([plateau.force_sd for plateau in plateaus])
        x_sd = np.array([plateau.displacement_sd for plateau in plateaus])
        work = float(np.sum((force[1:] + force[:-1]) / 2 * np.diff(x)))
        works.append((work, math.hypot(float(np.linalg.norm(by_force * force_sd)), float(np.linalg.norm(by_x * x_sd)))))
    if not works:
        return None
    values, errors = np.array(works).T
    spread = float(np.std(values, ddof=1)) if len(values) > 1 else 0.0
    error = max(float(np.linalg.norm(errors)) / len(values), spread / math.sqrt(len(values)))
    return normal_estimate(float(values.mean()), error)


def _ends(count: int) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Weights (n,) for np.gradient: in a trapezoidal sum its one-sided ends have half the weight."""
    return np.array([0.5, *np.ones(count - 2), 0.5])

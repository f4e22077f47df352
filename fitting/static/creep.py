"""Creep: a cuff that goes on yielding under a held load, and comes back when the load is off.

    x = C [F + φ y] + a,   ẏ = (F − y)/T      C the compliance at once, C (1 + φ) after long, T the time constant

y is the force led through a first-order lag, so the whole loading history counts. Slip does not come back: it has an
offset a of its own for each stretch between two slips, and no part in the holds while the load falls.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter

from fitting.outcome import FitOutcome
from fitting.static.plateaus import Plateau
from fitting.static.stiffness import LEAST_SD
from fitting.static.tangent import within
from fitting.uncertainty import Estimate, normal_estimate

BIN = 0.5
MIN_BINS = 20
MAX_CONDITION = 1e8
STEP = 0.05
MAX_ROUNDS = 500
"""Of the search for the time constant."""
TIME_CONSTANTS = np.geomspace(2.0, 60.0, 12)
SIGNIFICANCE = 4.0
"""From which a cuff is said to creep; the time constant is picked, so three would be too few."""
BELIEVED = 0.999
IN_HOLDS, IN_HOLDS_ALONE = 2.0, 3.0
"""Standard errors by which the holds themselves must go on yielding, where creep explains all of them and where not: a
cuff that rubs lies apart under the same loads, too."""
LEAST = 0.01
"""Part of the elastic way below which creep is not worth a word."""


@dataclass(frozen=True)
class HeldTrial:
    """One static trial for creep: force (n,) [N] at force_time [s], displacement (frames,) [m] at marker_time [s].

    segment (plateaus,) numbers the stretches in which the cuff did not slip.
    """

    force_time: NDArray[np.float64]
    force: NDArray[np.float64]
    marker_time: NDArray[np.float64]
    displacement: NDArray[np.float64]
    plateaus: Sequence[Plateau]
    segment: NDArray[np.intp]


@dataclass(frozen=True)
class Creep:
    """fraction φ, time_constant T [s], stiffness_at_rest 1/(C (1 + φ)) [N/m]; the fit's χ² and its degrees of freedom.

    significance is by how many standard errors creep explains the holds better than none; in_holds by how many the
    cuff goes on yielding while a load is held, whatever lies between the holds.

    to_come is how far y is from the force in each trial's last hold [N]: by C φ to_come the cuff will still move.
    outcome is that of the search for the time constant.
    """

    fraction: Estimate
    time_constant: float
    compliance: float
    stiffness_at_rest: Estimate
    significance: float
    in_holds: float
    chi_square: float
    dof: int
    to_come: tuple[float, ...]
    outcome: FitOutcome = FitOutcome.CONVERGED

    @property
    def is_seen(self) -> bool:
        """Whether the cuff creeps, be it by how much."""
        enough = IN_HOLDS if self.explains else IN_HOLDS_ALONE
        return self.significance > SIGNIFICANCE and self.fraction.value > LEAST and self.in_holds > enough

    @property
    def is_measured(self) -> bool:
        """Whether it creeps, and nothing else moves it, so that the figures are those of creep."""
        return self.is_seen and self.explains

    @property
    def explains(self) -> bool:
        """Whether creep alone leaves over no more than noise does."""
        return self.dof > 0 and self.chi_square < float(stats.chi2.ppf(BELIEVED, self.dof))

    def recovery(self, trial: int) -> float:
        """How far [m] the cuff will still move after the last hold of trial number `trial` (from 0): back, negative."""
        return self.compliance * self.fraction.value * self.to_come[trial]


def fit_creep(trials: Sequence[HeldTrial]) -> Creep | None:
    """Creep of one donning from its static trials, None if the holds are too few to tell it."""
    bins = [_binned(trial) for trial in trials]
    if sum(len(each.time) for each in bins) < MIN_BINS:
        return None
    problem = _problem(trials, bins)
    logs = np.log(TIME_CONSTANTS)
    tried = [problem.solve(float(log))[1] for log in logs]
    best = int(np.argmin(tried))
    if not math.isfinite(tried[best]):
        return None
    bounds = float(logs[max(best - 1, 0)]), float(logs[min(best + 1, len(logs) - 1)])
    found = minimize_scalar(
        lambda log: problem.solve(log)[1], bounds=bounds, method="bounded", options={"maxiter": MAX_ROUNDS}
    )
    log = float(found.x)
    (compliance, extra), chi_square = problem.solve(log)
    if compliance <= 0:
        return None
    dof = len(problem.x) - len(np.unique(problem.group)) - 3
    scale = max(1.0, chi_square / max(dof, 1))
    covariance = problem.covariance(log, extra) * scale
    of_fraction = np.array([-extra / compliance**2, 1 / compliance, 0.0])
    rest, rest_sd = compliance + extra, math.sqrt(float(covariance[:2, :2].sum()))
    return Creep(
        fraction=normal_estimate(extra / compliance, math.sqrt(float(of_fraction @ covariance @ of_fraction))),
        time_constant=math.exp(log),
        compliance=compliance,
        stiffness_at_rest=normal_estimate(1 / rest, rest_sd / rest**2),
        significance=math.sqrt(max(0.0, problem.without() - chi_square) / scale),
        in_holds=problem.in_holds(log),
        chi_square=chi_square,
        dof=dof,
        to_come=tuple(_lagged(trial, np.zeros(0), math.exp(log))[1] for trial in trials),
        outcome=FitOutcome.CONVERGED if found.success else FitOutcome.NOT_CONVERGED,
    )


@dataclass(frozen=True)
class _Problem:
    """All bins of a donning, within their groups: x [m] and load [N] against weights (bins,) [1/m²].

    hold is the number of the held load.
    """

    trials: Sequence[HeldTrial]
    bins: Sequence[_Bins]
    group: NDArray[np.intp]
    hold: NDArray[np.intp]
    weight: NDArray[np.float64]
    x: NDArray[np.float64]
    load: NDArray[np.float64]

    def solve(self, log: float) -> tuple[tuple[float, float], float]:
        """C and C φ [m/N] for the logarithm of a time constant, and χ²: infinite where holds cannot tell them apart."""
        columns = np.column_stack((self.load, self._lagged(log)))
        normal = (columns.T * self.weight) @ columns
        scale = np.sqrt(np.diag(normal))
        if not np.all(scale > 0) or np.linalg.cond(normal / np.outer(scale, scale)) > MAX_CONDITION:
            return (0.0, 0.0), math.inf
        compliance, extra = np.linalg.solve(normal, columns.T @ (self.weight * self.x))
        left = self.x - compliance * self.load - extra * columns[:, 1]
        return (float(compliance), float(extra)), float(self.weight @ left**2)

    def without(self) -> float:
        """χ² of a cuff that does not creep."""
        compliance = float(self.weight @ (self.load * self.x)) / float(self.weight @ self.load**2)
        return float(self.weight @ (self.x - compliance * self.load) ** 2)

    def in_holds(self, log: float) -> float:
        """Standard errors by which x follows y within each hold."""
        x, y = (within(values, self.hold, self.weight) for values in (self.x, self._lagged(log)))
        information = float(self.weight @ y**2)
        if information == 0:
            return 0.0
        follows = float(self.weight @ (x * y)) / information
        dof = max(1, len(x) - len(np.unique(self.hold)) - 1)
        scale = max(1.0, float(self.weight @ (x - follows * y) ** 2) / dof)
        return follows * math.sqrt(information / scale)

    def covariance(self, log: float, extra: float) -> NDArray[np.float64]:
        """(3, 3) of C, C φ and the logarithm of the time constant."""
        turning = extra * (self._lagged(log + 0.01) - self._lagged(log - 0.01)) / 0.02
        columns = np.column_stack((self.load, self._lagged(log), turning))
        scale = np.linalg.norm(columns, axis=0) + 1e-300
        scaled = columns / scale
        covariance = np.linalg.pinv((scaled.T * self.weight) @ scaled, rcond=1e-10, hermitian=True)
        return np.asarray(covariance / np.outer(scale, scale), np.float64)

    def _lagged(self, log: float) -> NDArray[np.float64]:
        pairs = zip(self.trials, self.bins, strict=True)
        y = np.concatenate([_lagged(trial, each.time, math.exp(log))[0] for trial, each in pairs])
        return within(y, self.group, self.weight)


def _problem(trials: Sequence[HeldTrial], bins: Sequence[_Bins]) -> _Problem:
    group = _numbered([each.segment for each in bins], [trial.segment.max(initial=-1) + 1 for trial in trials])
    hold = _numbered([each.hold for each in bins], [len(trial.plateaus) for trial in trials])
    weight = np.maximum(np.concatenate([each.sd for each in bins]), LEAST_SD) ** -2.0
    x, load = (np.concatenate([getattr(each, name) for each in bins]) for name in ("x", "force"))
    return _Problem(trials, bins, group, hold, weight, within(x, group, weight), within(load, group, weight))


def _numbered(numbers: Sequence[NDArray[np.intp]], counts: Sequence[int]) -> NDArray[np.intp]:
    """Numbers (bins,) within each trial, led on from trial to trial."""
    firsts = np.concatenate(([0], np.cumsum(counts)))
    return np.concatenate([each + first for each, first in zip(numbers, firsts, strict=False)]).astype(np.intp)


@dataclass(frozen=True)
class _Bins:
    """Half seconds of the holds: time [s], force [N], x and its standard error [m], segment and hold; all (bins,)."""

    time: NDArray[np.float64]
    force: NDArray[np.float64]
    x: NDArray[np.float64]
    sd: NDArray[np.float64]
    segment: NDArray[np.intp]
    hold: NDArray[np.intp]


def _binned(trial: HeldTrial) -> _Bins:
    rows = []
    seen = np.isfinite(trial.displacement)
    for hold, (plateau, segment) in enumerate(zip(trial.plateaus, trial.segment, strict=True)):
        inside = seen & (trial.marker_time >= plateau.start) & (trial.marker_time <= plateau.end)
        time, x = trial.marker_time[inside], trial.displacement[inside]
        index = ((time - plateau.start) / BIN).astype(np.intp)
        count = np.bincount(index)
        full = count > 0.5 * count.max(initial=1)
        sd = plateau.displacement_sd * np.sqrt(len(x) / np.maximum(count, 1))
        of_bins = [np.bincount(index, values) / np.maximum(count, 1) for values in (time, x)]
        same = [np.full(len(count), value) for value in (plateau.force, segment, hold)]
        rows.append(np.column_stack((of_bins[0], same[0], of_bins[1], sd, *same[1:]))[full])
    time, force, x, sd, segments, holds = np.concatenate([*rows, np.zeros((0, 6))]).T
    return _Bins(time, force, x, sd, segments.astype(np.intp), holds.astype(np.intp))


def _lagged(trial: HeldTrial, time: NDArray[np.float64], time_constant: float) -> tuple[NDArray[np.float64], float]:
    """y (bins,) [N] at time [s], and how far it still is from the force in the last hold [N].

    Before the trial the cuff is taken to have rested under the first load.
    """
    grid = np.arange(trial.force_time[0], trial.force_time[-1], STEP)
    force = np.interp(grid, trial.force_time, trial.force)
    first = trial.plateaus[0].force if trial.plateaus else float(force[0])
    decay = math.exp(-STEP / time_constant)
    y = first + lfilter([0.0, 1 - decay], [1.0, -decay], force - first)
    if not trial.plateaus:
        return np.interp(time, grid, y), 0.0
    last = trial.plateaus[-1]
    held = (grid >= last.start) & (grid <= last.end)
    return np.interp(time, grid, y), last.force - float(np.mean(y[held]))

"""Creep: displacement that increases under a held load and recovers after unloading.

    x = C [F + φ y] + a,   ẏ = (F − y)/T      C: instantaneous compliance, C (1 + φ): at rest, T: time constant

y is the force filtered by a first-order low-pass, so the whole loading history matters. Slip does not recover: every
stretch between two slips has its own offset a.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from fitting.pull.plateaus import Plateau
from fitting.pull.pull import Pull
from fitting.results.outcome import FitOutcome
from fitting.static.stiffness import LEAST_SD, StaticFit
from fitting.static.tangent import within
from fitting.uncertainty import Estimate, chi_square_limit, normal_estimate

BIN = 0.5
MIN_BINS = 20
MAX_CONDITION = 1e8
STEP = 0.05
MAX_ROUNDS = 500
"""Of the search for the time constant."""
TIME_CONSTANTS = np.geomspace(2.0, 60.0, 12)
SIGNIFICANCE = 4.0
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
    remaining_force  [N] of every trial: force − y in its last hold; the cuff will still move by C φ remaining_force
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
    remaining_force: tuple[float, ...]
    outcome: FitOutcome = FitOutcome.CONVERGED

    @property
    def is_seen(self) -> bool:
        """Whether creep is significant."""
        enough = IN_HOLDS if self.explains else IN_HOLDS_ALONE
        return self.significance > SIGNIFICANCE and self.fraction.value > LEAST and self.in_holds > enough

    @property
    def is_measured(self) -> bool:
        """Whether creep is significant and explains the holds, so that its figures are identified."""
        return self.is_seen and self.explains

    @property
    def explains(self) -> bool:
        """Whether the residual with creep is that of noise."""
        return self.dof > 0 and self.chi_square < chi_square_limit(self.dof)

    def recovery(self, trial: int) -> float:
        """Displacement [m] still to come after the last hold of trial number `trial` (from 0); recovery is negative."""
        return self.compliance * self.fraction.value * self.remaining_force[trial]


def fit_creep(pulls: Sequence[Pull], fits: Sequence[StaticFit]) -> Creep | None:
    """Creep of one donning from its static pulls; None for too few holds.

    The segments of the fits are the stretches without slip.
    """
    held = list(zip(pulls, fits, strict=True))
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
        remaining_force=tuple(_lagged(pull, fit.plateaus, np.zeros(0), math.exp(log))[1] for pull, fit in held),
        outcome=FitOutcome.CONVERGED if found.success else FitOutcome.NOT_CONVERGED,
    )


@dataclass(frozen=True)
class _Problem:
    """All bins of a donning: x [m] and load [N] without the mean of their group, with weights (bins,) [1/m²].

    hold is the number of the held load.
    """

    held: Sequence[tuple[Pull, StaticFit]]
    bins: Sequence[_Bins]
    group: NDArray[np.intp]
    hold: NDArray[np.intp]
    weight: NDArray[np.float64]
    x: NDArray[np.float64]
    load: NDArray[np.float64]

    def solve(self, log: float) -> tuple[tuple[float, float], float]:
        """C and C φ [m/N] for the logarithm of a time constant, and χ²: infinite if they are not identifiable."""
        columns = np.column_stack((self.load, self._lagged(log)))
        normal = (columns.T * self.weight) @ columns
        scale = np.sqrt(np.diag(normal))
        if not np.all(scale > 0) or np.linalg.cond(normal / np.outer(scale, scale)) > MAX_CONDITION:
            return (0.0, 0.0), math.inf
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

    def covariance(self, log: float, extra: float) -> NDArray[np.float64]:
        """(3, 3) of C, C φ and the logarithm of the time constant."""
        turning = extra * (self._lagged(log + 0.01) - self._lagged(log - 0.01)) / 0.02
        columns = np.column_stack((self.load, self._lagged(log), turning))
        scale = np.linalg.norm(columns, axis=0) + 1e-300
        scaled = columns / scale
        covariance = np.linalg.pinv((scaled.T * self.weight) @ scaled, rcond=1e-10, hermitian=True)
        return np.asarray(covariance / np.outer(scale, scale), np.float64)

    def _lagged(self, log: float) -> NDArray[np.float64]:
        pairs = zip(self.held, self.bins, strict=True)
        time_constant = math.exp(log)
        y = [_lagged(pull, fit.plateaus, bins.time, time_constant)[0] for (pull, fit), bins in pairs]
        return within(np.concatenate(y), self.group, self.weight)


def _problem(held: Sequence[tuple[Pull, StaticFit]], bins: Sequence[_Bins]) -> _Problem:
    group = _numbered([trial.segment for trial in bins], [fit.segment.max(initial=-1) + 1 for _, fit in held])
    hold = _numbered([trial.hold for trial in bins], [len(fit.plateaus) for _, fit in held])
    weight = np.maximum(np.concatenate([trial.sd for trial in bins]), LEAST_SD) ** -2.0
    x, load = (np.concatenate([getattr(trial, name) for trial in bins]) for name in ("x", "force"))
    return _Problem(held, bins, group, hold, weight, within(x, group, weight), within(load, group, weight))


def _numbered(numbers: Sequence[NDArray[np.intp]], counts: Sequence[int]) -> NDArray[np.intp]:
    """Numbers (bins,) within each trial, made unique over all trials."""
    firsts = np.concatenate(([0], np.cumsum(counts)))
    return np.concatenate([number + first for number, first in zip(numbers, firsts, strict=False)]).astype(np.intp)


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
        full = count > 0.5 * count.max(initial=1)
        sd = plateau.displacement_sd * np.sqrt(len(x) / np.maximum(count, 1))
        of_bins = [np.bincount(index, values) / np.maximum(count, 1) for values in (time, x)]
        same = [np.full(len(count), value) for value in (plateau.force, segment, hold)]
        rows.append(np.column_stack((of_bins[0], same[0], of_bins[1], sd, *same[1:]))[full])
    time, force, x, sd, segments, holds = np.concatenate([*rows, np.zeros((0, 6))]).T
    return _Bins(time, force, x, sd, segments.astype(np.intp), holds.astype(np.intp))


def _lagged(
    pull: Pull, plateaus: Sequence[Plateau], time: NDArray[np.float64], time_constant: float
) -> tuple[NDArray[np.float64], float]:
    """y (bins,) [N] at time [s], and force − y in the last hold [N].

    Before the trial the cuff is assumed to be at rest under the first load.
    """
    grid = np.arange(pull.force_time[0], pull.force_time[-1], STEP)
    force = np.interp(grid, pull.force_time, pull.force)
    first = plateaus[0].force if plateaus else float(force[0])
    decay = math.exp(-STEP / time_constant)
    y = first + scipy.signal.lfilter([0.0, 1 - decay], [1.0, -decay], force - first)
    if not plateaus:
        return np.interp(time, grid, y), 0.0
    last = plateaus[-1]
    held = (grid >= last.start) & (grid <= last.end)
    return np.interp(time, grid, y), last.force - float(np.mean(y[held]))

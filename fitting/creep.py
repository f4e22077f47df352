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
from scipy.signal import lfilter

from fitting.plateaus import Plateau
from fitting.tangent import within
from fitting.uncertainty import Estimate, normal_estimate

BIN = 0.5
MIN_BINS = 20
MAX_CONDITION = 1e8
STEP = 0.05
TIME_CONSTANTS = np.geomspace(2.0, 60.0, 12)
SIGNIFICANCE = 4.0
"""Standard errors of φ from which a cuff is said to creep; the time constant is picked from twelve."""
BELIEVED = 0.99
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

    to_come is how far y is from the force in each trial's last hold [N]: by C φ to_come the cuff will still move.
    """

    fraction: Estimate
    time_constant: float
    compliance: float
    stiffness_at_rest: Estimate
    chi_square: float
    dof: int
    to_come: tuple[float, ...]

    @property
    def is_seen(self) -> bool:
        return self.fraction.value > max(SIGNIFICANCE * self.fraction.standard_error, LEAST)

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
    firsts = np.concatenate(([0], np.cumsum([trial.segment.max(initial=-1) + 1 for trial in trials])))
    group = np.concatenate([each.segment + first for each, first in zip(bins, firsts, strict=False)]).astype(np.intp)
    weight = np.concatenate([each.sd for each in bins]) ** -2.0
    x = within(np.concatenate([each.x for each in bins]), group, weight)
    load = within(np.concatenate([each.force for each in bins]), group, weight)
    best: Creep | None = None
    for time_constant in TIME_CONSTANTS.tolist():
        lagged = [_lagged(trial, each.time, time_constant) for trial, each in zip(trials, bins, strict=True)]
        columns = np.column_stack((load, within(np.concatenate([each for each, _ in lagged]), group, weight)))
        normal = (columns.T * weight) @ columns
        scale = np.sqrt(np.diag(normal))
        if not np.all(scale > 0) or np.linalg.cond(normal / np.outer(scale, scale)) > MAX_CONDITION:
            continue
        solution = np.asarray(np.linalg.solve(normal, columns.T @ (weight * x)), np.float64)
        chi_square = float(weight @ (x - columns @ solution) ** 2)
        if solution[0] > 0 and (best is None or chi_square < best.chi_square):
            dof = len(x) - len(np.unique(group)) - 3
            covariance = np.asarray(np.linalg.inv(normal), np.float64) * max(1.0, chi_square / max(dof, 1))
            best = _creep(
                np.asarray(solution, np.float64),
                covariance,
                time_constant,
                chi_square,
                dof,
                tuple(left for _, left in lagged),
            )
    return best


@dataclass(frozen=True)
class _Bins:
    """Half seconds of the holds: time [s], force [N], x and its standard error [m], segment; all (bins,)."""

    time: NDArray[np.float64]
    force: NDArray[np.float64]
    x: NDArray[np.float64]
    sd: NDArray[np.float64]
    segment: NDArray[np.intp]


def _binned(trial: HeldTrial) -> _Bins:
    rows = []
    seen = np.isfinite(trial.displacement)
    for plateau, segment in zip(trial.plateaus, trial.segment, strict=True):
        inside = seen & (trial.marker_time >= plateau.start) & (trial.marker_time <= plateau.end)
        time, x = trial.marker_time[inside], trial.displacement[inside]
        index = ((time - plateau.start) / BIN).astype(np.intp)
        count = np.bincount(index)
        full = count > 0.5 * count.max(initial=1)
        sd = plateau.displacement_sd * np.sqrt(len(x) / np.maximum(count, 1))
        of_bins = [np.bincount(index, values) / np.maximum(count, 1) for values in (time, x)]
        same = [np.full(len(count), value) for value in (plateau.force, segment)]
        rows.append(np.column_stack((of_bins[0], same[0], of_bins[1], sd, same[1]))[full])
    time, force, x, sd, number = np.concatenate([*rows, np.zeros((0, 5))]).T
    return _Bins(time, force, x, sd, number.astype(np.intp))


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


def _creep(
    solution: NDArray[np.float64],
    covariance: NDArray[np.float64],
    time_constant: float,
    chi_square: float,
    dof: int,
    to_come: tuple[float, ...],
) -> Creep:
    compliance, extra = solution
    of_fraction = np.array([-extra / compliance**2, 1 / compliance])
    fraction = normal_estimate(float(extra / compliance), math.sqrt(float(of_fraction @ covariance @ of_fraction)))
    rest = float(compliance + extra)
    at_rest = normal_estimate(1 / rest, math.sqrt(float(covariance.sum())) / rest**2)
    return Creep(fraction, time_constant, float(compliance), at_rest, chi_square, dof, to_come)

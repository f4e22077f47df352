"""Stiffness in three dimensions from held loads: X = K⁻¹ F u + X0, an offset X0 per segment of a trial.

F is the load cell's force, u the rope's direction and X the cuff's displacement in the anchor's frame. Compliance is
fitted, since displacement carries most of the noise; errors of F and u enter the weights through it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from fitting.outcome import NEGLIGIBLE, FitOutcome
from fitting.spatial.posture import posture_error
from fitting.spatial.reduction import ReducedTrial
from fitting.spatial.tensor import (
    NoTensor,
    Tensor,
    entries_of,
    half_width_factor,
    joined,
    require_positive,
    require_span,
    symmetric,
    unit_tensors,
)
from fitting.static.plateaus import Plateau
from fitting.static.stiffness import BELIEVED, SAME_LOAD

BATCH = 0.5
"""Seconds whose means tell the error of a hold's mean: sway and its noise are coloured."""
ROUNDS, MAX_ROUNDS = 6, 40
"""Of the weights: at least so many, and then until the compliance rests."""


def held_tensor(trials: Sequence[ReducedTrial], gain_sd: float) -> Tensor:
    """K (3, 3) [N/m] of the static trials of one donning; gain_sd is relative. Raises NoTensor."""
    seen = [(each, rope) for each in trials if (rope := each.motion.rope) is not None and len(each.plateaus) > 1]
    if not seen:
        raise NoTensor("stiffness in three dimensions needs two markers on the rope (rope_markers) and static trials")
    directions = require_span(np.array([each.direction for each, _ in seen]), "stiffness", "static")
    holds = [[_hold(each, rope, plateau) for plateau in each.plateaus] for each, rope in seen]
    fit = _solve(holds, [np.zeros(len(each), np.intp) for each in holds])
    if fit.chi_square > stats.chi2.ppf(BELIEVED, max(fit.dof, 1)):
        slipped = [_segments(each.plateaus) for each, _ in seen]
        if all(len(np.unique(segment)) < len(segment) for segment in slipped):
            fit = _solve(holds, slipped)
    if fit.outcome is not FitOutcome.CONVERGED:
        why = "stiffness in three dimensions is not identified: the fit did not converge; hang more weight on"
        raise NoTensor(why, fit.outcome)
    inflation = fit.chi_square / fit.dof if fit.dof else 1.0
    # δK = −K δ(K⁻¹) K, entry by entry.
    stiffness = np.asarray(np.linalg.inv(fit.compliance), dtype=np.float64)
    turn = np.array([entries_of(-stiffness @ unit @ stiffness) for unit in unit_tensors()]).T
    covariance = max(1.0, inflation) * turn @ fit.covariance @ turn.T
    tensor = Tensor(stiffness, covariance, half_width_factor(inflation, max(fit.dof, 1)), directions)
    posture = posture_error(stiffness, seen[0][0].trial, seen[0][0].markers.anchor_rms)
    return require_positive(tensor.widened({"gain": tensor.scaled_error(gain_sd), "posture": posture}), "stiffness")


@dataclass(frozen=True)
class _Hold:
    """One held load: force [N] along u (3,), displacement (3,) [m], and their standard errors."""

    force: float
    force_sd: float
    u: NDArray[np.float64]
    u_sd: float
    x: NDArray[np.float64]
    x_sd: float


@dataclass(frozen=True)
class _Fit:
    compliance: NDArray[np.float64]
    covariance: NDArray[np.float64]
    chi_square: float
    dof: int
    outcome: FitOutcome


def _hold(each: ReducedTrial, rope: NDArray[np.float64], plateau: Plateau) -> _Hold:
    trial, motion = each.trial, each.motion
    inside = (trial.marker_time >= plateau.start) & (trial.marker_time <= plateau.end)
    time = trial.marker_time[inside]
    x, x_sd = _mean(time, motion.displacement[inside])
    mean, u_sd = _mean(time, rope[inside])
    u = mean / np.linalg.norm(mean)
    return _Hold(plateau.force, plateau.force_sd, u * np.sign(u @ each.direction), u_sd, x, x_sd)


def _mean(time: NDArray[np.float64], values: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Mean (3,) of values (frames, 3) that were seen, and its error per axis from the means of half seconds."""
    seen = np.isfinite(values).all(axis=1)
    if np.count_nonzero(seen) < 2:
        raise NoTensor("stiffness in three dimensions needs the rope's markers in every hold; check the cameras' view")
    time, values = time[seen], values[seen]
    white = _rms(np.std(values, axis=0, ddof=1)) / math.sqrt(len(values))
    batch = ((time - time[0]) / BATCH).astype(np.intp)
    count = np.bincount(batch)
    full = count > 0.5 * count.max()
    means = np.array([np.bincount(batch, column)[full] / count[full] for column in values.T])
    batched = _rms(np.std(means, axis=1, ddof=1)) / math.sqrt(full.sum()) if full.sum() >= 4 else 0.0
    return values.mean(axis=0), max(white, batched)


def _rms(values: NDArray[np.float64]) -> float:
    return math.sqrt(float(np.mean(values**2)))


def _segments(plateaus: Sequence[Plateau]) -> NDArray[np.intp]:
    """Number of each plateau's segment if the cuff slips wherever the load exceeds all before in the trial."""
    force = np.array([plateau.force for plateau in plateaus])
    highest = np.maximum.accumulate(force)
    begins = np.concatenate(([False], force[1:] > highest[:-1] + SAME_LOAD))
    return np.cumsum(begins, dtype=np.intp)


def _solve(holds: Sequence[Sequence[_Hold]], segments: Sequence[NDArray[np.intp]]) -> _Fit:
    """Weighted least squares of the six compliances and the offsets; the weights from the round before."""
    flat = [hold for trial in holds for hold in trial]
    units = unit_tensors()
    design = np.concatenate([(units @ (hold.force * hold.u)).T for hold in flat])
    offsets = joined(
        [np.asarray(np.kron(np.eye(segment.max() + 1)[segment], np.eye(3)), dtype=np.float64) for segment in segments]
    )
    columns = np.hstack((design, offsets))
    x = np.concatenate([hold.x for hold in flat])
    compliance, outcome = np.zeros((3, 3)), FitOutcome.NOT_CONVERGED
    for count in range(1, MAX_ROUNDS + 1):
        roots: list[NDArray[np.float64]] = [_whitening(hold, compliance) for hold in flat]
        white = joined(roots) @ np.column_stack((columns, x))
        scale = np.linalg.norm(white[:, :-1], axis=0)
        solved, _, rank, _ = np.linalg.lstsq(white[:, :-1] / scale, white[:, -1])
        if rank < len(scale):
            raise NoTensor("stiffness in three dimensions is not told: the loads of some pull do not differ; hang more")
        before, compliance = compliance, symmetric(solved[:6] / scale[:6])
        inverse = np.linalg.inv((white[:, :-1] / scale).T @ (white[:, :-1] / scale)) / np.outer(scale, scale)
        change = entries_of(compliance - before)
        if count >= ROUNDS and np.all(change**2 <= NEGLIGIBLE**2 * np.diag(inverse)[:6]):
            outcome = FitOutcome.CONVERGED
            break
    residual = white[:, -1] - white[:, :-1] @ (solved / scale)
    return _Fit(compliance, inverse[:6, :6], float(residual @ residual), len(x) - len(scale), outcome)


def _whitening(hold: _Hold, compliance: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 3) that makes the errors of a hold's displacement independent and 1, with those of force and direction."""
    along = np.outer(hold.u, hold.u)
    force = hold.force_sd**2 * along + (hold.force * hold.u_sd) ** 2 * (np.eye(3) - along)
    variance = hold.x_sd**2 * np.eye(3) + compliance @ force @ compliance
    return np.asarray(np.linalg.inv(np.linalg.cholesky(variance)), dtype=np.float64)

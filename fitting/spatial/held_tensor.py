"""Stiffness in three dimensions from held loads: X = K⁻¹ F u + X0, an offset X0 per segment of a trial.

F is the force of the load cell, u the direction of the rope and X the displacement of the cuff in the anchor's frame.
Compliance is fitted, because displacement has most of the noise; errors of F and u are included in the weights.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fitting.pull.plateaus import SAME_LOAD, Plateau
from fitting.pull.pull import Pull
from fitting.results.codes import TensorCode
from fitting.results.outcome import NEGLIGIBLE, FitOutcome
from fitting.spatial.tensor import (
    NoTensor,
    Tensor,
    block_diagonal,
    entries_of,
    half_width_factor,
    posture_error,
    require_positive,
    require_span,
    symmetric,
    unit_tensors,
)
from fitting.uncertainty import chi_square_limit

BATCH = 0.5
"""Seconds of the batch means from which the error of a hold's mean is computed, because sway is coloured noise."""
ROUNDS, MAX_ROUNDS = 6, 40
"""Least and largest number of reweighting rounds; they end when the compliance has converged."""


def held_tensor(trials: Sequence[Pull], gain_sd: float) -> Tensor:
    """K (3, 3) [N/m] of the static trials of one donning; gain_sd is relative. Raises NoTensor."""
    seen = [(pull, rope) for pull in trials if (rope := pull.motion.rope) is not None and len(pull.plateaus) > 1]
    if not seen:
        raise NoTensor(TensorCode.NO_ROPE, {"quantity": "stiffness", "test": "static"})
    directions = require_span(np.array([pull.direction for pull, _ in seen]), "stiffness", "static")
    holds = [[_hold(pull, rope, plateau) for plateau in pull.plateaus] for pull, rope in seen]
    fit = _solve(holds, [np.zeros(len(trial), np.intp) for trial in holds])
    if fit.chi_square > chi_square_limit(max(fit.dof, 1)):
        slipped = [_segments(pull.plateaus) for pull, _ in seen]
        if all(len(np.unique(segment)) < len(segment) for segment in slipped):
            fit = _solve(holds, slipped)
    if fit.outcome is not FitOutcome.CONVERGED:
        raise NoTensor(TensorCode.NOT_CONVERGED, {"quantity": "stiffness"}, fit.outcome)
    inflation = fit.chi_square / fit.dof if fit.dof else 1.0
    # δK = −K δ(K⁻¹) K for every entry.
    stiffness = np.asarray(np.linalg.inv(fit.compliance), dtype=np.float64)
    turn = np.array([entries_of(-stiffness @ unit @ stiffness) for unit in unit_tensors()]).T
    covariance = max(1.0, inflation) * turn @ fit.covariance @ turn.T
    tensor = Tensor(stiffness, covariance, half_width_factor(inflation, max(fit.dof, 1)), directions)
    posture = posture_error(stiffness, seen[0][0].motion.anchor, seen[0][0].markers.anchor_rms)
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


def _hold(pull: Pull, rope: NDArray[np.float64], plateau: Plateau) -> _Hold:
    trial, motion = pull.trial, pull.motion
    inside = (trial.marker_time >= plateau.start) & (trial.marker_time <= plateau.end)
    time = trial.marker_time[inside]
    x, x_sd = _mean(time, motion.displacement[inside])
    mean, u_sd = _mean(time, rope[inside])
    u = mean / np.linalg.norm(mean)
    return _Hold(plateau.force, plateau.force_sd, u * np.sign(u @ pull.direction), u_sd, x, x_sd)


def _mean(time: NDArray[np.float64], values: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Mean (3,) of the visible values (frames, 3), and its error per axis from the means of half seconds."""
    seen = np.isfinite(values).all(axis=1)
    if np.count_nonzero(seen) < 2:
        raise NoTensor(TensorCode.ROPE_HIDDEN_IN_HOLD)
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
    """Segment numbers (plateaus,) if the cuff slips whenever the load exceeds all previous loads of the trial."""
    force = np.array([plateau.force for plateau in plateaus])
    highest = np.maximum.accumulate(force)
    begins = np.concatenate(([False], force[1:] > highest[:-1] + SAME_LOAD))
    return np.cumsum(begins, dtype=np.intp)


def _solve(holds: Sequence[Sequence[_Hold]], segments: Sequence[NDArray[np.intp]]) -> _Fit:
    """Weighted least squares of the six compliances and the offsets, with weights of the previous round."""
    flat = [hold for trial in holds for hold in trial]
    units = unit_tensors()
    design = np.concatenate([(units @ (hold.force * hold.u)).T for hold in flat])
    offsets = block_diagonal(
        [np.asarray(np.kron(np.eye(segment.max() + 1)[segment], np.eye(3)), dtype=np.float64) for segment in segments]
    )
    columns = np.hstack((design, offsets))
    x = np.concatenate([hold.x for hold in flat])
    compliance, outcome = np.zeros((3, 3)), FitOutcome.NOT_CONVERGED
    for count in range(1, MAX_ROUNDS + 1):
        roots: list[NDArray[np.float64]] = [_whitening(hold, compliance) for hold in flat]
        white = block_diagonal(roots) @ np.column_stack((columns, x))
        scale = np.linalg.norm(white[:, :-1], axis=0)
        solved, _, rank, _ = np.linalg.lstsq(white[:, :-1] / scale, white[:, -1])
        if rank < len(scale):
            raise NoTensor(TensorCode.EQUAL_LOADS)
        before, compliance = compliance, symmetric(solved[:6] / scale[:6])
        inverse = np.linalg.inv((white[:, :-1] / scale).T @ (white[:, :-1] / scale)) / np.outer(scale, scale)
        change = entries_of(compliance - before)
        if count >= ROUNDS and np.all(change**2 <= NEGLIGIBLE**2 * np.diag(inverse)[:6]):
            outcome = FitOutcome.CONVERGED
            break
    residual = white[:, -1] - white[:, :-1] @ (solved / scale)
    return _Fit(compliance, inverse[:6, :6], float(residual @ residual), len(x) - len(scale), outcome)


def _whitening(hold: _Hold, compliance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Whitening matrix (3, 3) of the displacement of a hold, with the errors of force and direction included."""
    along = np.outer(hold.u, hold.u)
    force = hold.force_sd**2 * along + (hold.force * hold.u_sd) ** 2 * (np.eye(3) - along)
    variance = hold.x_sd**2 * np.eye(3) + compliance @ force @ compliance
    return np.asarray(np.linalg.inv(np.linalg.cholesky(variance)), dtype=np.float64)

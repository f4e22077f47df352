"""Postures, velocities and accelerations of a whole trial at once: nothing is differentiated.

Inverse kinematics gives the posture of each frame and its covariance from the marker noise. The noise is white, and so
is a high derivative of each coordinate (motion_prior.py). The motion is the most probable one, found by the Kalman
filter and the smoother of Bryson and Frazier (Durbin, Koopman, Time Series Analysis by State Space Methods, 2012,
ch. 4.3 and 4.4). Markers whose labels are exchanged for a while, and a marker far from its usual place on its body, are
left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from solver.errors import SolverCode
from solver.inverse_kinematics.exchanges import find_exchanges
from solver.inverse_kinematics.motion_prior import LEAST_SD, START_SD, MotionPrior, fit_motion_prior, transition
from solver.inverse_kinematics.posture_uncertainty import posture_uncertainty
from solver.inverse_kinematics.solve import (
    InverseKinematics,
    PostureOutcome,
    TrackingTasks,
    allocate_workspace,
    build_problem,
    solve_inverse_kinematics,
)
from solver.model import Model, ModelError
from solver.motion import Kinematics
from solver.multibody.postures import points_in_ground, postures

Array = NDArray[np.float64]

MOST_ROUNDS = 20
SETTLED = 0.05
"""Standard deviations; of the largest change of any position, velocity or acceleration in a round."""
LEAST_CHANGE = (1e-6, 1e-4, 1e-2)
"""rad or m, per s, per s²; a smaller change does not count, however small the standard deviation."""
GAP_SD = 1e-5
"""m; by which a constraint may be missed."""
FAR, LEAST_FAR = 6.0, 5e-3
"""Robust standard deviations, and m, by which a marker must leave its usual place to be left out."""
SINGULAR = 1e-12
"""Part of the greatest variance of a posture, below which a direction is one that the constraints exclude."""
MOST_SEARCHES = 4
"""Searches for markers to leave out; leaving one out shows others."""


class SmootherOutcome(StrEnum):
    """What became of the trial."""

    SOLVED = "solved"
    NOT_CONVERGED = "not_converged"  # or no frame has a posture
    NO_MARKERS = "no_markers"


@dataclass(frozen=True, eq=False)
class SmoothedMotion:
    """The most probable motion.

    positions, speeds, accelerations   (frames, coordinates) q, q̇, q̈ [rad or m, per s, per s²]
    prior    how smooth each coordinate moves, and how well that determines it
    counts   (frames, markers) whether a marker was seen and used
    """

    positions: Array
    speeds: Array
    accelerations: Array
    prior: MotionPrior
    counts: NDArray[np.bool_]
    outcome: SmootherOutcome

    @property
    def standard_deviations(self) -> Array:
        """(3, frames, coordinates) of positions, speeds, accelerations; infinite for a coordinate that no marker
        determines in any frame, which keeps its value.
        """
        return self.prior.standard_deviations

    def kinematics(self, time: Array) -> Kinematics:
        """What the muscles take, at evenly spaced time (frames,) [s]."""
        interval = float(time[-1] - time[0]) / (len(time) - 1)
        return Kinematics(time, interval, self.positions, self.speeds, self.accelerations, None)


def smooth_motion(
    model: Model,
    observed: Array,
    interval: float,
    tasks: TrackingTasks,
    noise: ArrayLike,
    most_rounds: int = MOST_ROUNDS,
) -> SmoothedMotion:
    """Smooth a trial. observed (frames, markers, 3) [m] in ground, NaN where hidden; interval between frames [s]; noise
    is the standard deviation of a marker along each axis [m], one for all or (markers,).

    Raises ModelError where shapes do not fit.
    """
    if interval <= 0 or len(observed) < 3:
        raise ModelError(
            f"smoothing needs at least 3 frames at a positive interval, got {len(observed)}, {interval:g} s",
            SolverCode.TOO_FEW_FRAMES,
        )
    counts, frames = _trusted(model, observed, tasks)
    used = np.where(counts[..., None], observed, np.nan)
    stated = posture_uncertainty(model, used, tasks, frames, noise)
    is_solved = np.array([outcome is PostureOutcome.SOLVED for outcome in frames.outcomes])
    known = stated.is_held & np.isfinite(frames.coordinates) & is_solved[:, None]
    if not known.any():
        outcome = SmootherOutcome.NOT_CONVERGED if counts.any() else SmootherOutcome.NO_MARKERS
        return _without_motion(model, counts, outcome)
    values = np.where(known, frames.coordinates, np.nan)
    prior = fit_motion_prior(values, np.where(known, stated.standard_deviation, np.nan) ** 2, interval)
    evidence = _Evidence(model, tasks, frames.coordinates, stated.covariance, known)
    means, outcome = _iterate(evidence, _filled(frames.coordinates), interval, prior, most_rounds)
    return SmoothedMotion(means[0], means[1], means[2], prior, counts, outcome)


def _iterate(
    evidence: _Evidence, q: Array, interval: float, prior: MotionPrior, most_rounds: int
) -> tuple[Array, SmootherOutcome]:
    """Linearise the constraints about the motion until it settles: (3, frames, coordinates) of q, q̇, q̈."""
    near = SETTLED * prior.standard_deviations + np.reshape(LEAST_CHANGE, (3, 1, 1))
    before = np.full((3, *q.shape), np.inf)
    for _ in range(most_rounds):
        means = _smooth(*evidence.about(q), interval, prior, q[0])
        if (np.abs(means - before) <= near).all():
            return means, SmootherOutcome.SOLVED
        q, before = means[0], means
    return means, SmootherOutcome.NOT_CONVERGED


def _trusted(model: Model, observed: Array, tasks: TrackingTasks) -> tuple[NDArray[np.bool_], InverseKinematics]:
    """(frames, markers) whether a marker counts, and the postures that those that do give frame by frame."""
    counts = np.asarray(np.isfinite(observed).all(axis=2))
    for exchange in find_exchanges(observed):
        counts[exchange.start : exchange.stop, list(exchange.markers)] = False
    for _ in range(MOST_SEARCHES):
        frames = solve_inverse_kinematics(model, np.where(counts[..., None], observed, np.nan), tasks)
        far = counts & _far(model, observed, tasks, frames.coordinates)
        if not far.any():
            break
        counts &= ~far
    return counts, frames


def _far(model: Model, observed: Array, tasks: TrackingTasks, coordinates: Array) -> NDArray[np.bool_]:
    """(frames, markers) the marker of a frame that is farthest from its usual place in its body, if it is too far."""
    if not np.isfinite(coordinates).any():
        return np.zeros(observed.shape[:2], dtype=np.bool_)
    state = postures(model, _filled(coordinates), np.zeros_like(coordinates))
    beside = np.stack(
        [
            np.einsum(
                "fij,fi->fj",
                state.rotation_to_ground[:, marker.body],
                observed[:, m] - points_in_ground(state, marker.body, marker.location),
            )
            for m, marker in enumerate(tasks.markers)
        ],
        axis=1,
    )
    with np.errstate(invalid="ignore"):
        away = np.linalg.norm(beside - _median(beside)[None], axis=2)
        reach = np.maximum(FAR * 1.4826 * _median(away), LEAST_FAR)
        excess = np.nan_to_num(away / reach, nan=0.0)
    return np.asarray((excess > 1.0) & (excess == excess.max(axis=1, keepdims=True)))


def _median(values: Array) -> Array:
    """Over the frames; 0 for what is never seen."""
    seen = np.isfinite(values).any(axis=0)
    found: Array = np.nanmedian(np.where(seen, values, 0.0), axis=0)
    return found


class _Evidence:
    """Postures of the frames and the constraints, as information on the coordinates of every frame."""

    def __init__(
        self, model: Model, tasks: TrackingTasks, values: Array, covariances: Array, known: NDArray[np.bool_]
    ) -> None:
        self._problem = build_problem(model, tasks)
        self._work = allocate_workspace(model, self._problem)
        self._unseen = np.full((len(values), len(tasks.markers), 3), np.nan)
        self._information = _information(covariances, known)
        self._vector = (self._information @ np.where(known, values, 0.0)[..., None])[..., 0]

    def about(self, q: Array) -> tuple[Array, Array]:
        """Information (frames, coordinates, coordinates) and its product with the coordinates (frames, coordinates);
        constraints are linearised about q.
        """
        from solver.inverse_kinematics.posture_uncertainty import (
            fill_information,  # the compiler takes a while to import
        )

        frames, count = q.shape
        gap, rows = np.zeros((frames, *self._work.system.gap.shape)), np.zeros((frames, *self._work.system.rows.shape))
        of_markers = np.zeros((frames, count, count)), np.zeros((frames, count)), np.zeros(self._unseen.shape)
        results = (*of_markers, gap, rows)
        weightless = np.zeros(self._unseen.shape[:2])
        fill_information(self._problem, self._unseen, weightless, np.ascontiguousarray(q), self._work, results)
        transposed = np.swapaxes(rows, 1, 2) / GAP_SD**2
        tight = transposed @ rows
        beyond = (tight @ q[..., None] - transposed @ gap[..., None])[..., 0]
        return self._information + tight, self._vector + beyond


def _information(covariances: Array, known: NDArray[np.bool_]) -> Array:
    """(frames, coordinates, coordinates) information of the postures on the coordinates: none across constraints, which
    give the covariances directions of variance 0.
    """
    both = known[:, :, None] & known[:, None, :]
    kept = np.where(both, covariances, 0.0)
    exact = known & (np.diagonal(kept, axis1=1, axis2=2) < LEAST_SD**2)
    diagonal = np.arange(known.shape[1])
    kept[:, diagonal, diagonal] += np.where(exact, LEAST_SD**2, 0.0)
    variances, directions = np.linalg.eigh(kept)
    is_open = variances > SINGULAR * variances[:, -1:]
    inverse = np.divide(1.0, variances, out=np.zeros_like(variances), where=is_open)
    found: Array = (directions * inverse[:, None, :]) @ np.swapaxes(directions, 1, 2)
    return found


def _smooth(information: Array, vector: Array, interval: float, prior: MotionPrior, first: Array) -> Array:
    """Means (3, frames, coordinates) of q, q̇, q̈.

    information H on q and vector H q are those of each frame; first (coordinates,) is the mean before the first. The
    state holds q, q̇, q̈ of all coordinates, then their third derivatives as far as the prior has them.
    """
    frames, n = vector.shape
    step, drive, cov, places = _state_space(prior, interval)
    mean = np.concatenate([first, np.zeros(len(step) - n)])
    filtered = []
    for k in range(frames):
        if k:
            mean, cov = step @ mean, step @ cov @ step.T + drive
        column = cov[:, :n]
        weighted = np.column_stack([information[k], vector[k] - information[k] @ mean[:n]])
        inner = np.linalg.solve(np.eye(n) + information[k] @ column[:n], weighted)
        filtered.append((mean, cov, inner))
        mean = mean + column @ inner[:, n]
        cov = cov - column @ inner[:, :n] @ column.T
        cov = 0.5 * (cov + cov.T)
    means, later = np.zeros((3, frames, n)), np.zeros(len(step))
    for k in range(frames - 1, -1, -1):
        mean, cov, inner = filtered[k]
        later[:n] += inner[:, n] - inner[:, :n].T @ (cov[:n] @ later)
        means[:, k] = (mean + cov @ later)[places]
        later = step.T @ later
    return means


def _state_space(prior: MotionPrior, interval: float) -> tuple[Array, Array, Array, NDArray[np.int64]]:
    """Transition, covariance of a step, that before the first frame, and the places (3, coordinates) of q, q̇, q̈."""
    count = len(prior.order)
    places = np.arange(3 * count).reshape(3, count)
    size = int(prior.order.sum())
    step, drive, start = np.eye(size), np.zeros((size, size)), np.zeros(size)
    beyond = 3 * count
    for k, order in enumerate(prior.order.tolist()):
        own = [*places[:, k].tolist(), *range(beyond, beyond + order - 3)]
        beyond += order - 3
        one, unit = transition(order, interval)
        step[np.ix_(own, own)] = one
        drive[np.ix_(own, own)] = prior.intensity[k] * unit
        start[own] = np.square(START_SD[:order])
    return step, drive, np.diag(start), places


def _without_motion(model: Model, counts: NDArray[np.bool_], outcome: SmootherOutcome) -> SmoothedMotion:
    nothing = np.full((len(counts), len(model.coordinates)), np.nan)
    return SmoothedMotion(nothing, nothing, nothing, fit_motion_prior(nothing, nothing, 1.0), counts, outcome)


def _filled(coordinates: Array) -> Array:
    """Frames without a posture lie on the straight line between their neighbours."""
    known = np.isfinite(coordinates[:, 0])
    at = np.arange(len(coordinates))
    return np.column_stack([np.interp(at, at[known], column[known]) for column in coordinates.T])

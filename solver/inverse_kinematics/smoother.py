"""Postures, velocities and accelerations of a whole trial at once: nothing is differentiated.

Inverse kinematics gives the posture of each frame and its covariance from the marker noise. The noise is white, and so
is a high derivative of each coordinate, the third (jerk) or fourth (snap): whichever makes the record likelier. The
motion is the most probable one, found by the Kalman filter and the smoother of Bryson and Frazier, which inverts no
covariance (Durbin, Koopman, Time Series Analysis by State Space Methods, 2012, ch. 4.3 and 4.4). Markers whose labels
are exchanged for a while, and a marker far from its usual place on its body, are left out.

The intensity of the white derivative is not known exactly either, so intervals are those of the mixture over the
intensities that the record admits. A plug-in estimate alone gives intervals that are too narrow in short records (Kass,
Steffey, J. Am. Stat. Assoc. 84:717, 1989).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from math import factorial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from solver.compiled import compiled, compiled_for_python
from solver.errors import SolverCode
from solver.inverse_kinematics.marker_fit import find_exchanges
from solver.inverse_kinematics.solve import (
    InverseKinematics,
    PostureOutcome,
    TrackingTasks,
    allocate_workspace,
    build_problem,
    linearise_frames,
    posture_uncertainty,
    solve_inverse_kinematics,
)
from solver.model import Model, ModelError
from solver.motion import Kinematics
from solver.multibody.postures import postures

Array = NDArray[np.float64]

ORDERS = (3, 4)
START_SD = (0.3, 2.0, 10.0, 60.0)  # of q, q̇, q̈ and the third derivative before the first frame [rad or m, s]
LEAST_SD = 1e-6  # rad or m; added to that of postures, for coordinates that constraints determine exactly
LOWEST, HIGHEST, SPACING = -18.0, 32.0, 0.8  # of the logarithm of the intensity [rad² or m², s]
WORTHWHILE = 5.0  # of the log-likelihood, below the highest; less likely intensities do not count
SKIPPED = 6  # observations that the likelihood leaves to the wide start, the same for every order


@dataclass(frozen=True, eq=False)
class MotionPrior:
    """How smooth each coordinate moves.

    order      (coordinates,) of the white derivative;  intensity (coordinates,) [rad² or m² / s^(2 order − 1)]
    standard_deviations   (3, frames, coordinates) of q, q̇, q̈ from the coordinate's own record, over all intensities
                          that it admits; infinite for a coordinate that is never determined
    """

    order: NDArray[np.int64]
    intensity: Array
    standard_deviations: Array


def transition(order: int, interval: float) -> tuple[Array, Array]:
    """Transition and covariance per unit of intensity of a step; both (order, order), of q and its derivatives."""
    step, drive = np.zeros((order, order)), np.zeros((order, order))
    for i, j in np.ndindex(order, order):
        if j >= i:
            step[i, j] = interval ** (j - i) / factorial(j - i)
        a, b = order - 1 - i, order - 1 - j
        drive[i, j] = interval ** (a + b + 1) / (factorial(a) * factorial(b) * (a + b + 1))
    return step, drive


def fit_motion_prior(values: Array, variances: Array, interval: float) -> MotionPrior:
    """Fit each coordinate by itself. values, variances (frames, coordinates) of postures found frame by frame, NaN
    where a coordinate is not determined; one that never is gets the lowest intensity.
    """
    frames, count = values.shape
    order, intensity = np.full(count, ORDERS[0]), np.full(count, np.exp(LOWEST))
    deviations = np.full((3, frames, count), np.inf)
    for k in range(count):
        known = np.isfinite(values[:, k])
        if known.sum() > 2 * max(ORDERS):
            moved = values[:, k] - values[known, k][0]
            candidates = [_Candidate(moved, variances[:, k] + LEAST_SD**2, interval, tried) for tried in ORDERS]
            best = max(candidates, key=lambda candidate: candidate.highest)
            order[k], intensity[k] = best.order, best.intensity
            deviations[:, :, k] = _mixed(candidates, best.highest).T
    return MotionPrior(order, intensity, deviations)


def _mixed(candidates: list[_Candidate], highest: float) -> Array:
    """(frames, 3) standard deviation of the mixture over orders and intensities."""
    states = [state for candidate in candidates for state in candidate.states(highest)]
    weights, means, spreads = (np.array(part) for part in zip(*states, strict=True))
    weights = weights[:, None, None] / sum(weights)
    mean = (weights * means).sum(axis=0)
    return np.asarray(np.sqrt((weights * (spreads + (means - mean) ** 2)).sum(axis=0)))


class _Candidate:
    """A coordinate with a white derivative of one order, over a grid of intensities."""

    def __init__(self, values: Array, variances: Array, interval: float, order: int) -> None:
        self.order = order
        self._values, self._variances = np.ascontiguousarray(values), np.ascontiguousarray(variances)
        self._step, self._drive = transition(order, interval)
        self._start = np.diag(np.square(START_SD[:order]))
        self._grid = np.arange(LOWEST, HIGHEST, SPACING)
        self._found: dict[int, float] = {}
        at = max(range(0, len(self._grid), 6), key=self._likelihood)
        while (beside := max(self._around(at), key=self._likelihood)) != at:
            at = beside
        self._at, self.highest = at, self._likelihood(at)
        self.intensity = float(np.exp(self._grid[at]))

    def states(self, highest: float) -> list[tuple[float, Array, Array]]:
        """Weight, means and variances (frames, 3) of q, q̇, q̈ at every intensity whose likelihood counts."""
        found = [at for at in self._worthwhile() if self._likelihood(at) > highest - WORTHWHILE]
        return [(float(np.exp(self._likelihood(at) - highest)), *self._smooth(at)) for at in found]

    def _worthwhile(self) -> list[int]:
        kept = [self._at]
        for direction in (-1, 1):
            at = self._at + direction
            while 0 <= at < len(self._grid) and self._likelihood(at) > self.highest - WORTHWHILE:
                kept.append(at)
                at += direction
        return kept

    def _around(self, at: int) -> list[int]:
        return [at, *(beside for beside in (at - 1, at + 1) if 0 <= beside < len(self._grid))]

    def _likelihood(self, at: int) -> float:
        if at not in self._found:
            found = self._run(at, *np.zeros((2, 0, self.order)))
            self._found[at] = found if np.isfinite(found) else -np.inf
        return self._found[at]

    def _smooth(self, at: int) -> tuple[Array, Array]:
        means, spread = np.zeros((2, len(self._values), self.order))
        self._run(at, means, spread)
        return means[:, :3], np.maximum(spread[:, :3], 0.0)

    def _run(self, at: int, means: Array, spread: Array) -> float:
        drive = np.exp(self._grid[at]) * self._drive
        found: float = smooth_scalar(self._values, self._variances, self._step, drive, self._start, means, spread)
        return found


@compiled_for_python
def smooth_scalar(
    values: Array, variances: Array, step: Array, drive: Array, start: Array, means: Array, spread: Array
) -> float:
    """Fill means and spread (frames, order) with the smoothed state and its variances; return the log-likelihood.

    values, variances (frames,) of the observations, NaN where there is none; step, drive, start (order, order): the
    transition, the covariance that a step adds, and that before the first frame. means may have no rows: then only the
    likelihood is computed.
    """
    frames, order = len(values), len(step)
    mean, cov, gain, other = np.zeros(order), start.copy(), np.zeros(order), np.zeros((order, order))
    kept = frames if len(means) else 0
    ahead, covs = np.zeros((kept, order)), np.zeros((kept, order, order))
    gains, errors = np.zeros((kept, order)), np.zeros((kept, 2))
    likelihood, seen = 0.0, 0
    for k in range(frames):
        if k:
            advance(step, drive, mean, cov, other)
        if kept:
            ahead[k] = mean
            covs[k] = cov
        if np.isfinite(values[k]):
            total, error = cov[0, 0] + variances[k], values[k] - mean[0]
            if seen >= SKIPPED:
                likelihood -= 0.5 * (np.log(total) + error * error / total)
            seen += 1
            update(error, total, mean, cov, gain, other)
            if kept:
                gains[k] = gain
                errors[k, 0], errors[k, 1] = error, total
    r, N = np.zeros(order), np.zeros((order, order))
    for k in range(kept - 1, -1, -1):
        observe(gains[k], errors[k], r, N, other)
        smoothed_state(ahead[k], covs[k], r, N, means[k], spread[k])
        go_back(step, r, N, other)
    return likelihood


@compiled
def update(error: float, total: float, mean: Array, cov: Array, gain: Array, other: Array) -> None:
    """Fill gain; mean and covariance after an observation of the first entry."""
    order = len(mean)
    for i in range(order):
        gain[i] = cov[i, 0] / total
        mean[i] += gain[i] * error
    for i in range(order):
        for j in range(order):
            other[i, j] = cov[i, j] - gain[i] * cov[0, j]
    for i in range(order):
        for j in range(order):
            cov[i, j] = 0.5 * (other[i, j] + other[j, i])


@compiled
def advance(step: Array, drive: Array, mean: Array, cov: Array, other: Array) -> None:
    """Mean and covariance one frame ahead; step is an upper triangle."""
    order = len(step)
    for i in range(order):
        ahead = 0.0
        for j in range(i, order):
            ahead += step[i, j] * mean[j]
        mean[i] = ahead
        for j in range(order):
            other[i, j] = 0.0
            for k in range(i, order):
                other[i, j] += step[i, k] * cov[k, j]
    for i in range(order):
        for j in range(order):
            cov[i, j] = drive[i, j]
            for k in range(j, order):
                cov[i, j] += other[i, k] * step[j, k]


@compiled
def observe(gain: Array, errors: Array, r: Array, N: Array, other: Array) -> None:
    """r becomes Lᵀ r + e/S and N becomes Lᵀ N L + 1/S in the first entry, L = I − K (1 0 …): backwards they gather
    what later observations add. errors (2,): observed less predicted, e, and its variance S, 0 without an observation.
    """
    order, total = len(r), errors[1]
    if not total > 0.0:
        return
    along = 0.0
    for i in range(order):
        along += gain[i] * r[i]
    r[0] += errors[0] / total - along
    for i in range(order):
        other[0, i] = 0.0
        for j in range(order):
            other[0, i] += gain[j] * N[j, i]
    inner = 0.0
    for i in range(order):
        inner += other[0, i] * gain[i]
    for i in range(order):
        N[0, i] -= other[0, i]
        N[i, 0] -= other[0, i]
    N[0, 0] += inner + 1.0 / total


@compiled
def smoothed_state(ahead: Array, cov: Array, r: Array, N: Array, mean: Array, spread: Array) -> None:
    """Fill mean and spread (order,) of a frame, from those before its observation and all later ones."""
    order = len(r)
    for i in range(order):
        mean[i], spread[i] = ahead[i], cov[i, i]
        for j in range(order):
            mean[i] += cov[i, j] * r[j]
            for m in range(order):
                spread[i] -= cov[i, j] * N[j, m] * cov[m, i]


@compiled
def go_back(step: Array, r: Array, N: Array, other: Array) -> None:
    """r becomes Φᵀ r and N becomes Φᵀ N Φ."""
    order = len(r)
    for i in range(order - 1, -1, -1):
        before = 0.0
        for j in range(i + 1):
            before += step[j, i] * r[j]
        r[i] = before
        for j in range(order):
            other[i, j] = 0.0
            for m in range(i + 1):
                other[i, j] += step[m, i] * N[m, j]
    for i in range(order):
        for j in range(order):
            N[i, j] = 0.0
            for m in range(j + 1):
                N[i, j] += other[i, m] * step[m, j]


MOST_ROUNDS = 20
SETTLED = 0.05  # standard deviations; largest change of any position, velocity or acceleration in a round
LEAST_CHANGE = (1e-6, 1e-4, 1e-2)  # rad or m, per s, per s²; a smaller change does not count
GAP_SD = 1e-5  # m; by which a constraint may be missed
FAR, LEAST_FAR = 6.0, 5e-3  # robust standard deviations, and m, from its usual place, where a marker is left out
SINGULAR = 1e-12  # part of the greatest variance of a posture; below it constraints exclude a direction
MOST_SEARCHES = 4  # for markers to leave out; leaving one out shows others


class SmootherOutcome(StrEnum):
    """Outcome of the smoothing of a trial."""

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
        """Kinematics for the muscles, at evenly spaced time (frames,) [s]."""
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
        nothing = np.full(frames.coordinates.shape, np.nan)
        return SmoothedMotion(nothing, nothing, nothing, fit_motion_prior(nothing, nothing, 1.0), counts, outcome)
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
    bodies, locations = [marker.body for marker in tasks.markers], [marker.location for marker in tasks.markers]
    rotation = state.rotation_to_ground[:, bodies]
    points = state.origin_in_ground[:, bodies] + (rotation @ np.array(locations)[..., None])[..., 0]
    beside = np.einsum("fmij,fmi->fmj", rotation, observed - points)
    with np.errstate(invalid="ignore"):
        away = np.linalg.norm(beside - _median(beside)[None], axis=2)
        reach = np.maximum(FAR * 1.4826 * _median(away), LEAST_FAR)
        excess = np.nan_to_num(away / reach, nan=0.0)
    return np.asarray((excess > 1.0) & (excess == excess.max(axis=1, keepdims=True)))


def _median(values: Array) -> Array:
    """Over the frames; 0 for a marker that is never seen."""
    return np.asarray(np.nanmedian(np.where(np.isfinite(values).any(axis=0), values, 0.0), axis=0))


class _Evidence:
    """Postures of the frames and the constraints, as information on the coordinates of every frame."""

    def __init__(
        self, model: Model, tasks: TrackingTasks, values: Array, covariances: Array, known: NDArray[np.bool_]
    ) -> None:
        self._problem = build_problem(model, tasks)
        self._work = allocate_workspace(model, self._problem)
        self._information = _information(covariances, known)
        self._vector = (self._information @ np.where(known, values, 0.0)[..., None])[..., 0]

    def about(self, q: Array) -> tuple[Array, Array]:
        """Information (frames, coordinates, coordinates) and its product with the coordinates (frames, coordinates);
        constraints are linearised about q.
        """
        _, _, _, gap, rows = linearise_frames(self._problem, self._work, q)
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
    return np.asarray((directions * inverse[:, None, :]) @ np.swapaxes(directions, 1, 2))


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


def _filled(coordinates: Array) -> Array:
    """Frames without a posture lie on the straight line between their neighbours."""
    known, at = np.isfinite(coordinates[:, 0]), np.arange(len(coordinates))
    return np.column_stack([np.interp(at, at[known], column[known]) for column in coordinates.T])

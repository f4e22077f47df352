"""Postures, velocities and accelerations of a whole trial at once, from its markers: nothing is differentiated.

Each coordinate is driven by white jerk of its own intensity (Singer 1970; Bar-Shalom, Li, Kirubarajan, Estimation with
Applications to Tracking and Navigation, 2001, ch. 6.2), each marker is seen with noise; the trajectory is the most
probable one. It is found by Gauss–Newton: markers and constraints are linearised about a trajectory, and the linear
problem is solved by the Rauch–Tung–Striebel smoother. The intensities are those of greatest likelihood, by expectation
maximisation (Shumway, Stoffer 1982). A marker that lies far from its usual place beside the model does not count there.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from solver.inverse_kinematics.frame import IkWorkspace, Problem
from solver.inverse_kinematics.solve import (
    InverseKinematics,
    TrackingTasks,
    allocate_workspace,
    build_problem,
    solve_inverse_kinematics,
)
from solver.model import CoordinateLock, Model, ModelError

Array = NDArray[np.float64]

MOST_ROUNDS = 60
SETTLED = 0.1
"""Standard deviations; of the largest change in a round of any position, velocity or acceleration."""
LEAST_HASTE, GAIN, MOST_HASTE = 6.0, 1.5, 60.0
"""Times the step of expectation maximisation, in the logarithm: it is slow where noise hides most of the motion. The
factor grows while an intensity keeps its direction (as in Rprop)."""
GAP_SD = 1e-6
"""m or rad; by which constraints and locks may be missed."""
FAR, LEAST_FAR = 6.0, 5e-3
"""Robust standard deviations, and m, by which a marker must leave its usual place not to count."""
START_SD = (1.0, 10.0, 100.0)
"""Of position, velocity and acceleration before the first frame."""
FIRST_INTENSITY = 1e2
LEAST_INTENSITY = 1e-8


class SmootherOutcome(StrEnum):
    """What became of the iteration."""

    SOLVED = "solved"
    NOT_CONVERGED = "not_converged"
    NO_MARKERS = "no_markers"


@dataclass(frozen=True, eq=False)
class SmoothedMotion:
    """The most probable motion.

    positions, speeds, accelerations   (frames, coordinates) q, q̇, q̈ [rad or m, per s, per s²]
    covariance      (frames, 3, 3, coordinates) of (q, q̇, q̈) of each coordinate
    jerk_intensity  (coordinates,) [rad² or m² per s⁵];  rounds of the iteration
    counts          (frames, markers) whether a marker was seen and taken to be at its place
    """

    positions: Array
    speeds: Array
    accelerations: Array
    covariance: Array
    jerk_intensity: Array
    counts: NDArray[np.bool_]
    outcome: SmootherOutcome
    rounds: int

    @property
    def standard_deviations(self) -> Array:
        """(3, frames, coordinates) of positions, speeds, accelerations."""
        variances = np.stack([self.covariance[:, k, k] for k in range(3)])
        found: Array = np.sqrt(np.maximum(variances, 0.0))
        return found


def smooth_motion(
    model: Model,
    observed: Array,
    interval: float,
    tasks: TrackingTasks,
    noise: ArrayLike,
    start: InverseKinematics | None = None,
    most_rounds: int = MOST_ROUNDS,
) -> SmoothedMotion:
    """Smooth a trial. observed (frames, markers, 3) [m], NaN where hidden; interval between frames [s]; noise is the
    standard deviation of a marker along each axis [m], one for all or (markers,), of one whose weight is the mean.

    start is the solution frame by frame, solved here unless given. Raises ModelError where shapes do not fit.
    """
    start = start or solve_inverse_kinematics(model, observed, tasks)
    problem, frames = build_problem(model, tasks), len(observed)
    seen = np.asarray(np.isfinite(observed).all(axis=2))
    if interval <= 0 or frames < 3:
        raise ModelError(f"a motion of at least three frames is smoothed, and there are {frames}, {interval:g} s apart")
    if not seen.any():
        nothing = np.full((frames, len(model.coordinates)), np.nan)
        empty = np.full((frames, 3, 3, len(model.coordinates)), np.nan)
        return SmoothedMotion(nothing, nothing, nothing, empty, nothing[0], seen, SmootherOutcome.NO_MARKERS, 0)
    usual = tasks.weights / tasks.weights[tasks.weights > 0].mean()
    precision = usual / np.asarray(noise, dtype=np.float64) ** 2
    q = _filled(start.coordinates)
    locks = {lock.coordinate: lock.value for lock in model.constraints if isinstance(lock, CoordinateLock)}
    evidence = _Evidence(problem, allocate_workspace(model, problem), observed, seen * precision, locks)
    intensity = np.full(q.shape[1], FIRST_INTENSITY)
    before = np.full((frames, 3, q.shape[1]), np.inf)
    last, haste = np.zeros(q.shape[1]), np.full(q.shape[1], LEAST_HASTE)
    outcome, rounds = SmootherOutcome.NOT_CONVERGED, 0
    while rounds < most_rounds and outcome is SmootherOutcome.NOT_CONVERGED:
        rounds += 1
        information, vector = evidence.about(q)
        means, variances, updated = _smooth(information, vector, interval, intensity)
        moved = float((np.abs(means - before) / np.sqrt(np.einsum("faai->fai", variances))).max())
        q, before = means[:, 0], means
        if moved < SETTLED:
            outcome = SmootherOutcome.SOLVED
        grown = np.log(updated / intensity)
        haste = np.where(grown * last > 0, np.minimum(GAIN * haste, MOST_HASTE), LEAST_HASTE)
        last = grown
        intensity = np.maximum(intensity * np.exp(np.clip(haste * grown, -3.0, 3.0)), LEAST_INTENSITY)
    return SmoothedMotion(means[:, 0], means[:, 1], means[:, 2], variances, intensity, evidence.counts, outcome, rounds)


class _Evidence:
    """Markers, constraints and locks of every frame as information on its coordinates."""

    def __init__(
        self,
        problem: Problem,
        work: IkWorkspace,
        observed: Array,
        precisions: Array,
        locks: dict[int, float],
    ) -> None:
        self._problem, self._work, self._locks = problem, work, locks
        self._observed = np.ascontiguousarray(observed)
        self._precisions = precisions
        self.counts = precisions > 0

    def about(self, q: Array) -> tuple[Array, Array]:
        """Information (frames, coordinates, coordinates) and its product with the coordinates (frames, coordinates)."""
        from solver.inverse_kinematics.information import fill_information  # the compiler takes a while to import

        frames, count = q.shape
        rows = len(self._work.system.gap)
        results = (
            np.zeros((frames, count, count)),
            np.zeros((frames, count)),
            np.zeros(self._observed.shape),
            np.zeros((frames, rows)),
            np.zeros((frames, rows, count)),
        )
        at = np.ascontiguousarray(q)
        fill_information(self._problem, self._observed, self._precisions * self.counts, at, self._work, results)
        information, gradient, points, gap, constraints = results
        self._set_far_markers_aside(points)
        transposed = np.swapaxes(constraints, 1, 2)
        information = information + transposed @ constraints / GAP_SD**2
        pull = gradient + (transposed @ gap[..., None])[..., 0] / GAP_SD**2
        for coordinate, value in self._locks.items():
            information[:, coordinate, coordinate] += GAP_SD**-2
            pull[:, coordinate] += (q[:, coordinate] - value) / GAP_SD**2
        return information, (information @ q[..., None])[..., 0] - pull

    def _set_far_markers_aside(self, points: Array) -> None:
        """A marker stands beside its place in the model as usual; one that jumps or is swapped does not."""
        beside = np.where((self._precisions > 0)[..., None], points - self._observed, np.nan)
        middle = np.nanmedian(beside, axis=0)
        away = np.linalg.norm(beside - middle, axis=2)
        reach = np.maximum(FAR * 1.4826 * np.nanmedian(away, axis=0), LEAST_FAR)
        self.counts = (self._precisions > 0) & (away <= reach)


def _smooth(information: Array, vector: Array, h: float, intensity: Array) -> tuple[Array, Array, Array]:
    """Means (frames, 3, coordinates), covariances (frames, 3, 3, coordinates) of each coordinate, and new intensities.

    The state is (q, q̇, q̈); information H on q and vector H q are those of each frame.
    """
    frames, n = vector.shape
    one = np.array([[1.0, h, h * h / 2], [0.0, 1.0, h], [0.0, 0.0, 1.0]])
    shape = np.array([[h**5 / 20, h**4 / 8, h**3 / 6], [h**4 / 8, h**3 / 3, h**2 / 2], [h**3 / 6, h**2 / 2, h]])
    step, drive = np.kron(one, np.eye(n)), np.kron(shape, np.diag(intensity))
    mean = np.zeros(3 * n)
    cov = np.kron(np.diag(np.square(START_SD)), np.eye(n))
    filtered: list[tuple[Array, Array]] = []
    ahead: list[tuple[Array, Array]] = []
    for k in range(frames):
        if k:
            mean, cov = step @ mean, step @ cov @ step.T + drive
        ahead.append((mean, cov))
        column = cov[:, :n]
        gain = np.linalg.solve(np.eye(n) + information[k] @ column[:n], np.column_stack([information[k], vector[k]]))
        mean = mean + column @ (gain[:, n] - gain[:, :n] @ mean[:n])
        cov = cov - column @ gain[:, :n] @ column.T
        cov = 0.5 * (cov + cov.T)
        filtered.append((mean, cov))
    means, covs = np.zeros((frames, 3 * n)), np.zeros((frames, 3, 3, n))
    inverse = np.linalg.inv(shape)
    driven = np.zeros(n)
    for k in range(frames - 1, -1, -1):
        if k < frames - 1:
            before, its = filtered[k]
            back = np.linalg.solve(ahead[k + 1][1], step @ its).T
            later_mean, later_cov = mean, cov
            mean = before + back @ (later_mean - ahead[k + 1][0])
            cov = its + back @ (later_cov - ahead[k + 1][1]) @ back.T
            # Expectation of w wᵀ for w = x_{k+1} − F x_k, with the covariance of neighbours later_cov backᵀ.
            jump = (later_mean - step @ mean).reshape(3, n)
            cross = later_cov @ back.T @ step.T
            spread = later_cov - cross - cross.T + step @ cov @ step.T
            blocks = np.einsum("aibi->abi", spread.reshape(3, n, 3, n))
            driven += np.einsum("ab,abi->i", inverse, blocks + jump[:, None] * jump[None])
        means[k] = mean
        covs[k] = np.einsum("aibi->abi", cov.reshape(3, n, 3, n))
    updated = np.maximum(driven / (3 * (frames - 1)), LEAST_INTENSITY)
    return means.reshape(frames, 3, n), covs, updated


def _filled(coordinates: Array) -> Array:
    """Frames without a posture lie on the straight line between their neighbours."""
    known = np.isfinite(coordinates[:, 0])
    at = np.arange(len(coordinates))
    return np.column_stack([np.interp(at, at[known], column[known]) for column in coordinates.T])

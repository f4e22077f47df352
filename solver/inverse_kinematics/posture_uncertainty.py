"""How far marker noise moves the coordinates that inverse kinematics finds.

At the optimum the Lagrangian's gradient vanishes, so observations that change by dx move the posture by dq = S dx with

    S = P⁺ Jᵀ W,   P⁺ = Z (Zᵀ ∇²L Z)⁻¹ Zᵀ,   Z the directions that the constraints leave

and Cov q = Σ_m σ_m² S_m S_mᵀ. The Hessian is exact: with Gauss–Newton's part alone the standard deviations are wrong
by a factor of 3 to 4 where residuals are centimetres.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import comb

import numpy as np
from numpy.typing import ArrayLike, NDArray

from solver.compiled import compiled_for_python
from solver.errors import SolverCode
from solver.inverse_kinematics.gauss_newton import IkWorkspace, Problem, share_weights
from solver.inverse_kinematics.linearise import Targets, add_curvature, evaluate_gap, fill_constraint_rows, linearise
from solver.inverse_kinematics.pose import differentiate_screws, evaluate_pose
from solver.inverse_kinematics.solve import (
    InverseKinematics,
    TrackingTasks,
    allocate_workspace,
    build_problem,
)
from solver.model import Model, ModelError

Array = NDArray[np.float64]

LEAST_CURVATURE = 1e-9  # m²/rad²: a marker with a tenth of the weight, 0.1 mm from the axis
HELD_ABOVE = 1e-4  # square of a coordinate's part in a direction without curvature
DIFFERENCES, NOISE_STEP = 6, 0.030
"""Order of the differences that show the noise, and their step [s]."""
MOST_MEDIANS = 25.0
"""Median sizes of a difference; a greater one is a jump or an exchange. Noise in motion is several times that at
rest."""
LEAST_FRAMES = 2
"""Sixth differences of a marker from which its noise is estimated."""


@dataclass(frozen=True, eq=False)
class PostureUncertainty:
    """Uncertainty of the postures from independent marker noise.

    covariance           (frames, coordinates, coordinates) [rad or m]², NaN where a frame has no posture
    standard_deviation   (frames, coordinates) [rad or m]; infinite where no marker holds the coordinate
    is_held              (frames, coordinates) whether the visible markers, tasks or locks determine the coordinate
    """

    covariance: Array
    standard_deviation: Array
    is_held: NDArray[np.bool_]


def posture_uncertainty(
    model: Model, observed: Array, tasks: TrackingTasks, solution: InverseKinematics, noise: ArrayLike
) -> PostureUncertainty:
    """Uncertainty of a solution; noise is the standard deviation of a marker along each axis [m], one for all or
    (markers,). observed and tasks are those that were solved.
    """
    sigma = np.broadcast_to(np.asarray(noise, dtype=np.float64), (len(tasks.markers),))
    if not (np.isfinite(sigma).all() and sigma.min(initial=0.0) >= 0.0):
        raise ModelError("the noise of each marker should be finite and not negative [m]", SolverCode.WRONG_NOISE)
    problem = build_problem(model, tasks)
    work = allocate_workspace(model, problem)
    return uncertainty_of_postures(problem, work, observed, solution.coordinates, solution.multipliers, sigma)


def uncertainty_of_postures(
    problem: Problem, work: IkWorkspace, observed: Array, q: Array, multipliers: Array, sigma: Array
) -> PostureUncertainty:
    """posture_uncertainty with the tables of the compiled solver: q (frames, coordinates), λ (frames, rows) of the
    constraints, sigma (markers,) [m].
    """

    frames, count = q.shape
    rows = np.zeros((frames, multipliers.shape[1], count))
    hessians, spread = np.zeros((frames, count, count)), np.zeros((frames, count, count))
    seen = np.ascontiguousarray(observed, dtype=np.float64)
    fill_sensitivities(problem, seen, q, multipliers, sigma**2, work, (hessians, rows, spread))
    bounds = problem.bounds
    is_at_bound = ((q <= bounds.lowest) | (q >= bounds.highest)) & ~bounds.is_locked
    response, loose = _response(hessians, rows, bounds.is_locked | is_at_bound)
    covariance = response @ spread @ response
    covariance[np.isnan(q[:, 0])] = np.nan
    is_held = np.diagonal(loose, axis1=1, axis2=2) < HELD_ABOVE
    is_moved = (np.diagonal(hessians, axis1=1, axis2=2) > LEAST_CURVATURE) | (rows != 0.0).any(axis=1)
    is_held &= is_moved | ~is_at_bound  # one that nothing moves may happen to stand at its bound
    variance = np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 0.0)
    return PostureUncertainty(covariance, np.where(is_held, np.sqrt(variance), np.inf), is_held)


def estimate_marker_noise(observed: Array, interval: float) -> Array:
    """(markers,) standard deviation per axis [m] of white noise, from sixth differences of observed
    (frames, markers, 3). Jumps are left out.

    The differences are taken over steps of about 30 ms, so that they show the noise between 8 and 16 Hz: files are
    often low-pass filtered at 15 to 20 Hz, and neighbouring frames then show a tenth of the noise that matters. Motion
    below 3 Hz hardly enters. interval between frames [s]. NaN for a marker that is not seen for long enough.
    """
    step = max(1, round(NOISE_STEP / interval))
    weights = np.array([(-1.0) ** k * comb(DIFFERENCES, k) for k in range(DIFFERENCES + 1)])
    count = len(observed) - DIFFERENCES * step
    if count < 1:
        return np.full(observed.shape[1], np.nan)
    sixth = sum(weight * observed[k * step : k * step + count] for k, weight in enumerate(weights))
    noise = [_rms_without_jumps(values[np.isfinite(values)]) for values in np.moveaxis(np.asarray(sixth), 1, 0)]
    found: Array = np.array(noise) / np.sqrt((weights**2).sum())
    return found


def _rms_without_jumps(differences: Array) -> float:
    """NaN of too few."""
    if len(differences) < 3 * LEAST_FRAMES:
        return np.nan
    sizes = np.abs(differences)
    return float(np.sqrt(np.mean(sizes[sizes <= MOST_MEDIANS * np.median(sizes)] ** 2)))


def _response(hessians: Array, rows: Array, is_fixed: NDArray[np.bool_]) -> tuple[Array, Array]:
    """P⁺ (frames, coordinates, coordinates), and the projector onto what neither curvature nor constraints hold."""
    free = (~is_fixed).astype(np.float64)
    kept = rows * free[:, None, :]
    identity = np.eye(rows.shape[-1])
    projector = free[:, :, None] * (identity - np.linalg.pinv(kept, rcond=1e-10) @ kept) * free[:, None, :]
    curvatures, directions = np.linalg.eigh(projector @ hessians @ projector)
    is_curved = np.abs(curvatures) > LEAST_CURVATURE
    inverse = np.divide(1.0, curvatures, out=np.zeros_like(curvatures), where=is_curved)
    transposed = np.swapaxes(directions, 1, 2)
    curved = (directions * is_curved[:, None, :]) @ transposed
    return (directions * inverse[:, None, :]) @ transposed, projector - curved


@compiled_for_python
def fill_sensitivities(
    problem: Problem,
    observed: Array,
    found: Array,
    multipliers: Array,
    variance: Array,
    work: IkWorkspace,
    results: tuple[Array, Array, Array],
) -> None:
    """Fill results: Hessian of L (frames, coordinates, coordinates), rows of the constraints (frames, rows,
    coordinates), and Σ (w_m / Σ w)² σ_m² JᵀJ (frames, coordinates, coordinates).

    found (frames, coordinates), of which rows with NaN are passed over; variance (markers,) σ² of each marker [m²].
    """
    hessians, rows, noise = results
    nothing = np.zeros(len(problem.pull))
    for frame in range(len(observed)):
        q, seen = found[frame], observed[frame]
        if not (np.isfinite(q[0]) and share_weights(problem, seen, work.share)):
            continue
        evaluate_pose(problem.skeleton, q, work.pose)
        targets = Targets(seen, work.share, q, problem.pull)
        linearise(problem.skeleton, problem.markers, targets, q, work.pose, work.system)
        fill_constraint_rows(problem.skeleton, problem.constraints, q, work.pose, work.system)
        differentiate_screws(problem.skeleton, q, work.pose)
        add_curvature(problem.skeleton, problem.constraints, multipliers[frame], q, work.pose, work.system)
        hessians[frame] = work.system.hessian
        rows[frame] = work.system.rows
        for m in range(len(work.share)):
            work.share[m] = work.share[m] ** 2 * variance[m]
        targets = Targets(seen, work.share, q, nothing)
        linearise(problem.skeleton, problem.markers, targets, q, work.pose, work.system)
        noise[frame] = work.system.hessian


@compiled_for_python
def fill_information(
    problem: Problem,
    observed: Array,
    precisions: Array,
    coordinates: Array,
    work: IkWorkspace,
    results: tuple[Array, Array, Array, Array, Array],
) -> None:
    """Fill results: Σ JᵀJ/σ² (frames, coordinates, coordinates), Σ Jᵀ(p − x)/σ² (frames, coordinates), the points p
    (frames, markers, 3), and gap (frames, rows) and rows (frames, rows, coordinates) of the constraints.

    precisions (frames, markers) 1/σ² [1/m²], 0 for a marker that does not count.
    """
    information, gradient, points, gap, rows = results
    nothing = np.zeros(coordinates.shape[1])
    for frame in range(len(observed)):
        q = coordinates[frame]
        evaluate_pose(problem.skeleton, q, work.pose)
        targets = Targets(observed[frame], precisions[frame], q, nothing)
        linearise(problem.skeleton, problem.markers, targets, q, work.pose, work.system)
        evaluate_gap(problem.constraints, q, work.pose, work.system.gap)
        fill_constraint_rows(problem.skeleton, problem.constraints, q, work.pose, work.system)
        information[frame] = work.system.hessian
        gradient[frame] = work.system.gradient
        points[frame] = work.system.points
        gap[frame] = work.system.gap
        rows[frame] = work.system.rows

"""Hessian of the Lagrangian, rows of the constraints and noise matrix of every frame of a solution; compiled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from solver.compiled import compiled_for_python
from solver.inverse_kinematics.frame import IkWorkspace, Problem, share_weights
from solver.inverse_kinematics.linearise import Targets, add_curvature, fill_constraint_rows, linearise
from solver.inverse_kinematics.skeleton import differentiate_screws, evaluate_pose

Array = NDArray[np.float64]


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

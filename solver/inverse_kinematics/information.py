"""What the markers of every frame say of its coordinates, linearised about given ones; compiled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from solver.compiled import compiled_for_python
from solver.inverse_kinematics.frame import IkWorkspace, Problem
from solver.inverse_kinematics.linearise import Targets, evaluate_gap, fill_constraint_rows, linearise
from solver.inverse_kinematics.skeleton import evaluate_pose

Array = NDArray[np.float64]


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

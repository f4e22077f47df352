"""Coordinates that no control can accelerate as the motion wants: as of a pelvis without residual actuators.

Of the accelerations that the constraints allow, the columns of the mobility P, those of A are produced by muscles and
actuators. A coordinate on which an actuator would add to the range of A is out of balance.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from solver.errors import SolverCode
from solver.model import CoordinateActuator, Model, ModelError

Array = NDArray[np.float64]

OUTSIDE = (
    1e-6  # share of a column beyond the range of A; round-off is 1e-10 on legs, a missing actuator leaves above 1e-3
)
INSPECTED = 5  # frames, because a muscle may have no force or no moment arm in one


def ensure_balanced(model: Model, matrix: Array, mobility: Array, tracked: NDArray[np.bool_]) -> None:
    """Raise ModelError that names tracked coordinates out of balance, with A (frames, tracked, controls) and P (frames,
    coordinates, coordinates).

    Coordinates in which P has no column beside round-off are held by a constraint and need no actuator. Nothing is
    computed where each coordinate has an actuator, whose column of A is that of P.
    """
    if has_actuators(model, tracked):
        return
    frames = np.flatnonzero(np.isfinite(mobility).all(axis=(1, 2)) & np.isfinite(matrix).all(axis=(1, 2)))
    if not len(frames):
        return
    chosen = frames[np.unique(np.linspace(0, len(frames) - 1, min(INSPECTED, len(frames)), dtype=int))]
    is_out = np.logical_and.reduce(
        [_is_outside(matrix[frame], mobility[frame][tracked][:, tracked]) for frame in chosen]
    )
    names = np.array(model.coordinate_names)[tracked][is_out]
    if len(names):
        raise ModelError(
            f"neither muscles nor actuators of {model.name} can balance the coordinates {', '.join(names)}; add "
            "actuators for them (--actuators FILE, or [reserves] of --effort), or name them in --free-coordinates",
            SolverCode.NOT_BALANCED,
        )


def has_actuators(model: Model, tracked: NDArray[np.bool_]) -> bool:
    """Whether each of the tracked coordinates (coordinates,) has an actuator."""
    actuators = [one for one in model.actuators if isinstance(one, CoordinateActuator) and one.optimal_force]
    return {one.coordinate for one in actuators}.issuperset(np.flatnonzero(tracked).tolist())


def _is_outside(matrix: Array, mobility: Array) -> NDArray[np.bool_]:
    """(tracked,) whether the column of P is outside of the range of A."""
    columns, wanted = _normalised(matrix), _normalised(mobility)
    left, sizes, _ = np.linalg.svd(columns, full_matrices=False)
    basis = left[:, sizes > 1e-9 * sizes[:1]]
    outside: NDArray[np.bool_] = np.linalg.norm(wanted - basis @ (basis.T @ wanted), axis=0) > OUTSIDE
    return outside


def _normalised(matrix: Array) -> Array:
    """Columns of length 1, but for those that are round-off, which become zero."""
    lengths = np.linalg.norm(matrix, axis=0)
    is_kept = lengths > 1e-9 * lengths.max(initial=0.0)
    return matrix[:, :] * np.where(is_kept, 1.0 / np.where(is_kept, lengths, 1.0), 0.0)

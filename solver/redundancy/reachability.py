"""Accelerations that the controls can produce, and the residual of a solution.

With A x = b in each frame, b splits into its projection onto the column space of A, which a solution satisfies, and a
rest that no x produces. The residual of a solution is orthogonal to all columns of A, or a control could reduce it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ROUND_OFF = 1e-9  # of the frame's longest column
UNMET_LIMIT = 1e-6  # of 1 + |b|, in rad/s² or m/s²
FRAMES_AT_ONCE = 100  # bounds the memory of many scenarios


def idle_controls(matrix: Array, reaction_matrix: Array) -> NDArray[np.bool_]:
    """(frames, controls) whose columns of A (frames, rows, controls) and of the reaction's A_F are round-off.

    The actuator of a locked coordinate is one: the lock takes its force.
    """
    is_idle: NDArray[np.bool_] = np.logical_and(*(_is_round_off(part) for part in (matrix, reaction_matrix)))
    return is_idle


def is_met(matrix: Array, residual: Array, size: Array) -> NDArray[np.bool_]:
    """(scenarios, frames) whether no x reduces the residual A x − b (scenarios, frames, rows); size is |b|."""
    lengths = np.sqrt(_squares(matrix))
    shares = 1.0 / np.where(lengths > 0, lengths, 1.0)
    unmet = np.empty(residual.shape[:2])
    for start in range(0, len(matrix), FRAMES_AT_ONCE):
        part = slice(start, start + FRAMES_AT_ONCE)
        products = np.swapaxes(matrix[part], 1, 2) @ residual[:, part].transpose(1, 2, 0)
        products *= shares[part, :, None]
        unmet[:, part] = np.abs(products, out=products).max(axis=1, initial=0.0).T
    met: NDArray[np.bool_] = unmet <= UNMET_LIMIT * (1.0 + size)
    return met


def _is_round_off(matrix: Array) -> NDArray[np.bool_]:
    squares = _squares(matrix)
    is_short: NDArray[np.bool_] = squares <= ROUND_OFF**2 * squares.max(axis=1, keepdims=True, initial=0.0)
    return is_short


def _squares(matrix: Array) -> Array:
    """Squared lengths (frames, controls) of the columns, without an intermediate array."""
    squares: Array = np.einsum("fij,fij->fj", matrix, matrix)
    return squares

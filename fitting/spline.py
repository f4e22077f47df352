"""A uniform B-spline as sparse matrices: position, velocity, acceleration and jerk of an unknown motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
import scipy
from numpy.typing import NDArray

DEGREE = 4


@dataclass(frozen=True)
class Spline:
    """Degree-4 splines on [start, end] s with knots every `step` s; coefficients are (size,)."""

    start: float
    end: float
    step: float

    @property
    def size(self) -> int:
        return self._intervals + DEGREE

    def design(self, time: NDArray[np.float64]) -> tuple[scipy.sparse.csr_array, ...]:
        """Matrices (len(time), size) that map coefficients to position and its first three derivatives.

        Times outside the spline are clipped to its ends.
        """
        place = (np.clip(time, self.start, self.end) - self.start) / self.step
        interval = np.minimum(place.astype(np.intp), self._intervals - 1)
        powers = np.vander(place - interval, DEGREE + 1, increasing=True)
        columns = (interval[:, None] + np.arange(DEGREE + 1)).ravel()
        rows = np.arange(0, columns.size + 1, DEGREE + 1)
        return tuple(
            scipy.sparse.csr_array(
                ((powers @ pieces).ravel() / self.step**order, columns, rows), shape=(len(time), self.size)
            )
            for order, pieces in enumerate(_pieces())
        )

    @property
    def _intervals(self) -> int:
        return max(1, int(np.ceil((self.end - self.start) / self.step)))


@cache
def _pieces() -> tuple[NDArray[np.float64], ...]:
    """(5, 5) per derivative: coefficients of u⁰ … u⁴ of the five B-splines that are non-zero on 0 ≤ u ≤ 1."""
    bump = scipy.interpolate.BSpline.basis_element(np.arange(DEGREE + 2), extrapolate=False)
    whole = scipy.interpolate.PPoly.from_spline((bump.t, bump.c, DEGREE))
    found = []
    for order in range(4):
        piece = whole.derivative(order) if order else whole
        inside = (piece.x[:-1] >= 0) & (piece.x[:-1] < DEGREE + 1) & (np.diff(piece.x) > 0)
        powers = np.zeros((DEGREE + 1, DEGREE + 1))
        powers[: DEGREE + 1 - order] = piece.c[::-1, inside]
        found.append(powers[:, ::-1].copy())
    return tuple(found)


def linear_combination(factors: Sequence[float], designs: Sequence[scipy.sparse.csr_array]) -> scipy.sparse.csr_array:
    """The sum of factor × design; the designs are for the same times and have the same sparsity pattern."""
    first = designs[0]
    entries = np.asarray(factors) @ np.stack([design.data for design in designs])
    return scipy.sparse.csr_array((entries, first.indices, first.indptr), shape=(first.shape[0], first.shape[1]))


def regularised(matrix: scipy.sparse.csr_array) -> scipy.sparse.csr_array:
    """The matrix plus 1e-9 of its largest diagonal entry: a coefficient without samples in its support stays at 0."""
    diagonal = matrix.diagonal()
    added = matrix.copy()
    added.setdiag(diagonal + 1e-9 * diagonal.max())
    return added


def solve_banded(matrix: scipy.sparse.csr_array, right: NDArray[np.float64]) -> NDArray[np.float64]:
    """matrix⁻¹ right for a symmetric positive definite matrix with the bandwidth of the spline."""
    bands = np.zeros((DEGREE + 1, matrix.shape[0]))
    for offset in range(DEGREE + 1):
        bands[DEGREE - offset, offset:] = matrix.diagonal(offset)
    return np.asarray(scipy.linalg.solveh_banded(bands, right))

"""A uniform B-spline as sparse matrices: position, velocity, acceleration, jerk of an unknown motion."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.linalg import solveh_banded
from scipy.sparse import csr_array, diags_array

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

    def design(self, time: NDArray[np.float64]) -> tuple[csr_array, ...]:
        """Matrices (len(time), size) that take coefficients to position and its first three derivatives.

        Times outside the spline count as its ends.
        """
        inside = np.clip(time, self.start, self.end)
        knots = self.start + self.step * np.arange(-DEGREE, self._intervals + DEGREE + 1)
        bases = (
            csr_array(BSpline.design_matrix(inside, knots[order : len(knots) - order], DEGREE - order))
            for order in range(4)
        )
        return tuple(csr_array(basis @ to) for basis, to in zip(bases, _derivatives(self.size, self.step), strict=True))

    @property
    def _intervals(self) -> int:
        return max(1, int(np.ceil((self.end - self.start) / self.step)))


@cache
def _derivatives(size: int, step: float) -> tuple[csr_array, ...]:
    """Matrices from coefficients to those of the spline itself and of its first three derivatives."""
    found: list[csr_array] = [csr_array(diags_array(np.ones(size)))]
    for order in range(1, 4):
        rows = size - order
        difference: csr_array = csr_array(diags_array([-1 / step, 1 / step], offsets=[0, 1], shape=(rows, rows + 1)))
        found.append(csr_array(difference @ found[-1]))
    return tuple(found)


def grounded(matrix: csr_array) -> csr_array:
    """The matrix plus a billionth of its largest diagonal: a coefficient that no sample touches stays at 0."""
    diagonal = matrix.diagonal()
    standing = matrix.copy()
    standing.setdiag(diagonal + 1e-9 * diagonal.max())
    return standing


def solve_banded(matrix: csr_array, right: NDArray[np.float64]) -> NDArray[np.float64]:
    """matrix⁻¹ right for a symmetric positive definite matrix with the bandwidth of the spline."""
    bands = np.zeros((DEGREE + 1, matrix.shape[0]))
    for offset in range(DEGREE + 1):
        bands[DEGREE - offset, offset:] = matrix.diagonal(offset)
    return np.asarray(solveh_banded(bands, right))

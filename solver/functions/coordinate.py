"""Functions of one coordinate, as in OpenSim models: for joint axes, moving path points, coupled coordinates.

Each gives its value with its first two derivatives. All of OpenSim's are piecewise polynomials, but for the sine.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Derivatives = tuple[Array, Array, Array]
"""Value, slope and curvature of a function, each of the shape of its argument."""
LEAST_PIECE = 1e-7


@dataclass(frozen=True, eq=False)
class PiecewisePolynomial:
    """On piece i: Σ_k coefficients[i, k] (x − origins[i])ᵏ.

    breaks        (pieces − 1,) where a piece ends and the next begins; the first and the last are unbounded
    origins       (pieces,)
    coefficients  (pieces, degree + 1) the lowest power first
    """

    breaks: Array
    origins: Array
    coefficients: Array

    def derivatives(self, x: Array) -> Derivatives:
        piece = np.searchsorted(self.breaks, x, side="right")
        local, powers = x - self.origins[piece], self.coefficients[piece]
        value, slope, curvature = (np.zeros_like(local) for _ in range(3))
        for k in range(powers.shape[-1] - 1, -1, -1):
            curvature = curvature * local + 2.0 * slope
            slope = slope * local + value
            value = value * local + powers[..., k]
        return value, slope, curvature


@dataclass(frozen=True)
class Sine:
    """amplitude · sin(omega · x + phase) + offset."""

    amplitude: float
    omega: float
    phase: float
    offset: float

    def derivatives(self, x: Array) -> Derivatives:
        angle = self.omega * x + self.phase
        swing = self.amplitude * np.sin(angle)
        return swing + self.offset, self.amplitude * self.omega * np.cos(angle), -(self.omega**2) * swing


Function = PiecewisePolynomial | Sine


def polynomial(coefficients: ArrayLike) -> PiecewisePolynomial:
    """The polynomial with these coefficients (degree + 1,), the lowest power first."""
    return _pieces([], [0.0], np.atleast_2d(np.asarray(coefficients, dtype=float)))


def scaled(function: Function, factor: float) -> Function:
    """The function times a factor."""
    if isinstance(function, Sine):
        return Sine(factor * function.amplitude, function.omega, function.phase, factor * function.offset)
    return _pieces(function.breaks, function.origins, factor * function.coefficients)


def times_linear(function: PiecewisePolynomial, slope: float, offset: float) -> PiecewisePolynomial:
    """The function times slope · x + offset."""
    coefficients = np.zeros((len(function.origins), function.coefficients.shape[1] + 1))
    coefficients[:, :-1] = function.coefficients * (slope * function.origins + offset)[:, None]
    coefficients[:, 1:] += slope * function.coefficients
    return _pieces(function.breaks, function.origins, coefficients)


def piecewise_linear(x: Array, y: Array) -> PiecewisePolynomial:
    """Straight lines through points (knots,), x increasing; the first and the last line are extended."""
    return _pieces(x[1:-1], x[:-1], np.column_stack([y[:-1], np.diff(y) / np.diff(x)]))


def piecewise_constant(x: Array, y: Array) -> PiecewisePolynomial:
    """y[i] from x[i] to x[i + 1]; the first and the last value are extended."""
    return _pieces(x[1:], x, y[:, None])


def smooth_step(start: float, end: float, low: float, high: float) -> PiecewisePolynomial:
    """From `low` at `start` to `high` at `end`, 10 t³ − 15 t⁴ + 6 t⁵ between them; start may be beyond end."""
    rise = (high - low) * np.array([0.0, 0.0, 0.0, 10.0, -15.0, 6.0]) / (end - start) ** np.arange(6.0)
    coefficients = np.zeros((3, 6))
    coefficients[:, 0] = low
    coefficients[1] += rise
    coefficients[2, 0] = high
    if end < start:
        coefficients[[0, 2]] = coefficients[[2, 0]]
    return _pieces(sorted([start, end]), [start] * 3, coefficients)


def simm_spline(x: Array, y: Array) -> PiecewisePolynomial:
    """OpenSim's SimmSpline through points (knots,), x not decreasing: cubic, straight beyond its ends.

    Its third derivatives at the ends are those of the cubics through the first and through the last four points.
    OpenSim computes the coefficients of a piece that is shorter than LEAST_PIECE as if it were that long.
    """
    if len(x) == 2:
        return piecewise_linear(x, y)
    h = np.maximum(np.diff(x), LEAST_PIECE)
    slope = np.diff(y) / h
    last = len(x) - 1
    matrix, right = np.zeros((len(x), len(x))), np.zeros(len(x))  # of the curvatures over 6
    for i in range(1, last):
        matrix[i, i - 1 : i + 2] = h[i - 1], 2.0 * (h[i - 1] + h[i]), h[i]
        right[i] = slope[i] - slope[i - 1]
    matrix[0, :2], matrix[last, last - 1 :] = (-h[0], h[0]), (h[-1], -h[-1])
    if len(x) > 3:
        second = np.diff(slope) / (x[2:] - x[:-2])
        third = np.diff(second) / (x[3:] - x[:-3])
        right[0], right[last] = h[0] ** 2 * third[0], -(h[-1] ** 2) * third[-1]
    bend = np.linalg.solve(matrix, right)
    first_slope = slope - h * (bend[1:] + 2.0 * bend[:-1])
    end_slope = slope[-1] + h[-1] * (bend[-2] + 2.0 * bend[-1])
    inner = np.column_stack([y[:-1], first_slope, 3.0 * bend[:-1], np.diff(bend) / h])
    before, beyond = [y[0], first_slope[0], 0.0, 0.0], [y[-1], end_slope, 0.0, 0.0]
    return _pieces(x, [x[0], *x], np.vstack([before, inner, beyond]))


def natural_spline(x: Array, y: Array, half_order: int) -> PiecewisePolynomial:
    """The natural spline of degree 2 half_order − 1 through points (knots,): OpenSim's GCVSpline without smoothing.

    Beyond its ends it is a polynomial of degree half_order − 1.
    """
    flat = [(order, 0.0) for order in range(half_order, 2 * half_order - 1)]
    ends_are_flat: Any = (flat, flat) if flat else None
    spline: Any = scipy.interpolate.make_interp_spline(x, y, k=2 * half_order - 1, bc_type=ends_are_flat)
    inner = scipy.interpolate.PPoly.from_spline(spline)
    is_piece = np.diff(inner.x) > 0.0
    origins, coefficients = inner.x[:-1][is_piece], inner.c[::-1].T[is_piece]
    ends = np.zeros((2, coefficients.shape[1]))
    factorial = 1.0
    for order in range(half_order):
        factorial *= max(order, 1)
        ends[:, order] = spline(x[[0, -1]], nu=order) / factorial
    return _pieces(x, [x[0], *origins, x[-1]], np.vstack([ends[0], coefficients, ends[1]]))


def _pieces(breaks: ArrayLike, origins: ArrayLike, coefficients: Array) -> PiecewisePolynomial:
    values = [np.array(numbers, dtype=float) for numbers in (breaks, origins, coefficients)]
    for array in values:
        array.flags.writeable = False
    return PiecewisePolynomial(*values)

"""The mean direction of OpenSim's fan: sums over nodes against the blades themselves, in NumPy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numba import njit
from numpy.typing import NDArray

from solver.wrapping.fan import Fan, allocate_fan, fan_direction

Array = NDArray[np.float64]
STOP, SPACINGS = 1e-9, 300  # of OpenSim's search, and of its blades


@njit(error_model="numpy")  # type: ignore[untyped-decorator]
def _directions(starts: Array, inner: Array, radii: Array, fan: Fan, code: NDArray[np.int8], found: Array) -> None:
    for k in range(len(starts)):
        r, d, a = starts[k], inner[k], radii[k]
        vector = fan_direction((r[0], r[1], r[2]), (d[0], d[1], d[2]), (a[0], a[1], a[2]), fan, code)
        found[k, 0], found[k, 1], found[k, 2] = vector


def _found(starts: Array, inner: Array, radii: Array) -> Array:
    found = np.empty_like(starts)
    kernel: Any = _directions
    kernel(starts, inner, radii, allocate_fan(), np.zeros(1, np.int8), found)
    return found


def _direction_of_blades(start: Array, inner: Array, radii: Array) -> Array:
    x = start + (np.arange(1, SPACINGS - 1) / SPACINGS)[:, None] * inner
    squares, t = radii**2, np.zeros(len(x))
    for _ in range(64):
        sums = t[:, None] + squares
        product = (sums**2).prod(axis=1)
        terms = squares * x**2 / sums**2
        f = product * (1 - terms.sum(axis=1))
        slope = product * (2 * (1 / sums).sum(axis=1) * (1 - terms.sum(axis=1)) + 2 * (terms / sums).sum(axis=1))
        unfinished = np.abs(f) >= STOP
        if not unfinished.any():
            break
        t[unfinished] -= (f / slope)[unfinished]
    blades = squares * x / (t[:, None] + squares) - x
    lengths = np.linalg.norm(blades, axis=1, keepdims=True)
    total = np.divide(blades, lengths, out=np.zeros_like(blades), where=lengths > 0).sum(axis=0)
    return np.asarray(total / np.linalg.norm(total))


def _segments(count: int) -> tuple[Array, Array, Array]:
    """Segments that pierce ellipsoids, from grazing ones to those near the centre; the semi-axes average 1."""
    generator = np.random.default_rng(11)
    radii = generator.uniform(0.4, 2.0, (count, 3))
    radii *= 3 / radii.sum(axis=1, keepdims=True)
    ends = generator.normal(size=(2, count, 3))
    ends /= np.linalg.norm(ends, axis=2, keepdims=True)
    near = ends[0] + generator.uniform(0.05, 1.0, (count, 1)) * ends[1]
    ends[1] = near / np.linalg.norm(near, axis=1, keepdims=True)
    return ends[0] * radii, (ends[1] - ends[0]) * radii, radii


@pytest.mark.slow
def test_the_fan_is_the_mean_of_its_blades() -> None:
    starts, inner, radii = _segments(400)
    expected = np.array([_direction_of_blades(*segment) for segment in zip(starts, inner, radii, strict=True)])
    np.testing.assert_allclose(_found(starts, inner, radii), expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("shift", [0.0, 1e-4])
def test_the_fan_of_a_segment_through_a_plane_of_symmetry_at_a_blade(shift: float) -> None:
    radii = np.array([0.8, 1.3, 0.9])
    start = np.array([-0.5, 0.6, 0.3 + shift])
    inner = np.array([1.0, 0.1, 0.05])  # blade 150 starts at x = 0
    expected = _direction_of_blades(start, inner, radii)
    np.testing.assert_allclose(_found(*np.array([[start], [inner], [radii]]))[0], expected, rtol=0, atol=1e-10)

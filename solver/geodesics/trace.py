"""Trace a geodesic of a sphere, a cylinder or an ellipsoid from its middle to both ends, with their derivatives.

Points are in the surface's own frame [m]; the geodesic passes a point x of the surface, its middle, in the unit
direction t, n is the outward normal and b = n × t. A neighbouring geodesic is j b away: the Jacobi field j″ + K j = 0
with the Gaussian curvature K. The Jacobi scalars (a, r, a′, r′) are those at an end, with a = 1, a′ = 0, r = 0 and
r′ = 1 in the middle (do Carmo, Differential Geometry of Curves and Surfaces, sec. 5.5).
"""

from __future__ import annotations

from math import cos, sin

from solver.compiled import compiled
from solver.geodesics.series import Trace, trace_on_ellipsoid
from solver.vectors import Array, Vector, add, divide, dot, norm, scale, unit
from solver.wrapping.path_tables import ELLIPSOID, SPHERE, Codes


@compiled
def trace_geodesic(
    kind: int, size: Vector, x: Vector, t: Vector, length: float, accuracy: float, series: Array, code: Codes
) -> tuple[Trace, Trace]:
    """Both ends of the geodesic of this length, which may be negative; accuracy, series and code are those of
    series.py.
    """
    half = 0.5 * length
    if kind == ELLIPSOID:
        return trace_on_ellipsoid(size, x, t, half, accuracy, series, code)
    if kind == SPHERE:
        return _trace_on_sphere(size[0], x, t, -half), _trace_on_sphere(size[0], x, t, half)
    return _trace_on_cylinder(size[0], x, t, -half), _trace_on_cylinder(size[0], x, t, half)


@compiled
def normal_at(kind: int, size: Vector, x: Vector) -> Vector:
    if kind == ELLIPSOID:
        return unit(divide(divide(x, size), size))
    if kind == SPHERE:
        return scale(1.0 / size[0], x)
    return x[0] / size[0], x[1] / size[0], 0.0


@compiled
def normal_curvatures(kind: int, size: Vector, x: Vector, t: Vector, b: Vector) -> Vector:
    """The second fundamental form of tangents t and b at x: (t, t), (t, b), (b, b) [1/m]; n changes by (t, b) along b
    for a step along t.
    """
    if kind == ELLIPSOID:
        share, t, b = 1.0 / norm(divide(divide(x, size), size)), divide(t, size), divide(b, size)
        return share * dot(t, t), share * dot(t, b), share * dot(b, b)
    if kind == SPHERE:
        return 1.0 / size[0], 0.0, 1.0 / size[0]
    by_t, by_b = (x[0] * t[1] - x[1] * t[0]) / size[0], (x[0] * b[1] - x[1] * b[0]) / size[0]
    return by_t * by_t / size[0], by_t * by_b / size[0], by_b * by_b / size[0]


@compiled
def project_onto_surface(kind: int, size: Vector, x: Vector) -> Vector:
    """A point near the surface brought onto it."""
    if kind == ELLIPSOID:
        return scale(1.0 / norm(divide(x, size)), x)
    if kind == SPHERE:
        return scale(size[0] / norm(x), x)
    factor = size[0] / norm((x[0], x[1], 0.0))
    return factor * x[0], factor * x[1], x[2]


@compiled
def _trace_on_sphere(radius: float, x: Vector, t: Vector, length: float) -> Trace:
    c, s = cos(length / radius), sin(length / radius)
    end = add(scale(c, x), scale(s * radius, t))
    return end, add(scale(c, t), scale(-s / radius, x)), (c, radius * s, -s / radius, c)


@compiled
def _trace_on_cylinder(radius: float, x: Vector, t: Vector, length: float) -> Trace:
    around = (x[0] * t[1] - x[1] * t[0]) / radius
    c, s = cos(around * length / radius), sin(around * length / radius)
    end = c * x[0] - s * x[1], s * x[0] + c * x[1], x[2] + length * t[2]
    return end, (c * t[0] - s * t[1], s * t[0] + c * t[1], t[2]), (1.0, length, 0.0, 1.0)

"""Trace a geodesic of a sphere, a cylinder or an ellipsoid: its end, and the derivative of the end by its beginning.

Points are in the surface's own frame [m]; the geodesic leaves a point x of the surface in the unit direction t, n is
the outward normal and b = n × t. A neighbouring geodesic is j b away: the Jacobi field j″ + K j = 0 with the Gaussian
curvature K. `jacobi` are its scalars (a, r, a′, r′) at the end, with a = 1, a′ = 0, r = 0 and r′ = 1 at the beginning
(do Carmo, Differential Geometry of Curves and Surfaces, sec. 5.5).
"""

from __future__ import annotations

from math import cos, sin

from solver.compiled import compiled
from solver.geodesics.series import trace_on_ellipsoid
from solver.vectors import Array, Vector, add, divide, dot, norm, scale, unit
from solver.wrapping.path_tables import ELLIPSOID, SPHERE, Codes

JacobiScalars = tuple[float, float, float, float]


@compiled
def trace_geodesic(
    kind: int, size: Vector, x: Vector, t: Vector, length: float, accuracy: float, series: Array, code: Codes
) -> tuple[Vector, Vector, JacobiScalars]:
    """End, direction there and Jacobi scalars of the geodesic of this length, which may be negative; accuracy, series
    and code are those of series.py.
    """
    if kind == ELLIPSOID:
        return trace_on_ellipsoid(size, x, t, length, accuracy, series, code)
    if kind == SPHERE:
        return _trace_on_sphere(size[0], x, t, length)
    return _trace_on_cylinder(size[0], x, t, length)


@compiled
def normal_at(kind: int, size: Vector, x: Vector) -> Vector:
    if kind == ELLIPSOID:
        return unit(divide(divide(x, size), size))
    if kind == SPHERE:
        return unit(x)
    return unit((x[0], x[1], 0.0))


@compiled
def normal_curvature(kind: int, size: Vector, x: Vector, v: Vector, w: Vector) -> float:
    """The second fundamental form of tangents v and w at x: n changes by it along w for a step along v [1/m]."""
    if kind == ELLIPSOID:
        return dot(divide(v, size), divide(w, size)) / norm(divide(divide(x, size), size))
    if kind == SPHERE:
        return dot(v, w) / size[0]
    return (x[0] * v[1] - x[1] * v[0]) * (x[0] * w[1] - x[1] * w[0]) / (size[0] * size[0] * size[0])


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
def _trace_on_sphere(radius: float, x: Vector, t: Vector, length: float) -> tuple[Vector, Vector, JacobiScalars]:
    c, s = cos(length / radius), sin(length / radius)
    end = add(scale(c, x), scale(s * radius, t))
    return end, add(scale(c, t), scale(-s / radius, x)), (c, radius * s, -s / radius, c)


@compiled
def _trace_on_cylinder(radius: float, x: Vector, t: Vector, length: float) -> tuple[Vector, Vector, JacobiScalars]:
    around = (x[0] * t[1] - x[1] * t[0]) / radius
    c, s = cos(around * length / radius), sin(around * length / radius)
    end = c * x[0] - s * x[1], s * x[0] + c * x[1], x[2] + length * t[2]
    return end, (c * t[0] - s * t[1], s * t[0] + c * t[1], t[2]), (1.0, length, 0.0, 1.0)

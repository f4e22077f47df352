"""A straight segment and a wrap surface: the wrap action, and geometry that the surfaces share.

Points are vectors of three in the surface's own frame [m].
"""

from __future__ import annotations

from math import nan, sqrt

from solver.compiled import compiled
from solver.vectors import Vector, along, cross, dot, norm, subtract, unit

# Wrap actions, as in OpenSim. A mandatory wrap ends the search; of several others the least length increase is taken.
INSIDE_RADIUS = -1
NO_WRAP = 0
WRAPPED = 1
MANDATORY_WRAP = 2

WrapResult = tuple[int, Vector, Vector, float]
"""Wrap action, the two tangent points, length of the path between them on the surface."""

ROUND_OFF = 2e-13


@compiled
def side(value: float) -> int:
    """+1 or -1; zero counts as positive."""
    return 1 if value >= 0.0 else -1


@compiled
def pierces(direction: Vector, start: Vector, radius_squared: float) -> tuple[bool, float, float]:
    """Where start + l · direction crosses a sphere about the origin: whether both 0 < l < 1, then the larger l.

    An ellipsoid with semi-axes a is the unit sphere once both vectors are divided by a.
    """
    a = dot(direction, direction)
    b = 2.0 * dot(direction, start)
    if not 0.0 < -b < 2.0 * a:  # the middle between both
        return False, nan, nan
    c = dot(start, start) - radius_squared
    discriminant = b * b - 4.0 * a * c
    if discriminant < 0.0:
        return False, nan, nan
    root = sqrt(discriminant)
    far, near = (-b + root) / (2.0 * a), (-b - root) / (2.0 * a)
    return 0.0 < far < 1.0 and 0.0 < near < 1.0, far, near


@compiled
def nearest_on_lines(p1: Vector, p2: Vector, p3: Vector, p4: Vector) -> tuple[Vector, float, Vector]:
    """The points of lines p1 p2 and p3 p4 nearest to one another, and where the first lies (0 at p1, 1 at p2).

    NaN where the lines are parallel.
    """
    first, second = unit(subtract(p2, p1)), unit(subtract(p4, p3))
    normal = cross(first, second)
    square = dot(normal, normal)
    if not square > ROUND_OFF:
        return (nan, nan, nan), nan, (nan, nan, nan)
    offset = subtract(p3, p1)
    on_first = dot(offset, cross(second, normal)) / square
    on_second = dot(offset, cross(first, normal)) / square
    return along(p1, on_first, first), on_first / norm(subtract(p2, p1)), along(p3, on_second, second)

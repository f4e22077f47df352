"""A path over a torus, as in OpenSim 4.6 (WrapTorus): over a cylinder in place of the tube where the path is nearest.

The ring lies in the plane z = 0 of the surface's frame. OpenSim looks for the point of the path's line that is nearest
to the ring, once from either end, and ends that search early; its steps are kept, so that the lengths are the same.

The search is OpenSim's Lmdif for one unknown: Moré, "The Levenberg–Marquardt algorithm", Lecture Notes in Mathematics
630 (1978), MINPACK's LMDIF. OpenSim stops it early, so that its result depends on every step; the rules and their
constants are kept.
"""

from __future__ import annotations

from math import sqrt

from solver.compiled import compiled
from solver.vectors import ORIGIN, Vector, add, along, cross, dot, norm, scale, subtract, unit
from solver.wrapping.path_tables import Codes
from solver.wrapping.segment import MANDATORY_WRAP, NO_WRAP, WRAPPED, WrapResult, side
from solver.wrapping.sphere_and_cylinder import wrap_cylinder

LENGTH = 10_000.0  # of the cylinder [m]
X_AXIS, POSITIVE = 0, 1
TOLERANCE = 1e-4  # of the sum of squares, and of the unknown
FIRST_STEP = 0.2  # greatest first step, in the scaled unknown
DIFFERENCE = 1e-5  # for the slope
MOST_EVALUATIONS = 500
ACCEPTED, POOR, GOOD = 1e-4, 0.25, 0.75  # ratios of the actual to the predicted reduction
MOST_PARAMETERS = 10  # tried for one step


@compiled
def wrap_torus(
    start: Vector, end: Vector, tube: float, ring: float, axis: int, allowed: int, surfaces: int, code: Codes
) -> WrapResult:
    """Wrap the segment from start to end over a torus with the radii of its tube and of its ring [m].

    axis, allowed, surfaces, code  as in wrap_cylinder
    """
    is_found, center = _nearest_on_ring(start, end, ring, axis, allowed)
    if not is_found:
        return NO_WRAP, ORIGIN, ORIGIN, 0.0
    x = unit(scale(-1.0, center))
    y = (0.0, 0.0, -1.0)
    z = cross(x, y)
    p1, p2 = subtract(start, center), subtract(end, center)
    p1, p2 = (dot(x, p1), dot(y, p1), dot(z, p1)), (dot(x, p2), dot(y, p2), dot(z, p2))
    action, r1, r2, length = wrap_cylinder(p1, p2, tube, LENGTH, X_AXIS, POSITIVE, surfaces, code)
    if action not in (WRAPPED, MANDATORY_WRAP):
        return NO_WRAP, ORIGIN, ORIGIN, 0.0
    return WRAPPED, _from_cylinder(center, x, y, z, r1), _from_cylinder(center, x, y, z, r2), length


@compiled
def _from_cylinder(center: Vector, x: Vector, y: Vector, z: Vector, point: Vector) -> Vector:
    return add(center, along(along(scale(point[0], x), point[1], y), point[2], z))


@compiled
def _nearest_on_ring(start: Vector, end: Vector, ring: float, axis: int, allowed: int) -> tuple[bool, Vector]:
    """The point of the ring nearest to the line, of the two searches from either end, on the allowed side if any."""
    one, other = _search(start, end, ring), _search(end, start, ring)
    takes_one = _distance(one, ring) < _distance(other, ring)
    if allowed != 0:
        one_is_on, other_is_on = side(one[axis]) == allowed, side(other[axis]) == allowed
        if not (one_is_on or other_is_on):
            return False, ORIGIN
        if one_is_on != other_is_on:
            takes_one = one_is_on
    nearest = one if takes_one else other
    size = sqrt(nearest[0] * nearest[0] + nearest[1] * nearest[1])
    return True, (nearest[0] * ring / size, nearest[1] * ring / size, 0.0)


@compiled
def _distance(point: Vector, ring: float) -> float:
    x, y, z = point
    return sqrt(x * x + y * y + z * z + ring * ring - 2.0 * ring * sqrt(x * x + y * y))


@compiled
def _search(start: Vector, end: Vector, ring: float) -> Vector:
    """The point of the line, from `start` on, where the derivative of its squared distance from the ring is least.

    MINPACK's LMDIF for one unknown.
    """
    direction = subtract(end, start)
    direction = scale(1.0 / norm(direction), direction)
    u, extent, parameter, weight, bound, is_first = 0.0, 0.0, 0.0, 0.0, FIRST_STEP, True
    value = _slope(start, direction, ring, u)
    evaluations = 1
    while evaluations < MOST_EVALUATIONS and value != 0.0:
        slope = (_slope(start, direction, ring, u + DIFFERENCE) - value) / DIFFERENCE
        if slope == 0.0:
            break
        weight = max(weight, abs(slope))
        is_accepted = False
        while not is_accepted:
            step, parameter = limited_step(slope, value, weight, bound, parameter)
            size = abs(weight * step)
            if is_first:
                bound = min(bound, size)
            trial = _slope(start, direction, ring, u + step)
            evaluations += 1
            actual = 1.0 - (trial / value) ** 2 if 0.1 * abs(trial) < abs(value) else -1.0
            linear, damped = (slope * step / value) ** 2, parameter * (size / value) ** 2
            predicted = linear + 2.0 * damped
            ratio = actual / predicted if predicted != 0.0 else 0.0
            if ratio <= POOR:
                shrink = _shrinkage(actual, linear + damped, trial / value)
                bound, parameter = shrink * min(bound, 10.0 * size), parameter / shrink
            elif parameter == 0.0 or ratio >= GOOD:
                bound, parameter = 2.0 * size, 0.5 * parameter
            is_accepted = ratio >= ACCEPTED
            if is_accepted:
                u, extent, value, is_first = u + step, abs(weight * (u + step)), trial, False
            has_converged = abs(actual) <= TOLERANCE and predicted <= TOLERANCE and 0.5 * ratio <= 1.0
            if has_converged or bound <= TOLERANCE * extent or evaluations >= MOST_EVALUATIONS:
                return along(start, u, direction)
    return along(start, u, direction)


@compiled
def _shrinkage(actual: float, slope: float, growth: float) -> float:
    """Factor of the step bound after a poor step; growth is the new value over the old one."""
    shrink = 0.5 if actual >= 0.0 else 0.5 * slope / (slope - 0.5 * actual)
    return 0.1 if 0.1 * abs(growth) >= 1.0 or shrink < 0.1 else shrink


@compiled
def _slope(start: Vector, direction: Vector, ring: float, u: float) -> float:
    """Derivative by u of the squared distance between the ring and start + u · direction."""
    x, y, z = start
    nx, ny, nz = direction
    c2 = 2.0 * (x * nx + y * ny + z * nz)
    c3 = x * nx + y * ny
    c4 = nx * nx + ny * ny
    c5 = x * x + y * y
    return c2 + 2.0 * u - 2.0 * ring * (2.0 * c4 * u + 2.0 * c3) / sqrt(u * u * c4 + 2.0 * c3 * u + c5)


@compiled
def limited_step(slope: float, value: float, scale: float, bound: float, parameter: float) -> tuple[float, float]:
    """Step p of the linearised problem with |scale · p| about `bound` at most, and its damping parameter (LMPAR)."""
    step = value / slope if slope != 0.0 else 0.0
    size = abs(scale * step)
    excess = size - bound
    if excess <= 0.1 * bound:
        return -step, 0.0
    lowest = 0.0
    if slope != 0.0:
        change = abs(scale * (scale * step / size) / slope)
        lowest = excess / bound / change / change
    gradient = abs(slope * value / scale)
    highest = gradient / bound
    parameter = min(max(parameter, lowest), highest)
    if parameter == 0.0:
        parameter = gradient / size
    for attempt in range(MOST_PARAMETERS):
        if parameter == 0.0:
            parameter = 0.001 * highest
        damping = sqrt(parameter) * scale
        stiffness = sqrt(slope * slope + damping * damping)
        step = slope * value / (stiffness * stiffness)
        size = abs(scale * step)
        before, excess = excess, size - bound
        if abs(excess) <= 0.1 * bound or (lowest == 0.0 and excess <= before < 0.0) or attempt == MOST_PARAMETERS - 1:
            break
        change = abs(scale * (scale * step / size) / stiffness)
        correction = excess / bound / change / change
        if excess > 0.0:
            lowest = max(lowest, parameter)
        else:
            highest = min(highest, parameter)
        parameter = max(lowest, parameter + correction)
    return -step, parameter

"""What a Millard muscle with a rigid tendon can pull: active force per activation, and passive force.

Millard, Uchida, Seth, Delp, J. Biomech. Eng. 135(2):021005 (2013), with the curves of OpenSim's
Millard2012EquilibriumMuscle: chains of quintic Bézier corners (SmoothSegmentedFunctionFactory's shapes).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.model import Model
from solver.vectors import compiled

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class MuscleForces:
    """Forces along each muscle's tendon, all (frames, muscles): tension = active · activation + passive [N].

    The factors they are made of, without dimension: active = F_max · length_factor · velocity_factor · cos(pennation),
    passive = F_max · passive_factor · cos(pennation).
    """

    active: Array
    passive: Array
    length_factor: Array
    velocity_factor: Array
    passive_factor: Array
    cos_pennation: Array


def muscle_forces(model: Model, lengths: Array, lengthening_speeds: Array) -> MuscleForces:
    """Forces at path lengths [m] and lengthening speeds [m/s], both (frames, muscles)."""
    optimal, slack, pennation, strength, fastest = _parameters(model)
    height = optimal * np.sin(pennation)
    shortest_pennate = height / np.sin(_STEEPEST_PENNATION)
    along = np.maximum(lengths - slack, shortest_pennate * np.cos(_STEEPEST_PENNATION))
    shortest = np.maximum(_SHORTEST_ACTIVE * optimal, shortest_pennate)
    fiber = np.maximum(np.sqrt(height**2 + along**2), shortest)
    angle = np.minimum(np.arcsin(np.minimum(height / fiber, 1.0)), _STEEPEST_PENNATION)
    cos_pennation = np.cos(angle)
    fiber_speed = lengthening_speeds * cos_pennation
    is_slack = lengths - fiber * cos_pennation < slack - 1e-14
    is_held = (fiber <= shortest) & (fiber_speed <= 0.0)
    velocity_factor = np.where(is_slack | is_held, 1.0, force_velocity(fiber_speed / (fastest * optimal)))
    length_factor, passive_factor = active_force_length(fiber / optimal), passive_force_length(fiber / optimal)
    return MuscleForces(
        active=strength * length_factor * velocity_factor * cos_pennation,
        passive=strength * passive_factor * cos_pennation,
        length_factor=length_factor,
        velocity_factor=velocity_factor,
        passive_factor=passive_factor,
        cos_pennation=cos_pennation,
    )


def active_force_length(length: Array) -> Array:
    """Active force over its greatest, at fibre length over optimal; any shape."""
    return _evaluate(_ACTIVE_FORCE_LENGTH, np.ascontiguousarray(length))


def force_velocity(speed: Array) -> Array:
    """Force over the isometric one, at fibre speed over the fastest, lengthening positive; any shape."""
    return _evaluate(_FORCE_VELOCITY, np.ascontiguousarray(speed))


def passive_force_length(length: Array) -> Array:
    """Passive force over the greatest active one, at fibre length over optimal; any shape."""
    return _evaluate(_PASSIVE_FORCE_LENGTH, np.ascontiguousarray(length))


_STEEPEST_PENNATION = np.arccos(0.1)
_SHORTEST_ACTIVE = 0.4441


def _parameters(model: Model) -> tuple[Array, Array, Array, Array, Array]:
    muscles = model.muscles
    return (
        np.array([muscle.optimal_fiber_length for muscle in muscles]),
        np.array([muscle.tendon_slack_length for muscle in muscles]),
        np.array([muscle.pennation_at_optimal for muscle in muscles]),
        np.array([muscle.max_isometric_force for muscle in muscles]),
        np.array([muscle.max_contraction_velocity for muscle in muscles]),
    )


_Knot = tuple[float, float, float]


def _chain(*knots: _Knot, curviness: tuple[float, ...]) -> Array:
    """(corners, 2, 6) control points (x, y) of the corners between knots (x, y, slope)."""
    return np.array([_corner(a, b, c) for a, b, c in zip(knots[:-1], knots[1:], curviness, strict=True)])


def _corner(start: _Knot, end: _Knot, curviness: float) -> Array:
    """Six control points on the two end tangents; the inner ones are doubled, near where the tangents meet."""
    (x0, y0, slope0), (x1, y1, slope1) = start, end
    x = (y1 - y0 - x1 * slope1 + x0 * slope0) / (slope0 - slope1)
    first, last, meet = np.array([x0, y0]), np.array([x1, y1]), np.array([x, (x - x1) * slope1 + y1])
    reach = 0.1 + 0.8 * curviness
    inner_first, inner_last = first + reach * (meet - first), last + reach * (meet - last)
    return np.column_stack([first, inner_first, inner_first, inner_last, inner_last, last])


def _active_force_length_curve() -> Array:
    shortest, shallow, optimal, longest, slope, plateau = _SHORTEST_ACTIVE, 0.73, 1.0, 1.8123, 0.8616, 0.05
    shoulder = optimal - plateau
    height = 1.0 - slope * (shoulder - shallow)
    return _chain(
        (shortest, 0.0, 0.0),
        ((shortest + shallow) / 2, height / 2, 1.25 * height / (shallow - shortest)),
        ((shallow + shoulder) / 2, (height + 1.0) / 2, slope),
        (optimal, 1.0, 0.0),
        ((optimal + plateau + longest) / 2, 0.5, -1.0 / (longest - optimal - 2 * plateau)),
        (longest, 0.0, 0.0),
        curviness=(1.0,) * 5,
    )


def _force_velocity_curve() -> Array:
    slow_slope, fast_slope, isometric_slope, strongest = 0.25, 0.15, 5.0, 1.4
    return _chain(
        (-1.0, 0.0, 0.0),
        (-0.9, 0.5 * slow_slope * 0.1, slow_slope),
        (0.0, 1.0, isometric_slope),
        (0.9, strongest - 0.5 * fast_slope * 0.1, fast_slope),
        (1.0, strongest, 0.0),
        curviness=(0.6, 0.6, 0.9, 0.9),
    )


def _passive_force_length_curve() -> Array:
    strain, low_slope = 0.7, 0.2
    slope = 2.0 / strain
    toe = min(0.1 / slope, 0.1 * strain)
    return _chain(
        (1.0, 0.0, 0.0), (1.0 + toe, low_slope * toe / 2, low_slope), (1.0 + strain, 1.0, slope), curviness=(0.75, 0.75)
    )


_ACTIVE_FORCE_LENGTH = _active_force_length_curve()
_FORCE_VELOCITY = _force_velocity_curve()
_PASSIVE_FORCE_LENGTH = _passive_force_length_curve()


@compiled
def _evaluate(corners: Array, abscissae: Array) -> Array:
    values = np.empty_like(abscissae)
    for place, x in np.ndenumerate(abscissae):
        values[place] = _ordinate(corners, x)
    return values


@compiled
def _ordinate(corners: Array, x: float) -> float:
    """y of the chain at x; beyond its ends a straight line with the end's slope."""
    first, last = corners[0], corners[-1]
    if x < first[0, 0]:
        return float(first[1, 0] + (x - first[0, 0]) * (first[1, 1] - first[1, 0]) / (first[0, 1] - first[0, 0]))
    if x >= last[0, 5]:
        return float(last[1, 5] + (x - last[0, 5]) * (last[1, 5] - last[1, 4]) / (last[0, 5] - last[0, 4]))
    index = 0
    while x >= corners[index, 0, 5]:
        index += 1
    return _bezier(corners[index, 1], _parameter(corners[index, 0], x))


@compiled
def _parameter(points: Array, x: float) -> float:
    """The s in [0, 1] with X(s) = x for increasing X: Newton's steps, halving where they leave the bracket."""
    low, high = 0.0, 1.0
    s = float((x - points[0]) / (points[5] - points[0]))
    for _ in range(60):
        error = _bezier(points, s) - x
        if error > 0.0:
            high = s
        else:
            low = s
        step = error / _bezier_slope(points, s)
        following = s - step if low <= s - step <= high else 0.5 * (low + high)
        if abs(following - s) <= 1e-16:
            break
        s = following
    return s


@compiled
def _bezier(p: Array, s: float) -> float:
    t = 1.0 - s
    return float(
        t**5 * p[0]
        + 5.0 * s * t**4 * p[1]
        + 10.0 * s**2 * t**3 * p[2]
        + 10.0 * s**3 * t**2 * p[3]
        + 5.0 * s**4 * t * p[4]
        + s**5 * p[5]
    )


@compiled
def _bezier_slope(p: Array, s: float) -> float:
    t = 1.0 - s
    return 5.0 * float(
        t**4 * (p[1] - p[0])
        + 4.0 * s * t**3 * (p[2] - p[1])
        + 6.0 * s**2 * t**2 * (p[3] - p[2])
        + 4.0 * s**3 * t * (p[4] - p[3])
        + s**4 * (p[5] - p[4])
    )

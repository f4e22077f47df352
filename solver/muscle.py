"""What a Millard muscle with a rigid tendon can pull: active force per activation, and passive force.

Millard, Uchida, Seth, Delp, J. Biomech. Eng. 135(2):021005 (2013), with the curves of OpenSim's
Millard2012EquilibriumMuscle: chains of quintic Bézier corners (SmoothSegmentedFunctionFactory's shapes).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from solver.model import Model

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
    return _evaluate(_active_force_length_curve(), length)


def force_velocity(speed: Array) -> Array:
    """Force over the isometric one, at fibre speed over the fastest, lengthening positive; any shape."""
    return _evaluate(_force_velocity_curve(), speed)


def passive_force_length(length: Array) -> Array:
    """Passive force over the greatest active one, at fibre length over optimal; any shape."""
    return _evaluate(_passive_force_length_curve(), length)


_STEEPEST_PENNATION = np.arccos(0.1)
_SHORTEST_ACTIVE = 0.4441
_NEWTON_STEPS = 2  # from a node 1/512 away; each squares the error


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


@dataclass(frozen=True, eq=False)
class _Curve:
    """A chain of Bézier corners (X(s), Y(s)), s in [0, 1], with X increasing.

    corners            (corners, 2, 6) control points (x, y)
    nodes_x, nodes_s   points to start the search for s from: X and number of the corner + s
    """

    corners: Array
    nodes_x: Array
    nodes_s: Array


def _curve(*knots: _Knot, curviness: tuple[float, ...]) -> _Curve:
    """The chain of corners between knots (x, y, slope)."""
    corners = np.array([_corner(a, b, c) for a, b, c in zip(knots[:-1], knots[1:], curviness, strict=True)])
    s = np.linspace(0.0, len(corners), 512 * len(corners) + 1)
    index = np.minimum(s.astype(int), len(corners) - 1)
    return _Curve(corners, _bezier(corners[index, 0].T, s - index), s)


def _corner(start: _Knot, end: _Knot, curviness: float) -> Array:
    """Six control points on the two end tangents; the inner ones are doubled, near where the tangents meet."""
    (x0, y0, slope0), (x1, y1, slope1) = start, end
    x = (y1 - y0 - x1 * slope1 + x0 * slope0) / (slope0 - slope1)
    first, last, meet = np.array([x0, y0]), np.array([x1, y1]), np.array([x, (x - x1) * slope1 + y1])
    reach = 0.1 + 0.8 * curviness
    inner_first, inner_last = first + reach * (meet - first), last + reach * (meet - last)
    return np.column_stack([first, inner_first, inner_first, inner_last, inner_last, last])


@cache
def _active_force_length_curve() -> _Curve:
    shortest, shallow, optimal, longest, slope, plateau = _SHORTEST_ACTIVE, 0.73, 1.0, 1.8123, 0.8616, 0.05
    shoulder = optimal - plateau
    height = 1.0 - slope * (shoulder - shallow)
    return _curve(
        (shortest, 0.0, 0.0),
        ((shortest + shallow) / 2, height / 2, 1.25 * height / (shallow - shortest)),
        ((shallow + shoulder) / 2, (height + 1.0) / 2, slope),
        (optimal, 1.0, 0.0),
        ((optimal + plateau + longest) / 2, 0.5, -1.0 / (longest - optimal - 2 * plateau)),
        (longest, 0.0, 0.0),
        curviness=(1.0,) * 5,
    )


@cache
def _force_velocity_curve() -> _Curve:
    slow_slope, fast_slope, isometric_slope, strongest = 0.25, 0.15, 5.0, 1.4
    return _curve(
        (-1.0, 0.0, 0.0),
        (-0.9, 0.5 * slow_slope * 0.1, slow_slope),
        (0.0, 1.0, isometric_slope),
        (0.9, strongest - 0.5 * fast_slope * 0.1, fast_slope),
        (1.0, strongest, 0.0),
        curviness=(0.6, 0.6, 0.9, 0.9),
    )


@cache
def _passive_force_length_curve() -> _Curve:
    strain, low_slope = 0.7, 0.2
    slope = 2.0 / strain
    toe = min(0.1 / slope, 0.1 * strain)
    return _curve(
        (1.0, 0.0, 0.0), (1.0 + toe, low_slope * toe / 2, low_slope), (1.0 + strain, 1.0, slope), curviness=(0.75, 0.75)
    )


def _evaluate(curve: _Curve, x: Array) -> Array:
    """y of the curve at x; beyond its ends a straight line with the end's slope."""
    corners = curve.corners
    first, last = corners[0, :, :2], corners[-1, :, 4:]
    inside = np.clip(x, first[0, 0], last[0, 1])
    index = np.searchsorted(corners[1:, 0, 0], inside, side="right")
    points_x, points_y = np.moveaxis(corners, 0, -1)[..., index]
    s = np.interp(inside, curve.nodes_x, curve.nodes_s) - index
    for _ in range(_NEWTON_STEPS):
        s -= (_bezier(points_x, s) - inside) / _bezier_slope(points_x, s)
    before, beyond = np.minimum(x - first[0, 0], 0.0), np.maximum(x - last[0, 1], 0.0)
    (dx0, dy0), (dx1, dy1) = np.diff(first)[:, 0], np.diff(last)[:, 0]
    value: Array = _bezier(points_y, s) + before * (dy0 / dx0) + beyond * (dy1 / dx1)
    return value


def _bezier(p: Array, s: Array) -> Array:
    """Σ (5 over k) sᵏ (1 − s)⁵⁻ᵏ p_k, p (6, …)."""
    t = 1.0 - s
    ss, tt = s * s, t * t
    value: Array = tt * t * (tt * p[0] + 5.0 * s * t * p[1] + 10.0 * ss * p[2])
    value += ss * s * (10.0 * tt * p[3] + 5.0 * s * t * p[4] + ss * p[5])
    return value


def _bezier_slope(p: Array, s: Array) -> Array:
    t = 1.0 - s
    d = 5.0 * np.diff(p, axis=0)
    slope: Array = t * t * (t * t * d[0] + 4.0 * s * t * d[1] + 6.0 * s * s * d[2])
    slope += s * s * s * (4.0 * t * d[3] + s * d[4])
    return slope

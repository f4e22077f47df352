"""Scale the forces and actuators of a model with its bodies, as OpenSim's ScaleTool does it (OpenSim 4.6).

Paths and frames are scaled with their bodies, and the resting length of a path grows with the path in the default
posture. Stiffness, damping and optimal forces stay. OpenSim leaves points at which forces act, and contact geometry,
where they were; they are scaled too if `scales_points`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar, get_args

import numpy as np
from numpy.typing import NDArray

from solver.errors import SolverCode
from solver.forces.actuators import PathActuator, PointActuator, PointToPointActuator, TorqueActuator
from solver.forces.bushing import Bushing, ExpressionBushing, FunctionBushing
from solver.forces.contact import ContactSurface, HuntCrossleyContact
from solver.forces.path_force import BlankevoortLigament, Ligament, PathExpression, PathSpring
from solver.forces.point_force import ConstantForce, PointToPointExpression, PointToPointSpring
from solver.forces.smooth_contact import SmoothContact
from solver.functions.coordinate import scaled
from solver.model import (
    Actuator,
    AnyPathPoint,
    CoordinateActuator,
    ModelError,
    MovingPathPoint,
    PassiveForce,
    Path,
    Placement,
)

Array = NDArray[np.float64]
Factors = Array
"""(bodies, 3), 1 where a body keeps its size along an axis."""

ALONG_PATH = (PathSpring, PathExpression, Ligament, BlankevoortLigament)
_BUSHINGS = (Bushing, FunctionBushing, ExpressionBushing)
_AtPoints = PointToPointSpring | PointToPointExpression | ConstantForce | HuntCrossleyContact | SmoothContact
_AT_POINTS = get_args(_AtPoints)


def scaled_force(force: PassiveForce, factors: Factors, *, scales_points: bool) -> PassiveForce:
    """Its resting length is that of before, see with_grown_length. Raises ModelError for a force of another class."""
    if isinstance(force, ALONG_PATH):
        return replace(force, path=scaled_path(force.path, factors))
    if isinstance(force, _BUSHINGS):
        frame_1 = moved(force.frame_1, factors[force.body_1])
        return replace(force, frame_1=frame_1, frame_2=moved(force.frame_2, factors[force.body_2]))
    if not isinstance(force, _AT_POINTS):
        raise ModelError(f"{force.name} has no rule for scaling; remove it from the model", SolverCode.UNSUPPORTED)
    return _with_points(force, factors) if scales_points else force


def with_grown_length(force: PassiveForce, ratio: float) -> PassiveForce:
    """A force along a path that became longer by the ratio; any other force as it is."""
    if isinstance(force, ALONG_PATH):
        return replace(force, resting_length=force.resting_length * ratio)
    return force


def scaled_actuator(actuator: Actuator, factors: Factors, *, scales_points: bool) -> Actuator:
    """Raises ModelError for an actuator of another class."""
    if isinstance(actuator, CoordinateActuator | TorqueActuator):
        return actuator
    if isinstance(actuator, PathActuator):
        return replace(actuator, path=scaled_path(actuator.path, factors))
    if isinstance(actuator, PointActuator):
        keeps = actuator.is_point_in_ground or not scales_points
        return actuator if keeps else replace(actuator, point=actuator.point * factors[actuator.body])
    if isinstance(actuator, PointToPointActuator):
        if actuator.are_points_in_ground or not scales_points:
            return actuator
        point_a, point_b = actuator.point_a * factors[actuator.body_a], actuator.point_b * factors[actuator.body_b]
        return replace(actuator, point_a=point_a, point_b=point_b)
    raise ModelError(f"{actuator.name} has no rule for scaling; remove it from the model", SolverCode.UNSUPPORTED)


def _with_points(force: _AtPoints, factors: Factors) -> PassiveForce:
    if isinstance(force, HuntCrossleyContact):
        return replace(force, surfaces=tuple(_surface(surface, factors) for surface in force.surfaces))
    if isinstance(force, SmoothContact):
        sphere = factors[force.sphere_body]
        plane = moved(force.plane, factors[force.plane_body])
        return replace(force, center=force.center * sphere, radius=force.radius * float(sphere.mean()), plane=plane)
    if isinstance(force, ConstantForce):
        return force if force.is_point_in_ground else replace(force, point=force.point * factors[force.body])
    point_1, point_2 = force.point_1 * factors[force.body_1], force.point_2 * factors[force.body_2]
    return replace(force, point_1=point_1, point_2=point_2)


def scaled_path(path: Path, factors: Factors) -> Path:
    return replace(path, points=tuple(_point(point, factors[point.body]) for point in path.points))


def moved(placement: Placement, s: Array) -> Placement:
    """A frame of a body that is scaled by s (3,)."""
    return Placement(placement.rotation, placement.translation * s)


Fixed = TypeVar("Fixed", bound=AnyPathPoint)


def _point(point: Fixed, s: Array) -> Fixed:
    if not isinstance(point, MovingPathPoint):
        return replace(point, location=point.location * s)
    x, y, z = (scaled(function, float(factor)) for function, factor in zip(point.functions, s, strict=True))
    return replace(point, placement=moved(point.placement, s), functions=(x, y, z))


def _surface(surface: ContactSurface, factors: Factors) -> ContactSurface:
    s = factors[surface.body]
    radius = None if surface.radius is None else surface.radius * float(s.mean())
    return replace(surface, placement=moved(surface.placement, s), radius=radius)

"""Scale a model: every body along its own axes, as OpenSim's ScaleTool does it (OpenSim 4.6).

Factors belong to bodies; what is fixed to a body is scaled with it, component by component. Muscles keep their maximum
isometric force and pennation; fibres and tendons grow with the length of the path in the default posture.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from solver.constraint import ConstantDistanceConstraint, PointOnLineConstraint, WeldConstraint
from solver.errors import SolverCode
from solver.functions.coordinate import PiecewisePolynomial, scaled
from solver.inverse_kinematics.solve import assemble
from solver.model import (
    AxisMotion,
    Body,
    Constraint,
    CoordinateCoupler,
    Joint,
    Model,
    ModelError,
    Muscle,
    PointConstraint,
    ScapulothoracicMotion,
    WrapSurface,
)
from solver.multibody.postures import postures
from solver.paths import evaluate_paths
from solver.scaling_forces import ALONG_PATH, moved, scaled_actuator, scaled_force, scaled_path, with_grown_length

Array = NDArray[np.float64]
Factors = Array
"""(bodies, 3), 1 where a body keeps its size along an axis."""

ALIKE = 1e-12  # of factors that count as equal: then inertia is scaled exactly


@dataclass(frozen=True)
class Scaling:
    """Scale factors of a model, and the rules for its masses.

    factors         (3,) by the name of a body, along its own axes; a body without factors keeps its size
    mass            of the whole model afterwards [kg]; None leaves what follows from the factors. Of a model of thorax
                    and one arm it is no subject's mass
    keeps_masses    masses keep their ratios; otherwise each body's grows with its volume
    scales_joined_points  points that a constraint joins or at which a force acts, and contact geometry, are scaled with
                    their bodies. OpenSim leaves them (False), so that the shoulder girdle moves in the assembly
    """

    factors: Mapping[str, ArrayLike] = field(default_factory=dict)
    mass: float | None = None
    keeps_masses: bool = False
    scales_joined_points: bool = True


def scale_model(model: Model, scaling: Scaling) -> Model:
    """The scaled model. Raises ModelError for factors that are not above zero, or of a body it does not have."""
    factors, also_points = _factors(model, scaling), scaling.scales_joined_points
    scaled_model = replace(
        scale_skeleton(model, scaling),
        bodies=_masses_to([_body(b, s, scaling) for b, s in zip(model.bodies, factors, strict=True)], scaling.mass),
        surfaces=tuple(_surface(surface, factors[surface.body]) for surface in model.surfaces),
        muscles=tuple(replace(muscle, path=scaled_path(muscle.path, factors)) for muscle in model.muscles),
        forces=tuple(scaled_force(force, factors, scales_points=also_points) for force in model.forces),
        actuators=tuple(scaled_actuator(one, factors, scales_points=also_points) for one in model.actuators),
    )
    ratios = iter(_default_lengths(scaled_model) / _default_lengths(model))
    muscles = [_grown(muscle, next(ratios)) for muscle in scaled_model.muscles]
    forces = [
        with_grown_length(force, float(next(ratios))) if isinstance(force, ALONG_PATH) else force
        for force in scaled_model.forces
    ]
    return replace(scaled_model, muscles=tuple(muscles), forces=tuple(forces))


def scale_skeleton(model: Model, scaling: Scaling) -> Model:
    """The model with joints, markers and constraints scaled, which is all that inverse kinematics reads; the rest is as
    it was. Raises ModelError as scale_model does.
    """
    factors = _factors(model, scaling)
    return replace(
        model,
        joints=tuple(_joint(joint, factors) for joint in model.joints),
        markers=tuple(replace(marker, location=marker.location * factors[marker.body]) for marker in model.markers),
        constraints=tuple(_constraint(model, constraint, factors, scaling) for constraint in model.constraints),
    )


def _factors(model: Model, scaling: Scaling) -> Factors:
    factors = np.ones((len(model.bodies), 3))
    for name, given in scaling.factors.items():
        one = np.asarray(given, dtype=np.float64)
        if one.shape != (3,) or not (np.isfinite(one).all() and one.min() > 0):
            raise ModelError(
                f"the scale factors of {name} should be three numbers above zero and are {given!r}",
                SolverCode.NOT_POSITIVE,
            )
        factors[model.body_index(name)] = one
    if scaling.mass is not None and not (np.isfinite(scaling.mass) and scaling.mass > 0):
        raise ModelError(
            f"the scaled model's mass should be above zero [kg] and is {scaling.mass}", SolverCode.NOT_POSITIVE
        )
    return factors


def _body(body: Body, s: Array, scaling: Scaling) -> Body:
    mass = body.mass if scaling.keeps_masses else body.mass * float(np.prod(s))
    return Body(body.name, mass, body.mass_center * s, _inertia(body, mass, s))


def _inertia(body: Body, mass: float, s: Array) -> Array:
    """Of equal factors exactly; otherwise as of a cylinder along the axis about which the inertia is least."""
    if body.mass == 0.0:
        return np.zeros((3, 3))
    ratio = mass / body.mass
    if np.ptp(s) < ALIKE:
        alike: Array = body.inertia * (ratio * s[0] ** 2)
        return alike
    moments = np.diag(body.inertia)
    axis = int(np.argmin(moments))
    other = 1 if axis == 0 else 0
    radius_squared = max(0.0, 2.0 * moments[axis] / body.mass)
    length_squared = max(0.0, 12.0 * (moments[other] / body.mass - 0.25 * radius_squared))
    length_squared *= s[axis] ** 2
    radius_squared *= float(np.prod(np.delete(s, axis)))
    inertia: Array = body.inertia * np.outer(s, s) * ratio
    np.fill_diagonal(inertia, mass * (3.0 * radius_squared + length_squared) / 12.0)
    inertia[axis, axis] = 0.5 * mass * radius_squared
    return inertia


def _masses_to(bodies: list[Body], total: float | None) -> tuple[Body, ...]:
    """All masses and inertias times one number."""
    if total is None:
        return tuple(bodies)
    ratio = total / sum(body.mass for body in bodies)
    return tuple(Body(body.name, ratio * body.mass, body.mass_center, ratio * body.inertia) for body in bodies)


def _joint(joint: Joint, factors: Factors) -> Joint:
    parent, child = factors[joint.parent], factors[joint.child]
    motion = joint.motion
    if isinstance(motion, ScapulothoracicMotion):
        motion = replace(motion, radii=motion.radii * parent, winging_origin=motion.winging_origin * child[:2])
    elif isinstance(motion, AxisMotion):
        functions = tuple(
            function if index < 3 or _is_plain(function) else scaled(function, float(np.abs(axis) @ parent))
            for index, (axis, function) in enumerate(zip(motion.axes, motion.functions, strict=True))
        )
        motion = replace(motion, functions=functions)
    return replace(
        joint,
        frame_in_parent=moved(joint.frame_in_parent, parent),
        frame_in_child=moved(joint.frame_in_child, child),
        motion=motion,
    )


def _is_plain(function: object) -> bool:
    """Whether the axis moves by the coordinate itself: a degree of freedom, which has no size."""
    if not isinstance(function, PiecewisePolynomial):
        return False
    value, slope, bend = function.derivatives(np.array([-1.0, 0.0, 1.0]))
    return bool(np.array_equal(value, [-1.0, 0.0, 1.0]) and np.all(slope == 1.0) and not bend.any())


def _surface(surface: WrapSurface, s: Array) -> WrapSurface:
    columns = np.linalg.norm(s[:, None] * surface.placement.rotation, axis=0)
    if surface.kind == "sphere":
        grown = np.full(3, s.mean())
    elif surface.kind == "cylinder":
        across = columns[:2].mean()
        grown = np.array([across, across, columns[2]])
    elif surface.kind == "torus":
        grown = np.full(3, columns[:2].mean())
    else:
        grown = columns
    return replace(surface, placement=moved(surface.placement, s), dimensions=surface.dimensions * grown)


def _constraint(model: Model, constraint: Constraint, factors: Factors, scaling: Scaling) -> Constraint:
    """Frames of a weld are scaled as OpenSim's are. Distances and lines have no rule for scaling."""
    if isinstance(constraint, ConstantDistanceConstraint | PointOnLineConstraint):
        sentence = f"{constraint.name} keeps a distance or a line, which the solver cannot scale; remove the constraint"
        raise ModelError(sentence, SolverCode.UNSUPPORTED)
    if isinstance(constraint, CoordinateCoupler):
        return _coupler(model, constraint, factors)
    if not isinstance(constraint, PointConstraint | WeldConstraint):
        return constraint
    if isinstance(constraint, PointConstraint) and not scaling.scales_joined_points:
        return constraint
    return replace(
        constraint,
        location_1=constraint.location_1 * factors[constraint.body_1],
        location_2=constraint.location_2 * factors[constraint.body_2],
    )


def _coupler(model: Model, coupler: CoordinateCoupler, factors: Factors) -> CoordinateCoupler:
    """As in OpenSim, a distance that follows other coordinates grows with the body from which it is measured."""
    if model.coordinates[coupler.dependent].motion != "translation":
        return coupler
    parent = next(joint.parent for joint in model.joints if coupler.dependent in joint.motion.coordinates)
    if np.ptp(factors[parent]) > ALIKE:
        raise ModelError(
            f"{coupler.name} couples a distance, which OpenSim scales only by one factor for all directions; give "
            f"{model.bodies[parent].name} equal factors",
            SolverCode.UNSUPPORTED,
        )
    functions = tuple(scaled(function, float(factors[parent, 0])) for function in coupler.functions)
    return replace(coupler, functions=functions)


@lru_cache(maxsize=2)  # many models are scaled from one; they are frozen
def _default_lengths(model: Model) -> Array:
    """Of muscles, then of forces along paths [m], in the default posture, assembled."""
    posture = assemble(model)[None]
    paths = [*(muscle.path for muscle in model.muscles)]
    paths += [force.path for force in model.forces if isinstance(force, ALONG_PATH)]
    lengths: Array = evaluate_paths(model, postures(model, posture, np.zeros_like(posture)), paths).lengths[0]
    return lengths


def _grown(muscle: Muscle, ratio: float) -> Muscle:
    return replace(
        muscle,
        optimal_fiber_length=muscle.optimal_fiber_length * ratio,
        tendon_slack_length=muscle.tendon_slack_length * ratio,
    )

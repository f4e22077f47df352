"""Scale a model: every body along its own axes, as OpenSim's ScaleTool does it (OpenSim 4.6).

Factors belong to bodies; what is fixed to a body is scaled with it, component by component: also forces, actuators and
paths. Muscles keep their maximum isometric force and pennation; fibres, tendons and the resting length of a path grow
with the path in the default posture. Stiffness, damping and optimal forces stay. OpenSim leaves points at which forces
act, and contact geometry, where they were; they are scaled too if `scales_points`.

Findings on a scaled model: unequal factors move path points linearly and surfaces by mean factors, and a girdle in a
wrong posture stretches muscles. Marker residuals show neither.

Markers of a static pose: how still they are, and a model's markers moved to where they were seen (the last step of
OpenSim's ScaleTool).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import TypeVar, get_args

import numpy as np
from numpy.typing import ArrayLike

from documents.message import Message
from solver.constraint import ConstantDistanceConstraint, PointOnLineConstraint, WeldConstraint
from solver.errors import ScalingCode, SolverCode
from solver.forces.actuators import PathActuator, PointActuator, PointToPointActuator, TorqueActuator
from solver.forces.passive_forces import (
    BlankevoortLigament,
    Bushing,
    ConstantForce,
    ContactSurface,
    ExpressionBushing,
    FunctionBushing,
    HuntCrossleyContact,
    Ligament,
    PathExpression,
    PathSpring,
    PointToPointExpression,
    PointToPointSpring,
    SmoothContact,
)
from solver.functions.coordinate_functions import PiecewisePolynomial, scaled
from solver.inverse_kinematics.solve import TrackingTasks, assemble, solve_inverse_kinematics
from solver.model import (
    Actuator,
    AnyPathPoint,
    Array,
    AxisMotion,
    Body,
    Constraint,
    CoordinateActuator,
    CoordinateCoupler,
    Joint,
    Model,
    ModelError,
    MovingPathPoint,
    PassiveForce,
    Path,
    PathPoint,
    Placement,
    PointConstraint,
    ScapulothoracicMotion,
    WrapSurface,
)
from solver.multibody.postures import Postures, postures
from solver.muscle import evaluate_paths, muscle_forces

Factors = Array
"""(bodies, 3), 1 where a body keeps its size along an axis."""

ALIKE = 1e-12  # of factors that count as equal: then inertia is scaled exactly
ALONG_PATH = (PathSpring, PathExpression, Ligament, BlankevoortLigament)
_BUSHINGS = (Bushing, FunctionBushing, ExpressionBushing)
_AtPoints = PointToPointSpring | PointToPointExpression | ConstantForce | HuntCrossleyContact | SmoothContact
_AT_POINTS = get_args(_AtPoints)


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
    muscles = [
        replace(m, optimal_fiber_length=m.optimal_fiber_length * k, tendon_slack_length=m.tendon_slack_length * k)
        for m, k in ((muscle, next(ratios)) for muscle in scaled_model.muscles)
    ]
    forces = [
        replace(force, resting_length=force.resting_length * float(next(ratios)))
        if isinstance(force, ALONG_PATH)
        else force
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
        return np.asarray(body.inertia * (ratio * s[0] ** 2))
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
        is_plain = [isinstance(one, PiecewisePolynomial) and one.is_identity for one in motion.functions]
        functions = tuple(
            function if index < 3 or is_plain[index] else scaled(function, float(np.abs(axis) @ parent))
            for index, (axis, function) in enumerate(zip(motion.axes, motion.functions, strict=True))
        )
        motion = replace(motion, functions=functions)
    return replace(
        joint,
        frame_in_parent=moved(joint.frame_in_parent, parent),
        frame_in_child=moved(joint.frame_in_child, child),
        motion=motion,
    )


def _surface(surface: WrapSurface, s: Array) -> WrapSurface:
    columns = np.linalg.norm(s[:, None] * surface.placement.rotation, axis=0)
    across = columns[:2].mean()
    round_ones = {"sphere": [s.mean()] * 3, "cylinder": [across, across, columns[2]], "torus": [across] * 3}
    grown = np.array(round_ones.get(surface.kind, columns))
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
    paths = [*(muscle.path for muscle in model.muscles)]
    paths += [force.path for force in model.forces if isinstance(force, ALONG_PATH)]
    return np.asarray(evaluate_paths(model, _in_default_posture(model), paths).lengths[0])


def scaled_force(force: PassiveForce, factors: Factors, *, scales_points: bool) -> PassiveForce:
    """Its resting length is that of before. Raises ModelError for a force of another class."""
    if isinstance(force, ALONG_PATH):
        return replace(force, path=scaled_path(force.path, factors))
    if isinstance(force, _BUSHINGS):
        frame_1 = moved(force.frame_1, factors[force.body_1])
        return replace(force, frame_1=frame_1, frame_2=moved(force.frame_2, factors[force.body_2]))
    if not isinstance(force, _AT_POINTS):
        raise ModelError(f"{force.name} has no rule for scaling; remove it from the model", SolverCode.UNSUPPORTED)
    return _with_points(force, factors) if scales_points else force


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
        return replace(force, surfaces=tuple(_contact_surface(surface, factors) for surface in force.surfaces))
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


def _contact_surface(surface: ContactSurface, factors: Factors) -> ContactSurface:
    s = factors[surface.body]
    radius = None if surface.radius is None else surface.radius * float(s.mean())
    return replace(surface, placement=moved(surface.placement, s), radius=radius)


FIBRE_RANGE = (0.5, 1.45)  # normalised; beyond it passive force dominates, below it there is no active force
ROUND_OFF = 1e-6
LENGTH_RANGE = (0.9, 1.15)  # of a path's length ratio over the median of all
LARGEST_JUMP = 0.010  # m, of a path's length from one frame to the next, beyond the mean of its neighbours
LARGEST_PASSIVE_FORCE = 0.5  # over the maximum isometric force


def _finding(code: ScalingCode, muscle: str, figure: float, surface: str = "") -> Message[ScalingCode]:
    """A muscle that does not fit the scaled body, with the figure that shows it.

    figure  POINT_INSIDE_SURFACE: depth as part of the surface's size; FIBRE_LENGTH: normalised fibre length in the
            default posture; PATH_LENGTH: the path's length ratio over the median of all; FIBRE_LENGTH_IN_MOTION: the
            normalised fibre length farthest outside FIBRE_RANGE; PASSIVE_FORCE: over the maximum isometric force;
            PATH_JUMP [m]
    """
    return Message(code, {"muscle": muscle, "figure": figure, "surface": surface, "jump_mm": 1e3 * figure})


def check_scaling(generic: Model, scaled: Model) -> tuple[Message[ScalingCode], ...]:
    """Findings in the default posture on a model that was scaled from a generic one; both with the same muscles."""
    before, after = _in_default_posture(generic), _in_default_posture(scaled)
    lengths = [evaluate_paths(model, state).lengths for model, state in ((generic, before), (scaled, after))]
    ratios = lengths[1][0] / lengths[0][0]
    ratios = ratios / np.median(ratios)
    old_fibres, fibres = (_normalised_fibres(m, one)[0] for m, one in zip((generic, scaled), lengths, strict=True))
    found = []
    for index, muscle in enumerate(scaled.muscles):
        if not LENGTH_RANGE[0] <= ratios[index] <= LENGTH_RANGE[1]:
            found.append(_finding(ScalingCode.PATH_LENGTH, muscle.name, float(ratios[index])))
        if _is_usual(old_fibres[index]) and not _is_usual(fibres[index]):
            found.append(_finding(ScalingCode.FIBRE_LENGTH, muscle.name, float(fibres[index])))
        found += _inside(generic, scaled, index, before, after)
    return tuple(found)


@dataclass(frozen=True, eq=False)
class MuscleRanges:
    """Ranges of the muscles of a model in a motion, each (muscles,).

    shortest, longest  normalised fibre length;  passive  greatest passive force [N]
    jump               of the path's length between neighbouring frames, beyond the mean of the steps about it [m]
    """

    muscles: tuple[str, ...]
    max_isometric_forces: Array
    shortest: Array
    longest: Array
    passive: Array
    jump: Array

    @property
    def findings(self) -> tuple[Message[ScalingCode], ...]:
        """Muscles outside FIBRE_RANGE, pulled passively, or whose path jumps."""
        found = []
        for index, name in enumerate(self.muscles):
            outside = [fibre for fibre in (self.longest[index], self.shortest[index]) if not _is_usual(fibre)]
            if outside:
                found.append(_finding(ScalingCode.FIBRE_LENGTH_IN_MOTION, name, float(outside[0])))
            ratio = self.passive[index] / self.max_isometric_forces[index]
            if ratio > LARGEST_PASSIVE_FORCE:
                found.append(_finding(ScalingCode.PASSIVE_FORCE, name, float(ratio)))
            if self.jump[index] > LARGEST_JUMP:
                found.append(_finding(ScalingCode.PATH_JUMP, name, float(self.jump[index])))
        return tuple(found)


def muscle_ranges(model: Model, coordinates: Array) -> MuscleRanges:
    """In postures (frames, coordinates) that follow one another in time, as they were recorded."""
    state = postures(model, coordinates, np.zeros_like(coordinates))
    lengths = evaluate_paths(model, state).lengths
    fibres = _normalised_fibres(model, lengths)
    return MuscleRanges(
        model.muscle_names,
        np.array([muscle.max_isometric_force for muscle in model.muscles]),
        fibres.min(axis=0),
        fibres.max(axis=0),
        muscle_forces(model, lengths, np.zeros_like(lengths)).passive.max(axis=0),
        _jumps(lengths),
    )


def _jumps(lengths: Array) -> Array:
    steps = np.diff(lengths, axis=0)
    if len(steps) < 3:
        return np.zeros(lengths.shape[1])
    padded = np.concatenate([steps[1:2], steps, steps[-2:-1]])
    return np.asarray(np.abs(steps - 0.5 * (padded[:-2] + padded[2:])).max(axis=0))


def _in_default_posture(model: Model) -> Postures:
    posture = assemble(model)[None]
    return postures(model, posture, np.zeros_like(posture))


def _normalised_fibres(model: Model, lengths: Array) -> Array:
    """Fibre length over the optimal one (frames, muscles), at lengths of the paths [m]; the tendons are rigid."""
    optimal, slack, pennation = np.array(
        [(m.optimal_fiber_length, m.tendon_slack_length, m.pennation_at_optimal) for m in model.muscles]
    ).T
    along = np.maximum(lengths - slack, 0.0)
    return np.asarray(np.hypot(along, optimal * np.sin(pennation)) / optimal)


def _is_usual(fibre: float) -> bool:
    return bool(FIBRE_RANGE[0] - ROUND_OFF <= fibre <= FIBRE_RANGE[1] + ROUND_OFF)


def _inside(generic: Model, scaled: Model, index: int, before: Postures, after: Postures) -> list[Message[ScalingCode]]:
    """Points that lie in a surface of their path, and did not before."""
    found = []
    muscle, old = scaled.muscles[index], generic.muscles[index]
    for wrap in muscle.path.wraps:
        surface, old_surface = scaled.surfaces[wrap.surface], generic.surfaces[wrap.surface]
        for point, old_point in zip(muscle.path.points, old.path.points, strict=True):
            if not (isinstance(point, PathPoint) and isinstance(old_point, PathPoint)):
                continue
            level = _level(surface, point, after)
            if level < 1.0 <= _level(old_surface, old_point, before):
                code = ScalingCode.POINT_INSIDE_SURFACE
                found.append(_finding(code, muscle.name, 1.0 - level, surface.name))
    return found


def _level(surface: WrapSurface, point: PathPoint, state: Postures) -> float:
    """Below 1 inside, 1 on the surface: distance from its middle or axis over its size in that direction."""
    rotations, origins = state.rotation_to_ground[0], state.origin_in_ground[0]
    in_ground = origins[point.body] + rotations[point.body] @ point.location
    in_body = rotations[surface.body].T @ (in_ground - origins[surface.body])
    local = surface.placement.rotation.T @ (in_body - surface.placement.translation)
    if surface.kind == "torus":
        tube, ring, _ = surface.dimensions
        return float(np.hypot(np.hypot(local[0], local[1]) - ring, local[2]) / tube)
    if surface.kind == "cylinder":
        if abs(local[2]) > surface.dimensions[2] / 2:
            return float("inf")
        local = local * [1.0, 1.0, 0.0]
    return float(np.linalg.norm(local / surface.dimensions))


def place_markers(model: Model, labels: Sequence[str], static: Array, tasks: TrackingTasks) -> Model:
    """The model with every marker that is seen and not fixed at its place in the body, in the posture of the tasks.

    static (labels, 3) [m] is the mean of the frames of a static pose, NaN where a marker is hidden.
    """
    columns = [list(labels).index(marker.name) for marker in tasks.markers]
    posture = solve_inverse_kinematics(model, static[None, columns], tasks).coordinates
    state = postures(model, posture, np.zeros_like(posture))
    places = dict(zip(labels, static, strict=True))
    moved = []
    for marker in model.markers:
        place = places.get(marker.name)
        if marker.is_fixed or place is None or not np.isfinite(place).all():
            moved.append(marker)
            continue
        rotation, origin = state.rotation_to_ground[0, marker.body], state.origin_in_ground[0, marker.body]
        moved.append(replace(marker, location=rotation.T @ (place - origin)))
    return replace(model, markers=tuple(moved))


def largest_motion(labels: Sequence[str], observed: Array) -> tuple[str, float]:
    """Label of the marker that moves most along an axis in (frames, labels, 3) [m], and its range [m]."""
    hidden = ~np.isfinite(observed).any(axis=(0, 2))
    filled = np.where(np.isfinite(observed), observed, np.nan)
    filled[:, hidden] = 0.0
    ranges = (np.nanmax(filled, axis=0) - np.nanmin(filled, axis=0)).max(axis=1)
    index = int(np.argmax(ranges))
    return labels[index], float(ranges[index])

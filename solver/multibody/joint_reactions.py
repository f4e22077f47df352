"""Joint reactions: the moment and force that a joint carries from one body to the other, as OpenSim's JointReaction.

Newton and Euler from the outermost bodies inwards: a joint carries what its child and the bodies beyond it need for
their accelerations, less all other loads on them. Forces on coordinates, as those of actuators and locks, are part of
what the joint carries; forces on bodies, as those of muscles, external loads and constraints between bodies, are not.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from documents.results import EqualByFields
from solver.checks import ensure_known, ensure_names
from solver.constraint import CoordinateCoupler, CoordinateLock, CoordinatePrescription
from solver.model import GROUND, Joint, Model
from solver.multibody.constraints import constraint_wrenches
from solver.multibody.dynamics import EquationsOfMotion, multipliers
from solver.multibody.loads import total_loads
from solver.multibody.postures import Postures, jacobians, point_acceleration, points_in_ground, velocity_at
from solver.multibody.rotations import cross, rotate, wrench_about_origin

Array = NDArray[np.float64]
Side = Literal["child", "parent"]
Axes = Literal["ground", "child", "parent"]


@dataclass(frozen=True)
class ReactionRequest:
    """Joints whose reactions are wanted, the body they act on, and the body in whose axes they are given."""

    joints: tuple[str, ...] = ()
    on: Side = "child"
    axes: Axes = "ground"

    def __post_init__(self) -> None:
        """Raise ModelError for another side or other axes."""
        ensure_names("joints", self.joints)
        ensure_known("on", self.on, get_args(Side))
        ensure_known("axes", self.axes, get_args(Axes))


@dataclass(frozen=True, eq=False)
class JointReactions(EqualByFields):
    """Reactions of some joints in every frame.

    labels  of every joint, as OpenSim's: knee_r_on_tibia_r_in_ground
    moment  (frames, joints, 3) [N m] about the point
    force   (frames, joints, 3) [N]
    point   (frames, joints, 3) origin of the joint's frame in the body acted on [m], from the origin of the axes' body
    """

    labels: tuple[str, ...]
    moment: Array
    force: Array
    point: Array


def joint_reactions(
    model: Model,
    state: Postures,
    equations: EquationsOfMotion,
    wrenches: Array,
    coordinate_forces: Array,
    request: ReactionRequest,
) -> JointReactions:
    """Reactions under loads besides the model's passive ones, with the accelerations that all of them cause.

    wrenches           (frames, bodies, 6) moment about the ground origin [N m] and force [N], in ground: of muscles
                       and external loads
    coordinate_forces  (frames, coordinates) on coordinates and no body [N, N m]: of actuators, and of muscles with
                       moving points

    Raises ModelError for a joint that the model does not have.
    """
    joints = [model.joint(name) for name in request.joints]
    on_children = _reactions_on_children(model, state, equations, wrenches, coordinate_forces)
    moment, force, point = np.empty((3, len(wrenches), len(joints), 3))
    labels = []
    for place, joint in enumerate(joints):
        body, frame, sign = joint.child, joint.frame_in_child, 1.0
        if request.on == "parent":
            body, frame, sign = joint.parent, joint.frame_in_parent, -1.0
        axes = {"ground": GROUND, "child": joint.child, "parent": joint.parent}[request.axes]
        origin, carried = points_in_ground(state, body, frame.translation), sign * on_children[:, joint.child]
        to_axes = np.swapaxes(state.rotation_to_ground[:, axes], 1, 2)
        moment[:, place] = rotate(to_axes, carried[:, :3] - cross(origin, carried[:, 3:]))
        force[:, place] = rotate(to_axes, carried[:, 3:])
        point[:, place] = rotate(to_axes, origin - state.origin_in_ground[:, axes])
        labels.append(f"{joint.name}_on_{model.bodies[body].name}_in_{model.bodies[axes].name}")
    return JointReactions(tuple(labels), moment, force, point)


def is_bypassed(model: Model, joint: Joint) -> bool:
    """Whether a constraint holds a body beyond the joint on one before it, and so carries part of its load."""
    beyond = {joint.child}
    for other in model.joints:
        if other.parent in beyond:
            beyond.add(other.child)
    of_bodies = (
        constraint
        for constraint in model.constraints
        if not isinstance(constraint, CoordinateLock | CoordinatePrescription | CoordinateCoupler)
    )
    return any((held.body_1 in beyond) != (held.body_2 in beyond) for held in of_bodies)


def _reactions_on_children(
    model: Model, state: Postures, equations: EquationsOfMotion, wrenches: Array, coordinate_forces: Array
) -> Array:
    """(frames, bodies, 6) moment about the ground origin and force on each body, by the joint that carries it."""
    columns = jacobians(model, state)
    force = np.einsum("fbi,fbij->fj", wrenches, columns) + coordinate_forces
    acceleration = equations.acceleration_unloaded + rotate(equations.mobility, force)
    held = np.einsum("frbi,fr->fbi", constraint_wrenches(model, state), multipliers(equations, force))
    carried: Array = _momentum_rates(model, state, rotate(columns, acceleration[:, None])) - wrenches + held
    if model.forces:
        carried -= total_loads(model, state)[0]
    for joint in reversed(model.joints):
        carried[:, joint.parent] += carried[:, joint.child]
    return carried


def _momentum_rates(model: Model, state: Postures, change: Array) -> Array:
    """(frames, bodies, 6) rate of change of each body's momentum about the ground origin, less its weight; change
    (frames, bodies, 6) of its screw by the accelerations of the coordinates.
    """
    rates = np.zeros_like(change)
    change = change + state.bias_acceleration
    for index, body in enumerate(model.bodies):
        rotation, alpha = state.rotation_to_ground[:, index], change[:, index, :3]
        spin = state.angular_velocity[:, index]
        center = points_in_ground(state, index, body.mass_center)
        velocity = velocity_at(state, index, center)
        acceleration = point_acceleration(alpha, change[:, index, 3:], spin, velocity, center)
        rates[:, index] = wrench_about_origin(center, body.mass * (acceleration - model.gravity))
        inertia = rotation @ body.inertia @ np.swapaxes(rotation, 1, 2)
        rates[:, index, :3] += rotate(inertia, alpha) + cross(spin, rotate(inertia, spin))
    return rates

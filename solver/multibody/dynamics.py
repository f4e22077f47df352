"""Equations of motion: mass matrix, bias, constraints, and the joint reaction between arm and trunk.

With u̇ the accelerations, f the generalised forces and λ the constraints' multipliers,

    M u̇ + c + Gᵀ λ = f,   G u̇ + b = 0   ⇒   u̇ = P (f − c) − K b,   λ = Kᵀ (f − c) + S⁻¹ b
    S = G M⁻¹ Gᵀ,   K = M⁻¹ Gᵀ S⁻¹,   P = M⁻¹ − K G M⁻¹

so one factorisation per frame serves all loads. If constraints are redundant, S⁻¹ is the pseudo-inverse and λ the least
multipliers that hold them, as in Simbody. Loads are wrenches on bodies about the ground origin (moment, force).

Inverse dynamics gives the generalised forces that produce a motion under external loads,

    τ = M q̈ + c − Σ Jᵀ w

with the mass matrix M, the bias c of velocities, gravity and passive forces, and the wrenches w of the loads. Muscles
and actuators do not act. As in OpenSim's InverseDynamicsTool, constraints do not act either: τ of a coupled or locked
coordinate is the one that its motion would need without the constraint.

Joint reactions: the moment and force that a joint carries from one body to the other, as OpenSim's JointReaction.

Newton and Euler from the outermost bodies inwards: a joint carries what its child and the bodies beyond it need for
their accelerations, less all other loads on them. Forces on coordinates, as those of actuators and locks, are part of
what the joint carries; forces on bodies, as those of muscles, external loads and constraints between bodies, are not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from documents.results import EqualByFields
from solver.checks import ensure_known, ensure_names
from solver.constraint import CoordinateCoupler, CoordinateLock, CoordinatePrescription
from solver.errors import SolverCode
from solver.model import GROUND, Array, Joint, Model, ModelError
from solver.motion import Kinematics
from solver.multibody.body_tables import Indices, Tables, pack_bodies
from solver.multibody.constraints import constraint_rows, constraint_wrenches
from solver.multibody.loads import ExternalForce, LoadWrenches, load_wrenches, on_all_bodies, total_loads
from solver.multibody.postures import (
    Postures,
    cross,
    jacobians,
    point_acceleration,
    points_in_ground,
    postures,
    read_only,
    rotate,
    velocity_at,
    wrench_about_origin,
)

if TYPE_CHECKING:
    from solver.multibody.mass_matrix import DynamicsTerms, Responses


_RANK_TOLERANCE = 2e-14  # per row, of the greatest singular value: Simbody's SignificantReal
_SINGULAR = 1e14  # greatest element of a matrix times that of its inverse; the arm reaches 1e6, odd postures 1e10


@dataclass(frozen=True, eq=False)
class EquationsOfMotion:
    """The terms of the module's equations, and the reaction R = R_b − R_a u̇ + wrench on the bodies beyond it.

    mass_matrix           M (frames, coordinates, coordinates)
    bias_force            c (frames, coordinates), of velocities, gravity and passive forces
    mobility              P (frames, coordinates, coordinates)
    multiplier_per_force  Kᵀ (frames, rows, coordinates)
    tables, screws        how loads reach the coordinates, as in tables.Tables and postures.Postures
    acceleration_unloaded (frames, coordinates) u̇ at f = 0
    multipliers_unloaded  (frames, rows) λ at f = 0
    reaction_body         index of the body that the reaction joint carries
    reaction_point        (frames, 3) origin of that joint's frame in its parent, in ground [m]
    reaction_per_acceleration  R_a (frames, 6, coordinates)
    reaction_unloaded     (frames, 6) R at f = 0: moment [N m] and force [N] on the joint's parent, in ground
    is_regular            False where S is singular in any of the frames; then what is finite depends on all of them
    """

    mass_matrix: Array
    bias_force: Array
    mobility: Array
    multiplier_per_force: Array
    tables: Tables
    screws: Array
    acceleration_unloaded: Array
    multipliers_unloaded: Array
    reaction_body: int
    reaction_point: Array
    reaction_per_acceleration: Array
    reaction_unloaded: Array
    is_regular: bool


def equations_of_motion(model: Model, state: Postures, reaction_joint: str = "GlenoHumeral") -> EquationsOfMotion:
    """The equations at a batch of postures, factored; they are independent of muscles and other loads.

    ModelError where the mass matrix is singular in all postures, or the model has no such joint. A single posture in
    which it is, or in which constraints become redundant, is NaN.
    """
    joint = model.joint(reaction_joint)
    point = points_in_ground(state, joint.parent, joint.frame_in_parent.translation)
    jacobian, bias = constraint_rows(model, state)
    terms = _terms(model, state, joint.child, point, jacobian)
    _mark_singular(terms, model)
    stiffness, is_regular = _pseudo_inverse(terms.compliance)
    gain = terms.inverse_times @ stiffness
    mobility = np.subtract(terms.inverse, gain @ np.swapaxes(terms.inverse_times, 1, 2), out=terms.inverse)
    bias_force, per_acceleration = terms.bias_force, terms.reaction_per_acceleration
    acceleration = -rotate(mobility, bias_force) - rotate(gain, bias)

    return EquationsOfMotion(
        mass_matrix=terms.mass_matrix,
        bias_force=bias_force,
        mobility=mobility,
        multiplier_per_force=np.swapaxes(gain, 1, 2),
        tables=pack_bodies(model),
        screws=state.screws,
        acceleration_unloaded=acceleration,
        multipliers_unloaded=rotate(stiffness, bias) - rotate(np.swapaxes(gain, 1, 2), bias_force),
        reaction_body=joint.child,
        reaction_point=point,
        reaction_per_acceleration=per_acceleration,
        reaction_unloaded=terms.reaction_bias - rotate(per_acceleration, acceleration),
        is_regular=is_regular,
    )


def mass_matrix_and_bias_force(model: Model, state: Postures) -> tuple[Array, Array]:
    """M (frames, coordinates, coordinates) and c (frames, coordinates), which needs no inverse and no constraints."""
    frames, count = state.coordinates.shape
    terms = _terms(model, state, model.joints[0].child, np.zeros((frames, 3)), np.zeros((frames, 0, count)))
    return terms.mass_matrix, terms.bias_force


@dataclass(frozen=True, eq=False)
class Response:
    """Change by loads: acceleration (frames, loads, coordinates) [rad/s², m/s²] and reaction (frames, loads, 6), moment
    [N m] and force [N] on the reaction joint's parent, in ground.
    """

    acceleration: Array
    reaction: Array


def response_to_loads(
    equations: EquationsOfMotion, wrenches: Array | LoadWrenches, generalised_forces: Array | None = None
) -> Response:
    """The response to each of many loads. It is linear in them, so one geometry serves all scenarios.

    wrenches            (frames, loads, bodies, 6) moment about the ground origin [N m] and force [N] on each body, in
                        ground, also sparse; see postures.wrench_about_origin for forces at points
    generalised_forces  (frames, loads, coordinates), that act on coordinates and on no body [N, N m]
    """
    if not isinstance(wrenches, LoadWrenches):
        wrenches = on_all_bodies(wrenches)
    shape = len(wrenches.values), wrenches.loads
    responses = responses_to(equations, wrenches, generalised_forces, np.ones(shape), np.zeros(shape))
    return Response(np.swapaxes(responses.acceleration, 1, 2), np.swapaxes(responses.reaction, 1, 2))


def responses_to(
    equations: EquationsOfMotion,
    wrenches: LoadWrenches,
    generalised_forces: Array | None,
    factors: Array,
    shares: Array,
    driven: Sequence[int] = (),
    strength: Sequence[float] = (),
) -> Responses:
    """The response to each load times its factor (frames, loads), and to forces of this strength (actuators,) on the
    `driven` coordinates (actuators,); their sum with shares (frames, loads) of the loads.
    """
    # the compiler behind them takes a third of a second to import
    from solver.multibody.mass_matrix import Loads, Mobility, Responses, fill_responses

    (frames, coordinates), columns = equations.screws.shape[:2], wrenches.loads + len(driven)
    responses = Responses(
        acceleration=np.empty((frames, coordinates, columns)),
        reaction=np.empty((frames, 6, columns)),
        total_acceleration=np.empty((frames, coordinates)),
        total_reaction=np.empty((frames, 6)),
    )
    fill_responses(
        Mobility(
            equations.tables.joints,
            equations.screws,
            equations.mobility,
            equations.reaction_per_acceleration,
            equations.reaction_body,
            equations.reaction_point,
        ),
        Loads(
            wrenches=read_only(wrenches.values),
            load=wrenches.load,
            body=wrenches.body,
            bodies=wrenches.bodies,
            forces=read_only(np.zeros((0, 0, 0)) if generalised_forces is None else generalised_forces),
            factors=read_only(factors),
            shares=read_only(shares),
            driven=np.array(driven, dtype=np.int64),
            strength=np.array(strength, dtype=np.float64),
        ),
        responses,
    )
    return responses


def multipliers(equations: EquationsOfMotion, generalised_force: Array) -> Array:
    """λ (frames, rows) [N; N m for angles] under a generalised force f (frames, coordinates), in Simbody's sign."""
    return equations.multipliers_unloaded + rotate(equations.multiplier_per_force, generalised_force)


def _terms(model: Model, state: Postures, child: int, point: Array, jacobian: Array) -> DynamicsTerms:
    """M, c, inverses with G, and the reaction about point (frames, 3) that carries `child` and the bodies beyond it."""
    from solver.multibody.mass_matrix import (
        DynamicsTerms,  # the compiler behind it takes a third of a second to import
        mass_matrix_and_bias,
    )

    frames, rows, count = jacobian.shape
    terms = DynamicsTerms(
        mass_matrix=np.zeros((frames, count, count)),
        bias_force=np.zeros((frames, count)),
        inverse=np.empty((frames, count, count)),
        inverse_times=np.empty((frames, count, rows)),
        compliance=np.empty((frames, rows, rows)),
        reaction_per_acceleration=np.zeros((frames, 6, count)),
        reaction_bias=np.zeros((frames, 6)),
    )
    for passive in model.coordinate_forces:
        q, u = state.coordinates[:, passive.coordinate], state.speeds[:, passive.coordinate]
        terms.bias_force[:, passive.coordinate] -= passive.at(q, u)
    gravity, carried = np.array(model.gravity), _carried(model, child)
    mass_matrix_and_bias(pack_bodies(model), gravity, state.poses, state.screws, carried, point, jacobian, terms)
    if model.forces:
        wrenches, on_coordinates = total_loads(model, state)
        beyond = pack_bodies(model).moves.T @ wrenches  # of each coordinate
        terms.bias_force[...] -= on_coordinates + (beyond * state.screws).sum(axis=-1)
        direct = carried @ wrenches
        terms.reaction_bias[...] += direct
        terms.reaction_bias[:, :3] -= cross(point, direct[:, 3:])
    return terms


def _mark_singular(terms: DynamicsTerms, model: Model) -> None:
    """NaN in frames in which the mass matrix is singular. ModelError if that is so in all frames."""
    largest = np.abs(terms.mass_matrix).max(axis=(1, 2), initial=0.0)
    with np.errstate(invalid="ignore"):  # infinite inverses times zero
        magnified = largest * np.abs(terms.inverse).max(axis=(1, 2), initial=0.0)
    is_singular = np.isfinite(largest) & ~(magnified <= _SINGULAR)
    if is_singular.all() and len(largest):
        bodies = [model.bodies[joint.child] for joint in model.joints if joint.motion.coordinates]
        lacking = ", ".join(body.name for body in bodies if not body.mass)
        raise ModelError(
            f"the mass matrix of {model.name} cannot be inverted: it is singular in all of {len(largest)} postures; "
            f"give {lacking or 'each moving body'} a mass, or weld it to its parent",
            SolverCode.SINGULAR,
        )
    terms.inverse[is_singular], terms.inverse_times[is_singular], terms.compliance[is_singular] = np.nan, np.nan, np.nan


def _pseudo_inverse(matrix: Array) -> tuple[Array, bool]:
    """Inverses of symmetric matrices (frames, n, n), pseudo-inverses if they are singular in all frames; and whether
    none is singular.

    NaN in a frame whose rank is below that of others: accelerations would jump there.
    """
    inverse = _inverse_by_frame(matrix)
    with np.errstate(invalid="ignore"):  # infinite inverses times zero
        magnified = np.abs(matrix).max(axis=(1, 2), initial=0.0) * np.abs(inverse).max(axis=(1, 2), initial=0.0)
    is_known = np.isfinite(matrix).all(axis=(1, 2))
    if not is_known.any() or (magnified[is_known] <= _SINGULAR).all():
        return inverse, True
    values, vectors = np.linalg.eigh(matrix[is_known])
    is_kept = np.abs(values) > matrix.shape[1] * _RANK_TOLERANCE * np.abs(values).max(axis=1, keepdims=True)
    shares = np.where(is_kept, 1.0 / np.where(is_kept, values, 1.0), 0.0)
    found = (vectors * shares[:, None]) @ np.swapaxes(vectors, 1, 2)
    rank = is_kept.sum(axis=1)
    found[rank < rank.max()] = np.nan
    inverse[is_known] = found
    return inverse, False


def _inverse_by_frame(matrix: Array) -> Array:
    """Inverses (frames, n, n); infinite for a singular matrix."""
    try:
        inverse: Array = np.linalg.inv(matrix)  # type: ignore[assignment]
    except np.linalg.LinAlgError:
        if len(matrix) == 1:
            return np.full_like(matrix, np.inf)
        inverse = np.concatenate([_inverse_by_frame(one[None]) for one in matrix])
    return inverse


def _carried(model: Model, body: int) -> Indices:
    """(bodies,) 1 for the body and all bodies beyond it, else 0."""
    carried = np.zeros(len(model.bodies), dtype=np.int64)
    carried[body] = 1
    for joint in model.joints:
        carried[joint.child] |= carried[joint.parent]
    return carried


def inverse_dynamics(model: Model, kinematics: Kinematics, loads: Sequence[ExternalForce] = ()) -> Array:
    """τ (frames, coordinates) [N m for angles, N for translations]; loads are sampled at the frames of the motion.

    Bodies may lack mass: nothing is inverted.
    """
    state = postures(model, kinematics.positions, kinematics.speeds, kinematics.time)
    mass_matrix, bias_force = mass_matrix_and_bias_force(model, state)
    forces = rotate(mass_matrix, kinematics.accelerations) + bias_force
    if loads:
        beyond = pack_bodies(model).moves.T @ load_wrenches(loads, state)  # of each coordinate
        forces -= (beyond * state.screws).sum(axis=-1)
    return forces


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

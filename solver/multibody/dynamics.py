"""How loads accelerate the model: mass matrix, bias, constraints, and the joint reaction between arm and trunk.

With u̇ the accelerations, f the generalised forces and λ the constraints' multipliers,

    M u̇ + c + Gᵀ λ = f,   G u̇ + b = 0   ⇒   u̇ = P (f − c) − K b,   λ = Kᵀ (f − c) + S⁻¹ b
    S = G M⁻¹ Gᵀ,   K = M⁻¹ Gᵀ S⁻¹,   P = M⁻¹ − K G M⁻¹

so one factorisation per frame serves every load. Loads are wrenches on bodies about the ground origin (moment, force).
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from solver.model import CoordinateForce, Model, ModelError
from solver.multibody.constraints import constraint_rows
from solver.multibody.postures import Postures, points_in_ground
from solver.multibody.rotations import cross, rotate
from solver.multibody.tables import Indices, Tables, tables_of
from solver.muscle import MuscleForces
from solver.paths import PathState

Array = NDArray[np.float64]

_SINGULAR = 1e14  # greatest element of a matrix times that of its inverse; the arm reaches 1e6, odd postures 1e10


@dataclass(frozen=True, eq=False)
class EquationsOfMotion:
    """The letters of the module's equations, and the reaction R = R_b − R_a u̇ + wrench on the bodies beyond it.

    mass_matrix           M (frames, coordinates, coordinates)
    bias_force            c (frames, coordinates), of velocities, gravity and what acts on coordinates by itself
    constraint_jacobian   G (frames, rows, coordinates), see solver/multibody/constraints.py
    constraint_bias       b (frames, rows)
    mobility              P (frames, coordinates, coordinates)
    multiplier_per_force  Kᵀ (frames, rows, coordinates)
    tables, screws        how loads reach the coordinates, as in moving/tables.py and kinematics.Postures
    acceleration_unloaded (frames, coordinates) u̇ at f = 0
    multipliers_unloaded  (frames, rows) λ at f = 0
    reaction_body         index of the body that the reaction joint carries
    reaction_point        (frames, 3) origin of that joint's frame in its parent, in ground [m]
    reaction_per_acceleration  R_a (frames, 6, coordinates)
    reaction_unloaded     (frames, 6) R at f = 0: moment [N m] and force [N] on the joint's parent, in ground
    """

    mass_matrix: Array
    bias_force: Array
    constraint_jacobian: Array
    constraint_bias: Array
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


@dataclass(frozen=True, eq=False)
class ResponseMaps:
    """Accelerations and reaction as affine functions of x = (activations of the muscles, controls of the actuators).

    acceleration_at_rest      (frames, coordinates) at x = 0, where muscles still pull passively [rad/s², m/s²]
    acceleration_per_control  (frames, coordinates, controls)
    reaction_at_rest          (frames, 6) moment [N m] and force [N] on the reaction joint's parent, in ground
    reaction_per_control      (frames, 6, controls)
    """

    acceleration_at_rest: Array
    acceleration_per_control: Array
    reaction_at_rest: Array
    reaction_per_control: Array

    @property
    def is_finite(self) -> NDArray[np.bool_]:
        """(frames,) False in a posture in which the model cannot be evaluated."""
        parts = (getattr(self, field.name) for field in fields(self))
        known = np.concatenate([part.reshape(len(part), -1) for part in parts], axis=1)
        is_finite: NDArray[np.bool_] = np.isfinite(known).all(axis=1)
        return is_finite

    def cleared(self, frames: NDArray[np.bool_]) -> ResponseMaps:
        """With NaN in these frames: an infinity would warn in every product that it enters."""
        maps = replace(self, **{field.name: getattr(self, field.name).copy() for field in fields(self)})
        for field in fields(self):
            getattr(maps, field.name)[frames] = np.nan
        return maps


def equations_of_motion(model: Model, state: Postures, reaction_joint: str = "GlenoHumeral") -> EquationsOfMotion:
    """The equations at a batch of postures, factored; nothing of them depends on muscles or other loads.

    ModelError where the mass matrix or the constraints are singular in all postures, or the model has no such joint; a
    single posture in which they are is NaN.
    """
    joint = model.joint(reaction_joint)
    point = points_in_ground(state, joint.parent, joint.frame_in_parent.translation)
    mass_matrix, bias_force, per_acceleration, reaction_bias = _weighed(model, state, joint.child, point)
    jacobian, bias = constraint_rows(model, state)

    inverse = _inverse(mass_matrix, f"the mass matrix of {model.name}, where a moving body may lack mass,")
    inverse_times = inverse @ np.swapaxes(jacobian, 1, 2)
    stiffness = _inverse(jacobian @ inverse_times, f"the constraints of {model.name}, of which one may be redundant,")
    gain = inverse_times @ stiffness
    mobility = inverse - gain @ np.swapaxes(inverse_times, 1, 2)
    acceleration = -rotate(mobility, bias_force) - rotate(gain, bias)

    return EquationsOfMotion(
        mass_matrix=mass_matrix,
        bias_force=bias_force,
        constraint_jacobian=jacobian,
        constraint_bias=bias,
        mobility=mobility,
        multiplier_per_force=np.swapaxes(gain, 1, 2),
        tables=tables_of(model),
        screws=state.screws,
        acceleration_unloaded=acceleration,
        multipliers_unloaded=rotate(stiffness, bias) - rotate(np.swapaxes(gain, 1, 2), bias_force),
        reaction_body=joint.child,
        reaction_point=point,
        reaction_per_acceleration=per_acceleration,
        reaction_unloaded=reaction_bias - rotate(per_acceleration, acceleration),
    )


@dataclass(frozen=True, eq=False)
class Response:
    """Effect of loads: acceleration (frames, loads, coordinates), reaction (frames, loads, 6) as in ResponseMaps."""

    acceleration: Array
    reaction: Array


def response_to_loads(
    equations: EquationsOfMotion, wrenches: Array, generalised_forces: Array | float = 0.0
) -> Response:
    """The response to each of many loads, linear in them: scale it, add it up, and reuse one geometry for all of them.

    wrenches            (frames, loads, bodies, 6) moment about the ground origin [N m] and force [N] on each body, in
                        ground; spatial.wrench_about_origin makes them of forces at points
    generalised_forces  (frames, loads, coordinates), what acts on coordinates without being a wrench on a body [N, N m]
    """
    from solver.multibody.joint_loads import add_joint_loads

    forces = np.empty((*wrenches.shape[:2], equations.screws.shape[1]))
    forces[...] = generalised_forces
    direct = np.empty((*wrenches.shape[:2], 6))
    wrenches = np.ascontiguousarray(wrenches).view()
    wrenches.flags.writeable = False  # whether they came so or not: to the compiler they are of two types
    add_joint_loads(equations.tables.joints, equations.screws, equations.reaction_body, wrenches, forces, direct)
    direct[..., :3] -= cross(equations.reaction_point[:, None], direct[..., 3:])
    acceleration = forces @ equations.mobility
    reaction = direct - acceleration @ np.swapaxes(equations.reaction_per_acceleration, 1, 2)
    return Response(acceleration, reaction)


def response_maps(
    model: Model, equations: EquationsOfMotion, paths: PathState, forces: MuscleForces, wrenches: Array | None = None
) -> ResponseMaps:
    """The maps of the redundancy problem; wrenches (frames, bodies, 6) are loads that act besides muscles (a suit)."""
    muscles = response_to_loads(equations, paths.wrench_per_tension, paths.mobility_per_tension)
    actuators = _actuator_response(model, equations)
    passive = forces.passive[..., None]
    acceleration = equations.acceleration_unloaded + (muscles.acceleration * passive).sum(axis=1)
    reaction = equations.reaction_unloaded + (muscles.reaction * passive).sum(axis=1)
    if wrenches is not None:
        worn = response_to_loads(equations, wrenches[:, None])
        acceleration, reaction = acceleration + worn.acceleration[:, 0], reaction + worn.reaction[:, 0]
    active = forces.active[..., None]
    per_control = np.concatenate([muscles.acceleration * active, actuators.acceleration], axis=1)
    reaction_per_control = np.concatenate([muscles.reaction * active, actuators.reaction], axis=1)
    return ResponseMaps(
        acceleration_at_rest=acceleration,
        acceleration_per_control=np.swapaxes(per_control, 1, 2),
        reaction_at_rest=reaction,
        reaction_per_control=np.swapaxes(reaction_per_control, 1, 2),
    )


def multipliers(equations: EquationsOfMotion, generalised_force: Array) -> Array:
    """λ (frames, rows) [N; N m for angles] under a generalised force f (frames, coordinates), in Simbody's sign."""
    return equations.multipliers_unloaded + rotate(equations.multiplier_per_force, generalised_force)


def _weighed(model: Model, state: Postures, child: int, point: Array) -> tuple[Array, Array, Array, Array]:
    """M (frames, u, u) and bias (frames, u); of the reaction that carries `child` and the bodies beyond it, about point
    (frames, 3), the part per acceleration (frames, 6, u) and its bias (frames, 6).
    """
    from solver.multibody.masses import (
        mass_matrix_and_bias,  # the compiler behind it takes a third of a second to import
    )

    frames, count = state.coordinates.shape
    tables = tables_of(model)
    mass_matrix, bias_force = np.zeros((frames, count, count)), np.zeros((frames, count))
    per_acceleration, reaction_bias = np.zeros((frames, 6, count)), np.zeros((frames, 6))
    for passive in model.coordinate_forces:
        bias_force[:, passive.coordinate] -= _own_force(passive, state)
    mass_matrix_and_bias(
        tables.bodies,
        tables.moves,
        np.array(model.gravity),
        state.poses,
        state.screws,
        mass_matrix,
        bias_force,
        _carried(model, child),
        point,
        per_acceleration,
        reaction_bias,
    )
    return mass_matrix, bias_force, per_acceleration, reaction_bias


def _own_force(passive: CoordinateForce, state: Postures) -> Array:
    q, u = state.coordinates[:, passive.coordinate], state.speeds[:, passive.coordinate]
    force: Array = passive.force.derivatives(q)[0] + passive.resistance.derivatives(q)[0] * u
    return force


def _inverse(matrix: Array, whose: str) -> Array:
    inverse = _each_inverse(matrix)
    magnified = np.abs(matrix).max(axis=(1, 2), initial=0.0) * np.abs(inverse).max(axis=(1, 2), initial=0.0)
    is_singular = magnified > _SINGULAR
    if is_singular.all() and len(matrix):
        raise ModelError(f"{whose} cannot be solved for: singular in all of {len(matrix)} postures")
    inverse[is_singular] = np.nan
    return inverse


def _each_inverse(matrix: Array) -> Array:
    """Infinite where there is none."""
    try:
        inverse: Array = np.linalg.inv(matrix)  # type: ignore[assignment]
    except np.linalg.LinAlgError:
        if len(matrix) == 1:
            return np.full_like(matrix, np.inf)
        inverse = np.concatenate([_each_inverse(one[None]) for one in matrix])
    return inverse


def _carried(model: Model, body: int) -> Indices:
    """(bodies,) 1 for the body and all bodies beyond it, else 0."""
    carried = np.zeros(len(model.bodies), dtype=np.int64)
    carried[body] = 1
    for joint in model.joints:
        carried[joint.child] |= carried[joint.parent]
    return carried


def _actuator_response(model: Model, equations: EquationsOfMotion) -> Response:
    """That of each actuator's full control, a force on one coordinate: a row of P, times its size."""
    driven = [actuator.coordinate for actuator in model.actuators]
    strength = np.array([actuator.optimal_force for actuator in model.actuators])
    acceleration = equations.mobility[:, driven] * strength[:, None]
    return Response(acceleration, -acceleration @ np.swapaxes(equations.reaction_per_acceleration, 1, 2))

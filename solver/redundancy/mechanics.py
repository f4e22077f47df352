"""A model in a motion: what the redundancy problem is built from.

Accelerations and joint reaction respond to activations and controls by affine maps. With x = (activations of the
muscles, controls of the actuators), q̈ = q̈₀ + A x and F = F₀ + A_F x. The response to a muscle is that to its path's
tension of 1 N times its active force.

Loads of forces that are left out of a model are computed as far as possible. The load of a force that the solver has is
computed. That of one it does not have is not known; the result shows how much of the forces that the motion needs is
left to reserve actuators.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from solver.errors import MotionError, SolverCode
from solver.model import CoordinateActuator, Model, ModelError
from solver.motion import Kinematics
from solver.multibody.dynamics import EquationsOfMotion, equations_of_motion, response_to_loads, responses_to
from solver.multibody.loads import ExternalForce, full_loads, load_wrenches, total_loads
from solver.multibody.postures import Postures, jacobians, postures
from solver.muscle import MuscleForceModel, MuscleForces, join_outcomes, modelled_forces
from solver.paths import PathMode, PathState, evaluate_paths
from solver.redundancy.glenoid import JOINT

if TYPE_CHECKING:
    from solver.multibody.mass_matrix import Responses

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Mechanics:
    """A model in a motion: everything that does not depend on the activations."""

    kinematics: Kinematics
    state: Postures
    paths: PathState
    forces: MuscleForces
    equations: EquationsOfMotion
    maps: ResponseMaps

    @property
    def muscle_outcomes(self) -> NDArray[np.object_]:
        """(frames, muscles) of MuscleOutcome."""
        return join_outcomes(self.paths, self.forces)


def evaluate_motion(
    model: Model,
    kinematics: Kinematics,
    paths: PathState | None = None,
    loads: Sequence[ExternalForce] = (),
    joint: str = JOINT,
    path_mode: PathMode = "opensim",
    muscle_force_model: MuscleForceModel = "rigid_tendon",
) -> Mechanics:
    """Evaluate a motion; `paths` are those of another model with the same geometry, if already computed.

    Raises MotionError if the model cannot be evaluated in any posture. In a single one its maps are not finite.
    """
    state = postures(model, kinematics.positions, kinematics.speeds, kinematics.time)
    paths = paths or evaluate_paths(model, state, mode=path_mode)
    forces = modelled_forces(model, paths.lengths, paths.speeds, muscle_force_model)
    equations = equations_of_motion(model, state, joint)
    maps = response_maps(model, state, equations, paths, forces, load_wrenches(loads, state) if loads else None)
    is_finite = maps.is_finite
    if not is_finite.any():
        raise MotionError(
            f"the model {model.name} should have finite accelerations and has them in none of {len(is_finite)} "
            f"postures, the first at {kinematics.time[0]:g} s; use another motion",
            SolverCode.NO_ACCELERATIONS,
        )
    return Mechanics(kinematics, state, paths, forces, equations, maps.cleared(is_finite))


@dataclass(frozen=True, eq=False)
class ResponseMaps:
    """Accelerations and reaction as affine functions of x = (activations of the muscles, controls of the actuators).

    acceleration_at_rest      (frames, coordinates) at x = 0, with the passive forces of the muscles [rad/s², m/s²]
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
        sums = [part.reshape(len(part), -1).sum(axis=1) for part in parts]  # finite only if all their terms are
        is_finite: NDArray[np.bool_] = np.isfinite(np.array(sums)).all(axis=0)
        return is_finite

    def cleared(self, is_finite: NDArray[np.bool_]) -> ResponseMaps:
        """With NaN in the frames that are not finite: infinities would cause warnings in later products."""
        if is_finite.all():
            return self
        maps = replace(self, **{field.name: getattr(self, field.name).copy() for field in fields(self)})
        for field in fields(self):
            getattr(maps, field.name)[~is_finite] = np.nan
        return maps


def response_maps(
    model: Model,
    state: Postures,
    equations: EquationsOfMotion,
    paths: PathState,
    forces: MuscleForces,
    wrenches: Array | None = None,
) -> ResponseMaps:
    """The maps of the redundancy problem; wrenches (frames, bodies, 6) are loads besides the muscles, as of a suit."""
    driven = [one.coordinate if isinstance(one, CoordinateActuator) else 0 for one in model.actuators]
    strength = [one.optimal_force if isinstance(one, CoordinateActuator) else 0.0 for one in model.actuators]
    responses = responses_to(
        equations,
        paths.wrenches,
        paths.mobility_per_tension if paths.has_moving_points else None,  # else zero, and 4 kB per frame to read
        factors=forces.active,
        shares=forces.passive,
        driven=driven,
        strength=strength,
    )
    _set_bodily_actuators(model, state, equations, responses)
    acceleration = equations.acceleration_unloaded + responses.total_acceleration
    reaction = equations.reaction_unloaded + responses.total_reaction
    if wrenches is not None:
        loads = response_to_loads(equations, wrenches[:, None])
        acceleration, reaction = acceleration + loads.acceleration[:, 0], reaction + loads.reaction[:, 0]
    return ResponseMaps(
        acceleration_at_rest=acceleration,
        acceleration_per_control=responses.acceleration,
        reaction_at_rest=reaction,
        reaction_per_control=responses.reaction,
    )


def _set_bodily_actuators(model: Model, state: Postures, equations: EquationsOfMotion, responses: Responses) -> None:
    """Fill the columns of actuators that act on bodies, and not on a coordinate."""
    bodily = [(index, one) for index, one in enumerate(model.actuators) if not isinstance(one, CoordinateActuator)]
    if not bodily:
        return
    on_bodies = response_to_loads(equations, *full_loads([one for _, one in bodily], model, state))
    for found, (index, _) in enumerate(bodily):
        responses.acceleration[:, :, len(model.muscles) + index] = on_bodies.acceleration[:, found]
        responses.reaction[:, :, len(model.muscles) + index] = on_bodies.reaction[:, found]


def without_forces(model: Model, names: Sequence[str]) -> Model:
    """The model without its passive forces of these names; left_out names them. ModelError for a name it lacks."""
    known = [force.name for force in (*model.coordinate_forces, *model.forces)]
    unknown = sorted(set(names) - set(known))
    if unknown:
        raise ModelError(
            f"{model.name} has no spring, ligament, contact or other passive force {', '.join(unknown)} to leave out; "
            f"it has {', '.join(known) or 'none'}",
            SolverCode.UNKNOWN_NAME,
        )
    return replace(
        model,
        coordinate_forces=tuple(force for force in model.coordinate_forces if force.name not in names),
        forces=tuple(force for force in model.forces if force.name not in names),
        left_out=(*model.left_out, *dict.fromkeys(names)),
    )


def forces_of(model: Model, kinematics: Kinematics, name: str) -> Array:
    """(frames, coordinates) generalised force [N, N m] of the passive forces of that name in a motion."""
    state = postures(model, kinematics.positions, kinematics.speeds)
    chosen = replace(model, forces=tuple(force for force in model.forces if force.name == name))
    wrenches, forces = total_loads(chosen, state)
    forces = forces + _generalised(model, state, wrenches)
    for force in model.coordinate_forces:
        if force.name == name:
            q, u = state.coordinates[:, force.coordinate], state.speeds[:, force.coordinate]
            forces[:, force.coordinate] += force.at(q, u)
    return forces


def actuator_forces(model: Model, kinematics: Kinematics, forces: Array) -> Array:
    """(frames, coordinates) generalised force [N m, N] of all actuators, on coordinates and on bodies, in a motion.

    forces (frames, actuators) are those of Model.actuators [N m, N].
    """
    generalised = np.zeros((len(forces), len(model.coordinates)))
    state = postures(model, kinematics.positions, kinematics.speeds)
    for actuator, values in zip(model.actuators, forces.T, strict=True):
        if isinstance(actuator, CoordinateActuator):
            generalised[:, actuator.coordinate] += values
        elif actuator.optimal_force:
            control = (values / actuator.optimal_force)[:, None]
            wrenches, on_coordinates = full_loads([actuator], model, state)
            generalised += control * (on_coordinates[:, 0] + _generalised(model, state, wrenches[:, 0]))
    return generalised


def _generalised(model: Model, state: Postures, wrenches: Array) -> Array:
    forces: Array = np.einsum("fbi,fbij->fj", wrenches, jacobians(model, state))
    return forces

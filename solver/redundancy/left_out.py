"""Loads of forces that are left out of a model in a motion, as far as they can be computed.

The load of a force that the solver has is computed. That of one it does not have is not known; the result shows how
much of the forces that the motion needs is left to reserve actuators.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from solver.errors import SolverCode
from solver.model import CoordinateActuator, Model, ModelError
from solver.motion import Kinematics
from solver.multibody.force_element import full_loads, total_loads
from solver.multibody.postures import Postures, jacobians, postures

Array = NDArray[np.float64]


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

"""Joint reactions of a solved motion: under the forces of its muscles, actuators and external loads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.model import CoordinateActuator, Model
from solver.multibody.external_loads import ExternalForce, load_wrenches
from solver.multibody.force_element import full_loads
from solver.multibody.joint_reactions import JointReactions, ReactionRequest, joint_reactions
from solver.redundancy.mechanics import Mechanics

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SolvedForces:
    """Forces of muscles (frames, muscles) [N] and actuators (frames, actuators) [N or N m], and the external loads."""

    muscles: Array
    actuators: Array
    loads: tuple[ExternalForce, ...]


def solved_reactions(
    model: Model, mechanics: Mechanics, solved: SolvedForces, request: ReactionRequest
) -> JointReactions:
    """The requested reactions. ModelError for a joint that the model does not have."""
    if not request.joints:
        moment, force, point = np.zeros((3, len(solved.muscles), 0, 3))
        return JointReactions((), moment, force, point)
    paths, state = mechanics.paths, mechanics.state
    forces = np.einsum("fm,fmj->fj", solved.muscles, paths.mobility_per_tension)
    wrenches = paths.wrenches.total(solved.muscles) + load_wrenches(solved.loads, state)
    for actuator, force in zip(model.actuators, solved.actuators.T, strict=True):
        if isinstance(actuator, CoordinateActuator):
            forces[:, actuator.coordinate] += force
        else:
            control = force / actuator.optimal_force
            on_bodies, on_coordinates = full_loads([actuator], model, state)
            wrenches += on_bodies[:, 0] * control[:, None, None]
            forces += on_coordinates[:, 0] * control[:, None]
    return joint_reactions(model, state, mechanics.equations, wrenches, forces, request)


def reaction_on_parent(model: Model, mechanics: Mechanics, solved: SolvedForces, joint: str) -> Array:
    """(frames, 6) moment [N m] and force [N] on the parent of a joint, in ground."""
    found = solved_reactions(model, mechanics, solved, ReactionRequest((joint,), "parent"))
    return np.concatenate([found.moment[:, 0], found.force[:, 0]], axis=-1)

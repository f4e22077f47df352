"""A model in a motion: what the redundancy problem is built from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.errors import MotionError, SolverCode
from solver.model import Model
from solver.motion import Kinematics
from solver.multibody.dynamics import EquationsOfMotion, equations_of_motion
from solver.multibody.external_loads import ExternalForce, load_wrenches
from solver.multibody.postures import Postures, postures
from solver.muscle import MuscleForces, join_outcomes
from solver.paths import PathMode, PathState, evaluate_paths
from solver.redundancy.glenoid import JOINT
from solver.redundancy.response_maps import ResponseMaps, response_maps
from solver.static_forces import MuscleForceModel, modelled_forces


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

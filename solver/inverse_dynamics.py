"""Inverse dynamics: the generalised forces that produce a motion under external loads.

    τ = M q̈ + c − Σ Jᵀ w

with the mass matrix M, the bias c of velocities, gravity and passive forces, and the wrenches w of the loads. Muscles
and actuators do not act. As in OpenSim's InverseDynamicsTool, constraints do not act either: τ of a coupled or locked
coordinate is the one that its motion would need without the constraint.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from solver.model import Model
from solver.motion import Kinematics
from solver.multibody.dynamics import mass_matrix_and_bias_force
from solver.multibody.external_loads import ExternalForce, load_wrenches
from solver.multibody.postures import postures
from solver.multibody.rotations import rotate
from solver.multibody.tables import tables_of

Array = NDArray[np.float64]


def inverse_dynamics(model: Model, kinematics: Kinematics, loads: Sequence[ExternalForce] = ()) -> Array:
    """τ (frames, coordinates) [N m for angles, N for translations]; loads are sampled at the frames of the motion.

    Bodies may lack mass: nothing is inverted.
    """
    state = postures(model, kinematics.positions, kinematics.speeds, kinematics.time)
    mass_matrix, bias_force = mass_matrix_and_bias_force(model, state)
    forces = rotate(mass_matrix, kinematics.accelerations) + bias_force
    if loads:
        beyond = tables_of(model).moves.T @ load_wrenches(loads, state)  # of each coordinate
        forces -= (beyond * state.screws).sum(axis=-1)
    return forces

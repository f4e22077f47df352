"""The muscle-redundancy problem: load sharing among the muscles, frame by frame (Belli et al. 2023, "RMR").

With x = (activations a of the muscles, controls r of the actuators), in each frame

    minimise  Σ w aᵖ + Σ w r²   subject to   A x = q̈ − q̈₀,   lower ≤ x ≤ upper,   F₀ + A_F x in the glenoid's cone

with p = 2; q̈₀ and F₀ are accelerations and glenohumeral reaction at x = 0. The effort is (10), the constraints are (11)
of the source study (docs/architecture.md). Bounds follow the activation dynamics from one frame to the next. A has rank
14 in 17 rows: the acromioclavicular constraint determines three combinations of accelerations, which no muscle changes.
The projection of q̈ − q̈₀ onto the column space of A is satisfied; the rest is reported per frame as the equality
residual.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.errors import SolverCode
from solver.model import Model, ModelError
from solver.redundancy.glenoid import cone_rows, glenoid_cone
from solver.redundancy.mechanics import Mechanics
from solver.redundancy.options import (
    Exponent,
    RedundancyOptions,
    Solver,
    activation_limits,
    effort_weights,
    tracked_coordinates,
)
from solver.redundancy.reachability import idle_controls

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RedundancyProblem:
    """The matrices of every frame; loads and bounds are left open, so one problem serves many scenarios.

    time            (frames,) [s];  interval [s] over which activations may change
    weights         (controls,);  reserves come after the muscles
    time_constants  (2, muscles) of activation and deactivation [s]; 0 without activation dynamics
    acceleration_matrix  A (frames, tracked, controls);  acceleration_target  q̈ − q̈₀ (frames, tracked) [rad/s², m/s²]
    tracked         (coordinates,) whether the acceleration is tracked: not of free ones, nor where a lock or a coupler
                    determines it
    reaction_matrix A_F (frames, 6, controls);  reaction_at_rest  F₀ (frames, 6) moment [N m], force [N] in ground
    cone            (frames, k, 3) rows that turn the force into (s, v); k = 3, or 0 without the glenoid
    solver, exponent  as in RedundancyOptions
    control_limits  (2, actuators) least and greatest control; None is no limits
    has_activation_dynamics  False where every frame is solved by itself
    activation_limits  (2, muscles) least and greatest activation; None is 0 and 1
    """

    time: Array
    interval: float
    weights: Array
    time_constants: Array
    acceleration_matrix: Array
    acceleration_target: Array
    tracked: NDArray[np.bool_]
    reaction_matrix: Array
    reaction_at_rest: Array
    cone: Array
    solver: Solver = "interior_point"
    control_limits: Array | None = None
    exponent: Exponent = 2
    has_activation_dynamics: bool = True
    activation_limits: Array | None = None

    def effort_of(self, controls: Array) -> Array:
        """Terms of the effort of x (…, controls), or of its muscles alone: w aᵖ, then w r² of the actuators; (10)."""
        terms: Array = self.weights[: controls.shape[-1]] * controls**2
        if self.exponent == 3:
            muscles = self.time_constants.shape[1]
            terms[..., :muscles] *= controls[..., :muscles]
        return terms

    @property
    def is_finite(self) -> NDArray[np.bool_]:
        """(frames,) False where the model has no finite accelerations, and nothing is solved."""
        known = np.concatenate([self.acceleration_target, self.reaction_at_rest], axis=-1)
        is_finite: NDArray[np.bool_] = np.isfinite(known).all(axis=-1)
        return is_finite


def build_redundancy(model: Model, mechanics: Mechanics, options: RedundancyOptions) -> RedundancyProblem:
    """Build the problem of all frames, without loads. ModelError for a model without muscles, or for unknown names.

    Columns of an actuator that are round-off, as on a locked coordinate, are set to zero; its control is 0 there.
    """
    if not model.muscles:
        raise ModelError(f"the model {model.name} should have muscles and has none; use another", SolverCode.NO_MUSCLES)
    kinematics, maps = mechanics.kinematics, mechanics.maps
    tracked = tracked_coordinates(model, options)
    matrix, reaction_matrix = maps.acceleration_per_control, maps.reaction_per_control
    if not tracked.all():  # else not a copy
        matrix = matrix[:, tracked]
    is_idle = idle_controls(matrix, reaction_matrix)
    is_idle[:, : len(model.muscles)] = False
    if is_idle.any():
        matrix, reaction_matrix = (np.where(is_idle[:, None], 0.0, part) for part in (matrix, reaction_matrix))
    cone = np.zeros((len(kinematics.time), 0, 3))
    if options.has_glenoid_cone:
        glenoid = glenoid_cone(model, options.glenoid_aspect, options.joint)
        cone = cone_rows(glenoid, mechanics.state.rotation_to_ground[:, glenoid.body])
    return RedundancyProblem(
        time=kinematics.time,
        interval=kinematics.interval,
        weights=effort_weights(model, options),
        time_constants=np.array(
            [
                [muscle.activation_time_constant for muscle in model.muscles],
                [muscle.deactivation_time_constant for muscle in model.muscles],
            ]
        ),
        acceleration_matrix=matrix,
        acceleration_target=(kinematics.accelerations - maps.acceleration_at_rest)[:, tracked],
        tracked=tracked,
        reaction_matrix=reaction_matrix,
        reaction_at_rest=maps.reaction_at_rest,
        cone=cone,
        solver=options.solver,
        control_limits=np.array([[actuator.min_control, actuator.max_control] for actuator in model.actuators])
        .reshape(-1, 2)
        .T,
        exponent=options.exponent,
        has_activation_dynamics=options.has_activation_dynamics,
        activation_limits=activation_limits(model) if options.has_muscle_limits else None,
    )

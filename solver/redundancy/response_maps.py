"""Response of accelerations and joint reaction to activations and controls: the affine maps of the redundancy problem.

With x = (activations of the muscles, controls of the actuators), q̈ = q̈₀ + A x and F = F₀ + A_F x. The response to a
muscle is that to its path's tension of 1 N times its active force.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from solver.model import CoordinateActuator, Model
from solver.multibody.dynamics import EquationsOfMotion, response_to_loads, responses_to
from solver.multibody.force_element import full_loads
from solver.multibody.postures import Postures
from solver.muscle import MuscleForces
from solver.paths import PathState

if TYPE_CHECKING:
    from solver.multibody.responses import Responses

Array = NDArray[np.float64]


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

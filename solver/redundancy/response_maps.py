"""Response of accelerations and joint reaction to activations and controls: the affine maps of the redundancy problem.

With x = (activations of the muscles, controls of the actuators), q̈ = q̈₀ + A x and F = F₀ + A_F x. The response to a
muscle is that to its path's tension of 1 N times its active force.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from solver.model import CoordinateActuator, Model
from solver.multibody.dynamics import EquationsOfMotion, Response, response_to_loads
from solver.multibody.force_element import full_loads
from solver.multibody.postures import Postures
from solver.muscle import MuscleForces
from solver.paths import PathState

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
        known = np.concatenate([part.reshape(len(part), -1) for part in parts], axis=1)
        is_finite: NDArray[np.bool_] = np.isfinite(known).all(axis=1)
        return is_finite

    def cleared(self, frames: NDArray[np.bool_]) -> ResponseMaps:
        """With NaN in these frames: infinities would cause warnings in later products."""
        maps = replace(self, **{field.name: getattr(self, field.name).copy() for field in fields(self)})
        for field in fields(self):
            getattr(maps, field.name)[frames] = np.nan
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
    muscles = response_to_loads(equations, paths.wrench_per_tension, paths.mobility_per_tension)
    actuators = _actuator_response(model, state, equations)
    passive = forces.passive[..., None]
    acceleration = equations.acceleration_unloaded + (muscles.acceleration * passive).sum(axis=1)
    reaction = equations.reaction_unloaded + (muscles.reaction * passive).sum(axis=1)
    if wrenches is not None:
        loads = response_to_loads(equations, wrenches[:, None])
        acceleration, reaction = acceleration + loads.acceleration[:, 0], reaction + loads.reaction[:, 0]
    active = forces.active[..., None]
    per_control = np.concatenate([muscles.acceleration * active, actuators.acceleration], axis=1)
    reaction_per_control = np.concatenate([muscles.reaction * active, actuators.reaction], axis=1)
    return ResponseMaps(
        acceleration_at_rest=acceleration,
        acceleration_per_control=np.swapaxes(per_control, 1, 2),
        reaction_at_rest=reaction,
        reaction_per_control=np.swapaxes(reaction_per_control, 1, 2),
    )


def _actuator_response(model: Model, state: Postures, equations: EquationsOfMotion) -> Response:
    """That of each actuator's full control."""
    on_coordinates = _coordinate_response(model, equations)
    bodily = [(index, one) for index, one in enumerate(model.actuators) if not isinstance(one, CoordinateActuator)]
    if not bodily:
        return on_coordinates
    on_bodies = response_to_loads(equations, *full_loads([one for _, one in bodily], model, state))
    for found, index in enumerate(index for index, _ in bodily):
        on_coordinates.acceleration[:, index] = on_bodies.acceleration[:, found]
        on_coordinates.reaction[:, index] = on_bodies.reaction[:, found]
    return on_coordinates


def _coordinate_response(model: Model, equations: EquationsOfMotion) -> Response:
    """A force on one coordinate is a row of P, times its size; 0 for other actuators."""
    driven = [one.coordinate if isinstance(one, CoordinateActuator) else 0 for one in model.actuators]
    strength = [one.optimal_force if isinstance(one, CoordinateActuator) else 0.0 for one in model.actuators]
    acceleration = equations.mobility[:, driven] * np.array(strength)[:, None]
    return Response(acceleration, -acceleration @ np.swapaxes(equations.reaction_per_acceleration, 1, 2))

"""Reserve actuators: generalised forces on single coordinates, for what muscles do not supply."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from solver.model import CoordinateActuator, Model


@dataclass(frozen=True)
class Reserve:
    """An actuator that gives optimal_force [N or N m] at x = 1, and keeps x within its limits."""

    optimal_force: float
    min_control: float = -np.inf
    max_control: float = np.inf


def with_reserves(model: Model, reserves: Mapping[str, Reserve]) -> Model:
    """The model with such an actuator on each of these coordinates, by name.

    It replaces the actuator of the coordinate if there is one. Raises ModelError where there is no such coordinate.
    """
    named = {model.coordinate_index(name): reserve for name, reserve in reserves.items()}
    kept = tuple(
        actuator
        for actuator in model.actuators
        if not (isinstance(actuator, CoordinateActuator) and actuator.coordinate in named)
    )
    added = tuple(
        CoordinateActuator(model.coordinate_names[coordinate] + "_reserve", coordinate, **vars(reserve))
        for coordinate, reserve in named.items()
    )
    return replace(model, actuators=kept + added)

"""Reserve actuators: generalised forces on single coordinates, for what muscles do not supply."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from solver.errors import SolverCode
from solver.model import CoordinateActuator, Model, ModelError
from solver.option_values import ensure_type


@dataclass(frozen=True)
class Reserve:
    """An actuator that gives optimal_force [N or N m] at x = 1, and keeps x within its limits."""

    optimal_force: float
    min_control: float = -np.inf
    max_control: float = np.inf

    def __post_init__(self) -> None:
        """Raise ModelError for values that effort.toml refuses, too."""
        if not (0.0 < self.optimal_force < np.inf and self.min_control <= 0.0 <= self.max_control):
            raise ModelError(
                f"a reserve should have a finite optimal_force above 0 and control limits around 0, and has "
                f"{self.optimal_force} and {self.min_control} to {self.max_control}; give others",
                SolverCode.WRONG_OPTION,
            )


def with_reserves(model: Model, reserves: Mapping[str, Reserve]) -> Model:
    """The model with such an actuator on each of these coordinates, by name: reserves [N m], residuals [N].

    It replaces the actuator of the coordinate if there is one. Raises ModelError where there is no such coordinate, and
    TypeError for arguments of another type.
    """
    ensure_type("model", model, Model, "a Model, as load_model(…) returns")
    ensure_type("reserves", reserves, Mapping, "a mapping from names of coordinates to Reserve")
    for reserve in reserves.values():
        ensure_type("reserves", reserve, Reserve, "a mapping from names of coordinates to Reserve")
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

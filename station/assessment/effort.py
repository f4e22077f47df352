"""Read effort.toml: weights of muscles and actuators, and reserve actuators.

    reserve_weight = 10.0
    unweighted_coordinates = ["elbow_flexion", "pro_sup"]     # whose actuators have no weight
    [weights]                                                 # single muscles, or coordinates for their actuators
    DeltoideusScapula_M = 2.0
    [reserves]                                                # replaces the actuator of the coordinate, if it has one
    shoulder_elv = { optimal_force = 20.0, min_control = -1.0, max_control = 1.0 }

Weights multiply squares of activations and controls, or cubes of activations with `--exponent 3`; a control of 1 gives
the optimal force, in N m or N.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from documents.plain_data import PlainDataError, read_toml
from documents.regular_file import describe_failure
from documents.validation import describe_error
from solver.model import Model
from solver.redundancy.redundancy_options import UNWEIGHTED_COORDINATES, RedundancyOptions, Reserve, with_reserves
from station.errors import StationError
from station.messages.codes import InputCode
from station.messages.message import Message

Weight = Annotated[float, Field(ge=0, allow_inf_nan=False)]


class EffortError(StationError):
    """The weights of the effort cannot be used."""


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class ReserveTable(_Table):
    optimal_force: Annotated[float, Field(gt=0, allow_inf_nan=False)]
    min_control: Annotated[float, Field(le=0)] = -inf
    max_control: Annotated[float, Field(ge=0)] = inf


class EffortWeights(_Table):
    muscle_weight: Weight = 1.0
    reserve_weight: Weight = 10.0
    unweighted_coordinates: tuple[str, ...] = UNWEIGHTED_COORDINATES
    weights: dict[str, Weight] = Field(default_factory=dict)
    reserves: dict[str, ReserveTable] = Field(default_factory=dict)

    def applied(self, model: Model, options: RedundancyOptions) -> tuple[Model, RedundancyOptions]:
        """The model with these reserves, the options with the weights in the file. ModelError for an unknown name."""
        if "unweighted_coordinates" in self.model_fields_set:
            for name in self.unweighted_coordinates:
                model.coordinate_index(name)
        reserves = {name: Reserve(**table.model_dump()) for name, table in self.reserves.items()}
        given = {name: getattr(self, name) for name in self.model_fields_set - {"reserves"}}
        return with_reserves(model, reserves), replace(options, **given)


def read_effort(path: Path) -> EffortWeights:
    """Read effort.toml. Raises EffortError."""
    try:
        return EffortWeights.model_validate(read_toml(path))
    except (OSError, PlainDataError) as error:
        reason = describe_failure(error)
        raise EffortError(Message(InputCode.EFFORT, {"path": str(path), "reason": reason})) from error
    except ValidationError as error:
        reason = describe_error(error)
        raise EffortError(Message(InputCode.EFFORT, {"path": str(path), "reason": reason})) from error

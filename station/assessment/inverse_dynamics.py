"""Inverse dynamics from files to a table with the columns of OpenSim's InverseDynamicsTool."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from solver.errors import MotionError, SolverCode
from solver.model import Coordinate
from solver.multibody.dynamics import inverse_dynamics
from solver.time_series_table import write_table
from station.assessment.given_motion import MotionCut, MuscleInputs, read_given_motion
from station.versions import solving_versions
from station.whole_file import drafted

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class GeneralisedForces:
    """Time (frames,) [s] and values (frames, columns) [N m, N]; `notes` reproduce them."""

    time: Array
    columns: tuple[str, ...]
    values: Array
    notes: Mapping[str, str]


def solve_inverse_dynamics(inputs: MuscleInputs, cut: MotionCut) -> GeneralisedForces:
    """Solve every frame. Raises ModelError or MotionError for files that cannot be used."""
    given = read_given_motion(inputs, cut, needs_paths=False)
    with np.errstate(over="ignore", invalid="ignore"):
        values = inverse_dynamics(given.model, given.kinematics, given.loads)
    is_finite = np.isfinite(values).all(axis=1)
    if not is_finite.all():
        raise MotionError(
            f"the generalised forces should be finite and are not at {given.kinematics.time[~is_finite][0]:g} s; check "
            "the motion and the loads there",
            SolverCode.NOT_FINITE,
        )
    made_by = {"made_by": "station id"}
    versions = {"versions": ", ".join(f"{name} {version}" for name, version in solving_versions().items())}
    left_out = {"left_out": ", ".join(given.model.left_out)} if given.model.left_out else {}
    columns = tuple(_column(coordinate) for coordinate in given.model.coordinates)
    notes = inputs.hashes() | made_by | versions | left_out | given.notes
    return GeneralisedForces(given.kinematics.time, columns, values, notes)


def write_inverse_dynamics(path: Path, found: GeneralisedForces) -> None:
    """Write a .csv, or a .sto for OpenSim."""
    with drafted(path) as draft:
        write_table(draft, found.columns, found.time, found.values, found.notes)


def _column(coordinate: Coordinate) -> str:
    """Name in OpenSim's results: a coordinate that is not an angle has a force."""
    return f"{coordinate.name}_{'moment' if coordinate.motion == 'rotation' else 'force'}"

"""What rmr found as one table, a row per frame: .csv, .sto as OpenSim reads it, or .parquet.

Activations stand under the names of their muscles, as in OpenSim's and the published files; everything else begins with
what it is and its unit: force_n.TRIlong, reserve_n_m.elbow_actuator, reaction_force_n.x.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from solver.motion import write_table
from station.exit_code import WRONG_USAGE
from station.muscles.rmr import STATUS, SolvedMotion
from station.whole_file import drafted

Array = NDArray[np.float64]

SUFFIXES = (".csv", ".sto", ".parquet")


class TableError(Exception):
    """The table cannot be written so; one sentence."""

    exit_code = WRONG_USAGE


@dataclass(frozen=True, eq=False)
class Column:
    """A quantity over time; values (frames,) in the unit."""

    name: str
    unit: str
    values: Array


def ensure_writable(path: Path) -> None:
    """Raises TableError for a name that says no format, before anything is computed."""
    if path.suffix not in SUFFIXES:
        raise TableError(f"the output should end in {', '.join(SUFFIXES)} and is {path.name}; choose one of these")


def write_solved(path: Path, solved: SolvedMotion) -> None:
    """Write all columns with the notes beside them, in the format that the suffix names."""
    ensure_writable(path)
    columns = tuple(solved_columns(solved))
    with drafted(path) as draft:
        if draft.suffix == ".parquet":
            _write_parquet(draft, solved, columns)
        else:
            values = np.column_stack([column.values for column in columns])
            write_table(draft, [column.name for column in columns], solved.solution.time, values, solved.notes)


def solved_columns(solved: SolvedMotion) -> Iterator[Column]:
    """Activations, forces, reserves, joint reaction and where it meets the glenoid, residuals and status."""
    model, found = solved.model, solved.solution
    muscles = model.muscle_names
    yield from _columns(muscles, "1", found.activations)
    yield from _columns([f"force_n.{name}" for name in muscles], "N", found.muscle_forces)
    yield from _columns([f"passive_force_n.{name}" for name in muscles], "N", found.passive_forces)
    for actuator, values in zip(model.actuators, found.reserves.T, strict=True):
        unit = reserve_unit(solved, actuator.coordinate)
        yield Column(f"reserve_{_suffix(unit)}.{actuator.name}", unit, values)
    yield from _columns([f"reaction_moment_n_m.{axis}" for axis in "xyz"], "N m", found.reaction[:, :3])
    yield from _columns([f"reaction_force_n.{axis}" for axis in "xyz"], "N", found.reaction[:, 3:])
    yield from _columns(["contact_m.along_edge", "contact_m.across"], "m", found.contact)
    yield Column("effort", "1", found.effort)
    yield Column("equality_residual", "rad/s² or m/s²", found.equality_residual)
    yield Column("cone_slack_n", "N", found.cone_slack)
    yield Column("status", "code", np.array([float(STATUS.index(outcome)) for outcome in found.outcomes]))


def reserve_unit(solved: SolvedMotion, coordinate: int) -> str:
    """Of the actuator of a coordinate; one that is neither angle nor distance has none of its own."""
    return {"rotation": "N m", "translation": "N", "coupled": "1"}[solved.model.coordinates[coordinate].motion]


def _columns(names: list[str] | tuple[str, ...], unit: str, values: Array) -> Iterator[Column]:
    return (Column(name, unit, column) for name, column in zip(names, values.T, strict=True))


def _suffix(unit: str) -> str:
    return {"N m": "n_m", "N": "n", "1": "coupled"}[unit]


def _write_parquet(path: Path, solved: SolvedMotion, columns: tuple[Column, ...]) -> None:
    import pyarrow as pa
    from pyarrow import parquet

    time = Column("time", "s", solved.solution.time)
    kinds = {"code": pa.int8()}
    fields = [
        pa.field(each.name, kinds.get(each.unit, pa.float64()), metadata={"unit": each.unit})
        for each in (time, *columns)
    ]
    arrays = [pa.array(each.values.astype("int8" if each.unit == "code" else float)) for each in (time, *columns)]
    parquet.write_table(pa.table(arrays, schema=pa.schema(fields, metadata=dict(solved.notes))), path)

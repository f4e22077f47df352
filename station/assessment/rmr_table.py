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
from station.assessment.rmr import STATUS, SolvedMotion
from station.errors import StationError
from station.exit_code import WRONG_USAGE
from station.whole_file import drafted

Array = NDArray[np.float64]

SUFFIXES = (".csv", ".sto", ".parquet")


class TableError(StationError):
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


def write_solved(path: Path, solved: SolvedMotion) -> str | None:
    """Write all columns with the notes beside them, in the format that the suffix names; a .sto holds finite numbers.

    Returns a sentence on what a .sto had to leave out, None where that is nothing.
    """
    ensure_writable(path)
    columns = tuple(solved_columns(solved))
    if path.suffix == ".parquet":
        with drafted(path) as draft:
            _write_parquet(draft, solved, columns)
        return None
    names, values, time = [column.name for column in columns], _stack(columns), solved.solution.time
    is_kept, left_out = np.ones(len(time), dtype=bool), ""
    if path.suffix == ".sto":
        columns, is_kept, left_out = _finite(columns, np.isfinite(solved.solution.effort), time)
        names, values = [column.name for column in columns], _stack(columns)
    notes = {**solved.notes, "left_out": left_out} if left_out else solved.notes
    with drafted(path) as draft:
        write_table(draft, names, time[is_kept], values[is_kept], notes)
    return f"{path.name} leaves out {left_out}, where OpenSim would stop reading" if left_out else None


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


def _stack(columns: tuple[Column, ...]) -> Array:
    return np.column_stack([column.values for column in columns])


def _finite(
    columns: tuple[Column, ...], is_solved: NDArray[np.bool_], time: Array
) -> tuple[tuple[Column, ...], NDArray[np.bool_], str]:
    """The columns that are finite in all solved frames, which frames are finite in these, and what else there was."""
    kept = tuple(column for column in columns if np.isfinite(column.values[is_solved]).all())
    is_kept: NDArray[np.bool_] = np.logical_and.reduce(np.isfinite(_stack(kept)), axis=1)
    dropped = [column.name for column in columns if column not in kept]
    parts = [f"the columns {', '.join(dropped)}"] if dropped else []
    if not is_kept.all():
        parts.append(f"{int((~is_kept).sum())} of {len(time)} frames, the first at {time[np.argmin(is_kept)]:g} s")
    return kept, is_kept, " and ".join(parts)


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

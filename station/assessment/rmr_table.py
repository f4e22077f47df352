"""The solution of rmr as one table, a row per frame: .csv, .sto as OpenSim reads it, or .parquet.

Activations have the names of their muscles, as in OpenSim and the published files; every other column begins with
quantity and unit: force_n.TRIlong, reserve_n_m.elbow_actuator, reaction_force_n.x.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from solver.model import Actuator, CoordinateActuator, Model
from solver.multibody.joint_reactions import JointReactions
from solver.muscle import MuscleOutcome
from solver.redundancy.glenoid import is_shoulder
from solver.time_series_table import write_table
from station.assessment.reserves import unit_of
from station.assessment.rmr import STATUS, SolvedMotion
from station.errors import StationError
from station.exit_code import WRONG_USAGE
from station.messages.codes import InputCode
from station.messages.message import Message
from station.whole_file import drafted

if TYPE_CHECKING:
    from solver.tendons.evaluation import ElasticForces  # the compiler behind it takes long to import

Array = NDArray[np.float64]

SUFFIXES = (".csv", ".sto", ".parquet")


class TableError(StationError):
    """The table cannot be written in this format."""

    exit_code = WRONG_USAGE


@dataclass(frozen=True, eq=False)
class Column:
    """A quantity over time; values (frames,) in the unit."""

    name: str
    unit: str
    values: Array


def ensure_table_format(path: Path) -> None:
    """Raise TableError for a name without a known suffix, before anything is computed."""
    if path.suffix not in SUFFIXES:
        raise TableError(
            Message(InputCode.TABLE_FORMAT, {"name": path.name or str(path), "suffixes": ", ".join(SUFFIXES)})
        )


def write_solved(path: Path, solved: SolvedMotion) -> str | None:
    """Write all columns and the notes, in the format of the suffix; a .sto holds finite numbers only.

    Returns a sentence on the columns and frames that a .sto leaves out, None if there are none.
    """
    ensure_table_format(path)
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
    return f"{path.name} leaves out {left_out}: OpenSim reads finite numbers only" if left_out else None


def solved_columns(solved: SolvedMotion) -> Iterator[Column]:
    """Activations, forces, reserves, joint reaction and its contact point on the glenoid, residuals and status."""
    model, solution = solved.model, solved.solution
    muscles = model.muscle_names
    yield from _columns(muscles, "1", solution.activations)
    yield from _columns([f"force_n.{name}" for name in muscles], "N", solution.muscle_forces)
    yield from _columns([f"passive_force_n.{name}" for name in muscles], "N", solution.passive_forces)
    if solution.fibers is not None:
        yield from _fibers(muscles, solution.fibers)
    for actuator, values in zip(model.actuators, solution.reserves.T, strict=True):
        unit = reserve_unit(model, actuator)
        yield Column(f"reserve_{_suffix(unit)}.{actuator.name}", unit, values)
    if is_shoulder(model, solved.options.joint):
        yield from _columns([f"reaction_moment_n_m.{axis}" for axis in "xyz"], "N m", solution.reaction[:, :3])
        yield from _columns([f"reaction_force_n.{axis}" for axis in "xyz"], "N", solution.reaction[:, 3:])
        yield from _columns(["contact_m.along_edge", "contact_m.across"], "m", solution.contact)
    yield from _joint_columns(solution.joint_reactions)
    yield Column("effort", "1", solution.effort)
    yield Column("equality_residual", "rad/s² or m/s²", solution.equality_residual)
    if solved.options.has_glenoid_cone:
        yield Column("cone_slack_n", "N", solution.cone_slack)
    yield Column("status", "code", np.array([float(STATUS.index(outcome)) for outcome in solution.outcomes]))
    unconverged = (solution.muscle_outcomes != MuscleOutcome.CONVERGED).sum(axis=1)
    yield Column("muscles_not_converged", "1", unconverged.astype(float))


def _joint_columns(reactions: JointReactions) -> Iterator[Column]:
    """Moment, force and point of every joint, by OpenSim's label."""
    parts = (
        ("moment_n_m", "N m", reactions.moment),
        ("force_n", "N", reactions.force),
        ("point_m", "m", reactions.point),
    )
    for place, label in enumerate(reactions.labels):
        for quantity, unit, values in parts:
            names = [f"reaction_{quantity}.{label}.{axis}" for axis in "xyz"]
            yield from _columns(names, unit, values[:, place])


def reserve_unit(model: Model, actuator: Actuator) -> str:
    """Unit of an actuator: N or N m."""
    if not isinstance(actuator, CoordinateActuator):
        return actuator.unit
    return unit_of(model, actuator.coordinate)


def _columns(names: list[str] | tuple[str, ...], unit: str, values: Array) -> Iterator[Column]:
    return (Column(name, unit, column) for name, column in zip(names, values.T, strict=True))


def _fibers(muscles: tuple[str, ...], fibers: ElasticForces) -> Iterator[Column]:
    """Of the muscles with elastic tendons."""
    chosen = fibers.elastic
    yield from _columns([f"fiber_length_m.{muscles[i]}" for i in chosen], "m", fibers.fiber_lengths[:, chosen])
    yield from _columns([f"tendon_strain.{muscles[i]}" for i in chosen], "1", fibers.tendon_strain[:, chosen])


def _stack(columns: tuple[Column, ...]) -> Array:
    return np.column_stack([column.values for column in columns])


def _finite(
    columns: tuple[Column, ...], is_solved: NDArray[np.bool_], time: Array
) -> tuple[tuple[Column, ...], NDArray[np.bool_], str]:
    """The columns that are finite in all solved frames, the frames that are finite in these, and the rest as a text."""
    kept = tuple(column for column in columns if np.isfinite(column.values[is_solved]).all())
    is_kept: NDArray[np.bool_] = np.logical_and.reduce(np.isfinite(_stack(kept)), axis=1)
    dropped = [column.name for column in columns if column not in kept]
    parts = [f"the columns {', '.join(dropped)}"] if dropped else []
    if not is_kept.all():
        parts.append(f"{int((~is_kept).sum())} of {len(time)} frames, the first at {time[np.argmin(is_kept)]:g} s")
    return kept, is_kept, " and ".join(parts)


def _suffix(unit: str) -> str:
    return {"N m": "n_m", "N": "n"}[unit]


def _write_parquet(path: Path, solved: SolvedMotion, columns: tuple[Column, ...]) -> None:
    import pyarrow as pa
    from pyarrow import parquet

    time = Column("time", "s", solved.solution.time)
    kinds = {"code": pa.int8()}
    fields = [
        pa.field(column.name, kinds.get(column.unit, pa.float64()), metadata={"unit": column.unit})
        for column in (time, *columns)
    ]
    arrays = [pa.array(column.values.astype("int8" if column.unit == "code" else float)) for column in (time, *columns)]
    parquet.write_table(pa.table(arrays, schema=pa.schema(fields, metadata=dict(solved.notes))), path)

"""External loads in OpenSim's files: an XML file of ExternalLoads, and the .mot or .sto data file that it names."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy

from solver.errors import MotionError, SolverCode
from solver.model import GROUND, Array, Model, ModelError
from solver.multibody.loads import ExternalForce
from solver.osim.document import Element, read_document
from solver.time_series_table import ensure_seconds, read_table

LONGEST_GAP = 10.0
"""In median steps. A spline across a longer one invents a force; OpenSim takes it without a message."""
LARGEST_LOAD = 1e9
"""[N, N m or m] Beyond any load in any unit; squares of far larger ones are not finite."""
WITHOUT_EFFECT = {"data_source_name": ".*", "lowpass_cutoff_frequency_for_load_kinematics": ".*"}
"""Elements, and the texts of them that change no load: OpenSim filters the kinematics of a file that is not used."""
SOUGHT = (
    *(f"{what}_identifier" for what in ("force", "torque", "point")),
    *(f"{what}_expressed_in_body" for what in ("force", "point")),
)
"""Elements that read_external_loads uses."""
LEAST_RECORDED = 20
"""Rows. Fewer are written by hand, and as far apart as they need to be."""


@dataclass(frozen=True)
class LoadsDocument:
    """Contents of an ExternalLoads file beside its forces, for findings.

    on_ground      names of the loads that act on the ground, which do not move the model
    moved, unused  as Element.moved_files and Element.unused
    """

    on_ground: tuple[str, ...]
    moved: tuple[str, ...]
    unused: tuple[str, ...]


def data_file(path: Path) -> Path:
    """Path of the data file of an ExternalLoads file."""
    return _data_file(_loads(path))


def read_loads_document(path: Path) -> LoadsDocument:
    """Raises ModelError, with the line, for any other file."""
    loads = _loads(path)
    applied = [element for element in loads.members("objects") if _is_applied(element)]
    on_ground = tuple(element.name for element in applied if _body_name(element, "applied_to_body") == "ground")
    for element in applied:
        element.sought.update(SOUGHT)
    _data_file(loads)
    return LoadsDocument(on_ground, tuple(loads.moved_files()), tuple(loads.unused(WITHOUT_EFFECT)))


def read_external_loads(path: Path, model: Model, time: Array) -> tuple[ExternalForce, ...]:
    """Forces of an ExternalLoads file at times (frames,) [s], without those that are switched off.

    The data file is interpolated as by OpenSim: by natural cubic splines, or linearly if it has fewer than four rows. A
    point that is not a number while the force is 0, as programs write a centre of pressure without contact, is
    interpolated; OpenSim reads no such file.
    Raises ModelError, with the line, for a body or function that the model lacks, MotionError if data are missing or
    do not cover the times.
    """
    loads = _loads(path)
    forces = [element for element in loads.members("objects") if _is_applied(element)]
    data = _Data.read(_data_file(loads), time)
    return tuple(_force(element, model, data) for element in forces)


@dataclass(frozen=True, eq=False)
class _Data:
    """Columns of a data file, and their values (frames, columns) at the times of the motion; largest (columns,) value
    of every column, which is 0 throughout where that is beyond LARGEST_LOAD; recorded (rows, columns), where a number
    may be missing.
    """

    name: str
    columns: list[str]
    values: Array
    largest: Array
    recorded: Array

    @staticmethod
    def read(path: Path, time: Array) -> _Data:
        columns, table, _ = read_table(path, may_have_gaps=True)
        if columns[0] != "time" or not np.all(np.diff(table[:, 0]) > 0):
            raise MotionError(
                f"{path.name} should begin with a column time that increases, and does not; check it",
                SolverCode.MALFORMED_TABLE,
            )
        ensure_seconds(path, table[:, 0], time)
        _ensure_covered(path, table[:, 0], time)
        _ensure_no_gap(path, table[:, 0], time)
        filled = _without_gaps(table)
        largest = np.abs(filled).max(axis=0)
        largest[0] = 0.0  # times since 1970 are as large
        values = _interpolated(np.where(largest > LARGEST_LOAD, 0.0, filled), time)
        return _Data(path.name, columns, values, largest, table)

    def vectors(self, element: Element, identifier: str) -> Array:
        """(frames, 3) of the three columns whose names begin with the identifier, in the file's order."""
        if not identifier:
            return np.zeros((len(self.values), 3))
        found = [i for i, column in enumerate(self.columns) if column.startswith(identifier)]
        if len(found) != 3:
            raise element.refusal(
                f"needs three columns of {self.name} that begin with {identifier}, and there are {len(found)}; correct "
                "the identifier"
            )
        endings = [self.columns[i].removeprefix(identifier) for i in found]
        if sorted(endings) == ["x", "y", "z"] != endings:
            raise element.refusal(
                f"has the columns {', '.join(self.columns[i] for i in found)} of {self.name} in this order, in which "
                "OpenSim takes them for x, y and z; order them"
            )
        for i in found:
            if self.largest[i] > LARGEST_LOAD:
                raise MotionError(
                    f"{self.name} should have {self.columns[i]} below {LARGEST_LOAD:g} N, N m or m and has "
                    f"{self.largest[i]:.3g}; correct the value",
                    SolverCode.IMPOSSIBLE_VALUE,
                )
        return self.values[:, found]

    def ensure_known(self, force: str, torque: str, point: str) -> None:
        """Raise MotionError where force or torque is no number, or the point while there is a force."""
        forces, torques, points = (self._recorded(identifier) for identifier in (force, torque, point))
        is_lost = ~np.isfinite(forces).all(axis=1) | ~np.isfinite(torques).all(axis=1)
        is_lost |= ~np.isfinite(points).all(axis=1) & (forces != 0.0).any(axis=1)
        if is_lost.any():
            row = int(np.flatnonzero(is_lost)[0])
            raise MotionError(
                f"{self.name} should have finite numbers for {', '.join(filter(None, (force, torque, point)))} and has "
                f"none of one of them in frame {row + 1}, {self.recorded[row, 0]:g} s; write 0 for a force, and any "
                "point, without contact, or fill the gap",
                SolverCode.NOT_FINITE,
            )

    def _recorded(self, identifier: str) -> Array:
        """(rows, columns) of the identifier."""
        is_named = [bool(identifier) and column.startswith(identifier) for column in self.columns]
        return self.recorded[:, is_named]


def _without_gaps(table: Array) -> Array:
    """Numbers that are not finite between those of their column in linear interpolation, and 0 in a column of them."""
    if np.isfinite(table).all():
        return table
    filled = table.copy()
    for column in filled.T:
        is_known = np.isfinite(column)
        column[~is_known] = (
            np.interp(table[~is_known, 0], table[is_known, 0], column[is_known]) if is_known.any() else 0
        )
    return filled


def _interpolated(table: Array, time: Array) -> Array:
    """(frames, columns) of a table at other times than those of its first column; all columns in one spline."""
    if len(table) > 3:
        return np.asarray(scipy.interpolate.CubicSpline(table[:, 0], table, bc_type="natural")(time))
    return np.column_stack([np.interp(time, table[:, 0], column) for column in table.T])


def _loads(path: Path) -> Element:
    if path.suffix.lower() in (".mot", ".sto", ".csv"):
        raise ModelError(
            f"{path.name} should be OpenSim's ExternalLoads (.xml), which names this table and the bodies that its "
            "columns act on; write one and give it",
            SolverCode.WRONG_DOCUMENT,
        )
    document = read_document(path)
    loads = document.own("ExternalLoads")
    if loads is None:
        raise document.refusal("has no ExternalLoads; give OpenSim's file of external loads", SolverCode.WRONG_DOCUMENT)
    return loads


def _ensure_covered(path: Path, given: Array, time: Array) -> None:
    first, last = given[[0, -1]]
    slight = 1e-9 * max(1.0, abs(last))
    covered = time[(time >= first - slight) & (time <= last + slight)]
    if len(covered) == len(time):
        return
    part = f"solve from {covered[0]:g} to {covered[-1]:g} s, or give longer data" if len(covered) else "give other data"
    raise MotionError(
        f"{path.name} should cover the motion, {time[0]:g} to {time[-1]:g} s, and has {first:g} to {last:g} s; {part}",
        SolverCode.NOT_COVERED,
    )


def _ensure_no_gap(path: Path, given: Array, time: Array) -> None:
    """Raise MotionError where a recording lacks samples between the first and the last of the times."""
    steps = np.diff(given)
    is_gap = (steps > LONGEST_GAP * np.median(steps)) & (given[:-1] < time[-1]) & (given[1:] > time[0])
    if len(given) < LEAST_RECORDED or not is_gap.any():
        return
    gap = int(np.flatnonzero(is_gap)[0])
    raise MotionError(
        f"{path.name} should cover the motion without a gap and has no sample between {given[gap]:g} and "
        f"{given[gap + 1]:g} s; fill the gap, or solve the time before or after it",
        SolverCode.NOT_COVERED,
    )


def _is_applied(element: Element) -> bool:
    if element.tag != "ExternalForce":
        raise element.unsupported("load", "ExternalForce")
    return element.flag("appliesForce", "true") and not element.flag("isDisabled")


def _data_file(loads: Element) -> Path:
    found = loads.named_file("datafile")
    if found is None:
        raise loads.refusal("names no <datafile>; add the file that holds the columns")
    if not os.path.exists(found):  # noqa: PTH110  (False also for a name that is too long)
        complaint = (
            f"names {loads.word('datafile', '')}, which is not there; correct the path, or put it beside {loads.file}"
        )
        raise loads.child("datafile").refusal(complaint, SolverCode.UNREADABLE_TABLE)
    return found


def _force(element: Element, model: Model, data: _Data) -> ExternalForce:
    force, torque, point = (_identifier(element, key) for key in ("force", "torque", "point"))
    if not force and not torque:
        raise element.refusal("names neither force nor torque; add a <force_identifier> or a <torque_identifier>")
    if point and not force:
        raise element.refusal("names a point and no force; add a <force_identifier> or take the point away")
    data.ensure_known(force, torque, point)
    body = _body(element, "applied_to_body", model)
    return ExternalForce(
        name=element.name,
        body=body,
        axes=_body(element, "force_expressed_in_body", model),
        force=data.vectors(element, force),
        torque=data.vectors(element, torque),
        origin=_body(element, "point_expressed_in_body", model) if point else body,
        point=data.vectors(element, point),
    )


def _identifier(element: Element, what: str) -> str:
    text = element.word(f"{what}_identifier", "")
    return "" if text == "Unassigned" else text


def _body(element: Element, socket: str, model: Model) -> int:
    """Index of the body of that name or path; an empty name is the ground, as in OpenSim."""
    name = _body_name(element, socket)
    names = [body.name for body in model.bodies]
    if name in names:
        return names.index(name)
    if not name and socket != "applied_to_body":
        return GROUND
    raise element.refusal(
        f"has {f'the {socket} {name}' if name else f'no {socket}'}, and the model {model.name} has {', '.join(names)}; "
        "use one of these",
        SolverCode.UNKNOWN_NAME,
    )


def _body_name(element: Element, socket: str) -> str:
    return element.word(socket, "").removeprefix("/bodyset/").removeprefix("/")

"""OpenSim's set-up of inverse kinematics, read and written: tasks for markers and coordinates with their weights."""

from __future__ import annotations

import os
import xml.etree.ElementTree as Xml
from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from solver.errors import MotionError, SolverCode
from solver.functions.coordinate_functions import natural_spline
from solver.inverse_kinematics.solve import TrackingTasks
from solver.model import Model, ModelError
from solver.osim.document import Element, read_document
from solver.osim.elements import VERSION, add, add_values
from solver.time_series_table import read_table

Array = NDArray[np.float64]


WITHOUT_EFFECT = {
    "accuracy": ".*",
    "constraint_weight": r"\+?inf(inity)?",
    "optimizer_algorithm": ".*",
    "output_motion_file": ".*",
    "report_errors": ".*",
    "report_marker_locations": ".*",
    "results_directory": ".*",
}
"""Elements of the tool, and the texts of them that do not change the postures: outputs, and constraints that hold."""


@dataclass(frozen=True)
class CoordinateTask:
    """Weight [m²/rad²] and target value [rad or m] of a coordinate; None takes the value from the coordinate file."""

    weight: float
    value: float | None
    is_default: bool = False


@dataclass(frozen=True)
class IkSetup:
    """An InverseKinematicsTool. Names without a task are not tracked; files are as the set-up names them.

    time_range  first and last second that are solved
    unused      what the file has and is not used, as Element.unused;  moved: Element.moved_files
    """

    time_range: tuple[float, float]
    markers: dict[str, float]
    coordinates: dict[str, CoordinateTask]
    model_file: Path | None
    marker_file: Path | None
    coordinate_file: Path | None
    unused: tuple[str, ...] = ()
    moved: tuple[str, ...] = ()

    @property
    def files(self) -> tuple[Path | None, ...]:
        """The files that it names."""
        return self.model_file, self.marker_file, self.coordinate_file

    def tasks(self, model: Model, labels: Collection[str], time: Array) -> TrackingTasks:
        """The tasks that model and markers have, at times (frames,) [s]; those for what one of them lacks are left out,
        as in OpenSim. Raises ModelError where none is left, MotionError for the coordinates' file.
        """
        known = {marker.name for marker in model.markers}
        names = [name for name, weight in self.markers.items() if name in known and name in labels and weight > 0]
        if not names:
            raise ModelError(
                f"no marker is tracked: the set-up has {_listed(self.markers)}, the model {_listed(known)}, the "
                f"markers' file {_listed(labels)}; make the names agree",
                SolverCode.NO_MARKERS,
            )
        weights = np.array([self.markers[name] for name in names])
        followed = {
            name: task for name, task in self.coordinates.items() if task.weight > 0 and name in model.coordinate_names
        }
        targets = {name: self._target(model, name, task, time) for name, task in followed.items()}
        pulls = {name: task.weight for name, task in followed.items()}
        return TrackingTasks(tuple(model.marker(name) for name in names), weights, pulls, targets)

    def without_place(self, model: Model) -> tuple[str, ...]:
        """Names of tracked markers and coordinates that the model lacks."""
        known = {marker.name for marker in model.markers}.union(model.coordinate_names)
        tracked = [name for name, weight in self.markers.items() if weight > 0]
        tracked += [name for name, task in self.coordinates.items() if task.weight > 0]
        return tuple(name for name in tracked if name not in known)

    def _target(self, model: Model, name: str, task: CoordinateTask, time: Array) -> Array | float:
        coordinate = model.coordinates[model.coordinate_index(name)]
        if task.is_default:
            return coordinate.default
        if task.value is not None:
            return task.value
        if self.coordinate_file is None:
            raise ModelError(
                f"the task of {name} takes its value from a file, and the set-up names none; name it",
                SolverCode.MALFORMED,
            )
        columns, table, header = read_table(self.coordinate_file)
        if name not in columns or len(table) < 4:
            raise MotionError(
                f"{self.coordinate_file.name} should have a column {name} of four rows; add it",
                SolverCode.MISSING_COLUMN,
            )
        scale = np.pi / 180 if header.in_degrees and coordinate.motion == "rotation" else 1.0
        spline = natural_spline(table[:, 0], scale * table[:, columns.index(name)], 2)
        values: Array = spline.derivatives(time)[0]
        return values


def read_ik_setup(path: Path) -> IkSetup:
    """Read an InverseKinematicsTool. Raises ModelError, with the line, for any other file."""
    tool = read_document(path).own("InverseKinematicsTool")
    if tool is None:
        raise ModelError(
            f"{path.name} should have an InverseKinematicsTool and has none; give OpenSim's set-up of one",
            SolverCode.WRONG_DOCUMENT,
        )
    setup = ik_setup_of(tool)
    return replace(setup, unused=tuple(tool.unused(WITHOUT_EFFECT)), moved=tuple(tool.moved_files()))


def ik_setup_of(tool: Element) -> IkSetup:
    """Set-up of an element with an IKTaskSet: an InverseKinematicsTool, or the MarkerPlacer of a ScaleTool."""
    kinds = ("IKMarkerTask", "IKCoordinateTask")
    tasks = [task for task in tool.objects("IKTaskSet") if task.tag in kinds and task.flag("apply", "true")]
    if not tasks:
        raise tool.refusal("has no task that is applied; add an IKTaskSet")
    first, last = tool.numbers("time_range", 2, "-inf inf", may_be_infinite=True)
    return IkSetup(
        (float(first), float(last)),
        {task.name: task.number("weight", "0") for task in tasks if task.tag == "IKMarkerTask"},
        {task.name: _coordinate_task(task) for task in tasks if task.tag == "IKCoordinateTask"},
        tool.named_file("model_file"),
        tool.named_file("marker_file"),
        tool.named_file("coordinate_file"),
    )


def ik_setup_of_tasks(model: Model, tasks: TrackingTasks, model_file: Path) -> IkSetup:
    """Set-up from tasks; marker weights are relative to the largest, which does not change the optimum.

    Raises ValueError for targets of coordinates that change from frame to frame.
    """
    largest = float(tasks.weights.max(initial=0.0)) or 1.0
    markers = {marker.name: weight / largest for marker, weight in zip(tasks.markers, tasks.weights, strict=True)}
    coordinates = {}
    for name, weight in tasks.coordinate_weights.items():
        default = model.coordinates[model.coordinate_index(name)].default
        target = np.asarray(tasks.coordinate_targets.get(name, default), dtype=np.float64)
        if target.ndim:
            raise ValueError(f"the target of {name} changes from frame to frame and cannot be written into a set-up")
        coordinates[name] = CoordinateTask(weight, float(target))
    return IkSetup((-np.inf, np.inf), markers, coordinates, model_file, None, None)


def ik_setup_document(setup: IkSetup, folder: Path, output_motion: str = "") -> Xml.Element:
    """The root of a document with an InverseKinematicsTool for OpenSim 4, to be stored in a folder.

    Files are named from there. output_motion is the file that OpenSim will write.
    """
    root = Xml.Element("OpenSimDocument", Version=VERSION)
    tool = add(root, "InverseKinematicsTool", "inverse_kinematics")
    add_file(tool, "model_file", setup.model_file, folder)
    add_values(tool, time_range=setup.time_range, output_motion_file=output_motion)
    add_tasks(tool, setup)
    add_file(tool, "marker_file", setup.marker_file, folder)
    add_file(tool, "coordinate_file", setup.coordinate_file, folder)
    return root


def add_tasks(tool: Xml.Element, setup: IkSetup) -> None:
    """The IKTaskSet of a tool, every task applied."""
    objects = add(add(tool, "IKTaskSet", "tasks"), "objects")
    for name, weight in setup.markers.items():
        add_values(add(objects, "IKMarkerTask", name), apply="true", weight=weight)
    for name, task in setup.coordinates.items():
        kind = "default_value" if task.is_default else "from_file" if task.value is None else "manual_value"
        made = add(objects, "IKCoordinateTask", name)
        add_values(made, apply="true", weight=task.weight, value_type=kind)
        if task.value is not None:
            add_values(made, value=task.value)


def add_file(tool: Xml.Element, tag: str, file: Path | None, folder: Path) -> None:
    """Path of a file relative to the folder of the document, or OpenSim's "Unassigned"."""
    if file is None:
        add(tool, tag).text = "Unassigned"
        return
    try:
        add(tool, tag).text = Path(os.path.relpath(file, folder)).as_posix()
    except ValueError:  # on another drive of Windows
        add(tool, tag).text = file.resolve().as_posix()


def _coordinate_task(task: Element) -> CoordinateTask:
    kind, weight = task.word("value_type", "from_file"), task.number("weight", "0")
    if kind not in ("default_value", "manual_value", "from_file"):
        raise task.refusal(f"has value_type {kind}, expected default_value, manual_value or from_file")
    value = task.number("value", "0") if kind == "manual_value" else None
    return CoordinateTask(weight, value, kind == "default_value")


def _listed(names: Collection[str]) -> str:
    return ", ".join(sorted(names)) or "none"

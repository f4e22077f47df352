"""OpenSim's set-up of inverse kinematics: which markers and coordinates a motion is to follow, with which weights."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from solver.functions.coordinate import natural_spline
from solver.inverse_kinematics.solve import TrackingTasks
from solver.model import Model, ModelError
from solver.motion import MotionError, read_table
from solver.osim.document import Element, read_document

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CoordinateTask:
    """Weight [m²/rad²], and the value [rad or m] that the coordinate is pulled to: None from the coordinates' file."""

    weight: float
    value: float | None
    is_default: bool = False


@dataclass(frozen=True)
class IkSetup:
    """An InverseKinematicsTool. Names without a task are not followed; files are as the set-up names them.

    time_range  first and last second that are solved
    """

    time_range: tuple[float, float]
    markers: dict[str, float]
    coordinates: dict[str, CoordinateTask]
    model_file: Path | None
    marker_file: Path | None
    coordinate_file: Path | None

    def tasks(self, model: Model, labels: Collection[str], time: Array) -> TrackingTasks:
        """The tasks that model and markers have, at times (frames,) [s]; a task for a marker that one of them lacks is
        passed over, as in OpenSim. Raises ModelError where none is left, MotionError for the coordinates' file.
        """
        known = {marker.name for marker in model.markers}
        names = [name for name, weight in self.markers.items() if name in known and name in labels and weight > 0]
        if not names:
            raise ModelError(
                f"no marker is followed: the set-up has {_listed(self.markers)}, the model {_listed(known)}, the "
                f"markers' file {_listed(labels)}; make the names agree"
            )
        weights = np.array([self.markers[name] for name in names])
        followed = {name: task for name, task in self.coordinates.items() if task.weight > 0}
        targets = {name: self._target(model, name, task, time) for name, task in followed.items()}
        pulls = {name: task.weight for name, task in followed.items()}
        return TrackingTasks(tuple(model.marker(name) for name in names), weights, pulls, targets)

    def _target(self, model: Model, name: str, task: CoordinateTask, time: Array) -> Array | float:
        coordinate = model.coordinates[model.coordinate_index(name)]
        if task.is_default:
            return coordinate.default
        if task.value is not None:
            return task.value
        if self.coordinate_file is None:
            raise ModelError(f"the task of {name} takes its value from a file, and the set-up names none; name it")
        columns, table, in_degrees = read_table(self.coordinate_file)
        if name not in columns or len(table) < 4:
            raise MotionError(f"{self.coordinate_file.name} should have a column {name} of four rows; add it")
        scale = np.pi / 180 if in_degrees and coordinate.motion == "rotation" else 1.0
        spline = natural_spline(table[:, 0], scale * table[:, columns.index(name)], 2)
        values: Array = spline.derivatives(time)[0]
        return values


def read_ik_setup(path: Path) -> IkSetup:
    """Read an InverseKinematicsTool; ModelError, with the line, for what is none or cannot be read."""
    tool = read_document(path).find("InverseKinematicsTool")
    if tool is None:
        raise ModelError(f"{path.name} should hold an InverseKinematicsTool and does not; take OpenSim's set-up of it")
    return ik_setup_of(path, tool)


def ik_setup_of(path: Path, tool: Element) -> IkSetup:
    """Of the element of a file that holds an IKTaskSet: an InverseKinematicsTool, or a ScaleTool's MarkerPlacer."""
    tasks = [task for task in tool.objects("IKTaskSet") if task.word("apply", "true") == "true"]
    if not tasks:
        raise tool.refusal("has no task that is applied; add an IKTaskSet")
    first, last = tool.numbers("time_range", 2, "-inf inf")
    return IkSetup(
        (float(first), float(last)),
        {task.name: task.number("weight", "0") for task in tasks if task.tag == "IKMarkerTask"},
        {task.name: _coordinate_task(task) for task in tasks if task.tag == "IKCoordinateTask"},
        _file(path, tool, "model_file"),
        _file(path, tool, "marker_file"),
        _file(path, tool, "coordinate_file"),
    )


def _coordinate_task(task: Element) -> CoordinateTask:
    kind, weight = task.word("value_type", "from_file"), task.number("weight", "0")
    if kind not in ("default_value", "manual_value", "from_file"):
        raise task.refusal(f"has value_type {kind}, expected default_value, manual_value or from_file")
    value = task.number("value", "0") if kind == "manual_value" else None
    return CoordinateTask(weight, value, kind == "default_value")


def _file(path: Path, tool: Element, tag: str) -> Path | None:
    """As the set-up names it, from the folder that it is in."""
    named = tool.word(tag, "")
    return path.parent / named if named and named != "Unassigned" else None


def _listed(names: Collection[str]) -> str:
    return ", ".join(sorted(names)) or "none"

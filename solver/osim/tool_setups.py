"""OpenSim's set-ups of inverse kinematics and of scaling, read and written.

Inverse kinematics: tasks for markers and coordinates with their weights. Scaling: distances between markers and manual
factors of the bodies.
"""

from __future__ import annotations

import os
import xml.etree.ElementTree as Xml
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from solver.errors import MotionError, SolverCode
from solver.functions.coordinate_functions import natural_spline
from solver.inverse_kinematics.solve import TrackingTasks, assemble
from solver.model import Array, Model, ModelError
from solver.multibody.postures import points_in_ground, postures
from solver.osim.document import Element, read_document
from solver.osim.elements import VERSION, add, add_values
from solver.time_series_table import read_table

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
        return np.asarray(spline.derivatives(time)[0])


def read_ik_setup(path: Path) -> IkSetup:
    """Read an InverseKinematicsTool. Raises ModelError, with the line, for any other file."""
    document = read_document(path)
    tool = document.own("InverseKinematicsTool")
    if tool is None:
        raise ModelError(
            f"{path.name} should have an InverseKinematicsTool and has none; give OpenSim's set-up of one",
            SolverCode.WRONG_DOCUMENT,
        )
    setup = parse_ik_setup(tool)
    if not any(setup.markers.values()):
        sentence = "has no marker with a weight above 0; give one to its IKMarkerTasks"
        raise tool.refusal(sentence, SolverCode.NO_MARKERS)
    return replace(setup, unused=tuple(document.unused(WITHOUT_EFFECT)), moved=tuple(tool.moved_files()))


def parse_ik_setup(tool: Element) -> IkSetup:
    """Set-up of an element with an IKTaskSet: an InverseKinematicsTool, or the MarkerPlacer of a ScaleTool."""
    kinds = ("IKMarkerTask", "IKCoordinateTask")
    tasks = [task for task in tool.objects("IKTaskSet") if task.tag in kinds and task.flag("apply", "true")]
    if not tasks:
        raise tool.refusal("has no task that is applied; add an IKTaskSet")
    markers: dict[str, float] = {}
    coordinates: dict[str, CoordinateTask] = {}
    for task in tasks:
        if task.tag == "IKMarkerTask":
            markers.setdefault(task.name, task.not_negative("weight", "0"))  # OpenSim uses the first of a name
        elif task.name in coordinates:
            raise task.refusal("has a task for this coordinate above; keep one of them")
        else:
            coordinates[task.name] = _coordinate_task(task)
    return IkSetup(
        _time_range(tool),
        markers,
        coordinates,
        tool.named_file("model_file"),
        tool.named_file("marker_file"),
        tool.named_file("coordinate_file"),
    )


def ik_setup_from_tasks(model: Model, tasks: TrackingTasks, model_file: Path) -> IkSetup:
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


def _time_range(tool: Element) -> tuple[float, float]:
    """First and last second; the whole trial without one, or where both are −1, as OpenSim writes an unset range."""
    first, last = tool.numbers("time_range", 2, "-inf inf", may_be_infinite=True)
    return (-np.inf, np.inf) if first == last == -1 else (float(first), float(last))


def _coordinate_task(task: Element) -> CoordinateTask:
    kind, weight = task.word("value_type", "from_file"), task.not_negative("weight", "0")
    if kind not in ("default_value", "manual_value", "from_file"):
        raise task.refusal(f"has value_type {kind}, expected default_value, manual_value or from_file")
    value = task.number("value", "0") if kind == "manual_value" else None
    return CoordinateTask(weight, value, kind == "default_value")


def _listed(names: Collection[str]) -> str:
    return ", ".join(sorted(names)) or "none"


AXES = "XYZ"
WITHOUT_EFFECT_IN_SCALING = {
    "age": ".*",
    "height": ".*",
    "max_marker_movement": r"-.*",
    "move_model_markers": "true",
    "notes": ".*",
    "output_marker_file": ".*",
    "output_model_file": ".*",
    "output_motion_file": ".*",
    "output_scale_file": ".*",
}
"""Elements of the tool, and the texts of them that do not change the model: outputs, and what OpenSim only stores."""


@dataclass(frozen=True)
class Measurement:
    """Distances between markers, as pairs of names, and the axes (0, 1, 2) of each body that they scale."""

    name: str
    pairs: tuple[tuple[str, str], ...]
    axes: Mapping[str, tuple[int, ...]]

    def missing(self, at: Collection[str], seen: Mapping[str, Array]) -> list[str]:
        """Names of its markers that are not in the model (at), or never visible (seen, as of factor)."""
        names = dict.fromkeys(name for pair in self.pairs for name in pair)
        return [name for name in names if name not in at or name not in seen or not np.isfinite(seen[name]).any()]

    def factor(self, model: Model, at: Mapping[str, Array], seen: Mapping[str, Array]) -> float:
        """Mean over the pairs of the mean measured distance over the model's.

        at: name → (3,) in the model's default posture; seen: name → (frames, 3), NaN where hidden. Raises ModelError.
        """
        ratios = []
        for pair in self.pairs:
            for name in pair:
                if name not in at or name not in seen:
                    where = f"the model {model.name}" if name not in at else "the markers' file"
                    raise ModelError(
                        f"measurement {self.name} needs the marker {name}, which {where} lacks; add it",
                        SolverCode.UNKNOWN_NAME,
                    )
            apart = np.linalg.norm(seen[pair[0]] - seen[pair[1]], axis=1)
            if not np.isfinite(apart).any():
                raise ModelError(
                    f"measurement {self.name}: {' and '.join(pair)} are never visible together in the range; choose "
                    "another",
                    SolverCode.NOT_COVERED,
                )
            ratios.append(float(np.nanmean(apart) / np.linalg.norm(at[pair[0]] - at[pair[1]])))
        return float(np.mean(ratios))


@dataclass(frozen=True)
class ScaleSetup:
    """A ScaleTool. Files are as the set-up names them.

    order       of "measurements" and "manualScale", later ones overwrite;  manual: name of a body → its factors (3,)
    mass        of the scaled model [kg], None to keep what follows from the factors
    marker_set_file  a MarkerSet whose markers the generic model gets first
    time_range  first and last second of the markers;  placement: the tasks that place markers, None for none
    unused      what the file has and is not used, as Element.unused;  moved: Element.moved_files
    """

    measurements: tuple[Measurement, ...]
    manual: Mapping[str, Array]
    order: tuple[str, ...]
    mass: float | None
    keeps_masses: bool
    time_range: tuple[float, float]
    marker_file: Path | None
    model_file: Path | None
    placement: IkSetup | None
    marker_set_file: Path | None = None
    unused: tuple[str, ...] = ()
    moved: tuple[str, ...] = ()

    @property
    def files(self) -> tuple[Path | None, ...]:
        """The files that it names."""
        placed = () if self.placement is None else self.placement.files
        return self.model_file, self.marker_file, self.marker_set_file, *placed

    @property
    def marker_names(self) -> frozenset[str]:
        """Names of the markers in measurements and placement tasks."""
        measured = {name for measurement in self.measurements for pair in measurement.pairs for name in pair}
        placed = [] if self.placement is None else [name for name, weight in self.placement.markers.items() if weight]
        return frozenset(measured | set(placed))

    def for_model(self, model: Model, labels: Sequence[str], observed: Array) -> tuple[ScaleSetup, tuple[str, ...]]:
        """Without the bodies that the model lacks and the measurements whose markers it or the file lacks, and these.

        As OpenSim, which warns of them. A set-up of which no measurement is left stays as it is.
        """
        bodies, at = {body.name for body in model.bodies}, {marker.name for marker in model.markers}
        seen = {label: observed[:, k] for k, label in enumerate(labels)}
        missing = {measurement.name: measurement.missing(at, seen) for measurement in self.measurements}
        lacking = [f"measurement {name} ({', '.join(markers)})" for name, markers in missing.items() if markers]
        unknown = [body for measurement in self.measurements for body in measurement.axes if body not in bodies]
        unknown += [body for body in self.manual if body not in bodies]
        kept = tuple(
            replace(measurement, axes={body: axes for body, axes in measurement.axes.items() if body in bodies})
            for measurement in self.measurements
            if not missing[measurement.name] and bodies.intersection(measurement.axes)
        )
        if self.measurements and not kept:
            return self, ()
        manual = {body: factors for body, factors in self.manual.items() if body in bodies}
        return replace(self, measurements=kept, manual=manual), (*dict.fromkeys(unknown), *lacking)

    def factors(self, model: Model, labels: Sequence[str], observed: Array) -> dict[str, Array]:
        """Name of a body → (3,) along its axes, of observed markers (frames, labels, 3) [m] within the time range.

        Raises ModelError for a body or a marker that is missing.
        """
        seen = {label: observed[:, k] for k, label in enumerate(labels)}
        posture = assemble(model)[None]
        state = postures(model, posture, np.zeros_like(posture))
        at = {marker.name: points_in_ground(state, marker.body, marker.location)[0] for marker in model.markers}
        factors: dict[str, Array] = {}
        for step in self.order:
            if step == "measurements":
                for measurement in self.measurements:
                    factor = measurement.factor(model, at, seen)
                    for body, axes in measurement.axes.items():
                        factors.setdefault(body, np.ones(3))[list(axes)] = factor
            else:
                factors |= {body: given.copy() for body, given in self.manual.items()}
        for body in factors:
            model.body_index(body)
        return factors


def read_scale_setup(path: Path) -> ScaleSetup:
    """Read a ScaleTool. Raises ModelError, with the line, for any other file."""
    document = read_document(path)
    tool = document.own("ScaleTool")
    if tool is None:
        raise ModelError(
            f"{path.name} should have a ScaleTool and has none; give OpenSim's set-up of one", SolverCode.WRONG_DOCUMENT
        )
    scaler = tool.child("ModelScaler")
    order = tuple(scaler.word("scaling_order", "measurements manualScale").split())
    if set(order) - {"measurements", "manualScale"}:
        raise scaler.refusal(f"has scaling_order {' '.join(order)}, expected measurements and manualScale")
    mass = tool.number("mass", "-1")
    placer, maker = tool.find("MarkerPlacer"), tool.find("GenericModelMaker")
    is_placed = placer is not None and _is_applied(placer)
    setup = ScaleSetup(
        tuple(
            _measurement(measurement) for measurement in scaler.objects("MeasurementSet") if _is_applied(measurement)
        ),
        {_segment(scale): scale.numbers("scales", 3) for scale in scaler.objects("ScaleSet") if _is_applied(scale)},
        order if _is_applied(scaler) else (),
        mass if mass > 0 else None,
        scaler.flag("preserve_mass_distribution"),
        _time_range(scaler),
        scaler.named_file("marker_file"),
        maker.named_file("model_file") if maker is not None else None,
        parse_ik_setup(placer) if placer is not None and is_placed else None,
        maker.named_file("marker_set_file") if maker is not None else None,
    )
    return replace(setup, unused=tuple(document.unused(WITHOUT_EFFECT_IN_SCALING)), moved=tuple(tool.moved_files()))


def scale_setup_document(setup: ScaleSetup, folder: Path, output_model: str) -> Xml.Element:
    """The root of a document with a ScaleTool for OpenSim 4, to be stored in a folder; files are named from there.

    OpenSim does not scale the points that a constraint joins, so its body differs from ours there.
    """
    root = Xml.Element("OpenSimDocument", Version=VERSION)
    tool = add(root, "ScaleTool", "scaling")
    add_values(tool, mass=-1.0 if setup.mass is None else setup.mass)
    maker = add(tool, "GenericModelMaker")
    add_file(maker, "model_file", setup.model_file, folder)
    add_file(maker, "marker_set_file", setup.marker_set_file, folder)
    scaler = add(tool, "ModelScaler")
    add_values(scaler, apply="true", scaling_order=" ".join(setup.order))
    measurements = add(add(scaler, "MeasurementSet", "measurements"), "objects")
    for measurement in setup.measurements:
        _add_measurement(measurements, measurement)
    manual = add(add(scaler, "ScaleSet", "factors"), "objects")
    for body, factors in setup.manual.items():
        add_values(add(manual, "Scale", body), scales=factors, segment=body, apply="true")
    add_file(scaler, "marker_file", setup.marker_file, folder)
    keeps = "true" if setup.keeps_masses else "false"
    add_values(scaler, time_range=setup.time_range, preserve_mass_distribution=keeps, output_model_file=output_model)
    if setup.placement is not None:
        placer = add(tool, "MarkerPlacer")
        add_values(placer, apply="true")
        add_tasks(placer, setup.placement)
        add_file(placer, "marker_file", setup.placement.marker_file or setup.marker_file, folder)
        add_file(placer, "coordinate_file", setup.placement.coordinate_file, folder)
        add_values(placer, time_range=setup.placement.time_range, output_model_file=output_model)
    return root


def _add_measurement(objects: Xml.Element, measurement: Measurement) -> None:
    made = add(objects, "Measurement", measurement.name)
    add_values(made, apply="true")
    pairs = add(add(made, "MarkerPairSet"), "objects")
    for pair in measurement.pairs:
        add_values(add(pairs, "MarkerPair"), markers=" ".join(pair))
    bodies = add(add(made, "BodyScaleSet"), "objects")
    for body, axes in measurement.axes.items():
        add_values(add(bodies, "BodyScale", body), axes=" ".join(AXES[axis] for axis in axes))


def _measurement(element: Element) -> Measurement:
    pairs = []
    for pair in element.objects("MarkerPairSet"):
        names = pair.word("markers", "").split()
        if len(set(names)) != 2 or len(names) != 2:
            raise pair.refusal(f"should name two markers and names {' '.join(names) or 'none'}")
        pairs.append((names[0], names[1]))
    axes: dict[str, tuple[int, ...]] = {}
    for body in element.objects("BodyScaleSet"):
        axis_names = body.word("axes", "").upper().split()
        if not axis_names or set(axis_names) - set(AXES):
            raise body.refusal(f"should name axes of X, Y and Z and names {' '.join(axis_names) or 'none'}")
        axes[body.name] = (*axes.get(body.name, ()), *(AXES.index(axis) for axis in axis_names))
    if not pairs:
        raise element.refusal("has no pair of markers")
    return Measurement(element.name, tuple(pairs), axes)


def _segment(element: Element) -> str:
    return element.child("segment").text


def _is_applied(element: Element) -> bool:
    return element.flag("apply", "true")

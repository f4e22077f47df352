"""A generic model → a model of a person's size, by OpenSim's set-up of scaling."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from documents.message import Message
from recordings.exchange.sample_tables import MarkerTable
from solver.inverse_kinematics.solve import TrackingTasks
from solver.model import Array, Model
from solver.osim.model_writer import osim_document, read_marker_set, with_markers
from solver.osim.tool_setups import IkSetup, ScaleSetup, read_scale_setup, scale_setup_document
from solver.personalisation.coverage import check_coverage
from solver.scaling import Scaling, check_scaling, place_markers, scale_model
from station.kinematics.ik import ensure_common, frames_in, model_with_markers, named_file, write_xml
from station.kinematics.marker_checks import (
    Finding,
    KinematicsError,
    ensure_markers_fit,
    ensure_model_mass_fits,
    find_in_markers,
    find_never_seen,
    finding_lines,
    mass_findings,
    pose_findings,
    read_body_markers,
    seen_markers,
    setup_findings,
    unattached_findings,
    unused_findings,
)
from station.messages.kinematics_messages import KinematicsCode
from station.sources import BUNDLED

LEAST_FACTOR, MOST_FACTOR = 0.5, 2.0


@dataclass(frozen=True)
class ScaleInputs:
    """Files; model and markers may come from the set-up. scales_joined_points as in solver.scaling.Scaling; prefix
    stands before the labels of the person; marker_set as in station.kinematics.ik.IkInputs.
    """

    setup: Path
    model: str | None = None
    markers: Path | None = None
    scales_joined_points: bool = True
    prefix: str = ""
    marker_set: str = ""


@dataclass(frozen=True, eq=False)
class ScaledBody:
    """The scaled model, the factors (3,) of each body by name, and findings on what may be wrong with it.

    setup  what was scaled, as OpenSim's set-up
    """

    setup: ScaleSetup
    model: Model
    factors: dict[str, Array]
    findings: tuple[Finding, ...]
    notes: tuple[str, ...]


def scale_body(inputs: ScaleInputs) -> ScaledBody:
    """Raises KinematicsError, ModelError, MotionError, ForeignFile for files that do not fit together, PersonError for
    a pose or a mass that cannot be right.
    """
    setup = read_scale_setup(inputs.setup)
    name = str(inputs.model or named_file(inputs.setup, setup.model_file, "model", "--model"))
    generic, _, odd = model_with_markers(name, inputs.marker_set)
    if setup.marker_set_file is not None:
        added, unattached, unused = read_marker_set(setup.marker_set_file, generic)
        generic = with_markers(generic, added)
        odd += unattached_findings(setup.marker_set_file.name, unattached)
        odd += unused_findings(setup.marker_set_file.name, unused)
    file = inputs.markers or named_file(inputs.setup, setup.marker_file, "markers' file", "--markers")
    table = read_body_markers(file, [marker.name for marker in generic.markers], inputs.prefix)
    observed: Array = 1e-3 * table.positions[frames_in(file, table, setup.time_range)]
    setup, unknown = setup.for_model(generic, table.labels, observed)
    _ensure_markers_fit(generic, file, table, setup, observed)
    factors = setup.factors(generic, table.labels, observed)
    _ensure_plausible(file, setup, factors)
    scaling = Scaling(factors, setup.mass, setup.keeps_masses, inputs.scales_joined_points)
    scaled = scale_model(generic, scaling)
    findings = [*odd, *check_scaling(generic, scaled), *mass_findings(scaled)]
    if setup.mass is not None:
        ensure_model_mass_fits(scaled, setup.mass)
    findings += _marker_findings(generic, table, setup.marker_names)
    notes = table.notes
    if setup.placement is not None:
        unknown += setup.placement.without_place(generic)
        named = setup.placement.marker_file or file
        pose_file = inputs.markers or named_file(inputs.setup, named, "markers' file", "--markers")
        pose = table if pose_file == file else read_body_markers(pose_file, setup.placement.markers, inputs.prefix)
        kept = frames_in(pose_file, pose, setup.placement.time_range)
        findings += pose_findings(pose.labels, 1e-3 * pose.positions[kept])
        scaled = _with_placed_markers(scaled, setup.placement, pose, kept)
        setup = replace(setup, placement=replace(setup.placement, marker_file=pose_file))
        notes += pose.notes if pose is not table else ()
    findings += setup_findings(inputs.setup.name, setup, unknown)
    setup = replace(setup, model_file=None if name == BUNDLED else Path(name), marker_file=file)
    return ScaledBody(setup, scaled, factors, tuple(findings), (*notes, *left_out_notes(generic)))


def _with_placed_markers(scaled: Model, placement: IkSetup, pose: MarkerTable, kept: NDArray[np.bool_]) -> Model:
    """Markers at the mean of their positions in the kept frames of the pose, with coordinates of the first of them."""
    observed = 1e-3 * pose.positions[kept]
    with np.errstate(invalid="ignore"):
        counts = np.isfinite(observed).sum(axis=0)
        static = np.where(counts > 0, np.nansum(observed, axis=0) / np.maximum(counts, 1), np.nan)
    tasks = placement.tasks(scaled, pose.labels, pose.time_s[kept][:1])
    return place_markers(scaled, pose.labels, static, tasks)


def left_out_notes(generic: Model) -> list[str]:
    """A sentence on the parts of the file that the scaled model does not have."""
    left_out = ", ".join(generic.left_out)
    return [f"left out of the model, and not in the scaled one: {left_out}"] if left_out else []


def _ensure_markers_fit(generic: Model, file: Path, table: MarkerTable, setup: ScaleSetup, observed: Array) -> None:
    """Raises KinematicsError where the markers that the set-up uses are not those of such a body."""
    known = [marker.name for marker in generic.markers]
    ensure_common(file.name, table.labels, known, known)
    expected = [marker for marker in generic.markers if marker.name in setup.marker_names]
    there = tuple(marker for marker in expected if marker.name in table.labels)
    tasks = TrackingTasks(there, np.ones(len(there)))
    columns = [table.labels.index(marker.name) for marker in there]
    if there:  # otherwise the measurement names what it lacks
        ensure_markers_fit(generic, file.name, [marker.name for marker in expected], tasks, observed[:, columns])


def _marker_findings(model: Model, table: MarkerTable, expected: Collection[str]) -> list[Finding]:
    """Labels that are exchanged for a while, expected markers that no frame shows, and segments that the markers do not
    determine.
    """
    there = [marker for marker in model.markers if marker.name in table.labels]
    observed = 1e-3 * table.positions[:, [table.labels.index(marker.name) for marker in there]]
    tasks, seen = TrackingTasks(tuple(there), np.ones(len(there))), seen_markers(there, observed)
    never_seen = find_never_seen({marker.name for marker in model.markers}.intersection(expected), seen)
    uncovered = [Message(code) for code in check_coverage(model, seen)]
    return [*find_in_markers(table.time_s, tasks, observed), *never_seen, *uncovered]


def _ensure_plausible(file: Path, setup: ScaleSetup, factors: Mapping[str, Array]) -> None:
    """Raises KinematicsError for a factor, of the markers or manual, that no two adults differ by."""
    for body, factor in factors.items():
        worst = float(factor[np.argmax(np.abs(np.log(np.maximum(factor, 1e-9))))])
        if not LEAST_FACTOR <= worst <= MOST_FACTOR:
            is_manual = np.array_equal(factor, setup.manual.get(body, ()))
            code = KinematicsCode.WRONG_MANUAL_FACTOR if is_manual else KinematicsCode.WRONG_FACTOR
            figures = {"factor": worst, "least": LEAST_FACTOR, "most": MOST_FACTOR}
            raise KinematicsError(Message(code, {"file": file.name, "body": body, **figures}))


def write_body(path: Path, body: ScaledBody) -> None:
    """The model as .osim: all that the solver reads of it, without meshes of bones."""
    write_xml(path, osim_document(body.model))


def write_scale_setup(path: Path, body: ScaledBody, model: Path) -> None:
    """OpenSim's ScaleTool for what was scaled; model is the file that OpenSim is to write."""
    write_xml(path, scale_setup_document(body.setup, path.parent, f"{model.stem}_opensim.osim"))


def summary(body: ScaledBody) -> list[str]:
    """Factors, mass and findings, line by line."""
    lines = [f"{name}: {' × '.join(f'{factor:.4f}' for factor in factors)}" for name, factors in body.factors.items()]
    lines.append(f"mass of the model {sum(part.mass for part in body.model.bodies):.2f} kg")
    return lines + finding_lines(body.findings)

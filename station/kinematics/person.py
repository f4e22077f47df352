"""The person's body: all trials of a person → size, marker places and masses, checked by muscles and joint.

…-body.json: a person's body as `station scale` estimated it, with standard errors, checks and findings. The model
and its set-up of inverse kinematics are files as well.
"""

from __future__ import annotations

import xml.etree.ElementTree as Xml
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from documents.interval import counted
from documents.message import Message, because
from recordings.exchange.sample_tables import MarkerTable
from recordings.standard_gravity import g
from solver.errors import CoverageCode, MotionError, ScalingCode
from solver.inverse_kinematics.marker_fit import Vertical
from solver.inverse_kinematics.solve import InverseKinematics, TrackingTasks
from solver.model import Array, CoordinateLock, Marker, Model, ModelError
from solver.motion import Motion, decimate, differentiate
from solver.osim.model_writer import osim_document
from solver.osim.tool_setups import ik_setup_document, ik_setup_from_tasks
from solver.personalisation.coverage import ESSENTIAL, check_coverage
from solver.personalisation.estimate import BodyEstimate, EstimateOutcome, estimate_body
from solver.personalisation.segment_masses import (
    HAND,
    fit_tendons,
    hold_load,
    mass_ratios,
    segment_masses,
    set_arm_masses,
    upper_arm_length,
)
from solver.redundancy.effort import RedundancyOptions
from solver.redundancy.motion_solution import solve_motion
from solver.scaling import MuscleRanges, check_scaling, muscle_ranges
from station.checksums import write_whole
from station.kinematics.ik import ensure_common, markers_in_ground, model_with_markers
from station.kinematics.marker_checks import (
    Finding,
    WrongTrials,
    ensure_markers_fit,
    ensure_mass_fits,
    estimate_findings,
    find_in_markers,
    find_never_seen,
    finding_lines,
    joint_force_findings,
    lock_findings,
    read_body_markers,
    refuse,
    tendon_finding,
)
from station.kinematics.scale import left_out_notes
from station.messages.kinematics_messages import KinematicsCode, PersonCode
from station.progress import Progress, silent
from station.sources import BUNDLED, named_hash, repeated_name
from station.versions import solving_versions

LARGEST_RMS = 0.030
"""m, of the markers from the best body; the published hand-tuned bodies of a lab have 24 to 27 mm without offsets."""
INCOMPLETE = (PersonCode.NOT_CONVERGED, PersonCode.UNSOLVED_FRAMES, KinematicsCode.EXCHANGED)
MOST_JOINT_FRAMES = 100
"""Frames of a trial in which muscles and joint force are solved, at most."""


@dataclass(frozen=True)
class PersonInputs:
    """model: a generic .osim or "bundled"; markers: .trc files of one person; masses in kg.

    held_mass     in the hand in all trials, 0 for an empty hand; None refuses a model whose hand seems to hold a load
    keeps_tendons leave the tendon slack lengths as scaling makes them
    prefix        before the labels of the person;  vertical  upward axis of the files;  marker_set as of IkInputs
    """

    model: str
    markers: tuple[Path, ...]
    body_mass: float
    held_mass: float | None = None
    keeps_tendons: bool = False
    prefix: str = ""
    vertical: Vertical = "y"
    marker_set: str = ""


@dataclass(frozen=True, eq=False)
class TrialCheck:
    """A trial of the person's body: residuals of the markers, ranges of the muscles, force of the joint.

    time         (frames,) [s];  rms [m] of the markers;  ranges  of the muscles
    joint_force  (frames,) [N] at joint_time [s], empty where it was not evaluated
    """

    name: str
    time: Array
    postures: InverseKinematics
    rms: float
    ranges: MuscleRanges
    joint_time: Array
    joint_force: Array


@dataclass(frozen=True, eq=False)
class PersonBody:
    """A person's model, with arm masses and the load; how it was estimated, and checks of every trial.

    generic   without locks, as estimated from;  markers  of it that were followed
    observed  of each trial (frames, markers, 3) [m] in the model's ground
    """

    generic: Model
    markers: tuple[Marker, ...]
    observed: tuple[Array, ...]
    model: Model
    estimate: BodyEstimate
    body_mass: float
    held_mass: float
    trials: tuple[TrialCheck, ...]
    findings: tuple[Finding, ...]
    notes: tuple[str, ...]

    @property
    def is_whole(self) -> bool:
        """Whether the estimate converged, every frame is solved and no labels are exchanged."""
        return not any(finding.code in INCOMPLETE for finding in self.findings)


def measure_person(inputs: PersonInputs, progress: Progress = silent) -> PersonBody:
    """Raises KinematicsError, PersonError, ModelError, MotionError or ForeignFile for what does not fit together."""
    if (repeated := repeated_name(inputs.markers)) is not None:
        raise WrongTrials(Message(PersonCode.SAME_NAME, {"name": repeated}))
    generic, _, on_marker_set = model_with_markers(inputs.model, inputs.marker_set)
    known = [marker.name for marker in generic.markers]
    tables = {path.name: read_body_markers(path, known, inputs.prefix) for path in inputs.markers}
    person = person_of_trials(generic, tables, inputs, progress)
    return replace(person, findings=(*on_marker_set, *person.findings))


def person_of_trials(
    generic: Model, tables: Mapping[str, MarkerTable], inputs: PersonInputs, progress: Progress = silent
) -> PersonBody:
    """The person of these trials, file name → markers; of the inputs the masses and the vertical axis count.

    Raises as measure_person does.
    """
    findings = lock_findings(generic)
    generic = replace(generic, constraints=tuple(c for c in generic.constraints if not isinstance(c, CoordinateLock)))
    held = _held_mass(generic, inputs)
    known = [marker.name for marker in generic.markers]
    for file, table in tables.items():
        ensure_common(file, table.labels, known, known)
    markers, on_coverage = _covering_markers(generic, tables)
    findings += on_coverage
    observed = []
    for file, table in tables.items():
        seen, odd = _observed(generic, markers, file, table, inputs.vertical)
        observed.append(seen)
        findings += odd
    progress("estimating the body", 0, 1)
    estimate = estimate_body(generic, markers, observed)
    progress("estimating the body", 1, 1)
    rms = _rms(estimate.postures)
    if rms > LARGEST_RMS:
        raise refuse(PersonCode.MARKERS_DO_NOT_FIT, rms_mm=1e3 * rms, highest_mm=1e3 * LARGEST_RMS)
    ensure_mass_fits(inputs.body_mass, upper_arm_length(estimate.model))
    names = [Path(file).stem for file in tables]
    findings += estimate_findings(estimate, names)
    findings += check_scaling(generic, estimate.model)
    model = set_arm_masses(estimate.model, inputs.body_mass)
    model = hold_load(model, held) if held else model
    if not inputs.keeps_tendons:
        motions = [solution.coordinates[np.isfinite(solution.gap)] for solution in estimate.postures]
        model, changes = fit_tendons(model, motions)
        findings += [tendon_finding(change) for change in changes]
    trials = []
    for k, (name, table) in enumerate(zip(names, tables.values(), strict=True)):
        progress("solving muscles", k, len(names))
        trials.append(_checked(model, name, table.time_s, estimate.postures[k], findings))
        findings += joint_force_findings(name, trials[k].joint_force, inputs.body_mass)
    progress("solving muscles", len(names), len(names))
    notes = tuple(f"{name}: {note}" for name, table in zip(names, tables.values(), strict=True) for note in table.notes)
    return PersonBody(
        generic=generic,
        markers=markers,
        observed=tuple(observed),
        model=model,
        estimate=estimate,
        body_mass=inputs.body_mass,
        held_mass=held,
        trials=tuple(trials),
        findings=tuple(findings),
        notes=(*notes, *left_out_notes(generic)),
    )


def _covering_markers(
    generic: Model, tables: Mapping[str, MarkerTable]
) -> tuple[tuple[Marker, ...], tuple[Finding, ...]]:
    """The markers that the files have, and findings on those never seen and on segments that the others do not
    determine. Raises PersonError where there is no posture of the shoulder without such a segment.
    """
    labels = {label for table in tables.values() for label in table.labels}
    shown = {label for table in tables.values() for label in np.array(table.labels)[~table.missing.all(axis=0)]}
    markers = tuple(marker for marker in generic.markers if marker.name in labels)
    visible = [marker for marker in markers if marker.name in shown]
    codes = check_coverage(generic, visible)
    for code in codes:
        if code in ESSENTIAL:
            raise refuse(code)
    never_seen = find_never_seen([marker.name for marker in markers], visible)
    return markers, (*never_seen, *(Message(code) for code in codes))


def _held_mass(generic: Model, inputs: PersonInputs) -> float:
    """Raises PersonError where the generic hand seems to hold a load, and none is given."""
    if inputs.held_mass is not None:
        return inputs.held_mass
    ratio = mass_ratios(generic).get(HAND, 1.0)
    if ratio > 1.0:
        mass = generic.bodies[generic.body_index(HAND)].mass
        raise refuse(PersonCode.HAND_HOLDS_LOAD, model=generic.name, hand_kg=mass, ratio=ratio)
    return 0.0


def _observed(
    generic: Model, markers: Sequence[Marker], file: str, table: MarkerTable, vertical: Vertical
) -> tuple[Array, list[Finding]]:
    """(frames, markers, 3) [m] in the model's ground, NaN throughout for a marker that the trial does not have, and
    what is odd about it. Raises KinematicsError for markers that are not those of such a body.
    """
    there = [k for k, marker in enumerate(markers) if marker.name in table.labels]
    tasks = TrackingTasks(tuple(markers[k] for k in there), np.ones(len(there)))
    found = markers_in_ground(generic, table, tasks, np.ones(len(table.time_s), dtype=np.bool_), vertical)
    findings = ensure_markers_fit(generic, file, [marker.name for marker in tasks.markers], tasks, found)
    seen = np.full((len(table.time_s), len(markers), 3), np.nan)
    seen[:, there] = found
    return seen, [*findings, *find_in_markers(table.time_s, tasks, found)]


def _rms(postures: Sequence[InverseKinematics]) -> float:
    residuals = np.concatenate([solution.residuals.ravel() for solution in postures])
    return float(np.sqrt(np.nanmean(residuals**2)))


def _checked(model: Model, name: str, time: Array, postures: InverseKinematics, findings: list[Finding]) -> TrialCheck:
    """A trial with its muscles and joint; what they show is added to the findings."""
    coordinates = _filled(postures.coordinates)
    ranges = muscle_ranges(model, coordinates)
    shown = {(finding.code, finding.figures.get("muscle")) for finding in findings}
    for finding in ranges.findings:
        if (finding.code, finding.figures["muscle"]) not in shown:
            findings.append(finding)
    joint_time, force = np.zeros(0), np.zeros(0)
    try:
        motion = differentiate(Motion(model.coordinate_names, time, coordinates))
        kinematics = decimate(motion, max(1, -(-len(time) // MOST_JOINT_FRAMES)))
        solution = solve_motion(model, kinematics, RedundancyOptions())
        joint_time, force = solution.time, np.linalg.norm(solution.reaction[:, 3:], axis=1)
    except (ModelError, MotionError) as error:
        figures = {"trial": name, **because(error)}
        findings.append(Message(PersonCode.JOINT_NOT_EVALUATED, figures))
    return TrialCheck(name, time, postures, _rms([postures]), ranges, joint_time, force)


def _filled(coordinates: Array) -> Array:
    """Frames without a posture lie on the straight line between their neighbours."""
    known = np.isfinite(coordinates[:, 0])
    at = np.arange(len(coordinates))
    return np.column_stack([np.interp(at, at[known], column[known]) for column in coordinates.T])


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, allow_inf_nan=False)


class BodySize(_Part):
    """A scale factor of the generic model; the prior's standard deviation is that of its logarithm."""

    name: str
    factor: float
    standard_error: float
    prior_standard_deviation: float


class BodyMarker(_Part):
    """Offset of a marker from its place on the scaled model, along the axes of its body."""

    name: str
    body: str
    offset_mm: tuple[float, float, float]
    standard_error_mm: tuple[float, float, float]


class BodyGirdle(_Part):
    """Mean of a coordinate of clavicle or scapula, from the model's default."""

    coordinate: str
    mean_deg: float
    standard_error_deg: float


class BodyExtreme(_Part):
    """The muscle that has it, and how much: normalised fibre length, N, or m."""

    muscle: str
    value: float


class BodyTrial(_Part):
    """Checks of markers, muscles and joint in a trial."""

    name: str
    frames: int
    effective_frames: float
    marker_rms_mm: float
    shortest_fibre: BodyExtreme
    longest_fibre: BodyExtreme
    passive_force_n: BodyExtreme
    path_jump_m: BodyExtreme
    joint_force_peak_n: float | None
    joint_force_peak_body_weights: float | None


class BodyFinding(_Part):
    """A code for programs, and its sentence."""

    code: PersonCode | CoverageCode | ScalingCode | KinematicsCode
    message: str


class BodyDocument(_Part):
    """The file; format increases when a key changes its meaning."""

    format: Literal[1] = 1
    versions: Mapping[str, str]
    sources: Annotated[dict[str, str], Field(description='role → "name SHA-256"')]
    outcome: EstimateOutcome
    body_mass_kg: float
    held_mass_kg: float
    segment_masses_kg: Mapping[str, float]
    sizes: list[BodySize]
    markers: list[BodyMarker]
    girdle: list[BodyGirdle]
    trials: list[BodyTrial]
    findings: list[BodyFinding]


def body_document(person: PersonBody, inputs: PersonInputs) -> BodyDocument:
    """The document of a body that was measured with these inputs."""
    estimate = person.estimate
    prior = np.sqrt(np.diag(estimate.priors.covariance))
    degrees = np.degrees([estimate.girdle, estimate.girdle_errors])
    trials = {f"trial {k + 1}": named_hash(path) for k, path in enumerate(inputs.markers)}
    return BodyDocument(
        versions=dict(solving_versions()),
        sources={"model": BUNDLED if inputs.model == BUNDLED else named_hash(Path(inputs.model)), **trials},
        outcome=estimate.outcome,
        body_mass_kg=person.body_mass,
        held_mass_kg=person.held_mass,
        segment_masses_kg=segment_masses(person.model),
        sizes=[
            BodySize(
                name=factor.name,
                factor=float(estimate.factors[k]),
                standard_error=float(estimate.factor_errors[k]),
                prior_standard_deviation=float(prior[k]),
            )
            for k, factor in enumerate(estimate.priors.factors)
        ],
        markers=[
            BodyMarker(
                name=marker.name,
                body=person.model.bodies[marker.body].name,
                offset_mm=tuple(1e3 * estimate.offsets[k]),
                standard_error_mm=tuple(1e3 * estimate.offset_errors[k]),
            )
            for k, marker in enumerate(estimate.tasks.markers)
        ],
        girdle=[
            BodyGirdle(coordinate=name, mean_deg=float(mean), standard_error_deg=float(error))
            for name, mean, error in zip(estimate.priors.girdle, *degrees, strict=True)
        ],
        trials=[
            _trial(trial, float(effective), person.body_mass)
            for trial, effective in zip(person.trials, estimate.effective, strict=True)
        ],
        findings=[
            BodyFinding.model_validate({"code": finding.code, "message": str(finding)}) for finding in person.findings
        ],
    )


def _trial(trial: TrialCheck, effective: float, body_mass: float) -> BodyTrial:
    ranges = trial.ranges
    peak = float(np.nanmax(trial.joint_force)) if len(trial.joint_force) else None

    def extreme(values: np.ndarray, index: np.intp) -> BodyExtreme:
        return BodyExtreme(muscle=ranges.muscles[int(index)], value=float(values[index]))

    return BodyTrial(
        name=trial.name,
        frames=len(trial.time),
        effective_frames=effective,
        marker_rms_mm=1e3 * trial.rms,
        shortest_fibre=extreme(ranges.shortest, ranges.shortest.argmin()),
        longest_fibre=extreme(ranges.longest, ranges.longest.argmax()),
        passive_force_n=extreme(ranges.passive, ranges.passive.argmax()),
        path_jump_m=extreme(ranges.jump, ranges.jump.argmax()),
        joint_force_peak_n=peak,
        joint_force_peak_body_weights=None if peak is None else peak / (g * body_mass),
    )


def result_files(output: Path) -> tuple[Path, Path, Path]:
    """The model, its set-up of inverse kinematics, and the record."""
    return output, output.with_name(f"{output.stem}-ik.xml"), output.with_name(f"{output.stem}-body.json")


def write_person(output: Path, person: PersonBody, inputs: PersonInputs) -> tuple[Path, ...]:
    """Write output (.osim), and in its folder …-ik.xml and …-body.json; returns their paths."""
    _, setup, record = result_files(output)
    documents = {
        output: Xml.tostring(osim_document(person.model), encoding="utf-8", xml_declaration=True),
        setup: Xml.tostring(
            ik_setup_document(ik_setup_from_tasks(person.model, person.estimate.tasks, output), output.parent),
            encoding="utf-8",
            xml_declaration=True,
        ),
        record: (body_document(person, inputs).model_dump_json(indent=1) + "\n").encode(),
    }
    for path, document in documents.items():
        write_whole(path, document)
    return output, setup, record


def summary(person: PersonBody) -> list[str]:
    """Sizes, checks of every trial and findings, line by line."""
    estimate = person.estimate
    lines = [
        f"{factor.name}: {estimate.factors[k]:.2f} ± {estimate.factor_errors[k]:.2f}"
        for k, factor in enumerate(estimate.priors.factors)
    ]
    masses = ", ".join(f"{name} {mass:.2f} kg" for name, mass in segment_masses(person.model).items())
    load = f"; load in the hand {person.held_mass:.2f} kg" if person.held_mass else ""
    lines.append(f"arm segments of a body of {person.body_mass:.1f} kg: {masses}{load}")
    lines += [_line(trial, person.body_mass) for trial in person.trials]
    return lines + finding_lines(person.findings)


def _line(trial: TrialCheck, body_mass: float) -> str:
    ranges = trial.ranges
    passive = int(ranges.passive.argmax())
    text = (
        f"{trial.name}: {counted(len(trial.time), 'frame')}, markers {1e3 * trial.rms:.1f} mm (RMS), fibres "
        f"{ranges.shortest.min():.2f} to {ranges.longest.max():.2f} of the optimal length, passive force up to "
        f"{ranges.passive[passive]:.0f} N ({ranges.muscles[passive]}), path jumps up to "
        f"{1e3 * ranges.jump.max():.1f} mm"
    )
    if len(trial.joint_force):
        peak = float(np.nanmax(trial.joint_force))
        text += f", joint force up to {peak:.0f} N ({100 * peak / (g * body_mass):.0f} % of body weight)"
    return text

"""…-body.json: a person's body as `station scale` estimated it, with standard errors, checks and findings. The model
and its set-up of inverse kinematics are files as well.
"""

from __future__ import annotations

import xml.etree.ElementTree as Xml
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from recordings.standard_gravity import g
from solver.coded_findings import CoverageCode, ScalingCode
from solver.errors import SolverCode
from solver.model import ModelError
from solver.osim.model_writer import osim_document
from solver.osim.tool_setups import ik_setup_document, ik_setup_of_tasks
from solver.personalisation.estimate import EstimateOutcome
from solver.personalisation.segment_masses import segment_masses
from station.kinematics.marker_checks import finding_lines
from station.kinematics.person import PersonBody, PersonInputs, TrialCheck
from station.messages.codes import KinematicsCode
from station.messages.kinematics_messages import PersonCode
from station.sources import BUNDLED, named_hash
from station.versions import solving_versions
from station.whole_file import write_whole


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, allow_inf_nan=False)


class BodySize(_Part):
    """A scale factor of the generic model; the prior's standard deviation is that of its logarithm."""

    name: str
    factor: float
    standard_error: float
    prior_standard_deviation: float


class BodyMarker(_Part):
    """Where a marker is, from where the scaled model has it, along the axes of its body."""

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
    """What markers, muscles and joint show in a trial."""

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
    if output.suffix != ".osim":
        raise ModelError(
            f"the person's model should be written as .osim and is {output.name}; choose such a name",
            SolverCode.NOT_WRITABLE,
        )
    _, setup, record = result_files(output)
    documents = {
        output: Xml.tostring(osim_document(person.model), encoding="utf-8", xml_declaration=True),
        setup: Xml.tostring(
            ik_setup_document(ik_setup_of_tasks(person.model, person.estimate.tasks, output), output.parent),
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
        f"{trial.name}: {len(trial.time)} frames, markers {1e3 * trial.rms:.1f} mm (RMS), fibres "
        f"{ranges.shortest.min():.2f} to {ranges.longest.max():.2f} of the optimal length, passive force up to "
        f"{ranges.passive[passive]:.0f} N ({ranges.muscles[passive]}), path jumps up to "
        f"{1e3 * ranges.jump.max():.1f} mm"
    )
    if len(trial.joint_force):
        peak = float(np.nanmax(trial.joint_force))
        text += f", joint force up to {peak:.0f} N ({100 * peak / (g * body_mass):.0f} % of body weight)"
    return text

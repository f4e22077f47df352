"""A person's body in files: the model, its set-up of inverse kinematics, and how both were estimated."""

from __future__ import annotations

import xml.etree.ElementTree as Xml
from pathlib import Path

import numpy as np

from recordings.standard_gravity import g
from solver.errors import SolverCode
from solver.model import ModelError
from solver.osim.ik_setup import ik_setup_document, ik_setup_of_tasks
from solver.osim.model_writer import osim_document
from solver.personalisation.segment_masses import segment_masses
from station.kinematics.body_document import body_document
from station.kinematics.checks import finding_lines
from station.kinematics.person import PersonBody, PersonInputs, TrialCheck
from station.whole_file import write_whole


def result_files(output: Path) -> tuple[Path, Path, Path]:
    """The model, its set-up of inverse kinematics, and the record."""
    return output, output.with_name(f"{output.stem}-ik.xml"), output.with_name(f"{output.stem}-body.json")


def write_person(output: Path, person: PersonBody, inputs: PersonInputs) -> tuple[Path, ...]:
    """Write output (.osim), and beside it …-ik.xml and …-body.json; returns their paths."""
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

"""Assess a suit: cuffs → suit on a model → assessment.json."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from documents.message import Message, because
from fitting.cuffs.wearable_cuff import Cuff, NotIdentified
from fitting.results.codes import Standing
from recordings.manifest import DataOrigin
from solver.cuff import CuffParameters, by_site
from solver.model import Model
from solver.personalisation.anthropometry import has_arm_segments
from solver.redundancy.effort import RedundancyOptions
from solver.redundancy.motion_solution import LoadedMotion
from solver.suit.assessment import Assessment, assess
from solver.suit.suit import SuitError
from solver.uncertainty.total import DrawnPeople
from station.assessment.assessment_file import FORMAT, AssessmentDocument
from station.assessment.assessment_inputs import (
    AssessmentInputs,
    InputError,
    cuff_findings,
    cuff_remarks,
    cuffs_file_standing,
    read_cuffs_to_wear,
    worn_cuffs,
)
from station.assessment.assessment_json import (
    ACTIVATIONS_FILE,
    ASSESSMENT_FILE,
    MeasuredReductionEntry,
    activations_table,
    cuff_entries,
    motion_entries,
)
from station.assessment.case import AssessedCase, read_case
from station.assessment.drawn_postures import PostureEntry, drawn_postures
from station.assessment.findings import Finding, findings
from station.assessment.given_motion import load_checks, motion_checks, motion_findings
from station.assessment.people_run import PeopleRun, assess_people
from station.assessment.study_comparison import StudyComparisonEntry, compare_with_study
from station.assessment.uncertainty_json import (
    PEOPLE_FILE,
    DecisionEntry,
    DonningSources,
    decision_entry,
    donning_sources,
    people_table,
    uncertainty_entry,
    without_decision,
)
from station.checksums import write_checksums, write_whole
from station.folders import ensure_folder
from station.messages.assessment_messages import AssessmentCode
from station.messages.kinematics_messages import SubjectCode
from station.progress import Progress, silent, with_part
from station.subject.assessed_subject import compare_cord, cuff_on_cord, subject_document, subject_inputs
from station.subject.subject_document import SubjectDocument
from station.subject.subject_file import refuse_subject
from station.versions import solving_versions

POINT = re.compile(r"\[\s+(-?[\d.]+),\s+(-?[\d.]+),\s+(-?[\d.]+)\s+\]")
"""Three numbers of a list, which share a line of the file."""
OTHER_FRAMES, OTHER_REST_LENGTHS = 40, 16
"""Frames and rest lengths that are solved of the other motion."""


@dataclass(frozen=True)
class AssessedSuit:
    """Assessment of the cuffs, and a shorter one of another motion (its name first) or None.

    emg are measured reductions, inputs the names and hashes of the files, cuffs_standing the check of the cuffs file,
    subject the wearer whose body and motion were assessed, None without one; people who gave the intervals, None
    without any, and donning the spread between donnings that they have; postures: for the picture of the body,
    suit_names: what its places are called; on_inputs: findings on the motion and the model; study: the source study's
    answer beside this one; are_people_drawn: whether intervals were asked for.
    """

    cuffs: tuple[Cuff, ...]
    assessment: Assessment
    beside: tuple[str, Assessment] | None
    emg: tuple[MeasuredReductionEntry, ...]
    inputs: dict[str, str]
    cuffs_standing: Standing
    postures: list[PostureEntry]
    suit_names: dict[str, str]
    subject: SubjectDocument | None = None
    people: DrawnPeople | None = None
    donning: DonningSources | None = None
    on_inputs: tuple[Finding, ...] = ()
    study: StudyComparisonEntry | None = None
    are_people_drawn: bool = False

    @property
    def is_changed(self) -> bool:
        """Whether the cuffs file has changed since it was recorded, or a recording of the wearer is not whole."""
        return self.cuffs_standing.is_break or not (self.subject is None or self.subject.is_whole)

    @property
    def origin(self) -> DataOrigin:
        """Origin of the cuffs' data: simulated if any of them is."""
        return DataOrigin.joined(fit.origin for fit in self.cuffs)

    @property
    def findings(self) -> list[Finding]:
        on_suit = findings(self.assessment, are_people_drawn=self.are_people_drawn)
        return [*on_suit, *cuff_findings(self.cuffs), *self.on_inputs]


def assess_cuffs(
    cuffs: dict[str, Cuff],
    inputs: AssessmentInputs,
    *,
    most_frames: int | None = None,
    most_rest_lengths: int | None = None,
    people: PeopleRun | None = None,
    progress: Progress = silent,
) -> AssessedSuit:
    """Assess the cuffs in a suit on a model, and more briefly for another motion; with `people`, with intervals.

    most_frames and most_rest_lengths limit the frames and rest lengths, evenly spaced; None: all of them.
    """
    donning = None if people is None else _donning(people, inputs.cuffs)  # first: its faults are reported at once
    worn, on_cord = worn_cuffs(cuffs, inputs.chosen), _cuff_on_cord(inputs, cuffs)  # at once, too
    case = read_case(inputs, most_rest_lengths, progress)
    model, kinematics, suit = case.model, case.kinematics, case.suit
    emg, options = inputs.read_emg(model, suit), inputs.read_options(model)
    # the shorter one first: a fault of its motion is reported at once
    beside = None if case.subject else _assess_other_motion(inputs, model, options, worn, most_frames, progress)
    moving = LoadedMotion(model, kinematics, inputs.read_loads(model, kinematics), options)
    assessment = assess(
        moving,
        suit,
        worn,
        every=1 if most_frames is None else math.ceil(len(kinematics.time) / most_frames),
        progress=progress,
    )
    fits = tuple(cuffs[cuff.name] for cuff in worn)
    standing = cuffs_file_standing(inputs.cuffs, fits)
    drawn_people = None
    if people is not None:
        spread = None if donning is None else donning.spread
        assessment, drawn_people = assess_people(people, case, moving, worn, assessment, progress, spread)
    drawn = drawn_postures(model, kinematics, suit, assessment.time)
    hashes = inputs.hashes() | ({} if people is None else people.inputs)
    subject, named = _wearer(inputs, case, worn, on_cord)
    hashes |= named
    on_loads = load_checks(inputs.external_loads, moving.loads, moving.model, moving.kinematics)
    on_inputs = _findings_on_inputs(case, on_loads, has_people=people is not None)
    names = dict(suit.names)
    return AssessedSuit(
        fits,
        assessment,
        beside,
        emg,
        hashes,
        standing,
        drawn,
        names,
        subject,
        drawn_people,
        donning,
        on_inputs,
        study=compare_with_study(case, inputs, worn, assessment),
        are_people_drawn=people is not None,
    )


def _donning(people: PeopleRun, cuffs: Path) -> DonningSources | None:
    """The spread between donnings of these people; None if the fit alone is drawn."""
    if people.sources == "cuffs":
        return None
    declared, estimates = people.budget.sources.donning, people.budget.donning.estimate
    return donning_sources(declared, cuffs, people.donnings, estimates=estimates)


def _cuff_on_cord(inputs: AssessmentInputs, cuffs: dict[str, Cuff]) -> CuffParameters | None:
    """The arm cuff of the compared cord tension. Raises SubjectError for one that was not fitted or cannot be worn."""
    name = None if inputs.subject is None else cuff_on_cord(inputs.subject, cuffs.values())
    if name is None:
        return None
    try:
        (worn,) = worn_cuffs({name: cuffs[name]}, ())
    except (NotIdentified, InputError, SuitError) as error:
        raise refuse_subject(SubjectCode.UNUSABLE_CUFF, cuff=name, **because(error)) from error
    return worn


def _wearer(
    inputs: AssessmentInputs, case: AssessedCase, worn: Sequence[CuffParameters], on_cord: CuffParameters | None
) -> tuple[SubjectDocument | None, dict[str, str]]:
    """The wearer, and what stood for the inputs of the assessment; None and nothing without one."""
    if inputs.subject is None or case.subject is None:
        return None, {}
    _, waists = by_site(worn)
    cord = compare_cord(case.subject, case.suit, next(iter(waists), None), on_cord)
    return subject_document(case.subject, case.spread, cord), subject_inputs(inputs.subject, case.subject)


def _assess_other_motion(
    inputs: AssessmentInputs,
    model: Model,
    options: RedundancyOptions,
    worn: Sequence[CuffParameters],
    most_frames: int | None,
    progress: Progress,
) -> tuple[str, Assessment] | None:
    """Name and assessment of the other motion, in fewer frames if tendons are rigid; None where there is none for this
    model.
    """
    other = inputs.read_other_motion(model)
    if other is None:
        return None
    name, loaded, kinematics = other
    every = math.ceil(len(kinematics.time) / min(most_frames or OTHER_FRAMES, OTHER_FRAMES))
    every = 1 if options.tendons == "elastic" else every
    short, motion = inputs.read_suit(OTHER_REST_LENGTHS), LoadedMotion(loaded, kinematics, options=options)
    return name, assess(motion, short, worn, every=every, progress=with_part(progress, "other motion"))


def _findings_on_inputs(case: AssessedCase, on_loads: dict[str, str], *, has_people: bool) -> tuple[Finding, ...]:
    found = motion_findings(motion_checks(case.model, case.kinematics) | on_loads)
    if has_people and not has_arm_segments(case.model):
        found.append(Message(AssessmentCode.NO_ARM_SEGMENTS))
    return tuple(found)


def assess_file(
    inputs: AssessmentInputs, output: Path, people: PeopleRun | None = None, progress: Progress = silent
) -> AssessedSuit:
    """cuffs.json → assessment.json and activations.csv in the output folder, and people.csv if people are drawn."""
    ensure_folder(output)
    cuffs = read_cuffs_to_wear(inputs.cuffs, inputs.chosen)
    assessed = assess_cuffs(cuffs, inputs, people=people, progress=progress)
    write_assessment(assessed, output)
    return assessed


def sentences_on(assessed: AssessedSuit, cuffs: Path) -> list[str]:
    """The decision, remarks on the cuffs of this file, and findings on the suit and on the wearer."""
    on_subject = assessed.subject.findings if assessed.subject else ()
    return [
        *decision_sentences(assessed),
        *cuff_remarks(cuffs, assessed.cuffs),
        *map(str, assessed.findings),
        *([str(assessed.donning.message)] if assessed.donning else []),
        *(f"{finding.text} [{finding.code}]" for finding in on_subject),
    ]


def decision_sentences(assessed: AssessedSuit) -> list[str]:
    """Choice of the cuff at the reference rest length, and at the best rest length of each cuff."""
    decision = _decision(assessed)
    entries = [decision.at_reference, decision.at_best]
    settle = [entry.settle.text for entry in entries if entry.settle]
    return list(dict.fromkeys([*(entry.text for entry in entries), *settle]))


def write_assessment(assessed: AssessedSuit, folder: Path) -> None:
    """Write assessment.json and, for the figures of the report, activations.csv."""
    folder.mkdir(parents=True, exist_ok=True)
    text = json.dumps(written_document(assessment_document(assessed)), indent=2, ensure_ascii=False, allow_nan=False)
    write_whole(folder / ASSESSMENT_FILE, POINT.sub(r"[\1, \2, \3]", text) + "\n")
    write_whole(folder / ACTIVATIONS_FILE, activations_table(assessed.assessment))
    written = [folder / ASSESSMENT_FILE, folder / ACTIVATIONS_FILE]
    if assessed.people is not None:
        write_whole(folder / PEOPLE_FILE, people_table(assessed.people))
        written.append(folder / PEOPLE_FILE)
    write_checksums(*written)


def written_document(document: AssessmentDocument) -> dict[str, Any]:
    """The document as it is written, without the keys that it does not set."""
    return document.model_dump(mode="json", exclude_unset=True)


def assessment_document(assessed: AssessedSuit) -> AssessmentDocument:
    """The content of assessment.json."""
    summary = assessed.assessment.uncertainty
    given: dict[str, Any] = {
        "format": FORMAT,
        "origin": assessed.origin,
        "cuffs": cuff_entries(assessed.cuffs),
        **motion_entries(assessed.assessment),
        "findings": list(map(str, assessed.findings)),
        "finding_codes": assessed.findings,
        "decision": _decision(assessed),
        "against_study": assessed.study,
        "emg": list(assessed.emg),
        "postures": assessed.postures,
        "suit_names": assessed.suit_names,
        "inputs": assessed.inputs,
        "inputs_checked": {"cuffs": assessed.cuffs_standing},
        "versions": solving_versions(),
    }
    if assessed.beside:
        name, other = assessed.beside
        given["beside"] = {"motion": name, **motion_entries(other)}
    if summary is not None and assessed.people is not None:
        given["uncertainty"] = uncertainty_entry(summary, assessed.people, assessed.donning)
    if assessed.subject is not None:
        given["subject"] = assessed.subject
    return AssessmentDocument.model_validate(given)


def _decision(assessed: AssessedSuit) -> DecisionEntry:
    summary, people = assessed.assessment.uncertainty, assessed.people
    if summary is None or people is None or not summary.is_total:
        return without_decision(can_draw_people="tendons" not in assessed.inputs)
    return decision_entry(summary, people.indices, assessed.assessment.reference_rest_length)

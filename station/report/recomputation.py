"""Compute the results of a session again from the samples of its recordings, and compare every number."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from documents.interval import counted
from documents.message import Message
from documents.plain_data import PlainDataError, read_json
from fitting.cuffs.cuff_fit import SessionFit
from fitting.cuffs.cuffs_file import CUFFS_FILE, cuffs_json
from fitting.results.codes import Standing
from station.assessment.assessment_file import AssessmentDocument, AssessmentFileError, read_assessment, read_cutoff
from station.assessment.assessment_inputs import AssessmentInputs, read_cuffs_to_wear
from station.assessment.assessment_json import ASSESSMENT_FILE
from station.assessment.budget_file import read_budget
from station.assessment.people_run import PeopleRun, SourceChoice
from station.checksums import file_sha256
from station.files.chain import NUMBERS_FILE, Link
from station.fit import fit_session_folder
from station.messages.file_messages import NumberCode
from station.progress import Progress, silent
from station.recordings_of_session import pulls_in
from station.report.page import Results, located_assessment, read_results, render
from station.report.report_file import ReportFileError, Source, read_numbers
from station.report.verification import compared_link
from station.sources import without_hash

TOLERANCE = 1e-6
"""Relative difference of two numbers that count as equal: other processors and libraries round differently."""
NOT_COMPUTED = frozenset({"seal", "recordings", "versions", "inputs", "inputs_checked"})
"""Keys that name files and versions."""
COMPARED = {"value", "ci95"}
ELSEWHERE = "its motion, model, suit, effort or budget file is not in this folder; assess it again with those files"
Plain = Mapping[str, Any]


@dataclass(frozen=True)
class Difference:
    """A value that is not the computed one, with its JSON Pointer."""

    pointer: str
    found: Any
    expected: Any

    @property
    def is_wording(self) -> bool:
        """Whether two sentences differ. Stations reword them; their codes and figures are compared beside them."""
        return all(isinstance(text, str) and " " in text for text in (self.found, self.expected))

    @property
    def size(self) -> float:
        """Relative difference of two numbers; infinite for anything else."""
        if not all(isinstance(one, float | int) and not isinstance(one, bool) for one in (self.found, self.expected)):
            return math.inf
        largest = max(abs(self.found), abs(self.expected))
        return abs(self.found - self.expected) / largest if math.isfinite(largest) else math.inf


def recomputed_links(folder: Path, progress: Progress = silent) -> Iterator[Link]:
    """Links of cuffs.json, assessment.json and report.json to what the recordings give when computed again.

    A session without recordings of cuffs has none. Raises SessionError if its recordings cannot be fitted.
    """
    fitted = fit_session_folder(folder, None, progress) if pulls_in(folder) else None
    if fitted is not None:
        results = read_results(folder, fitted)
        yield from _links(CUFFS_FILE, json.loads(cuffs_json(fitted)), results, "fit of the recordings")
    if (path := folder / ASSESSMENT_FILE).is_file():
        try:
            recorded = read_assessment(path)
        except AssessmentFileError as error:
            yield Link(f"{ASSESSMENT_FILE} ← the model", Standing.CHANGED, str(error), error.code)
            return
        yield from _assessment_links(folder, recorded, fitted, progress)


def differences(found: Any, expected: Any, pointer: str = "") -> Iterator[Difference]:
    """Every value of a file (found) that differs, in its order. A key that it lacks is one of a later station."""
    if isinstance(found, Mapping) and isinstance(expected, Mapping):
        for key, value in found.items():
            yield from differences(value, expected.get(key), Source.of("", pointer).child(key).pointer)
    elif isinstance(found, list) and isinstance(expected, list) and len(found) == len(expected):
        for index, (entry, other) in enumerate(zip(found, expected, strict=True)):
            yield from differences(entry, other, f"{pointer}/{index}")
    elif found != expected:
        yield Difference(pointer, found, expected)


def _links(file: str, computed: Plain, results: Results, what: str) -> Iterator[Link]:
    """Of a file of results, and of the numbers in the report that are from it; results hold the computed one."""
    if plain := _read(results.folder / file):
        compared = {key: value for key, value in plain.items() if key not in NOT_COMPUTED}
        yield _link(f"{file} ← {what}", list(differences(compared, computed)))
    with suppress(ReportFileError):
        listed = read_numbers(results.folder / NUMBERS_FILE).numbers.items()
        reported = {key: number.model_dump(include=COMPARED) for key, number in listed if number.source.file == file}
        if reported:
            again = {key: number.model_dump(include=COMPARED) for key, number in render(results)[1].numbers.items()}
            found = list(differences(reported, again, "/numbers"))
            yield _link(f"{NUMBERS_FILE} ← {what}, {counted(len(reported), 'number')}", found)


def _assessment_links(
    folder: Path, recorded: AssessmentDocument, fitted: SessionFit | None, progress: Progress
) -> Iterator[Link]:
    from station.assessment.assess import assess_cuffs, assessment_document, written_document

    inputs = _inputs(folder, recorded)
    if inputs is None:
        yield Link(f"{ASSESSMENT_FILE} ← the model", Standing.UNRECORDED, ELSEWHERE)
        return
    worn, people = read_cuffs_to_wear(inputs.cuffs, inputs.chosen), _people(recorded)
    frames, lengths = recorded.frames.value, len(recorded.rest_lengths_m.value)
    assessed = assess_cuffs(
        worn, inputs, most_frames=frames, most_rest_lengths=lengths, people=people, progress=progress
    )
    computed = assessment_document(assessed)
    whole = computed.model_copy(
        update={key: getattr(recorded, key) for key in NOT_COMPUTED & recorded.model_fields_set}
    )
    results = replace(read_results(folder, fitted), assessment=located_assessment(whole))
    yield from _links(ASSESSMENT_FILE, written_document(computed), results, "the model")


def _people(recorded: AssessmentDocument) -> PeopleRun | None:
    """The people of the assessment, drawn again from the bundled budget."""
    if not (uncertainty := recorded.uncertainty):
        return None
    budget = read_budget(people=uncertainty.people.value)
    sources: SourceChoice = "cuffs" if uncertainty.sources == ["fit"] else "all"
    return PeopleRun(budget, sources=sources, index_blocks=uncertainty.index_blocks.value)


def _inputs(folder: Path, recorded: AssessmentDocument) -> AssessmentInputs | None:
    """The inputs of the assessment, where all of them are bundled or in the folder."""
    named, cuffs, has_subject = recorded.inputs, folder / CUFFS_FILE, recorded.subject is not None
    is_bundled = {role: without_hash(named[role]) == named[role] for role in ("model", "motion", "suit")}
    is_bundled_budget = named.get("budget", "bundled").startswith("bundled")
    others = {"emg", "external_loads", "beside", "effort", "donnings"} & set(named)
    is_known = is_bundled["suit"] and is_bundled_budget and (has_subject or all(is_bundled.values()))
    if others or not is_known or not (cuffs.is_file() and named["cuffs"].endswith(file_sha256(cuffs))):
        return None
    chosen = tuple(name for name, cuff in recorded.cuffs.items() if cuff.site != "waist")
    options: dict[str, Any] = {key: named[key] for key in ("paths", "tendons") if key in named}
    return AssessmentInputs(
        cuffs, chosen=chosen, subject=folder if has_subject else None, cutoff_hz=read_cutoff(named), **options
    )


def _read(path: Path) -> Any:
    """A file of results; None if it is missing or cannot be read, which the chain of files reports."""
    with suppress(OSError, PlainDataError):
        return read_json(path)
    return None


def _link(what: str, found: list[Difference]) -> Link:
    """The first difference beyond rounding; else the largest one, unless sentences are worded otherwise."""
    reworded = [one.pointer for one in found if one.is_wording]
    figures = [one for one in found if not one.is_wording]
    faults = [
        Message(NumberCode.RECOMPUTED, {"id": one.pointer, "found": str(one.found), "expected": str(one.expected)})
        for one in figures
        if not one.size <= TOLERANCE
    ]
    largest = max((one.size for one in figures), default=None)
    remark = "every number equal" if largest is None else f"largest relative difference {largest:.1g}"
    if faults or not reworded:
        return compared_link(what, faults, remark)
    remark += f"; this station has another wording of {counted(len(reworded), 'sentence')}, the first: {reworded[0]}"
    return Link(what, Standing.UNRECORDED, remark)

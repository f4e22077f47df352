"""Compute the results of a session again from the samples of its recordings, and compare every number."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from documents.interval import counted
from documents.message import Message
from documents.plain_data import PlainDataError, read_json
from fitting.cuffs.cuff_fit import SessionFit
from fitting.cuffs.cuffs_file import CUFFS_FILE, cuffs_json
from fitting.results.codes import Standing
from station.assessment.assessment_file import AssessmentFileError, read_assessment
from station.assessment.assessment_inputs import AssessmentInputs, read_cuffs_to_wear
from station.assessment.assessment_json import ASSESSMENT_FILE
from station.assessment.budget_file import read_budget
from station.assessment.people_run import PeopleRun, SourceChoice
from station.checksums import sha256_of
from station.defaults import CUTOFF_HZ
from station.files.chain import NUMBERS_FILE, Link
from station.fit import fit_session_folder
from station.messages.file_messages import NumberCode
from station.progress import Progress, silent
from station.recordings_of_session import pulls_in
from station.report.page import Results, located_assessment, read_results, render
from station.report.report_file import ReportedNumber, ReportFileError, Source, read_numbers
from station.sources import without_hash

TOLERANCE = 1e-6
"""Relative difference of two numbers that count as equal: other processors and libraries round differently."""
NOT_COMPUTED = frozenset({"seal", "recordings", "versions", "inputs", "inputs_checked"})
"""Keys that name files and versions."""

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
        if _is_number(self.found) and _is_number(self.expected):
            largest = max(abs(self.found), abs(self.expected))
            return abs(self.found - self.expected) / largest if math.isfinite(largest) else math.inf
        return math.inf


def recomputed_links(folder: Path, progress: Progress = silent) -> list[Link]:
    """Links of cuffs.json, assessment.json and report.json to what the recordings give when computed again.

    A session without recordings of cuffs has none. Raises SessionError if its recordings cannot be fitted.
    """
    links: list[Link] = []
    fitted = fit_session_folder(folder, None, progress) if pulls_in(folder) else None
    if fitted is not None:
        document = json.loads(cuffs_json(fitted))
        links += _links(CUFFS_FILE, document, read_results(folder, fitted), "fit of the recordings")
    plain = _read(folder / ASSESSMENT_FILE)
    if plain is not None:
        links += _assessment_links(folder, plain, fitted, progress)
    return links


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
    plain, listed = _read(results.folder / file) or {}, _listed(results.folder)
    if plain:
        compared = {key: value for key, value in plain.items() if key not in NOT_COMPUTED}
        yield _link(f"{file} ← {what}", list(differences(compared, computed)))
    reported = {key: number for key, number in listed.items() if number.source.file == file}
    if reported:
        again = render(results)[1].numbers
        found = [found for key, number in reported.items() for found in _of_number(key, number, again.get(key))]
        yield _link(f"{NUMBERS_FILE} ← {what}, {counted(len(reported), 'number')}", found)


def _of_number(key: str, number: ReportedNumber, again: ReportedNumber | None) -> Iterator[Difference]:
    """Differences of a reported number, by its id, from the one that computed results give."""
    if again is None:
        yield Difference(key, number.value, None)
        return
    found, expected = ({"value": one.value, "ci95": one.ci95} for one in (number, again))
    yield from differences(found, expected, key)


def _assessment_links(folder: Path, plain: Plain, fitted: SessionFit | None, progress: Progress) -> Iterator[Link]:
    from station.assessment.assess import assess_cuffs, write_assessment

    inputs = _inputs(folder, plain)
    if inputs is None:
        remark = (
            "its motion, model, suit, effort or budget file is not in this folder; assess it again with those files"
        )
        yield Link(f"{ASSESSMENT_FILE} ← the model", Standing.UNRECORDED, remark)
        return
    worn = read_cuffs_to_wear(inputs.cuffs, inputs.chosen)
    assessed = assess_cuffs(
        worn,
        inputs,
        most_frames=int(plain["frames"]["value"]),
        most_rest_lengths=len(plain["rest_lengths_m"]["value"]),
        people=_people(plain),
        progress=progress,
    )
    with TemporaryDirectory() as written:
        write_assessment(assessed, Path(written))
        computed = read_json(Path(written) / ASSESSMENT_FILE)
    whole = {**computed, **{key: plain[key] for key in NOT_COMPUTED & set(plain)}}
    results = replace(read_results(folder, fitted), assessment=located_assessment(whole))
    yield from _links(ASSESSMENT_FILE, computed, results, "the model")


def _people(plain: Plain) -> PeopleRun | None:
    """The people of the assessment, drawn again from the bundled budget."""
    uncertainty = plain.get("uncertainty")
    if not uncertainty:
        return None
    budget = read_budget()
    people = {"people": int(uncertainty["people"]["value"])}
    budget = budget.model_copy(update={"sample": budget.sample.model_copy(update=people)})
    sources: SourceChoice = "cuffs" if uncertainty["sources"] == ["fit"] else "all"
    return PeopleRun(budget, sources=sources, index_blocks=int(uncertainty["index_blocks"]["value"]))


def _inputs(folder: Path, plain: Plain) -> AssessmentInputs | None:
    """The inputs of the assessment, where all of them are bundled or in the folder."""
    named, cuffs = plain["inputs"], folder / CUFFS_FILE
    has_subject = bool(plain.get("subject"))
    is_bundled = {role: without_hash(named[role]) == named[role] for role in ("model", "motion", "suit")}
    has_own_budget = not named.get("budget", "bundled").startswith("bundled")
    others = {"emg", "external_loads", "beside", "effort", "donnings"} & set(named)
    is_known = is_bundled["suit"] and (has_subject or all(is_bundled.values()))
    if not (
        is_known and cuffs.is_file() and not others and not has_own_budget and named["cuffs"].endswith(sha256_of(cuffs))
    ):
        return None
    chosen = tuple(name for name, cuff in plain["cuffs"].items() if cuff["site"] != "waist")
    inputs = AssessmentInputs(cuffs, chosen=chosen, paths=named["paths"], subject=folder if has_subject else None)
    cutoff = named.get("cutoff_hz", f"{CUTOFF_HZ:g}")
    return replace(inputs, tendons=named.get("tendons", "rigid"), cutoff_hz=None if cutoff == "none" else float(cutoff))


def _listed(folder: Path) -> Mapping[str, ReportedNumber]:
    try:
        return read_numbers(folder / NUMBERS_FILE).numbers
    except ReportFileError:
        return {}


def _read(path: Path) -> Any:
    """A file of results; None if it is missing or cannot be read, which the chain of files reports."""
    if not path.is_file():
        return None
    try:
        return read_assessment(path) if path.name == ASSESSMENT_FILE else read_json(path)
    except (OSError, PlainDataError, AssessmentFileError):
        return None


def _link(what: str, found: list[Difference]) -> Link:
    """The first difference beyond rounding; else the largest one, unless sentences are worded otherwise."""
    reworded = [difference for difference in found if difference.is_wording]
    found = [difference for difference in found if not difference.is_wording]
    beyond = [difference for difference in found if not difference.size <= TOLERANCE]
    if not beyond:
        detail = f"largest relative difference {max(one.size for one in found):.1g}" if found else "every number equal"
        if reworded:
            place = reworded[0].pointer
            remark = (
                f"{detail}; this station has another wording of "
                f"{counted(len(reworded), 'sentence')}, the first: {place}"
            )
            return Link(what, Standing.UNRECORDED, remark)
        return Link(what, Standing.AS_RECORDED, detail)
    first = beyond[0]
    fault = Message(
        NumberCode.RECOMPUTED, {"id": first.pointer, "found": str(first.found), "expected": str(first.expected)}
    )
    more = f"; and {len(beyond) - 1} more" if len(beyond) > 1 else ""
    return Link(what, Standing.CHANGED, f"{fault}{more}", fault.code)


def _is_number(value: Any) -> bool:
    return isinstance(value, float | int) and not isinstance(value, bool)

"""End of a session, of the console, the terminal and the demo alike: fit, assessment on the wearer, EMG and report."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from documents.message import Message, because
from station.cuff_text import SHOWN, of_cuff
from station.errors import StationError
from station.messages.assessment_messages import AssessmentCode
from station.progress import Progress, silent
from station.recordings_of_session import motions_in

if TYPE_CHECKING:
    from fitting.cuffs.cuff_fit import CuffFit, SessionFit
    from fitting.cuffs.wearable_cuff import Cuff
    from fitting.trial.trial import TrialReading
    from station.assessment.assess import AssessedSuit

Options = Mapping[str, Any]
NOT_IDENTIFIED = "not identified"
NOT_ASSESSED = "The effect on the muscles is not known, because no cuff could be assessed."
"""In the place of the answer; the other findings have the reasons."""


class SummaryError(StationError):
    """The session cannot be fitted."""


@dataclass(frozen=True)
class Summary:
    """rows: one per cuff, heading → text, with a verdict if not all is identified; findings: the answer first, then the
    findings of the assessment, in sentences.
    """

    rows: tuple[dict[str, str], ...]
    findings: tuple[str, ...]


@dataclass(frozen=True)
class EndedSession:
    """The results of a session, which are written in its folder.

    assumed  what was assumed of a cuff to wear it;  missing  what the report lacks, and why
    """

    fitted: SessionFit
    assessed: AssessedSuit | None
    assumed: tuple[str, ...]
    missing: tuple[str, ...]
    page: Path


def summarise(folder: Path, progress: Progress = silent) -> Summary:
    """End the session and return what its page shows. Raises SummaryError if no trial can be fitted.

    The first use of the solver on a machine compiles it, which is a stage of its own.
    """
    from fitting.results.codes import Verdict
    from station.assessment.assessment_file import read_assessment
    from station.assessment.assessment_json import ASSESSMENT_FILE
    from station.assessment.compilation import CompilationAhead, compilation_shown
    from station.fit import SessionError
    from station.report.first_page import answer, list_limits, other_findings
    from station.report.page import located_assessment

    try:
        with CompilationAhead() as ahead, compilation_shown(progress, ahead):
            ended = end_session(folder, progress)
    except SessionError as error:
        raise SummaryError(error.cause) from error
    rows = tuple(
        {"cuff": name}
        | {one.heading: of_cuff(cuff, key, one.text(getattr(cuff, key), NOT_IDENTIFIED)) for key, one in SHOWN.items()}
        | ({} if cuff.verdicts == (Verdict.IDENTIFIED,) else {"verdict": cuff.verdict})
        for name, cuff in ended.fitted.cuffs.items()
    )
    if ended.assessed is None:
        return Summary(rows, (NOT_ASSESSED, *ended.assumed, *ended.missing))
    assessment = located_assessment(read_assessment(folder / ASSESSMENT_FILE))
    found = ("".join(map(str, answer(assessment))), *ended.missing, *ended.assumed)
    return Summary(rows, tuple(dict.fromkeys((*found, *other_findings(assessment), *list_limits(assessment)))))


def end_session(
    folder: Path,
    progress: Progress = silent,
    readings: Mapping[str, TrialReading] = MappingProxyType({}),
    missing: tuple[str, ...] = (),
    ready: Callable[[], object] = lambda: None,
    options: Options = MappingProxyType({}),
) -> EndedSession:
    """Write cuffs.json, assessment.json, emg.json and report.html into the folder, from the trials recorded so far.

    readings: recordings by file name that are not read again; missing: trials that failed; ready is called before the
    solver is needed; options: limits of the assessment. Raises SessionError if no trial can be fitted.
    """
    from station.assessment.assess import write_assessment
    from station.fit import fit_session_folder
    from station.report.page import write_missing, write_report
    from station.session.wearer_emg import write_wearer_emg

    fitted = fit_session_folder(folder, folder / "cuffs.json", progress, readings)
    worn, left_out = _worn(fitted.cuffs)
    assumed = tuple(f"{name}: {note}" for name, cuff in worn.items() for note in cuff.assumed)
    ready()
    assessed, reasons = _assess(folder, worn, options, progress)
    if assessed is not None:
        write_assessment(assessed, folder)
    missing = (*missing, *left_out, *reasons, *write_wearer_emg(folder, assessed))
    write_missing(folder, missing)
    return EndedSession(fitted, assessed, assumed, missing, write_report(folder, fitted, progress))


def _worn(cuffs: Mapping[str, CuffFit]) -> tuple[dict[str, Cuff], tuple[str, ...]]:
    """The cuffs that can be worn, and a sentence for each of the others."""
    from station.assessment.assessment_inputs import wearable

    worn, left_out = wearable({name: fit.wearable().without_migration() for name, fit in cuffs.items()})
    return worn, tuple(f"not in the assessment: {reason}" for reason in left_out.values())


def _assess(
    folder: Path, worn: dict[str, Cuff], options: Options, progress: Progress
) -> tuple[AssessedSuit | None, tuple[str, ...]]:
    """Assess on the wearer's own body and motion; otherwise on the bundled ones, with the reason as a finding."""
    from fitting.errors import FitError
    from solver.errors import SolverError
    from station.assessment.assess import assess_cuffs
    from station.assessment.assessment_inputs import AssessmentInputs
    from station.assessment.budget_file import read_budget
    from station.assessment.people_run import PeopleRun

    inputs = AssessmentInputs(folder / "cuffs.json")
    options = {"people": PeopleRun(read_budget()), **options}
    finding = Message(AssessmentCode.WEARER_NOT_RECORDED)
    if any(manifest.condition != "mvc" for manifest in motions_in(folder).values()):
        try:
            return assess_cuffs(worn, replace(inputs, subject=folder), progress=progress, **options), ()
        except (SolverError, FitError, StationError) as error:
            finding = Message(AssessmentCode.WEARER_NOT_ASSESSED, because(error))
    try:
        assessed = assess_cuffs(worn, inputs, progress=progress, **options)
    except (SolverError, FitError, StationError) as error:
        return None, (f"no assessment: {error}",)
    return replace(assessed, on_inputs=(finding, *assessed.on_inputs)), ()

"""The end of a session, done in the worker: cuffs.json, the assessment, the report, and what the page says of them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from fitting.cuffs_file import CuffsFileError
from fitting.result import NotIdentified
from fitting.uncertainty import Estimate
from station.fit import SessionError, fit_session_folder
from station.interval import bracketed, of_cuff

DRAWS = 50


class SummaryError(Exception):
    """The session cannot be summed up; one sentence."""


@dataclass(frozen=True)
class Summary:
    """rows: a cuff each, heading → words; findings: the assessment in sentences."""

    rows: tuple[dict[str, str], ...]
    findings: tuple[str, ...]


def summarise(folder: Path) -> Summary:
    """Writes cuffs.json, assessment.json and report.html into the session's folder."""
    from station.muscles.assess import assess_file
    from station.muscles.assessment_inputs import AssessmentInputs, InputError
    from station.muscles.findings import findings
    from station.report.page import write_report

    try:
        fitted = fit_session_folder(folder, folder / "cuffs.json")
    except SessionError as error:
        raise SummaryError(str(error)) from error
    rows = tuple(
        {
            "cuff": name,
            "k [N/m]": of_cuff(cuff, "stiffness", _words(cuff.stiffness)),
            "c [N s/m]": of_cuff(cuff, "damping", _words(cuff.damping)),
            "migration [mm]": _words(cuff.migration, 1e3),
            "verdict": cuff.verdict,
        }
        for name, cuff in fitted.cuffs.items()
    )
    try:
        assessed = assess_file(AssessmentInputs(folder / "cuffs.json"), folder, DRAWS)
        said = tuple(findings(assessed.assessment))
    except (NotIdentified, CuffsFileError, InputError) as error:
        said = (f"no assessment: {error}",)
    write_report(folder, fitted)
    return Summary(rows, said)


def _words(estimate: Estimate | None, scale: float = 1.0) -> str:
    return "not identified" if estimate is None else bracketed(estimate.value, estimate.ci95, scale)

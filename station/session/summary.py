"""The end of a session, done in the worker: cuffs.json, the assessment, the report, and what the page says of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from fitting.result import CuffFit
from fitting.uncertainty import Estimate
from station.errors import StationError
from station.fit import SessionError, fit_session_folder
from station.interval import bracketed, of_cuff

DRAWS = 50


class SummaryError(StationError):
    """The session cannot be summed up; one sentence."""


@dataclass(frozen=True)
class Summary:
    """rows: a cuff each, heading → words; findings: the assessment in sentences."""

    rows: tuple[dict[str, str], ...]
    findings: tuple[str, ...]


def summarise(folder: Path) -> Summary:
    """Writes cuffs.json, assessment.json and report.html into the session's folder, of the trials that there are."""
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
            "migration [mm]": of_cuff(cuff, "migration", _words(cuff.migration, 1e3)),
            "verdict": cuff.verdict,
        }
        for name, cuff in fitted.cuffs.items()
    )
    said = _assess_what_is_there(folder, fitted.cuffs)
    write_report(folder, fitted)
    return Summary(rows, said)


def _assess_what_is_there(folder: Path, cuffs: Mapping[str, CuffFit]) -> tuple[str, ...]:
    """assessment.json of the cuffs that can be worn; what was found, and what is left out or assumed, by name."""
    from solver.motion import MotionError
    from solver.suit.suit import SuitError
    from station.assessment.assess import assess_cuffs, write_assessment
    from station.assessment.assessment_inputs import AssessmentInputs, InputError, wearable
    from station.assessment.findings import findings

    worn, left_out = wearable({name: fit.wearable().without_migration() for name, fit in cuffs.items()})
    remarks = [f"{name}: {note}" for name, cuff in worn.items() for note in cuff.assumed]
    remarks += [f"not in the assessment: {reason}" for reason in left_out.values()]
    try:
        assessed = assess_cuffs(worn, AssessmentInputs(folder / "cuffs.json"), draws=DRAWS)
    except (SuitError, MotionError, InputError) as error:
        return (*remarks, f"no assessment: {error}")
    write_assessment(assessed, folder)
    return (*remarks, *findings(assessed.assessment))


def _words(estimate: Estimate | None, scale: float = 1.0) -> str:
    return "not identified" if estimate is None else bracketed(estimate.value, estimate.ci95, scale)

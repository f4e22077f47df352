"""Summary of a session, made in the worker: cuffs.json, the assessment, the report, and their texts for the page."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from fitting.uncertainty import Estimate
from station.errors import StationError
from station.interval import bracketed, of_cuff

if TYPE_CHECKING:
    from fitting.cuffs.cuff_fit import CuffFit

DRAWS = 50


class SummaryError(StationError):
    """The session cannot be fitted."""


@dataclass(frozen=True)
class Summary:
    """rows: one per cuff, heading → text; findings: the assessment in sentences."""

    rows: tuple[dict[str, str], ...]
    findings: tuple[str, ...]


def summarise(folder: Path) -> Summary:
    """Write cuffs.json, assessment.json and report.html into the session's folder, from the trials recorded so far."""
    from station.fit import SessionError, fit_session_folder
    from station.report.page import write_report

    try:
        fitted = fit_session_folder(folder, folder / "cuffs.json")
    except SessionError as error:
        raise SummaryError(error.cause) from error
    rows = tuple(
        {
            "cuff": name,
            "k [N/m]": of_cuff(cuff, "stiffness", _text(cuff.stiffness)),
            "c [N s/m]": of_cuff(cuff, "damping", _text(cuff.damping)),
            "migration [mm]": of_cuff(cuff, "migration", _text(cuff.migration, 1e3)),
            "verdict": cuff.verdict,
        }
        for name, cuff in fitted.cuffs.items()
    )
    findings = _assess(folder, fitted.cuffs)
    write_report(folder, fitted)
    return Summary(rows, findings)


def _assess(folder: Path, cuffs: Mapping[str, CuffFit]) -> tuple[str, ...]:
    """Write assessment.json of the cuffs that can be worn; return assumptions, omissions and findings as sentences."""
    from solver.errors import MotionError
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
    return (*remarks, *map(str, findings(assessed.assessment)))


def _text(estimate: Estimate | None, scale: float = 1.0) -> str:
    return "not identified" if estimate is None else bracketed(estimate.value, estimate.ci95, scale)

"""The report's section on the suit, from assessment.json and the activations beside it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from solver.coded_findings import CoverageCode
from solver.suit.suit import PARTS
from station.assessment.assessment_file import read_activations
from station.assessment.assessment_json import ACTIVATIONS_FILE, CURVE_KEYS
from station.report.body_figure import body_figure, postures_text
from station.report.conditions import CONDITIONS
from station.report.first_page import findings_of, intervals_of
from station.report.muscle_figures import (
    LEAST_SHOWN,
    activation_figure,
    change_figure,
    cost_figure,
    cuffs_figure,
    muscle_changes,
    reduction_figure,
)
from station.report.pictures import Picture, PlannedFigure
from station.sources import without_hash

if TYPE_CHECKING:
    import pandas as pd

Plain = Mapping[str, Any]

FOREARM = ("elbow_flexion", "pro_sup")
"""Coordinates of the finding that there is no marker on the forearm."""


@dataclass(frozen=True)
class AssessmentSection:
    """names of the files that went in; not_measured: coordinates that no marker determines, but those of which a
    finding says so; places: what waist, shoulder and arm are called; the cuffs worn; rows of the tables, of the motion
    beside, None without one; findings that are not on the first page; what the intervals contain, empty without any.
    """

    names: Mapping[str, str]
    not_measured: Sequence[str]
    places: Mapping[str, str]
    cuffs: Plain
    rows: list[dict[str, Any]]
    beside: list[dict[str, Any]] | None
    findings: list[str]
    intervals: str
    pictures: Sequence[Picture]


def assessment_section(assessment: Plain, pictures: Sequence[Picture]) -> AssessmentSection:
    beside = assessment.get("beside")
    return AssessmentSection(
        names={role: without_hash(what) for role, what in assessment["inputs"].items()},
        not_measured=_not_measured(assessment.get("subject") or {}),
        places=places_of(assessment),
        cuffs=assessment.get("cuffs", {}),
        rows=_rows(assessment),
        beside=[row for row in _rows(beside) if row["key"] in ("rigid", "both")] if beside else None,
        findings=findings_of(assessment),
        intervals=intervals_of(assessment),
        pictures=pictures,
    )


def _not_measured(subject: Plain) -> list[str]:
    codes = {finding["code"] for finding in subject.get("findings", ())}
    explained = FOREARM if CoverageCode.NO_FOREARM_MARKERS in codes else ()
    return [name for name in subject.get("coordinates_not_measured", ()) if name not in explained]


def places_of(assessment: Plain) -> Mapping[str, str]:
    """What waist, shoulder and arm are called in the suit; an assessment of an older station has the bundled names."""
    return assessment.get("suit_names") or {part: part for part in PARTS}


def effort_figures(assessment: Plain) -> list[PlannedFigure]:
    """The first page's picture of the muscles: effort over the rest length with every arm cuff."""
    uncertainty = assessment.get("uncertainty")
    bands = f"; shaded: 95 % bands of {uncertainty['people']['value']:.0f} drawn people" if uncertainty else ""
    caption = (
        f"Effort over the rest length of the cord, with migration and compliance{bands}. Small dots: lengths solved"
    )
    return [PlannedFigure(partial(cuffs_figure, assessment), caption, is_printed=True)] if _arms(assessment) else []


def suit_figures(assessment: Plain, folder: Path) -> list[PlannedFigure]:
    """Muscle effort of every arm cuff, activations and their change if they are in the folder, and EMG."""
    waist = f" and the {places_of(assessment)['waist']} cuff" if assessment["waist_cuff"] else ""
    arms = _arms(assessment)
    figures = []
    if arms:
        caption = f"Effort over the rest length of the cord in every condition, with the named cuff{waist}"
        figures.append(PlannedFigure(partial(cost_figure, assessment), caption, is_wide=True))
    if (folder / ACTIVATIONS_FILE).is_file():
        at = f"at a rest length of {assessment['reference_rest_length_m']['value']:.3f} m"
        activations = read_activations(folder / ACTIVATIONS_FILE)
        figures = [
            *_body_figures(assessment, activations, at),
            *figures,
            *_activation_figures(assessment, activations, at),
        ]
    if assessment["emg"]:
        caption = "Reduction of the mean activation, relative to a slack cord, in the model and in the EMG"
        figures.append(PlannedFigure(partial(reduction_figure, assessment), caption, is_wide=True, is_printed=True))
    return figures


def _arms(assessment: Plain) -> list[str]:
    return [cuff for cuff in assessment["cost"] if cuff != "rigid"]


def _best_arm(assessment: Plain, activations: pd.DataFrame) -> str | None:
    """The arm cuff of the least effort at the reference rest length whose activations are known."""
    efforts = {cuff: assessment["at_rigid_optimum"][cuff]["both"]["value"] for cuff in _arms(assessment)}
    drawn = set(activations["cuff"][activations["condition"] == "both"])
    known = {cuff: effort for cuff, effort in efforts.items() if effort is not None and cuff in drawn}
    return min(known, key=known.__getitem__) if known else None


def _body_figures(assessment: Plain, activations: pd.DataFrame, at: str) -> Iterator[PlannedFigure]:
    """With the arm cuff of the least effort."""
    cuff = _best_arm(assessment, activations)
    if cuff and assessment.get("postures"):
        chosen = postures_text(assessment["postures"])
        caption = f"Change of activation from a slack cord to the {cuff} cuff {at}, {CONDITIONS['both']}: {chosen}"
        plan = partial(body_figure, assessment["postures"], activations, cuff, places_of(assessment))
        yield PlannedFigure(plan, caption, is_wide=True, is_printed=True)


def _activation_figures(assessment: Plain, activations: pd.DataFrame, at: str) -> Iterator[PlannedFigure]:
    """The change of every muscle's mean activation; activations over time with the arm cuff of the least effort."""
    changes = muscle_changes(activations, _arms(assessment))
    caption = f"Mean activation of each muscle {at}, with migration and compliance, and its change"
    rest = ", ".join(muscle.muscle for muscle in changes if muscle.is_at_rest)
    at_rest = f". At rest throughout (below {LEAST_SHOWN}): {rest}" if rest else ""
    yield PlannedFigure(partial(change_figure, changes), caption + at_rest, is_wide=True)
    cuff = _best_arm(assessment, activations)
    if cuff:
        over_time = f"Activations over time {at}, {cuff} cuff; muscles at rest are left out"
        yield PlannedFigure(partial(activation_figure, activations, cuff), over_time, is_wide=True)


def _rows(assessment: Plain) -> list[dict[str, Any]]:
    """A row per condition and arm cuff: numbers as in the JSON, under its keys."""
    rows = []
    for cuff, by_condition in assessment["at_rigid_optimum"].items():
        for condition in ["rigid"] if cuff == "rigid" else by_condition:

            def of(key: str, cuff: str = cuff, condition: str = condition) -> Any:
                found = assessment[key][cuff]
                return found if cuff == "rigid" else found[condition]

            numbers = {"cost": of("at_rigid_optimum"), **of("optimum"), **{key: of(key) for key in CURVE_KEYS.values()}}
            arm = "" if cuff == "rigid" else cuff
            rows.append({"key": condition, "condition": CONDITIONS.get(condition, condition), "cuff": arm, **numbers})
    return rows

"""The report's section on the suit, from assessment.json and the activations beside it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from solver.coverage_code import CoverageCode
from solver.suit.suit import PARTS
from solver.suit.uncertainty import DrawnSource
from station.assessment.assessment_file import read_activations
from station.assessment.assessment_json import ACTIVATIONS_FILE, CURVE_KEYS
from station.assessment.interval_sources import sources_of, sources_text
from station.report.body_figure import body_figure
from station.report.conditions import CONDITIONS
from station.report.first_page import findings_of
from station.report.muscle_figures import (
    LEAST_SHOWN,
    NAMED_MUSCLES,
    activation_figure,
    change_figure,
    cost_figure,
    cuffs_figure,
    muscle_changes,
    reduction_figure,
    shown_muscles,
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
    finding says so; places: what waist, shoulder and arm are called; the cuffs worn; rows of the table, of the motion
    beside, None without one; findings that are not among the limits; what the intervals contain, empty without any;
    whether the cuffs alone were drawn; the first page's figures, and the others.
    """

    names: Mapping[str, str]
    not_measured: Sequence[str]
    places: Mapping[str, str]
    cuffs: Plain
    rows: list[dict[str, Any]]
    beside: list[dict[str, Any]] | None
    findings: list[str]
    intervals: str
    only_cuffs_drawn: bool
    overview: Sequence[Picture]
    pictures: Sequence[Picture]


def assessment_section(
    assessment: Plain, overview: Sequence[Picture], pictures: Sequence[Picture]
) -> AssessmentSection:
    beside = assessment.get("beside")
    return AssessmentSection(
        names={role: without_hash(what) for role, what in assessment["inputs"].items()},
        not_measured=_not_measured(assessment.get("subject") or {}),
        places=places_of(assessment),
        cuffs=assessment.get("cuffs", {}),  # an assessment of an older station has none
        rows=_rows(assessment),
        beside=_rows(beside) if beside else None,
        findings=findings_of(assessment),
        intervals=intervals_of(assessment),
        only_cuffs_drawn=not assessment.get("total_uncertainty") and sources_of(assessment) == (DrawnSource.CUFFS,),
        overview=overview,
        pictures=pictures,
    )


def intervals_of(assessment: Plain) -> str:
    """What the intervals of the assessment contain; empty without any."""
    return "the total uncertainty" if assessment.get("total_uncertainty") else sources_text(sources_of(assessment))


def _not_measured(subject: Plain) -> list[str]:
    codes = {finding["code"] for finding in subject.get("findings", ())}
    explained = FOREARM if CoverageCode.NO_FOREARM_MARKERS in codes else ()
    return [name for name in subject.get("coordinates_not_measured", ()) if name not in explained]


def places_of(assessment: Plain) -> Mapping[str, str]:
    """What waist, shoulder and arm are called in the suit; an assessment of an older station has the bundled names."""
    return assessment.get("suit_names") or {part: part for part in PARTS}


def effort_figures(assessment: Plain) -> list[PlannedFigure]:
    """The first page's picture of the muscles: effort over the rest length with every arm cuff."""
    total = assessment.get("total_uncertainty") or {}
    bands = ""
    if total.get("cost"):
        bands = f"; shaded: 95 % bands of total uncertainty, {total['people']['value']:.0f} people"
    elif "tendons" not in assessment["inputs"]:  # people are refused with elastic tendons
        bands = ". Drawn people (--people 1000) give bands of total uncertainty"
    caption = f"Effort over the rest length of the cord, with migration and compliance{bands}"
    return [PlannedFigure(partial(cuffs_figure, assessment), caption, is_printed=True)] if _arms(assessment) else []


def suit_figures(assessment: Plain, folder: Path) -> list[PlannedFigure]:
    """Muscle effort of every arm cuff, activations and their change if they are in the folder, and EMG."""
    waist = f"{places_of(assessment)['waist']} and " if assessment["waist_cuff"] else ""
    what = "Effort over the rest length of the cord"
    arms = _arms(assessment)
    figures = [
        PlannedFigure(partial(cost_figure, assessment, arm), f"{what}, {waist}{arm} cuff", is_printed=True)
        for arm in arms
    ]
    if (folder / ACTIVATIONS_FILE).is_file():
        at = f"at a rest length of {assessment['reference_rest_length_m']['value']:.3f} m"
        activations = read_activations(folder / ACTIVATIONS_FILE)
        figures = [*_body_figures(assessment, activations, at), *figures]
        figures += _activation_figures(activations, arms, at, waist)
    if assessment["emg"]:
        caption = "Reduction of the mean activation, relative to a slack cord, in the model and in the EMG"
        figures += [
            PlannedFigure(partial(reduction_figure, assessment, arm), f"{caption}, {waist}{arm} cuff", is_printed=True)
            for arm in arms
        ]
    return figures


def _arms(assessment: Plain) -> list[str]:
    return [cuff for cuff in assessment["cost"] if cuff != "rigid"]


def _body_figures(assessment: Plain, activations: pd.DataFrame, at: str) -> Iterator[PlannedFigure]:
    """With the arm cuff of the least effort; an assessment of an older station has no postures."""
    efforts = {cuff: assessment["at_rigid_optimum"][cuff]["both"]["value"] for cuff in _arms(assessment)}
    drawn = set(activations["cuff"][activations["condition"] == "both"])
    known = {cuff: effort for cuff, effort in efforts.items() if effort is not None and cuff in drawn}
    if known and assessment.get("postures"):
        cuff = min(known, key=known.__getitem__)
        caption = f"Change of activation from a slack cord to the {cuff} cuff {at}, {CONDITIONS['both']}"
        plan = partial(body_figure, assessment["postures"], activations, cuff, places_of(assessment))
        yield PlannedFigure(plan, caption, is_wide=True, is_printed=True)


def _activation_figures(activations: pd.DataFrame, arms: Sequence[str], at: str, waist: str) -> Iterator[PlannedFigure]:
    """The change of every muscle's mean activation; of every arm cuff, activations over time."""
    changes = muscle_changes(activations, arms)
    caption = f"Mean activation of each muscle {at}, with migration and compliance, and its change"
    rest = ", ".join(muscle.muscle for muscle in changes if muscle.is_at_rest)
    at_rest = f". At rest throughout (below {LEAST_SHOWN}): {rest}" if rest else ""
    yield PlannedFigure(partial(change_figure, changes), caption + at_rest, is_wide=True, is_printed=True)
    left_out = [name for name in NAMED_MUSCLES if name in activations and name not in shown_muscles(activations)]
    without = f". At rest throughout (below {LEAST_SHOWN}): {', '.join(left_out)}" if left_out else ""
    for arm in arms:
        over_time = f"Activations over time {at}, {waist}{arm} cuff{without}"
        yield PlannedFigure(partial(activation_figure, activations, arm), over_time, is_wide=True)


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
            rows.append({"condition": CONDITIONS.get(condition, condition), "cuff": arm, **numbers})
    return rows

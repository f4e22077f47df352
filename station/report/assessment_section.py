"""The report's section on the suit, from assessment.json and the activations beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from station.assessment.assessment_file import read_activations
from station.assessment.assessment_json import ACTIVATIONS_FILE, CURVE_KEYS
from station.assessment.sources import without_hash
from station.report.muscle_figures import activation_figure, cost_figure, cuffs_figure, reduction_figure
from station.report.pictures import Picture, PlannedFigure

Plain = Mapping[str, Any]


@dataclass(frozen=True)
class AssessmentSection:
    """names of the files that went in; the cuffs worn; rows of the table, of the motion beside, None without one;
    figures.
    """

    names: Mapping[str, str]
    cuffs: Plain
    rows: list[dict[str, Any]]
    beside: list[dict[str, Any]] | None
    pictures: Sequence[Picture]


def assessment_section(assessment: Plain, pictures: Sequence[Picture]) -> AssessmentSection:
    beside = assessment.get("beside")
    return AssessmentSection(
        names={role: without_hash(what) for role, what in assessment["inputs"].items()},
        cuffs=assessment.get("cuffs", {}),  # an assessment of an older station has none
        rows=_rows(assessment),
        beside=_rows(beside) if beside else None,
        pictures=pictures,
    )


def suit_figures(assessment: Plain, folder: Path) -> list[PlannedFigure]:
    """Muscle cost of every arm cuff, activations where they lie beside the assessment, and their reduction."""
    activations_file = folder / ACTIVATIONS_FILE
    arms = [cuff for cuff in assessment["cost"] if cuff != "rigid"]
    waist = "waist and " if assessment["waist_cuff"] else ""
    what = "Muscle cost over the cord's rest length"
    figures = [PlannedFigure(partial(cost_figure, assessment, arm), f"{what}, {waist}{arm} cuff") for arm in arms]
    if len(arms) > 1:
        together = f"{what}, with every arm cuff shifted and yielding"
        figures.insert(0, PlannedFigure(partial(cuffs_figure, assessment), together))
    if activations_file.is_file():
        activations = read_activations(activations_file)
        at = f"at a rest length of {assessment['reference_rest_length_m']['value']:.2f} m"
        figures += [
            PlannedFigure(
                partial(activation_figure, activations, arm), f"Activations {at}, {waist}{arm} cuff", is_wide=True
            )
            for arm in arms
        ]
    beside = " beside what EMG measured" if assessment["emg"] else ""
    caption = f"By how much each muscle does less on average than with a slack cord{beside}"
    figures += [
        PlannedFigure(partial(reduction_figure, assessment, arm), f"{caption}, {waist}{arm} cuff") for arm in arms
    ]
    return figures


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
            rows.append({"condition": condition.replace("_", "-"), "cuff": arm, **numbers})
    return rows

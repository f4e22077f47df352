"""Charts of the suit's effect on the muscles: effort over the rest length, activations, and their change."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy

from station.assessment.assessment_file import AssessmentDocument
from station.assessment.assessment_json import RIGID
from station.charts.marks import (
    COLOURS,
    HALF,
    QUARTER,
    THIRD,
    Array,
    Band,
    Chart,
    Colour,
    Intervals,
    Line,
    Mark,
    Panel,
    Points,
    Rule,
    chart,
    values,
)

if TYPE_CHECKING:
    import pandas as pd

LEAST_SHOWN = 0.01
"""A muscle whose activation stays below this in all conditions is at rest: it is named, not drawn."""
FINE, SOLVED = 121, 1.6
"""Points of a smooth curve, and radius [px] of the dot of a length that was solved."""
COSTLIEST = 1.3
"""Largest cost in the figure: a cord that is far too short costs double, and would compress the other curves."""
NAMED_MUSCLES = (
    "DeltoideusClavicle_A",
    "DeltoideusScapula_M",
    "DeltoideusScapula_P",
    "TrapeziusScapula_S",
    "TrapeziusClavicle_S",
    "SerratusAnterior_S",
    "SerratusAnterior_M",
    "SerratusAnterior_I",
)
"""Those that the published study shows."""
NOT_MUSCLES = ("condition", "cuff", "time_s")
"""Columns of the table of activations that are not muscles."""
CONDITIONS = {
    "slack": "slack cord",
    "rigid": "rigid cuffs",
    "shift": "migration",
    "visco_elastic": "compliance",
    "both": "migration and compliance",
}
LIMIT = "rigid cuffs"


@dataclass(frozen=True)
class MuscleChange:
    """Mean activation of a muscle with the cord slack, and by arm cuff with the suit, migration and compliance.

    largest  activation in any of them, at any time
    """

    muscle: str
    slack: float
    suited: Mapping[str, float]
    largest: float

    @property
    def change(self) -> float:
        """Mean over the cuffs."""
        return float(np.mean(list(self.suited.values()))) - self.slack

    @property
    def is_at_rest(self) -> bool:
        return self.largest < LEAST_SHOWN


def cost_figure(assessment: AssessmentDocument) -> Chart:
    """Muscle effort over the cord's rest length: a panel per arm cuff with every condition; 1 is a slack cord."""
    panels = []
    for cuff, conditions in assessment.cost.arms.items():
        places = {LIMIT: (RIGID, ""), **{CONDITIONS[name]: (cuff, name) for name in conditions}}
        panels.append(replace(_effort_panel(assessment, places), title=cuff, width=THIRD, height=205.0))
    return chart(*panels, has_one_legend=True)


def cuffs_figure(assessment: AssessmentDocument) -> Chart:
    """The same with every arm cuff, with migration and compliance, beside rigid ones; where people were drawn, with the
    band of total uncertainty of every arm cuff.
    """
    places = {LIMIT: (RIGID, ""), **{cuff: (cuff, "both") for cuff in assessment.cost.arms}}
    return chart(_effort_panel(assessment, places, tuple(_bands(assessment))))


def muscle_changes(activations: pd.DataFrame, cuffs: Sequence[str]) -> list[MuscleChange]:
    """Of every muscle, the largest decrease first."""
    slack = activations[activations["condition"] == "slack"]
    suited = {cuff: activations[(activations["cuff"] == cuff) & (activations["condition"] == "both")] for cuff in cuffs}
    found = [
        MuscleChange(
            name,
            float(slack[name].mean()),
            {cuff: float(part[name].mean()) for cuff, part in suited.items()},
            float(max(part[name].max() for part in (slack, *suited.values()))),
        )
        for name in activations.columns
        if name not in NOT_MUSCLES
    ]
    return sorted(found, key=lambda muscle: muscle.change)


def change_figure(changes: Sequence[MuscleChange]) -> Chart:
    """A row per muscle that is not at rest: mean activation with the cord slack and with every arm cuff, and the
    difference, so that a muscle that works more is seen as well as one that works less.
    """
    shown = [muscle for muscle in changes if not muscle.is_at_rest]
    rows = values(range(len(shown)))
    slack = values([muscle.slack for muscle in shown])
    levels: list[Mark] = [Points(slack, rows, "ink", "slack cord", is_hollow=True)]
    differences: list[Mark] = [Rule(0.0, "quiet", is_upright=True)]
    cuffs = list(shown[0].suited) if shown else []
    for cuff, colour, beside in zip(cuffs, COLOURS, _offsets(len(cuffs)), strict=False):
        suited = values([muscle.suited[cuff] for muscle in shown])
        titles = tuple(
            f"{muscle.muscle}, {cuff}: {muscle.slack:.3f} → {muscle.suited[cuff]:.3f}"
            f" ({muscle.suited[cuff] - muscle.slack:+.3f})"
            for muscle in shown
        )
        levels.append(Points(suited, rows + beside, colour, cuff, titles=titles))
        differences.append(Points(suited - slack, rows + beside, colour, cuff, titles=titles))
    names, height = tuple(muscle.muscle for muscle in shown), 50.0 + 11.5 * len(shown)
    return chart(
        Panel(tuple(levels), "mean activation", y_names=names, x_limits=(0.0, None), width=HALF, height=height),
        Panel(tuple(differences), "change from the slack cord", y_names=names, width=HALF, height=height),
        has_one_legend=True,
    )


def _offsets(count: int) -> Array:
    """Of so many dots in a row from its middle, so that equal ones do not hide each other."""
    return np.linspace(-0.25, 0.25, count) if count > 1 else np.zeros(count)


def activation_figure(activations: pd.DataFrame, cuff: str) -> Chart:
    """Activations over time, one panel per named muscle that is not at rest, in every condition with one arm cuff."""
    conditions = list(_conditions(activations, cuff))
    panels = []
    for muscle in shown_muscles(activations):
        marks = tuple(
            Line(values(part["time_s"]), values(part[muscle]), colour, CONDITIONS.get(condition, condition), width=1.2)
            for condition, part, colour in conditions
        )
        limits = (0.0, None)
        panels.append(Panel(marks, "time [s]", "activation", muscle, y_limits=limits, width=QUARTER, height=120.0))
    return chart(*panels, has_one_legend=True)


def shown_muscles(activations: pd.DataFrame) -> list[str]:
    """The published study's muscles, or the eight with the largest activation, without those at rest throughout."""
    muscles = [name for name in activations.columns if name not in NOT_MUSCLES]
    greatest = {name: float(activations[name].max()) for name in muscles}
    largest = sorted(muscles, key=lambda name: -greatest[name])[: len(NAMED_MUSCLES)]
    named = [name for name in NAMED_MUSCLES if name in muscles] or [name for name in muscles if name in largest]
    return [name for name in named if float(activations[name].max()) >= LEAST_SHOWN]


def reduction_figure(assessment: AssessmentDocument) -> Chart:
    """Reduction of mean activation in the model at the reference rest length, and in the measured EMG, by arm cuff."""
    return chart(*(_reductions(assessment, cuff) for cuff in assessment.cost.arms))


def _reductions(assessment: AssessmentDocument, cuff: str) -> Panel:
    measured = {row.muscle: row for row in assessment.emg}
    rows = values(range(len(measured)))
    modelled = [assessment.muscle_reduction.of(cuff)[name] for name in measured]
    percent = values([row.reduction_percent.value for row in measured.values()])
    spread = values([row.sd_percent.value for row in measured.values()])
    ends = 100 * values([number.ci95 or (None, None) for number in modelled]).reshape(-1, 2)
    return Panel(
        (
            Rule(0.0, "quiet", is_upright=True),
            Intervals(rows - 0.12, ends[:, 0], ends[:, 1], "c1", is_upright=False),
            Points(100 * values([number.value for number in modelled]), rows - 0.12, "c1", f"model, {cuff}"),
            Intervals(rows + 0.12, percent - spread, percent + spread, "c2", is_upright=False),
            Points(percent, rows + 0.12, "c2", "EMG ± sd", is_hollow=True),
        ),
        "reduction of mean activation [%]",
        y_names=tuple(measured),
        width=THIRD,
        height=70.0 + 22.0 * len(measured),
    )


def _effort_panel(
    assessment: AssessmentDocument, places: Mapping[str, tuple[str, str]], bands: Sequence[Band | Line] = ()
) -> Panel:
    """A curve for each label and its place in the assessment, its best rest length marked, above the bands."""
    lengths = values(assessment.rest_lengths_m.value)
    reference = assessment.reference_rest_length_m.value
    marks: list[Mark] = [
        *bands,
        Rule(1.0, "quiet", word="slack cord"),
        Rule(reference, "quiet", dash="dotted", is_upright=True, word=f"compared at {reference:.3f} m"),
    ]
    lowest = min([1.0, *(float(np.nanmin(band.low, initial=1.0)) for band in bands if isinstance(band, Band))])
    colours: tuple[Colour, ...] = ("ink", *COLOURS)
    for (label, place), colour in zip(places.items(), colours, strict=False):
        best, curve = assessment.optimum.of(*place), values(assessment.cost.of(*place).value)
        marks.append(Line(*_smooth(lengths, curve), colour, label))
        marks.append(Points(lengths, curve, colour, radius=SOLVED))
        if best.rest_length_m.value is not None:
            at, effort = values([best.rest_length_m.value]), values([best.normalised_cost.value])
            title = f"{label}: best at {at[0]:.3f} m, effort {effort[0]:.3f}"
            marks.append(Points(at, effort, colour, titles=(title,)))
        lowest = min(lowest, float(np.nanmin(curve, initial=1.0)))
    return Panel(
        tuple(marks),
        "rest length of the cord [m]; dot: best",
        "effort / effort with slack cord",
        y_limits=(lowest - 0.03, COSTLIEST),
        width=420.0,
        height=290.0,
    )


def _bands(assessment: AssessmentDocument) -> Iterator[Band | Line]:
    """Of the intervals, with their edges, which distinguish overlapping bands."""
    lengths = values(assessment.rest_lengths_m.value)
    for cuff, colour in zip(assessment.cost.arms, COLOURS, strict=False):
        if ends_of_lengths := assessment.cost.of(cuff).ci95:
            low, high = values([ends or (None, None) for ends in ends_of_lengths]).T
            fine, low = _smooth(lengths, low)
            _, high = _smooth(lengths, high)
            yield Band(fine, low, high, colour)
            yield Line(fine, low, colour, dash="dashed", width=0.8)
            yield Line(fine, high, colour, dash="dashed", width=0.8)


def _smooth(lengths: Array, curve: Array) -> tuple[Array, Array]:
    """The cubic spline through the efforts at the lengths solved, whose minimum is the best rest length.

    Where an effort is not known, the values themselves.
    """
    if len(lengths) < 4 or not np.isfinite(curve).all():
        return lengths, curve
    fine = np.linspace(lengths[0], lengths[-1], FINE)
    return fine, values(scipy.interpolate.CubicSpline(lengths, curve)(fine))


def _conditions(activations: pd.DataFrame, cuff: str) -> Iterator[tuple[str, pd.DataFrame, Colour]]:
    """Condition, its rows, and its colour: the slack cord, rigid cuffs, then those with this cuff."""
    worn = activations[activations["cuff"].isin(["", cuff])]
    colours: tuple[Colour, ...] = ("quiet", "ink", *COLOURS)
    for (condition, part), colour in zip(worn.groupby("condition", sort=False), colours, strict=False):
        yield str(condition), part, colour

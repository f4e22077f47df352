"""The report's section on the suit, from assessment.json and the activations in its folder.

The picture of the body with the suit has three postures, muscles coloured by the change of their activation.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from solver.errors import CoverageCode
from solver.suit.suit import PARTS
from station.assessment.assessment_file import AssessmentDocument, read_activations
from station.assessment.assessment_json import (
    ACTIVATIONS_FILE,
    CURVE_KEYS,
    RIGID,
    AssessedMotionEntry,
    NumberEntry,
    WornCuffEntry,
)
from station.assessment.drawn_postures import LineEntry, PostureEntry
from station.charts.marks import SIXTH, Array, Chart, Colour, Line, Panel, values
from station.report.first_page import interval_contents, other_findings
from station.report.muscle_figures import (
    CONDITIONS,
    LEAST_SHOWN,
    activation_figure,
    change_figure,
    cost_figure,
    cuffs_figure,
    muscle_changes,
    reduction_figure,
)
from station.report.pictures import Picture, PlannedPicture
from station.sources import without_hash
from station.subject.subject_document import SubjectDocument

if TYPE_CHECKING:
    import pandas as pd

FOREARM = ("elbow_flexion", "pro_sup")
"""Coordinates of the finding that there is no marker on the forearm."""
STEPS = (0.01, 0.03, 0.1)
"""Of the change of activation, between colours; below the first a muscle is drawn as unchanged."""
LESS: tuple[Colour, ...] = ("less1", "less2", "less3")
MORE: tuple[Colour, ...] = ("more1", "more2", "more3")
ELEVATION = 12.0
"""Of the viewer above the horizontal [deg]: rings are seen as rings."""
MUSCLE, UNCHANGED, CORD, BONE = 2.4, 0.7, 1.6, {"shaft": 4.5, "plate": 1.6, "cage": 0.7}
"""Widths of lines [px]."""
WIDTH, TITLE = SIXTH, 17.0
"""Of a panel and of its title's line [px]."""
MARGIN = 0.06
"""Around muscles and suit, of both sides together [m]."""
POSTURES = {
    "elevation": "lowest, middle and highest elevation of the arm",
    "cord_length": "shortest, middle and longest cord",
}
"""Figure by which the postures were chosen → what they are."""


@dataclass(frozen=True)
class AssessmentSection:
    """names of the files that went in; not_measured: coordinates that no marker determines, but those of which a
    finding says so; places: what waist, shoulder and arm are called; the cuffs worn; rows of the tables, of the motion
    beside, None without one; findings that are not on the first page; what the intervals contain, empty without any.
    """

    names: Mapping[str, str]
    not_measured: Sequence[str]
    places: Mapping[str, str]
    cuffs: Mapping[str, WornCuffEntry]
    rows: list[dict[str, NumberEntry | str]]
    beside: list[dict[str, NumberEntry | str]] | None
    findings: list[str]
    intervals: str
    pictures: Sequence[Picture]


def assessment_section(assessment: AssessmentDocument, pictures: Sequence[Picture]) -> AssessmentSection:
    beside = assessment.beside
    return AssessmentSection(
        names={role: without_hash(what) for role, what in assessment.inputs.items()},
        not_measured=_not_measured(assessment.subject),
        places=suit_places(assessment),
        cuffs=assessment.cuffs,
        rows=_rows(assessment),
        beside=[row for row in _rows(beside) if row["key"] in (RIGID, "both")] if beside else None,
        findings=other_findings(assessment),
        intervals=interval_contents(assessment),
        pictures=pictures,
    )


def _not_measured(subject: SubjectDocument | None) -> list[str]:
    if subject is None:
        return []
    codes = {finding.code for finding in subject.findings}
    explained = FOREARM if CoverageCode.NO_FOREARM_MARKERS in codes else ()
    return [name for name in subject.coordinates_not_measured if name not in explained]


def suit_places(assessment: AssessmentDocument) -> Mapping[str, str]:
    """Names of waist, shoulder and arm in the suit; an assessment of an older station has the bundled names."""
    return assessment.suit_names or {part: part for part in PARTS}


def effort_figures(assessment: AssessmentDocument) -> list[PlannedPicture]:
    """The first page's picture of the muscles: effort over the rest length with every arm cuff."""
    uncertainty = assessment.uncertainty
    bands = f"; shaded: 95 % bands of {uncertainty.people.value:.0f} drawn people" if uncertainty else ""
    caption = (
        f"Effort over the rest length of the cord, with migration and compliance{bands}. Small dots: lengths solved"
    )
    return [PlannedPicture(partial(cuffs_figure, assessment), caption, is_printed=True)] if assessment.cost.arms else []


def suit_figures(assessment: AssessmentDocument, folder: Path) -> list[PlannedPicture]:
    """Muscle effort of every arm cuff, activations and their change if they are in the folder, and EMG."""
    waist = f" and the {suit_places(assessment)['waist']} cuff" if assessment.waist_cuff else ""
    figures = []
    if assessment.cost.arms:
        caption = f"Effort over the rest length of the cord in every condition, with the named cuff{waist}"
        figures.append(PlannedPicture(partial(cost_figure, assessment), caption, is_wide=True))
    if (folder / ACTIVATIONS_FILE).is_file():
        at = f"at a rest length of {assessment.reference_rest_length_m.value:.3f} m"
        activations = read_activations(folder / ACTIVATIONS_FILE)
        figures = [
            *_body_figures(assessment, activations, at),
            *figures,
            *_activation_figures(assessment, activations, at),
        ]
    if assessment.emg:
        caption = "Reduction of the mean activation, relative to a slack cord, in the model and in the EMG"
        figures.append(PlannedPicture(partial(reduction_figure, assessment), caption, is_wide=True, is_printed=True))
    return figures


def _best_arm(assessment: AssessmentDocument, activations: pd.DataFrame) -> str | None:
    """The arm cuff of the least effort at the reference rest length whose activations are known."""
    efforts = {cuff: assessment.at_rigid_optimum.of(cuff).value for cuff in assessment.cost.arms}
    drawn = set(activations["cuff"][activations["condition"] == "both"])
    known = {cuff: effort for cuff, effort in efforts.items() if effort is not None and cuff in drawn}
    return min(known, key=known.__getitem__) if known else None


def _body_figures(assessment: AssessmentDocument, activations: pd.DataFrame, at: str) -> Iterator[PlannedPicture]:
    """With the arm cuff of the least effort."""
    cuff = _best_arm(assessment, activations)
    if cuff and assessment.postures:
        chosen = postures_text(assessment.postures)
        caption = f"Change of activation from a slack cord to the {cuff} cuff {at}, {CONDITIONS['both']}: {chosen}"
        plan = partial(body_figure, assessment.postures, activations, cuff, suit_places(assessment))
        yield PlannedPicture(plan, caption, is_wide=True, is_printed=True)


def _activation_figures(assessment: AssessmentDocument, activations: pd.DataFrame, at: str) -> Iterator[PlannedPicture]:
    """The change of every muscle's mean activation; activations over time with the arm cuff of the least effort."""
    changes = muscle_changes(activations, list(assessment.cost.arms))
    caption = f"Mean activation of each muscle {at}, with migration and compliance, and its change"
    rest = ", ".join(muscle.muscle for muscle in changes if muscle.is_at_rest)
    at_rest = f". At rest throughout (below {LEAST_SHOWN}): {rest}" if rest else ""
    yield PlannedPicture(partial(change_figure, changes), caption + at_rest, is_wide=True)
    cuff = _best_arm(assessment, activations)
    if cuff:
        over_time = f"Activations over time {at}, {cuff} cuff; muscles at rest are left out"
        yield PlannedPicture(partial(activation_figure, activations, cuff), over_time, is_wide=True)


def _rows(part: AssessedMotionEntry) -> list[dict[str, NumberEntry | str]]:
    """A row per condition and arm cuff: numbers under their keys in the JSON."""
    curves = [("", RIGID), *((cuff, condition) for cuff, found in part.cost.arms.items() for condition in found)]
    return [
        {
            "key": condition,
            "condition": CONDITIONS.get(condition, condition),
            "cuff": cuff,
            "cost": part.at_rigid_optimum.of(cuff or RIGID, condition),
            **dict(part.optimum.of(cuff or RIGID, condition)),
            **{key: getattr(part, key).of(cuff or RIGID, condition) for key in CURVE_KEYS.values()},
        }
        for cuff, condition in curves
    ]


@dataclass(frozen=True)
class ViewDirection:
    """azimuth: angle [deg] about the vertical, from forward to the right of the body, of the viewer."""

    name: str
    azimuth: float


VIEWS = (ViewDirection("from behind", 145.0), ViewDirection("from the front", 35.0))


def body_figure(
    postures: Sequence[PostureEntry], activations: pd.DataFrame, cuff: str, places: Mapping[str, str] | None = None
) -> Chart:
    """A column per posture and view, from behind and from the front.

    Colours are the activation with the suit (this arm cuff, migration and compliance) less that with a slack cord.
    places: what waist and arm are called.
    """
    ends = [[_ends(posture, view) for view in VIEWS] for posture in postures]
    extent = np.max([high - low for column in ends for low, high in column], axis=0) + MARGIN
    size = WIDTH, WIDTH * extent[1] / extent[0] + TITLE
    columns = []
    for posture, column, name in zip(postures, ends, _names(postures), strict=True):
        changes = activation_changes(activations, cuff, posture.time_s.value)
        for view, (low, high) in zip(VIEWS, column, strict=True):
            title = f"{name}, {view.name}"
            marks = (*_legend(), *_marks(posture, changes, view, places or {}))
            (left, bottom), (right, top) = (low + high - extent) / 2, (low + high + extent) / 2
            limits = (float(left), float(right)), (float(bottom), float(top))
            columns.append((Panel(marks, "", "", title, (), (), *limits, *size, is_picture=True),))
    return Chart(tuple(columns), has_one_legend=True)


def postures_text(postures: Sequence[PostureEntry]) -> str:
    """Description of the postures."""
    return POSTURES[postures[0].chosen_by]


def _names(postures: Sequence[PostureEntry]) -> Iterator[str]:
    """Of the postures: the figure by which they were chosen."""
    for posture in postures:
        length = posture.cord_length_m if posture.chosen_by == "cord_length" else None
        yield f"{length.value:.3f} m" if length else f"{posture.elevation_deg.value:.0f}°"


def activation_changes(activations: pd.DataFrame, cuff: str, time: float) -> dict[str, float]:
    """Muscle → activation with the suit less that with a slack cord, at the frame next to the time [s]."""
    slack = activations[activations["condition"] == "slack"]
    suited = activations[(activations["condition"] == "both") & (activations["cuff"] == cuff)]
    rows = [part.iloc[int(np.argmin(np.abs(values(part["time_s"]) - time)))] for part in (suited, slack)]
    muscles = activations.columns[3:]
    return {str(name): float(rows[0][name] - rows[1][name]) for name in muscles}


def change_colour(change: float) -> Colour:
    """The colour of a change of activation."""
    step = sum(abs(change) >= edge for edge in STEPS)
    if step == 0:
        return "same"
    return (LESS if change < 0 else MORE)[step - 1]


def _legend() -> Iterator[Line]:
    """Without points: from the largest decrease to the largest increase."""
    low, middle, high = (f"{edge:g}" for edge in STEPS)
    texts = (f"over {high}", f"{middle} to {high}", f"{low} to {middle}")
    entries = [(colour, f"{text} less") for colour, text in zip(reversed(LESS), texts, strict=True)]
    entries.append(("same", f"within {low}"))
    entries += [(colour, f"{text} more") for colour, text in zip(MORE, reversed(texts), strict=True)]
    for colour, label in (*entries, ("cord", "cord and cuffs")):
        yield Line(values([]), values([]), colour, label)


def _marks(
    posture: PostureEntry, changes: Mapping[str, float], view: ViewDirection, places: Mapping[str, str]
) -> Iterator[Line]:
    """Bones, then muscles from the farthest to the nearest, then cord and cuffs."""
    for bone in posture.bones:
        across, up, _ = _seen(bone.line_m, view)
        yield Line(across, up, "bone", width=BONE[bone.kind])
    lines = {name: _seen(line, view) for name, line in posture.muscles_m.items()}
    for name in sorted(lines, key=lambda name: float(lines[name][2].mean())):
        across, up, _ = lines[name]
        colour, change = change_colour(changes.get(name, 0.0)), changes.get(name, 0.0)
        width = UNCHANGED if colour == "same" else MUSCLE
        yield Line(across, up, colour, width=width, title=f"{name}: {change:+.3f}".replace("-", "−"))
    for part, ring in posture.cuffs_m.items():
        across, up, _ = _seen(ring, view)
        yield Line(across, up, "cord", width=CORD, title=f"{places.get(part, part)} cuff")
    across, up, _ = _seen(posture.cord_m, view)
    yield Line(across, up, "cord", width=CORD, title="cord")


def _seen(line: LineEntry, view: ViewDirection) -> tuple[Array, Array, Array]:
    """Across, up and towards the viewer [m], parallel projection; x is forward, y up, z to the right of the body."""
    x, y, z = values(line.value).T
    azimuth, elevation = np.radians([view.azimuth, ELEVATION])
    before = np.cos(azimuth) * x + np.sin(azimuth) * z
    across = np.sin(azimuth) * x - np.cos(azimuth) * z
    up = np.cos(elevation) * y - np.sin(elevation) * before
    return across, up, np.cos(elevation) * before + np.sin(elevation) * y


def _ends(posture: PostureEntry, view: ViewDirection) -> tuple[Array, Array]:
    """Least and greatest (across, up) of muscles and suit; the arm beyond them is cut off."""
    lines = (*posture.muscles_m.values(), *posture.cuffs_m.values(), posture.cord_m)
    seen = np.concatenate([np.column_stack(_seen(line, view)[:2]) for line in lines])
    return seen.min(axis=0), seen.max(axis=0)

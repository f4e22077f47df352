"""Picture of the body with the suit in three postures, muscles coloured by the change of their activation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from station.charts.marks import SIXTH, Array, Chart, Colour, Line, Panel, values

if TYPE_CHECKING:
    import pandas as pd

Plain = Mapping[str, Any]

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
class ViewDirection:
    """azimuth: angle [deg] about the vertical, from forward to the right of the body, of the viewer."""

    name: str
    azimuth: float


VIEWS = (ViewDirection("from behind", 145.0), ViewDirection("from the front", 35.0))


def body_figure(
    postures: Sequence[Plain], activations: pd.DataFrame, cuff: str, places: Mapping[str, str] | None = None
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
        changes = activation_changes(activations, cuff, posture["time_s"]["value"])
        for view, (low, high) in zip(VIEWS, column, strict=True):
            title = f"{name}, {view.name}"
            marks = (*_legend(), *_marks(posture, changes, view, places or {}))
            (left, bottom), (right, top) = (low + high - extent) / 2, (low + high + extent) / 2
            limits = (float(left), float(right)), (float(bottom), float(top))
            columns.append((Panel(marks, "", "", title, (), (), *limits, *size, is_picture=True),))
    return Chart(tuple(columns), has_one_legend=True)


def postures_text(postures: Sequence[Plain]) -> str:
    """What the postures are."""
    return POSTURES[postures[0]["chosen_by"]]


def _names(postures: Sequence[Plain]) -> Iterator[str]:
    """Of the postures: the figure by which they were chosen."""
    for posture in postures:
        is_length = posture["chosen_by"] == "cord_length"
        yield f"{posture['cord_length_m']['value']:.3f} m" if is_length else f"{posture['elevation_deg']['value']:.0f}°"


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
    posture: Plain, changes: Mapping[str, float], view: ViewDirection, places: Mapping[str, str]
) -> Iterator[Line]:
    """Bones, then muscles from the farthest to the nearest, then cord and cuffs."""
    for bone in posture["bones"]:
        across, up, _ = _seen(bone["line_m"], view)
        yield Line(across, up, "bone", width=BONE[bone["kind"]])
    lines = {name: _seen(line, view) for name, line in posture["muscles_m"].items()}
    for name in sorted(lines, key=lambda name: float(lines[name][2].mean())):
        across, up, _ = lines[name]
        colour, change = change_colour(changes.get(name, 0.0)), changes.get(name, 0.0)
        width = UNCHANGED if colour == "same" else MUSCLE
        yield Line(across, up, colour, width=width, title=f"{name}: {change:+.3f}".replace("-", "−"))
    for part, ring in posture["cuffs_m"].items():
        across, up, _ = _seen(ring, view)
        yield Line(across, up, "cord", width=CORD, title=f"{places.get(part, part)} cuff")
    across, up, _ = _seen(posture["cord_m"], view)
    yield Line(across, up, "cord", width=CORD, title="cord")


def _seen(line: Plain, view: ViewDirection) -> tuple[Array, Array, Array]:
    """Across, up and towards the viewer [m], parallel projection; x is forward, y up, z to the right of the body."""
    x, y, z = values(line["value"]).T
    azimuth, elevation = np.radians([view.azimuth, ELEVATION])
    before = np.cos(azimuth) * x + np.sin(azimuth) * z
    across = np.sin(azimuth) * x - np.cos(azimuth) * z
    up = np.cos(elevation) * y - np.sin(elevation) * before
    return across, up, np.cos(elevation) * before + np.sin(elevation) * y


def _ends(posture: Plain, view: ViewDirection) -> tuple[Array, Array]:
    """Least and greatest (across, up) of muscles and suit; the arm beyond them is cut off."""
    lines = (*posture["muscles_m"].values(), *posture["cuffs_m"].values(), posture["cord_m"])
    seen = np.concatenate([np.column_stack(_seen(line, view)[:2]) for line in lines])
    return seen.min(axis=0), seen.max(axis=0)

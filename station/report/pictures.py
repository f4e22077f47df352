"""Figures as the page carries them, and drawing all of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

from station.charts.marks import Chart
from station.charts.svg import draw
from station.progress import Progress

Section = TypeVar("Section")


@dataclass(frozen=True)
class PlannedPicture:
    """A figure of the page before it is drawn: its caption, whether it is as wide as the page, and printed."""

    plan: Callable[[], Chart]
    caption: str
    is_wide: bool = False
    is_printed: bool = False


@dataclass(frozen=True)
class Picture:
    """A figure as the page carries it: HTML with SVG inside, and the rest of its plan."""

    drawing: str
    caption: str
    is_wide: bool
    is_printed: bool


def draw_all(
    planned: Mapping[Section, Sequence[PlannedPicture]], progress: Progress
) -> dict[Section, tuple[Picture, ...]]:
    """Draw the figures of every section; progress counts figures."""
    total, done = sum(map(len, planned.values())), 0
    drawn: dict[Section, tuple[Picture, ...]] = {}
    for section, figures in planned.items():
        pictures = []
        for figure in figures:
            progress("drawing figures", done, total)
            drawing = draw(figure.plan(), figure.caption)
            pictures.append(Picture(drawing, figure.caption, figure.is_wide, figure.is_printed))
            done += 1
        drawn[section] = tuple(pictures)
    if total:
        progress("drawing figures", total, total)
    return drawn

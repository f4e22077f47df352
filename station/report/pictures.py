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
class Picture:
    """A figure of the page: HTML with SVG inside, its caption, whether it is as wide as the page, and printed."""

    drawing: str
    caption: str
    is_wide: bool = False
    is_printed: bool = False


@dataclass(frozen=True)
class PlannedFigure:
    """A figure that is still to be drawn."""

    plan: Callable[[], Chart]
    caption: str
    is_wide: bool = False
    is_printed: bool = False


def draw_all(
    planned: Mapping[Section, Sequence[PlannedFigure]], progress: Progress
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

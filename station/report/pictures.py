"""Figures as the page carries them, and drawing all of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

from station.charts.marks import Chart
from station.charts.svg import draw
from station.progress import Progress

Section = TypeVar("Section")


@dataclass(frozen=True)
class Picture:
    """A figure of the page: its caption, whether it is as wide as the page, and printed.

    drawing  HTML with SVG inside, of the plan; empty before it is drawn
    """

    plan: Callable[[], Chart]
    caption: str
    is_wide: bool = False
    is_printed: bool = False
    drawing: str = ""


def draw_all(planned: Mapping[Section, Sequence[Picture]], progress: Progress) -> dict[Section, tuple[Picture, ...]]:
    """Draw the figures of every section; progress counts figures."""
    total, done = sum(map(len, planned.values())), 0
    drawn: dict[Section, tuple[Picture, ...]] = {}
    for section, figures in planned.items():
        pictures = []
        for figure in figures:
            progress("drawing figures", done, total)
            pictures.append(replace(figure, drawing=draw(figure.plan(), figure.caption)))
            done += 1
        drawn[section] = tuple(pictures)
    if total:
        progress("drawing figures", total, total)
    return drawn

"""Figures as the page carries them, inside itself, and drawing all of them."""

from __future__ import annotations

import base64
import gc
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TypeVar

from station.progress import Progress

Section = TypeVar("Section")


@dataclass(frozen=True)
class Picture:
    """A figure of the page: PNG as a data address, what it shows, and whether it takes the page's whole width."""

    address: str
    caption: str
    is_wide: bool = False


@dataclass(frozen=True)
class PlannedFigure:
    """A figure that is still to be drawn: draw returns PNG."""

    draw: Callable[[], bytes]
    caption: str
    is_wide: bool = False


def draw_all(
    planned: Mapping[Section, Sequence[PlannedFigure]], progress: Progress
) -> dict[Section, tuple[Picture, ...]]:
    """Draw the figures of every section; progress counts figures, so that it tells how long the rest takes."""
    total, done = sum(map(len, planned.values())), 0
    drawn: dict[Section, tuple[Picture, ...]] = {}
    with _collection_after_figures() as collect:
        for section, figures in planned.items():
            pictures = []
            for figure in figures:
                progress("drawing figures", done, total)
                pictures.append(_picture(figure))
                collect()
                done += 1
            drawn[section] = tuple(pictures)
    if total:
        progress("drawing figures", total, total)
    return drawn


def _picture(figure: PlannedFigure) -> Picture:
    png = base64.b64encode(figure.draw()).decode("ascii")
    return Picture("data:image/png;base64," + png, figure.caption, figure.is_wide)


@contextmanager
def _collection_after_figures() -> Iterator[Callable[[], object]]:
    """Yield what frees the figure just drawn; until then Python collects no garbage.

    A figure is 10,000 objects in cycles. Python's own collections come while it is being built, when nothing of it can
    be freed, and search all trials of the session, too: a fifth of the processor time.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield lambda: gc.collect(0)  # only what was made since the figure before
    finally:
        if was_enabled:
            gc.enable()

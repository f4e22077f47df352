"""Drawing all figures of a page: in their sections and order, counted one by one, and without a trace in Python."""

from __future__ import annotations

import gc

import pytest

from station.progress import silent
from station.report.pictures import PlannedFigure, draw_all


def test_progress_counts_every_figure_of_all_sections() -> None:
    told: list[tuple[str, int, int]] = []
    planned = {"waist": [_planned("a"), _planned("b")], "hand": [_planned("c")]}
    draw_all(planned, lambda *step: told.append(step))
    assert told == [("drawing figures", done, 3) for done in range(4)]


def test_a_page_without_figures_counts_none() -> None:
    told: list[tuple[str, int, int]] = []
    assert draw_all({"waist": []}, lambda *step: told.append(step)) == {"waist": ()}
    assert told == []


def test_every_section_has_its_own_figures_in_their_order() -> None:
    drawn = draw_all({"waist": [_planned("a"), _planned("b", is_wide=True)], None: [_planned("c")]}, silent)
    captions = {section: [(picture.caption, picture.is_wide) for picture in part] for section, part in drawn.items()}
    assert captions == {"waist": [("a", False), ("b", True)], None: [("c", False)]}
    assert drawn[None][0].address == "data:image/png;base64,Yw=="


def test_no_garbage_is_searched_for_amid_a_figure_and_that_of_the_figure_before_is_gone() -> None:
    amid: list[bool] = []
    left: list[int] = []

    def draw() -> bytes:
        amid.append(gc.isenabled())
        left.append(sum(type(thing) is _Cycle for thing in gc.get_objects()))
        _Cycle()
        return b""

    draw_all({"waist": [PlannedFigure(draw, "a"), PlannedFigure(draw, "b")]}, silent)
    assert amid == [False, False]
    assert left == [0, 0]
    assert gc.isenabled()


def test_garbage_is_collected_again_after_a_figure_that_failed() -> None:
    def fail() -> bytes:
        raise ValueError("no data")

    with pytest.raises(ValueError, match="no data"):
        draw_all({"waist": [PlannedFigure(fail, "a")]}, silent)
    assert gc.isenabled()


class _Cycle:
    """As a figure is: only a search for garbage frees it."""

    def __init__(self) -> None:
        self.itself = self


def _planned(caption: str, *, is_wide: bool = False) -> PlannedFigure:
    return PlannedFigure(caption.encode, caption, is_wide)

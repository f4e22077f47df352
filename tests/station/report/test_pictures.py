"""Drawing all figures of a page: in their sections and order, counted one by one."""

from __future__ import annotations

from functools import partial

from station.charts.marks import Panel, chart
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
    assert ">panel c</text>" in drawn[None][0].drawing


def _planned(caption: str, *, is_wide: bool = False) -> PlannedFigure:
    return PlannedFigure(partial(chart, Panel((), title=f"panel {caption}")), caption, is_wide)

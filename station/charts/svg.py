"""A chart as SVG with text, hover titles and colours of the page's style sheet; a sentence as HTML."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from html import escape

import numpy as np
from jinja2.filters import do_mark_safe
from markupsafe import Markup

from station.charts.marks import (
    SIXTH,
    Band,
    Chart,
    Cloud,
    Colour,
    Intervals,
    Line,
    Mark,
    Panel,
    Points,
    Rule,
    Scale,
    Strip,
    curve,
    dots,
    limits,
    outline,
    tick_texts,
    ticks,
)

TEXT = 11.0
"""Pixels of a line of text."""
CHARACTER = 6.0
"""Width [px] of a character, on average: what room names and legends are given."""
KEY = 22.0
"""Width [px] of a legend's sample and the space after it."""
ROW = 15.0
BESIDE_TICKS, BELOW_TICKS = 8.0, 14.0
LARGEST = 1.6
"""Of a drawing on the screen, as a multiple of its own size."""
MANY = 3
"""Columns; more are drawn smaller."""
Ticks = list[tuple[float, str]]


@dataclass(frozen=True)
class Area:
    """The panel's data rectangle with its scales; y pixels grow downwards."""

    x: Scale
    y: Scale

    @property
    def left(self) -> float:
        return self.x.start

    @property
    def right(self) -> float:
        return self.x.end

    @property
    def top(self) -> float:
        return min(self.y.start, self.y.end)

    @property
    def bottom(self) -> float:
        return max(self.y.start, self.y.end)


@dataclass(frozen=True)
class Layout:
    """Position of the axes of a panel, and their ticks with their texts."""

    area: Area
    x_ticks: Ticks
    y_ticks: Ticks

    def moved_to(self, left: float) -> Layout:
        return replace(self, area=Area(replace(self.area.x, start=left), self.area.y))


@dataclass(frozen=True)
class LegendEntry:
    """Of a legend: kind of its sample, text, and where it stands: x [px] from the area's left edge, row."""

    kind: str
    label: str
    colour: Colour
    x: float
    row: int


def draw(chart: Chart, description: str) -> str:
    """HTML: a div of columns, each with an SVG for every panel. description is read out by screen readers."""
    legend = _shared_legend(chart.columns[0][0]) if chart.has_one_legend and chart.columns else ""
    columns = "".join(_column(column, description, has_legend=not legend) for column in chart.columns)
    is_small = bool(chart.columns) and chart.columns[0][0].width <= SIXTH
    kind = " small" if is_small else " many" if len(chart.columns) > MANY else ""
    return f'{legend}<div class="chart{kind}">{columns}</div>'


def _column(panels: tuple[Panel, ...], description: str, *, has_legend: bool) -> str:
    """Panels with the same left edge of their axes."""
    legends = [list(_legend(panel)) if has_legend else [] for panel in panels]
    layouts = [
        _layout(panel, max((entry.row for entry in legend), default=-1) + 1)
        for panel, legend in zip(panels, legends, strict=True)
    ]
    left = max(layout.area.left for layout in layouts)
    drawn = "".join(
        _panel(panel, layout.moved_to(left), legend, description)
        for panel, layout, legend in zip(panels, layouts, legends, strict=True)
    )
    return f'<div class="column">{drawn}</div>'


def _panel(panel: Panel, layout: Layout, legend: list[LegendEntry], description: str) -> str:
    area = layout.area
    width, height = area.right - area.left, area.bottom - area.top
    window = f"{area.left:.1f} {area.top:.1f} {width:.1f} {height:.1f}"
    size = f'x="{area.left:.1f}" y="{area.top:.1f}" width="{width:.1f}" height="{height:.1f}"'
    parts = [
        f'<svg viewBox="0 0 {panel.width:g} {panel.height:g}" role="img" '
        f'style="max-width:{LARGEST * panel.width:g}px">',
        f"<title>{escape(panel.title or description)}</title>",
        *_axes(panel, layout),
        f'<svg {size} viewBox="{window}">',
        *(_mark(mark, area) for mark in panel.marks),
        "</svg>",
        *(_word(mark, area) for mark in panel.marks if isinstance(mark, Rule) and mark.word),
        *_legend_texts(panel, legend, area),
        "</svg>",
    ]
    return "".join(parts)


def _layout(panel: Panel, legend_rows: int) -> Layout:
    if panel.is_picture:
        return _picture_layout(panel)
    x_limits, y_limits = limits(panel)
    top = 6.0 + (ROW + 2 if panel.title else 0) + legend_rows * ROW
    bottom = panel.height - 6.0 - (BELOW_TICKS if panel.has_x_numbers else 0) - (ROW + 1 if panel.x_label else 0)
    y_ticks = _ticks(panel.y_names, y_limits, most=max(3, int((bottom - top) / 28)))
    widest = max((len(text) for _, text in y_ticks), default=0)
    left = 6.0 + (ROW if panel.y_label else 0) + CHARACTER * widest + BESIDE_TICKS
    right = panel.width - 10.0
    x_ticks = _ticks(panel.x_names, x_limits, most=max(3, int((right - left) / 50)))
    y_start, y_end = (top, bottom) if panel.y_names else (bottom, top)
    return Layout(Area(Scale(*x_limits, left, right), Scale(*y_limits, y_start, y_end)), x_ticks, y_ticks)


def _picture_layout(panel: Panel) -> Layout:
    """The limits in the middle, on the largest scale at which both fit."""
    (left, right), (low, high) = limits(panel)
    top = 6.0 + (ROW + 2 if panel.title else 0)
    width, height = panel.width - 12.0, panel.height - 6.0 - top
    half = 0.5 * max((right - left) / width, (high - low) / height)
    x, y = (left + right) / 2, (low + high) / 2
    across = Scale(x - half * width, x + half * width, 6.0, 6.0 + width)
    return Layout(Area(across, Scale(y - half * height, y + half * height, top + height, top)), [], [])


def _ticks(names: tuple[str, ...], ends: tuple[float, float], most: int) -> Ticks:
    if names:
        return [(float(place), name) for place, name in enumerate(names)]
    places = ticks(*ends, most=most)
    return [*zip(places, tick_texts(places), strict=True)]


def _axes(panel: Panel, layout: Layout) -> Iterator[str]:
    area, x_ticks, y_ticks = layout.area, layout.x_ticks, layout.y_ticks
    if panel.title:
        yield f'<text class="t" x="{area.left:.1f}" y="15">{escape(panel.title)}</text>'
    if panel.is_picture:
        return
    grid = [f"M{area.x.pixel(place):.1f} {area.bottom:.1f}V{area.top:.1f}" for place, _ in x_ticks]
    grid += [f"M{area.left:.1f} {area.y.pixel(place):.1f}H{area.right:.1f}" for place, _ in y_ticks]
    yield f'<path class="grid" d="{"".join(grid)}"/>'
    yield f'<path class="axis" d="M{area.left:.1f} {area.top:.1f}V{area.bottom:.1f}H{area.right:.1f}"/>'
    below = area.bottom + BELOW_TICKS
    for place, text in x_ticks if panel.has_x_numbers else ():
        yield f'<text class="m" x="{area.x.pixel(place):.1f}" y="{below:.1f}">{escape(text)}</text>'
    for place, text in y_ticks:
        yield f'<text class="e" x="{area.left - 5:.1f}" y="{area.y.pixel(place) + 4:.1f}">{escape(text)}</text>'
    if panel.x_label:
        middle = (area.left + area.right) / 2
        yield f'<text class="m" x="{middle:.1f}" y="{panel.height - 5:.1f}">{escape(panel.x_label)}</text>'
    if panel.y_label:
        middle = (area.top + area.bottom) / 2
        yield f'<text class="m" transform="translate(12 {middle:.1f}) rotate(-90)">{escape(panel.y_label)}</text>'


def _mark(mark: Mark, area: Area) -> str:
    text = "" if isinstance(mark, Intervals) else mark.label
    text = text or (mark.title if isinstance(mark, Line) else "")
    title = f"<title>{escape(text)}</title>" if text else ""
    match mark:
        case Line():
            d, style = curve(area.x.pixels(mark.x), area.y.pixels(mark.y)), f' style="stroke-width:{mark.width:g}"'
            drawn = f'<path class="line {mark.colour} {mark.dash}" d="{d}"{style}>{title}</path>'
        case Cloud():
            drawn = f'<path class="cloud {mark.colour}" d="{dots(area.x.pixels(mark.x), area.y.pixels(mark.y))}"/>'
        case Band():
            edges = (area.y.pixels(mark.low), area.y.pixels(mark.high))
            drawn = f'<path class="band {mark.colour}" d="{outline(area.x.pixels(mark.x), *edges)}">{title}</path>'
        case Rule():
            drawn = f'<path class="line {mark.colour} {mark.dash}" d="{_rule(mark, area)}">{title}</path>'
        case Strip():
            drawn = _span(mark, area, title)
        case Points():
            drawn = "".join(_points(mark, area))
        case Intervals():
            drawn = _intervals(mark, area)
    return drawn


def _rule(mark: Rule, area: Area) -> str:
    if mark.is_upright:
        return f"M{area.x.pixel(mark.at):.1f} {area.bottom:.1f}V{area.top:.1f}"
    return f"M{area.left:.1f} {area.y.pixel(mark.at):.1f}H{area.right:.1f}"


def _span(mark: Strip, area: Area, title: str) -> str:
    scale = area.x if mark.is_upright else area.y
    low, high = sorted((scale.pixel(mark.low), scale.pixel(mark.high)))
    x, y, width, height = (
        (low, area.top, high - low, area.bottom - area.top)
        if mark.is_upright
        else (area.left, low, area.right - area.left, high - low)
    )
    place = f'x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}"'
    return f'<rect class="band {mark.colour}" {place}>{title}</rect>'


def _points(mark: Points, area: Area) -> Iterator[str]:
    kind, radius = ("hollow", mark.radius or 4.2) if mark.is_hollow else ("point", mark.radius or 3.0)
    titles = mark.titles or ("",) * len(mark.x)
    for x, y, number_x, number_y, title in zip(
        area.x.pixels(mark.x), area.y.pixels(mark.y), mark.x, mark.y, titles, strict=True
    ):
        if np.isfinite(x) and np.isfinite(y):
            text = title or f"{mark.label + ': ' if mark.label else ''}{number_x:.4g}, {number_y:.4g}"
            yield (
                f'<circle class="{kind} {mark.colour}" cx="{x:.1f}" cy="{y:.1f}" r="{radius}">'
                f"<title>{escape(text)}</title></circle>"
            )


def _intervals(mark: Intervals, area: Area) -> str:
    across, along = (area.x, area.y) if mark.is_upright else (area.y, area.x)
    pieces = []
    for place, low, high in zip(
        across.pixels(mark.places), along.pixels(mark.low), along.pixels(mark.high), strict=True
    ):
        if np.isfinite(low) and np.isfinite(high):
            pieces.append(
                f"M{place:.1f} {low:.1f}V{high:.1f}" if mark.is_upright else f"M{low:.1f} {place:.1f}H{high:.1f}"
            )
    return f'<path class="line {mark.colour}" d="{"".join(pieces)}"/>'


def _word(mark: Rule, area: Area) -> str:
    if not mark.is_upright:
        return (
            f'<text class="e" x="{area.right - 4:.1f}" y="{area.y.pixel(mark.at) - 4:.1f}">{escape(mark.word)}</text>'
        )
    at = area.x.pixel(mark.at)
    is_left = at + CHARACTER * len(mark.word) < area.right
    anchor, x = ("", at + 3) if is_left else (' class="e"', at - 3)
    return f'<text{anchor} x="{x:.1f}" y="{area.top + TEXT + 3:.1f}">{escape(mark.word)}</text>'


def _legend(panel: Panel) -> Iterator[LegendEntry]:
    """An entry for every labelled mark; equal labels once."""
    room, x, row, seen = panel.width - 60.0, 0.0, 0, set()
    for mark in panel.marks:
        label = "" if isinstance(mark, Intervals) else mark.label
        if not label or label in seen:
            continue
        seen.add(label)
        width = KEY + CHARACTER * len(label) + 8
        if x and x + width > room:
            x, row = 0.0, row + 1
        yield LegendEntry(_kind(mark), label, mark.colour, x, row)
        x += width


def _kind(mark: Mark) -> str:
    match mark:
        case Line() | Rule():
            return f"line {mark.dash}"
        case Band() | Strip():
            return "band"
        case Points() if mark.is_hollow:
            return "hollow"
    return "point"


def _legend_texts(panel: Panel, legend: list[LegendEntry], area: Area) -> Iterator[str]:
    above = 6.0 + (ROW + 2 if panel.title else 0)
    for entry in legend:
        x, y = area.left + entry.x, above + entry.row * ROW + 7
        yield _sample(entry, x, y) + f'<text x="{x + 20:.1f}" y="{y + 4:.1f}">{escape(entry.label)}</text>'


def _shared_legend(panel: Panel) -> str:
    start = '<svg viewBox="0 0 16 12" width="16" height="12">'
    entries = "".join(
        f"<span>{start}{_sample(entry, 0.0, 6.0)}</svg> {escape(entry.label)}</span>" for entry in _legend(panel)
    )
    return f'<p class="chart legend">{entries}</p>'


def _sample(entry: LegendEntry, x: float, y: float) -> str:
    if entry.kind.startswith("line"):
        return f'<path class="{entry.kind} {entry.colour}" d="M{x:.1f} {y:.1f}h16"/>'
    if entry.kind == "band":
        return f'<rect class="band {entry.colour}" x="{x:.1f}" y="{y - 4:.1f}" width="16" height="8"/>'
    return f'<circle class="{entry.kind} {entry.colour}" cx="{x + 8:.1f}" cy="{y:.1f}" r="3.2"/>'


def with_commands(sentence: object) -> Markup:
    """A sentence as HTML, its `commands` as code."""
    text = str(sentence) if isinstance(sentence, Markup) else escape(str(sentence))
    return do_mark_safe(re.sub(r"`([^`]+)`", r"<code>\1</code>", text))

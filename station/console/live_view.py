"""The live page: the body with its muscles, effort by scenario, cord force, EMG, and the rest length of the cord.

It may be opened and closed at any time, on any number of browsers; all show the same. A page that draws too slowly
gets fewer updates (`UpdateSender`), and the age of what it shows is computed in the browser.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from nicegui import ui

from documents.interval import counted
from documents.plain_data import finite_or_none
from recordings.manifest import DataOrigin
from station.console.charts import DISPLACEMENT, FORCE, FORCE_AXIS, INK, axis, axis_below, line
from station.console.live_feed import SHOWN_S, SLACK, WORN, LiveFeed, LivePoint
from station.console.running_view import DRAW_TIMEOUT_S, UpdateSender
from station.live.published import LiveBest, LiveRecent, LiveScenario, LiveSetup, LiveUpdate, LiveValues
from station.messages.live_messages import LiveCode

PATH = "/live"
REFRESH_S = 0.08
HERE = Path(__file__).parent
SCRIPTS = "".join(
    f"<script>{(HERE / name).read_text(encoding='utf-8')}</script>"
    for name in ("freshness.js", "view3d.js", "body.js", "live.js")
)
SLIDER_STEP_M = 0.005
FULL_BAR = 1.2
"""Effort over that of the slack suit at which its bar ends."""
LINES: dict[str, tuple[str, str]] = {SLACK: (INK, "dotted"), WORN: (FORCE, "solid"), "rigid": (DISPLACEMENT, "dashed")}
"""Colour and dash of a condition."""
MAIN, FURTHER = ("slack", "worn", "rigid"), ("#8a94a3", "solid")
"""Scenarios with a curve in the colour of their condition; further rest lengths and cuffs are grey."""
EMG_LINES = ((FORCE, "solid"), (DISPLACEMENT, "dashed"), ("#00715a", "dotted"), ("#7a3e9d", "solid"))
MUSCLES_NAMED = 4
NO_VALUES = (
    "No live values: they are computed while a motion of the wearer is recorded with enabled = true under [live] in "
    "the configuration. This page shows them as soon as they arrive."
)


def show_live_page(feed: LiveFeed) -> None:
    """Build the page at /live for one browser; it has no effect on the operator's page or on the recording."""
    for name in ("style.css", "live.css"):
        ui.add_css(HERE / name)
    ui.add_head_html(SCRIPTS)
    ui.colors(primary="#1d4e89", positive="#1b7f3b", warning="#a34a00")
    with ui.header().classes("items-center justify-between no-wrap"):
        with ui.row().classes("items-center gap-5 no-wrap"):
            simulated = ui.label("SIMULATED DATA").classes("simulated").mark("simulated")
            with ui.column().classes("gap-0"):
                ui.label("live muscles").classes("title")
                trial = ui.label().classes("subtitle").mark("subtitle")
        with ui.row().classes("items-center no-wrap shrink-0"):
            ui.label().classes("age").mark("age")
            ui.button(icon="contrast").props('flat color=white aria-label="light or dark"').classes("small").on(
                "click", js_handler="() => Quasar.Dark.toggle()"
            )
    view = LiveMuscles(feed)

    def tick() -> None:
        setup = feed.setup
        simulated.set_visibility(setup is not None and setup.origin == DataOrigin.SIMULATED)
        trial.text = "" if setup is None else setup.trial
        view.tick()

    ui.timer(REFRESH_S, tick)


class LiveMuscles:
    """One page. tick() is to be called about ten times a second."""

    def __init__(self, feed: LiveFeed) -> None:
        self._feed, self._client = feed, ui.context.client
        self._sender = UpdateSender(self._draw)
        self._sent_points = 0
        self._setups = -1
        self._findings: tuple[str, ...] = ()
        self._shown_scenario = 0
        with ui.column().classes("screen live"):
            self._build()

    @ui.refreshable_method
    def _build(self) -> None:
        """Anew for every set-up: it has the names of scenarios, muscles and EMG channels."""
        feed, setup = self._feed, self._feed.setup
        self._ready = False
        if setup is None:
            ui.label(NO_VALUES).classes("text-xl").mark("no-values")
            return
        self._body_name = ui.label(body_text(setup)).classes("text-lg").mark("body-name")
        self._notices = ui.column().classes("notices").props("role=status").mark("findings")
        with ui.element("div").classes("live-grid"):
            with ui.column().classes("live-body gap-1"):
                self._canvas = ui.element("canvas").classes("body").props('aria-label="body, drag to turn"')
                self._active = ui.label().classes("under").mark("most-active")
                self._colour_by = _scenario_choice(feed.scenarios, feed.worn or 0, self._choose)
            with ui.column().classes("live-numbers gap-2"):
                self._effort = _EffortTable(feed.scenarios)
                self._build_rest_length()
                with ui.element("div").classes("live-charts"):
                    self._charts = _charts(setup, feed.scenarios)
        self._delivery = ui.label().classes("status quiet").mark("delivery")
        self._ready = True

    def _build_rest_length(self) -> None:
        feed = self._feed
        self._best = ui.label().classes("best").mark("best")
        self._rest_length = ui.label().classes("under").mark("rest-length")
        self._slider: ui.slider | None = None
        if feed.suit is not None and feed.worn is not None and math.isfinite(feed.rest_length_m):
            lowest, highest = (float(feed.suit.rest_lengths[end]) for end in (0, -1))
            self._slider = ui.slider(min=lowest, max=highest, step=SLIDER_STEP_M, value=feed.rest_length_m)
            self._slider.props('aria-label="rest length of the cord"').mark("slider")
            self._slider.on_value_change(lambda event: self._set_rest_length(event.value))

    def _set_rest_length(self, rest_length_m: float) -> None:
        if abs(rest_length_m - self._feed.rest_length_m) > 1e-6:  # else this page follows another one
            self._feed.set_rest_length(rest_length_m)

    def _choose(self, index: int) -> None:
        self._shown_scenario = index

    def tick(self) -> None:
        feed = self._feed
        if feed.setups != self._setups or (feed.drawing is not None) != self._has_drawing:
            self._setups, self._has_drawing = feed.setups, feed.drawing is not None
            self._sent_points, self._shown_scenario = 0, feed.worn or 0
            self._build.refresh()
        if not self._ready or feed.setup is None:
            return
        self._show_texts(feed.setup)
        self._sender.tick(None if feed.shown is None else (feed.setups, feed.shown))

    _has_drawing = False

    def _show_texts(self, setup: LiveSetup) -> None:
        feed = self._feed
        latest = feed.latest
        findings = tuple(one.sentence for one in latest.findings) if latest is not None else ()
        if findings != self._findings or not list(self._notices):
            self._findings = findings
            self._notices.clear()
            with self._notices:
                for sentence in findings:
                    ui.label(sentence).classes("notice")
        is_named = latest is not None and any(one.code == LiveCode.GENERIC_BODY for one in latest.findings)
        self._body_name.set_visibility(not is_named)
        self._delivery.text = delivery_text(setup, latest, is_over=feed.is_over)
        self._best.text = best_text(feed.values.best if feed.values else None)
        self._rest_length.text = rest_length_text(feed.rest_length_m)
        if self._slider is not None and abs(self._slider.value - feed.rest_length_m) > 1e-6:
            self._slider.value = feed.rest_length_m

    async def _draw(self) -> None:
        feed, update = self._feed, self._feed.shown
        if feed.setup is None or update is None or (values := update.values) is None:
            return
        new = min(feed.points - self._sent_points, len(feed.history))
        points, self._sent_points = list(feed.history)[-new:] if new else [], feed.points
        shown = values.scenarios[self._shown_scenario]
        picture = {
            "at": update.delivery.published_s - update.delivery.age_s,
            "lag": feed.setup.lag_s,
            "isOver": feed.is_over,
            "body": (self._canvas.html_id, self._body(values, shown.activations)),
            "active": (self._active.html_id, most_active(feed.setup.muscles, shown.activations)),
            "rows": self._effort.rows(values, feed),
            "recent": (self._effort.heading_id, recent_heading(values.recent)),
            "curves": [(chart.id, _curves(points, name)) for name, chart in self._charts.items()],
            "seconds": SHOWN_S,
        }
        drawn = f"return station.drawLive({json.dumps(finite_or_none(picture))})"
        await self._client.run_javascript(drawn, timeout=DRAW_TIMEOUT_S)

    def _body(self, values: LiveValues, activations: Sequence[float]) -> dict[str, Any] | None:
        if self._feed.drawing is None or not all(map(math.isfinite, values.coordinates)):
            return None
        return {**self._feed.drawing.lines(values.coordinates), "levels": activations}


class _EffortTable:
    """A row for every scenario: effort now and over the last cycles, as bars and figures."""

    def __init__(self, scenarios: Sequence[LiveScenario]) -> None:
        self._scenarios = scenarios
        self._ids: list[str] = []
        with ui.element("div").classes("efforts").mark("efforts"):
            ui.label("muscle effort").classes("heading")
            ui.label("now").classes("under").tooltip("bar: effort; figure: relative to the effort with a slack cord")
            heading = ui.label(recent_heading(None)).classes("under")
            self.heading_id = heading.html_id
            for scenario in scenarios:
                ui.label(scenario_text(scenario)).classes("scenario")
                for part in ("now", "recent"):
                    with ui.element("div").classes(f"effort {scenario.condition}") as cell:
                        with ui.element("div").classes("bar"):
                            ui.element("div").classes("fill")
                        ui.label("–").mark(f"{part}-{scenario.name}")
                    self._ids.append(cell.html_id)

    def rows(self, values: LiveValues, feed: LiveFeed) -> list[tuple[str, str, float]]:
        """Element, text, and width of the bar from 0 to 1, of every cell."""
        reference = math.nan if feed.slack is None else values.scenarios[feed.slack].effort
        past = (math.nan if feed.slack is None else point.efforts[feed.slack] for point in feed.history)
        largest = max(filter(math.isfinite, past), default=math.nan)
        cells: list[tuple[float, float]] = []
        for scenario, solved in zip(self._scenarios, values.scenarios, strict=True):
            recent = values.recent.effort.get(scenario.name, math.nan) if values.recent else math.nan
            cells += [(_ratio(solved.effort, reference), _ratio(solved.effort, largest)), (recent, recent)]
        return [(cell, share_text(share), _width(size)) for cell, (share, size) in zip(self._ids, cells, strict=True)]


def _ratio(effort: float, reference: float) -> float:
    return effort / reference if reference else math.nan


def _width(share: float) -> float:
    return max(0.0, min(1.0, share / FULL_BAR)) if math.isfinite(share) else 0.0


def _scenario_choice(scenarios: Sequence[LiveScenario], chosen: int, choose: Callable[[int], None]) -> ui.toggle:
    """Choice of the scenario whose activations colour the muscles, on this page only."""
    names = {index: scenario_text(scenario) for index, scenario in enumerate(scenarios)}
    toggle = ui.toggle(names, value=chosen, on_change=lambda event: choose(event.value))
    return toggle.classes("colour-by").props("no-caps").mark("colour-by")


def _charts(setup: LiveSetup, scenarios: Sequence[LiveScenario]) -> dict[str, ui.echart]:
    effort = [_line(scenario_text(one), *(LINES[one.condition] if one.name in MAIN else FURTHER)) for one in scenarios]
    force = [_line("predicted", FORCE, "solid")]
    force += [_line("measured", DISPLACEMENT, "dashed")] if setup.has_cord_cell else []
    emg = [_line(name, *EMG_LINES[k % len(EMG_LINES)]) for k, name in enumerate(setup.emg_channels)]
    charts = {"effort": ("muscle effort \u03a3 w a\u00b2", effort), "force": (f"cord {FORCE_AXIS}", force)}
    charts |= {"emg": ("EMG RMS [\u00b5V]", emg)} if emg else {}
    return {name: ui.echart(_chart(title, lines)).mark(f"chart-{name}") for name, (title, lines) in charts.items()}


def _line(name: str, colour: str, dash: str) -> dict[str, Any]:
    style = {"width": 2.5, "color": colour, "type": dash}
    return line(colour, name=name, lineStyle=style, symbol="none")


def _chart(title: str, lines: list[dict[str, Any]]) -> dict[str, Any]:
    text = {"fontSize": 14, "color": INK}
    return {
        "animation": False,
        "title": {"text": title, "left": 6, "top": 0, "textStyle": {**text, "fontSize": 16, "fontWeight": "normal"}},
        "legend": {"top": 22, "left": 6, "textStyle": text, "itemWidth": 34},
        "grid": {"left": 56, "right": 14, "top": 50, "bottom": 50},
        "xAxis": _time_axis(),
        "yAxis": axis(min=0, scale=False),
        "series": lines,
    }


def _time_axis() -> dict[str, Any]:
    below = axis_below("time [s]", splitNumber=4)
    return {**below, "axisLabel": {**below["axisLabel"], "showMinLabel": False, "showMaxLabel": False}}


def _curves(points: Sequence[LivePoint], name: str) -> list[list[tuple[float, float]]]:
    """New points of every curve of a chart."""
    rows: dict[str, list[tuple[float, ...]]] = {
        "effort": [point.efforts for point in points],
        "force": [(point.cord_force_n, point.measured_n) for point in points],
        "emg": [point.emg_uv for point in points],
    }
    times = [round(point.time_s, 3) for point in points]
    columns = zip(*rows[name], strict=True)
    return [[(time, round(value, 4)) for time, value in zip(times, column, strict=True)] for column in columns]


def body_text(setup: LiveSetup) -> str:
    """Name and scaling of the body."""
    scaled = "scaled to the wearer" if setup.subject.is_scaled else "generic, not scaled to the wearer"
    return f"body: {setup.subject.name}, {scaled}"


def scenario_text(scenario: LiveScenario) -> str:
    """Title of a scenario. Further rest lengths and cuffs have their own names."""
    return {"slack": "slack cord", "rigid": "rigid cuffs", "worn": "as worn"}.get(scenario.name, scenario.name)


def share_text(share: float) -> str:
    """Effort as a share of that with a slack cord; a dash without a solution."""
    return f"{100 * share:.0f} %" if math.isfinite(share) else "–"


def recent_heading(recent: LiveRecent | None) -> str:
    if recent is None or not recent.cycles:
        return "over cycles: none yet"
    return "last cycle" if recent.cycles == 1 else f"last {recent.cycles} cycles"


def best_text(best: LiveBest | None) -> str:
    """The best rest length so far, with its standard deviation."""
    if best is None:
        return "best rest length: known after the first cycle of the arm"
    change = 100 * (1 - best.effort)
    effort = f"{abs(change):.0f} % {'less' if change >= 0 else 'more'} effort than with a slack cord"
    beyond = {-1: " or shorter", 1: " or longer"}.get(best.edge, "")
    spread = f" ± {best.sd_m:.2f}" if math.isfinite(best.sd_m) and not beyond else ""
    return f"best for this motion so far: {best.rest_length_m:.2f} m{spread}{beyond}, {effort}"


def rest_length_text(rest_length_m: float) -> str:
    return f"rest length of the cord: {rest_length_m:.3f} m" if math.isfinite(rest_length_m) else ""


def most_active(muscles: Sequence[str], activations: Sequence[float]) -> str:
    """The muscles with the largest activations."""
    known = [(level, name) for name, level in zip(muscles, activations, strict=True) if math.isfinite(level)]
    if not known:
        return "no activations in this frame"
    return "most active: " + ", ".join(
        f"{name.replace('_', ' ')} {100 * level:.0f} %" for level, name in sorted(known, reverse=True)[:MUSCLES_NAMED]
    )


def delivery_text(setup: LiveSetup, update: LiveUpdate | None, *, is_over: bool) -> str:
    """Numbers of frames solved and left out, and of updates that this page missed."""
    if update is None:
        return "waiting for the first frame"
    delivery = update.delivery
    parts = [f"{setup.trial}, ended"] if is_over else [setup.trial]
    parts += [
        f"{delivery.solved_hz:.0f} of {setup.frame_rate_hz:.0f} frames per second solved",
        f"{counted(delivery.dropped_frames, 'frame')} left out",
        f"latency {1e3 * delivery.latency_s:.0f} ms",
    ]
    parts += [f"{counted(delivery.not_shown, 'update')} not shown"] if delivery.not_shown else []
    return " · ".join(part for part in parts if part)

"""The page of live values, at /live: beside the operator's page, and without effect on it or on the recording."""

from __future__ import annotations

from pathlib import Path

from nicegui import ui

from recordings.manifest import DataOrigin
from station.console.live_feed import LiveFeed
from station.console.live_view import LiveMuscles

PATH = "/live"
REFRESH_S = 0.08
HERE = Path(__file__).parent
SCRIPTS = "".join(
    f"<script>{(HERE / name).read_text(encoding='utf-8')}</script>"
    for name in ("freshness.js", "view3d.js", "body.js", "live.js")
)


def show_live_page(feed: LiveFeed) -> None:
    """Build the page for one browser."""
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

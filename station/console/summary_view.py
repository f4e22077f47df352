"""The end of a session: the cuffs' table, what they do to the muscles, the report."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any

from nicegui import ui

from station.session.desk import Desk


def show(desk: Desk, act: Callable[..., Any], acts: dict[str, Callable[[], Awaitable[None] | None]]) -> None:
    ui.label("Every trial of the plan is accepted").classes("cue").mark("complete")
    if desk.progress:
        with ui.row().classes("items-center"):
            ui.spinner(size="2rem")
            ui.label(desk.progress).classes("text-xl")
    summary = desk.summary
    if summary is None:
        button = ui.button("Fit, assess and report (f)", on_click=lambda: act(desk.finish)).mark("finish")
        button.set_enabled(not desk.progress)
        acts["finish"] = desk.finish
    else:
        columns = [{"name": key, "label": key, "field": key, "align": "left"} for key in summary.rows[0]]
        ui.table(columns=columns, rows=list(summary.rows)).props("flat wrap-cells").classes("text-xl").mark(
            "cuffs-table"
        )
        for sentence in summary.findings:
            ui.label(sentence).classes("text-xl").mark("finding")
        ui.link("Open the report", "/report", new_tab=True).classes("text-2xl").mark("report")
    ui.button("Leave the session", on_click=lambda: act(desk.leave)).props("outline").mark("leave")

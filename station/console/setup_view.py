"""Who is measured, with which cuffs; and whether the bench answers."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from nicegui import ui

from station.console.desk import Desk, looks_like_a_name
from station.journal import Setup


def show(desk: Desk, act: Callable[..., Any]) -> None:
    ui.label("A new session, or one to go on with").classes("cue")
    with ui.row().classes("w-full gap-8 items-start lg:flex-nowrap"):
        with ui.card().classes("w-full lg:w-1/2"):
            _form(desk, act)
        with ui.card().classes("w-full lg:w-1/2"):
            _sessions(desk, act)
            _preflight(desk)


def _form(desk: Desk, act: Callable[..., Any]) -> None:
    subject = ui.input("Subject code", placeholder="P01").props("autofocus").mark("subject").classes("w-full")
    warning = ui.label("this looks like a name: use a code, it becomes part of file names").classes(
        "text-lg text-negative"
    )
    warning.bind_visibility_from(subject, "value", backward=looks_like_a_name)
    operator = ui.input("Operator").mark("operator").classes("w-full")
    number = ui.input("Session", value="1").classes("w-full").mark("number")
    cuffs = list(desk.config.cuffs)
    chosen = (
        ui.select(cuffs, label="Cuffs, in this order", value=cuffs, multiple=True)
        .props("use-chips")
        .classes("w-full")
        .mark("cuffs")
    )
    repeats = (
        ui.number("Repeats of each test", value=desk.config.protocol.repeats, min=1, precision=0)
        .classes("w-full")
        .mark("repeats")
    )
    bounce = ui.switch("Bounce calibration first", value=desk.config.bounce is not None)
    bounce.set_enabled(desk.config.bounce is not None)

    def setup() -> Setup:
        return Setup(
            (subject.value or "").strip(),
            (operator.value or "").strip(),
            tuple(chosen.value),
            int(repeats.value or 1),
            bool(bounce.value),
            (number.value or "").strip(),
        )

    preview = ui.label().classes("text-lg opacity-70")
    subject.on_value_change(lambda: preview.set_text(f"files go to {desk.folder_of(setup())}"))
    with ui.row():
        ui.button("Begin", on_click=lambda: act(lambda: desk.begin(setup()))).mark("begin")
        ui.button("Rehearse", on_click=lambda: act(lambda: desk.begin(setup(), is_rehearsal=True))).props(
            "outline"
        ).mark("rehearse")


def _sessions(desk: Desk, act: Callable[..., Any]) -> None:
    ui.label("Go on with").classes("text-2xl")
    there = desk.sessions()
    if not there:
        ui.label("no session yet").classes("text-lg opacity-70")
    for setup, folder in there[:8]:
        _resumption(desk, act, setup, folder)


def _resumption(desk: Desk, act: Callable[..., Any], setup: Setup, folder: Path) -> None:
    words = f"{setup.subject}, session {setup.number}: {', '.join(setup.cuffs)}"
    button = ui.button(words, on_click=lambda: act(lambda: desk.begin(setup))).props("flat no-caps")
    button.tooltip(str(folder)).mark("resume")


def _preflight(desk: Desk) -> None:
    ui.separator()
    lines = ui.column().classes("gap-1")

    async def look() -> None:
        button.disable()
        lines.clear()
        with lines:
            ui.spinner()
        found = await desk.preflight()
        lines.clear()
        with lines:
            for line in found:
                with ui.row().classes("items-center no-wrap gap-2 text-lg"):
                    ui.icon(
                        "check_circle" if line.is_good else "cancel", color="positive" if line.is_good else "negative"
                    )
                    ui.label(f"{line.subject}: {line.found}").mark("preflight")
        button.enable()

    button = ui.button("Check the bench", on_click=look).props("outline").mark("check")

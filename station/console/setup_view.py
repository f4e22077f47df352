"""Who is measured, with which cuffs; and whether the bench answers."""

from __future__ import annotations

import re
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any, cast

from nicegui import ui
from nicegui.elements.mixins.value_element import ValueElement

from station.journal import Setup
from station.session.desk import Desk, DeskRefusal
from station.session.plan_check import looks_like_a_name


def show(desk: Desk, act: Callable[..., Any]) -> None:
    ui.label("A new session, or one to go on with").classes("cue")
    with ui.row().classes("w-full gap-8 items-start lg:flex-nowrap"):
        with ui.card().classes("w-full lg:w-1/2"):
            _form(desk, act)
        with ui.card().classes("w-full lg:w-1/2"):
            _sessions(desk, act)
            _preflight(desk, act)


def _form(desk: Desk, act: Callable[..., Any]) -> None:
    subject = ui.input("Subject code", placeholder="P01").mark("subject").classes("w-full")
    ui.timer(0.0, lambda: subject.run_method("focus"), once=True)  # once it stands on the page
    warning = ui.label("this looks like a name: use a code, it becomes part of file names").classes(
        "text-xl text-negative"
    )
    warning.bind_visibility_from(subject, "value", backward=looks_like_a_name)
    chosen = _choice(list(desk.config.cuffs))
    with ui.grid(columns=2).classes("w-full gap-x-8"):
        operator = ui.input("Operator").mark("operator")
        number = ui.input("Session", value="1").mark("number")
        repeats = ui.number("Repeats of each test", value=desk.config.protocol.repeats, min=1, precision=0)
        repeats.mark("repeats")
        masses = ui.input("Load steps [kg], in order", value=_in_words(desk.config.protocol.step_masses_kg))
        masses.mark("load-steps")
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
            _masses(masses.value or ""),
        )

    preview = ui.label().classes("text-xl opacity-80 break-all").mark("preview")

    def show_file() -> None:
        named = Setup(subject.value or "", "", tuple(chosen.value), 1, number=number.value or "")
        preview.set_text(f"files like {desk.example_file(named)}" if subject.value else "")

    def begin() -> Awaitable[None]:
        return cast(Awaitable[None], act(lambda: desk.begin(setup())))

    shown: tuple[ValueElement[Any], ...] = (subject, number, chosen)
    for field in shown:
        field.on_value_change(show_file)
    typed: tuple[ui.element, ...] = (subject, operator, number, repeats, masses)
    for box in typed:
        box.on("keydown.enter", begin)
    with ui.row():
        ui.button("Begin", on_click=begin).mark("begin")
        ui.button("Rehearse", on_click=lambda: act(lambda: desk.begin(setup(), is_rehearsal=True))).props(
            "outline"
        ).mark("rehearse")


def _choice(cuffs: list[str]) -> ui.select:
    choice = ui.select(cuffs, label="Cuffs, in this order", value=cuffs, multiple=True).props("use-chips")
    return choice.classes("w-full").mark("cuffs")


def _in_words(masses: tuple[float, ...]) -> str:
    return " ".join(f"{mass:g}" for mass in masses)


def _masses(words: str) -> tuple[float, ...]:
    """Kilograms between blanks, with a decimal point or comma. Raises DeskRefusal."""
    try:
        return tuple(float(word.replace(",", ".")) for word in re.sub(r";|,(?=\s|$)", " ", words).split())
    except ValueError as error:
        raise DeskRefusal(f"the load steps are {words!r}, expected kilograms between blanks, like 1.53 1.53") from error


def _sessions(desk: Desk, act: Callable[..., Any]) -> None:
    ui.label("Go on with").classes("text-2xl")
    there = desk.sessions()
    if not there:
        ui.label("no session yet").classes("text-xl opacity-70")
    for listed in there[:8]:
        _resumption(desk, act, listed.setup, listed.folder)


def _resumption(desk: Desk, act: Callable[..., Any], setup: Setup, folder: Path) -> None:
    words = f"{setup.subject}, session {setup.number}: {', '.join(setup.cuffs)}"
    button = ui.button(words, on_click=lambda: act(lambda: desk.resume(folder))).props("flat no-caps")
    button.tooltip(str(folder)).mark("resume")


def _preflight(desk: Desk, act: Callable[..., Any]) -> None:
    ui.separator()
    lines = ui.column().classes("gap-1")

    async def look() -> None:
        button.disable()
        lines.clear()
        with lines:
            ui.spinner()
        try:
            found = await desk.preflight()
        finally:
            lines.clear()
            button.enable()
        with lines:
            for line in found:
                with ui.row().classes("items-center no-wrap gap-2 text-xl"):
                    ui.icon(
                        "check_circle" if line.is_good else "cancel", color="positive" if line.is_good else "negative"
                    )
                    ui.label(f"{line.subject}: {line.found}").mark("preflight")

    button = ui.button("Check the bench", on_click=lambda: act(look)).props("outline").mark("check")

"""Who is measured, with which cuffs; and whether the bench answers."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from nicegui import ui
from nicegui.elements.mixins.value_element import ValueElement

from station.bench.check import Line
from station.console.actions import Actions
from station.journal import Setup
from station.session.desk import Desk
from station.session.listing import ListedSession, list_sessions
from station.session.open_session import CommandRefused
from station.session.plan_check import looks_like_a_name

ICONS = {"good": "check_circle", "doubtful": "help_outline", "bad": "cancel"}


def show(desk: Desk, actions: Actions) -> None:
    with ui.row().classes("w-full gap-8 items-start lg:flex-nowrap"):
        with ui.card().classes("w-full lg:w-1/2"):
            ui.label("New session").classes("heading")
            _form(desk, actions)
        with ui.card().classes("w-full lg:w-1/2"):
            _sessions(desk, actions)
            _preflight(desk, actions)


def _form(desk: Desk, actions: Actions) -> None:
    subject = ui.input("Subject code", placeholder="P01").mark("subject").classes("w-full")
    ui.timer(0.0, lambda: subject.run_method("focus"), once=True)  # once it stands on the page
    warning = ui.label("this looks like a name: use a code, it becomes part of file names").classes(
        "text-xl text-negative"
    )
    warning.bind_visibility_from(subject, "value", backward=looks_like_a_name)
    chosen = _choice(list(desk.session.config.cuffs))
    with ui.grid(columns=2).classes("w-full gap-x-8"):
        operator = ui.input("Operator").mark("operator")
        number = ui.input("Session", value="1").mark("number")
        repeats = ui.number("Repeats of each test", value=desk.session.config.protocol.repeats, min=1, precision=0)
        repeats.mark("repeats")
        masses = ui.input("Load steps [kg], in order", value=_in_words(desk.session.config.protocol.step_masses_kg))
        masses.mark("load-steps")
    bounce = ui.switch("Bounce calibration first", value=desk.session.config.bounce is not None)
    bounce.set_enabled(desk.session.config.bounce is not None)

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

    preview = ui.label().classes("text-lg quiet break-all").mark("preview")

    def show_file() -> None:
        named = Setup(subject.value or "", "", tuple(chosen.value), 1, number=number.value or "")
        preview.set_text(f"files like {_example_file(desk, named)}" if subject.value else "")

    def begin() -> None:
        desk.session.begin(setup())

    shown: tuple[ValueElement[Any], ...] = (subject, number, chosen)
    for field in shown:
        field.on_value_change(show_file)
    typed: tuple[ui.element, ...] = (subject, operator, number, repeats, masses)
    for box in typed:
        box.on("keydown.enter", lambda: actions.run(begin))
    actions.add("Begin", "b", begin, kind="main")
    actions.add("Rehearse", "r", lambda: desk.session.begin(setup(), is_rehearsal=True))


def _example_file(desk: Desk, setup: Setup) -> Path:
    """What the first static trial of its first cuff is called; nothing that is there already is overwritten."""
    cuff = setup.cuffs[0] if setup.cuffs else ""
    names = {"subject": setup.subject, "session": setup.number, "test": "static", "cuff": cuff, "run": 1}
    return desk.session.folder_of(setup) / f"{desk.session.config.session.file_name.format(**names)}.mcap"


def _choice(cuffs: list[str]) -> ui.select:
    choice = ui.select(cuffs, label="Cuffs, in this order", value=cuffs, multiple=True).props("use-chips")
    return choice.classes("w-full").mark("cuffs")


def _in_words(masses: tuple[float, ...]) -> str:
    return " ".join(f"{mass:g}" for mass in masses)


def _masses(words: str) -> tuple[float, ...]:
    """Kilograms between blanks, with a decimal point or comma. Raises CommandRefused."""
    try:
        return tuple(float(word.replace(",", ".")) for word in re.sub(r";|,(?=\s|$)", " ", words).split())
    except ValueError as error:
        raise CommandRefused(
            f"the load steps are {words!r}, expected kilograms between blanks, like 1.53 1.53"
        ) from error


def _sessions(desk: Desk, actions: Actions) -> None:
    ui.label("Resume a session").classes("heading")
    listed = list_sessions(desk.session.config.session.folder)
    if not listed:
        ui.label("no session yet").classes("text-xl quiet")
        return
    with ui.scroll_area().classes("w-full h-64 sessions"), ui.column().classes("w-full gap-1"):
        for session in listed:
            _session(desk, actions, session)


def _session(desk: Desk, actions: Actions, session: ListedSession) -> None:
    setup, folder = session.setup, session.folder
    name = f"{setup.subject}, session {setup.number}: {', '.join(setup.cuffs)}"
    when = f"{session.begun.day} {session.begun:%B %Y, %H:%M}" if session.begun else "date unknown"
    progress = f"{session.done} of {session.trials}"
    button = ui.button(on_click=lambda: actions.run(lambda: desk.session.resume(folder))).props(
        f'flat aria-label="{name}"'
    )
    with button.classes("w-full session").mark("resume"):
        button.tooltip(str(folder))
        with ui.grid(columns="1fr auto").classes("w-full gap-x-4 gap-y-0 text-left items-center"):
            ui.label(name).classes("font-bold break-words min-w-0")
            ui.label(f"{progress} trials").classes("text-right")
            ui.label(f"{when}{f' · {setup.operator}' if setup.operator else ''}").classes("quiet text-lg")
            ui.linear_progress(session.done / max(1, session.trials), show_value=False).classes("w-28").props(
                "size=10px rounded"
            )


def _preflight(desk: Desk, actions: Actions) -> None:
    lines = ui.column().classes("gap-1")

    async def look() -> None:
        button.disable()
        lines.clear()
        with lines:
            ui.spinner()
        try:
            found = await desk.reviewer.preflight()
        finally:
            lines.clear()
            button.enable()
        with lines:
            for line in found:
                grade = grade_of(line)
                with ui.row().classes("items-start no-wrap gap-2 text-lg"):
                    ui.icon(ICONS[grade], size="1.6rem").classes(grade).mark(f"grade-{grade}")
                    ui.label(f"{line.subject}: {line.found}").mark("preflight")

    button = actions.add("Check the bench", "c", look, mark="check", is_apart=True)


def grade_of(line: Line) -> str:
    """good only for what was checked and is right."""
    if not line.is_good:
        return "bad"
    return "doubtful" if line.is_doubtful else "good"

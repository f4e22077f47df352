"""Set-up of a session: subject, cuffs and plan; sessions to resume; check of the bench."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from nicegui import ui
from nicegui.elements.mixins.value_element import ValueElement

from station.bench.check import CheckResult
from station.console.actions import Actions
from station.journal import Setup
from station.messages.codes import CommandCode
from station.protocol import CONDITION_NAMES
from station.session.controller import SessionController
from station.session.listing import ListedSession, list_sessions
from station.session.open_session import CommandRefused
from station.session.plan_check import is_subject_code, looks_like_a_name

ICONS = {"good": "check_circle", "doubtful": "help_outline", "bad": "cancel"}


def show(controller: SessionController, actions: Actions) -> None:
    with ui.row().classes("w-full gap-8 items-start lg:flex-nowrap"):
        with ui.card().classes("w-full lg:w-1/2"):
            ui.label("New session").classes("heading")
            _form(controller, actions)
        with ui.column().classes("w-full lg:w-1/2 gap-4"):
            with ui.card().classes("w-full"):
                _sessions(controller, actions)
            with ui.card().classes("w-full").mark("bench"):
                _preflight(controller, actions)


def _form(controller: SessionController, actions: Actions) -> None:
    subject = ui.input("Subject code", placeholder="P01").mark("subject").classes("w-full")
    ui.timer(0.0, lambda: subject.run_method("focus"), once=True)  # once it is on the page
    warning = ui.label("this looks like a name: use a code, because it becomes part of file names").classes(
        "text-xl text-negative"
    )
    warning.bind_visibility_from(subject, "value", backward=looks_like_a_name)
    chosen = _choice(list(controller.session.config.cuffs))
    with ui.grid(columns=2).classes("w-full gap-x-8"):
        operator = ui.input("Operator").mark("operator")
        number = ui.input("Session", value="1").mark("number")
        repeats = ui.number(
            "Repeats of each test", value=controller.session.config.protocol.repeats, min=1, precision=0
        )
        repeats.mark("repeats")
        masses = ui.input(
            "Load steps [kg], in order", value=_format_masses(controller.session.config.protocol.step_masses_kg)
        )
        masses.mark("load-steps")
    conditions = _conditions(controller)
    bounce = ui.switch("Bounce calibration first", value=controller.session.config.bounce is not None)
    bounce.set_enabled(controller.session.config.bounce is not None)

    def setup() -> Setup:
        return Setup(
            (subject.value or "").strip(),
            (operator.value or "").strip(),
            tuple(chosen.value),
            int(repeats.value or 1),
            bool(bounce.value),
            (number.value or "").strip(),
            _parse_masses(masses.value or ""),
            tuple(conditions.value) if conditions is not None else (),
        )

    preview = ui.label().classes("text-lg quiet break-all").mark("preview")

    def show_file() -> None:
        named = Setup((subject.value or "").strip(), "", tuple(chosen.value), 1, number=(number.value or "").strip())
        is_possible = is_subject_code(named.subject) and is_subject_code(named.number)
        preview.set_text(f"files such as {_example_file(controller, named)}" if is_possible else "")

    def begin() -> None:
        controller.session.begin(setup())

    shown: tuple[ValueElement[Any], ...] = (subject, number, chosen)
    for field in shown:
        field.on_value_change(show_file)
    typed: tuple[ui.element, ...] = (subject, operator, number, repeats, masses)
    for box in typed:
        box.on("keydown.enter", lambda: actions.run(begin))
    actions.add("Begin", "b", begin, kind="main")
    actions.add("Rehearse", "r", lambda: controller.session.begin(setup(), is_rehearsal=True))


def _example_file(controller: SessionController, setup: Setup) -> Path:
    """File name of the first static trial of the first cuff; existing files are never overwritten."""
    cuff = setup.cuffs[0] if setup.cuffs else ""
    names = {"subject": setup.subject, "session": setup.number, "test": "static", "cuff": cuff, "run": 1}
    return controller.session.folder_of(setup) / f"{controller.session.config.session.file_name.format(**names)}.mcap"


def _choice(cuffs: list[str]) -> ui.select:
    choice = ui.select(cuffs, label="Cuffs, in this order", value=cuffs, multiple=True).props("use-chips")
    return choice.classes("w-full").mark("cuffs")


def _conditions(controller: SessionController) -> ui.select | None:
    """Conditions of the wearer's motions; None without markers of the wearer."""
    body = controller.session.config.body
    if body is None:
        return None
    choice = ui.select(
        dict(CONDITION_NAMES),
        label="Pose of the wearer, and motions in these conditions",
        value=list(body.conditions),
        multiple=True,
    )
    return choice.props("use-chips").classes("w-full").mark("conditions")


def _format_masses(masses: tuple[float, ...]) -> str:
    return " ".join(f"{mass:g}" for mass in masses)


def _parse_masses(text: str) -> tuple[float, ...]:
    """Kilograms separated by spaces, with a decimal point or comma. Raises CommandRefused."""
    try:
        return tuple(float(mass.replace(",", ".")) for mass in re.sub(r";|,(?=\s|$)", " ", text).split())
    except ValueError as error:
        raise CommandRefused.of(CommandCode.MASSES_NOT_NUMBERS, text=repr(text)) from error


def _sessions(controller: SessionController, actions: Actions) -> None:
    ui.label("Resume a session").classes("heading")
    listed = list_sessions(controller.session.config.session.folder)
    if not listed:
        ui.label("no session yet").classes("text-xl quiet")
        return
    with ui.scroll_area().classes("w-full h-64 sessions"), ui.column().classes("w-full gap-1"):
        for session in listed:
            _session(controller, actions, session)


def _session(controller: SessionController, actions: Actions, session: ListedSession) -> None:
    setup, folder = session.setup, session.folder
    name = f"{setup.subject}, session {setup.number}: {', '.join((*setup.cuffs, *setup.conditions))}"
    when = f"{session.begun.day} {session.begun:%B %Y, %H:%M}" if session.begun else "date unknown"
    progress = f"{session.done} of {session.trials}"
    button = ui.button(on_click=lambda: actions.run(lambda: controller.session.resume(folder))).props(
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


def _preflight(controller: SessionController, actions: Actions) -> None:
    ui.label("Bench").classes("heading")
    column = ui.column().classes("gap-1")
    with column:
        ui.label("not checked yet").classes("text-xl quiet")

    async def check() -> None:
        button.disable()
        column.clear()
        with column:
            ui.spinner()
        try:
            results = await controller.reviewer.preflight()
        finally:
            column.clear()
            button.enable()
        with column:
            for result in results:
                grade = grade_of(result)
                with ui.row().classes("items-start no-wrap gap-2 text-lg"):
                    ui.icon(ICONS[grade], size="1.6rem").classes(grade).mark(f"grade-{grade}")
                    ui.label(f"{result.subject}: {result.found}").mark("preflight")

    button = actions.add("Check the bench", "c", check, mark="check", is_apart=True)


def grade_of(result: CheckResult) -> str:
    """good only if it was checked and no fault was found."""
    if not result.is_good:
        return "bad"
    return "doubtful" if result.is_doubtful else "good"

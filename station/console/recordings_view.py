"""All recordings of the session, to undo a decision or to assign a recording to another trial."""

from __future__ import annotations

from typing import Any

from nicegui import ui

from station.console.actions import Actions
from station.journal import Journal, Recorded
from station.protocol import describe_trial
from station.session.controller import SessionController
from station.session.open_session import local_time

TESTS = ("static", "dynamic")


def add_recordings(controller: SessionController, actions: Actions) -> None:
    """Add the buttons that undo the last decision and open the list, if there are recordings."""
    journal = controller.session.journal
    if journal.verdicts:
        last = list(journal.verdicts)[-1]
        button = actions.add("Undo", "u", controller.reviewer.undo, is_of_session=True)
        with button:  # in line with the end of the button, so that it does not cover those of a decision above
            ui.tooltip(f"undo the decision on {last}: {_decision(journal, last)}").props(
                'anchor="center right" self="center left"'
            )
    actions.add("Note", "o", lambda: _open_note(controller, actions), mark="note", is_of_session=True)
    if journal.recorded:
        actions.add("Recordings", "t", lambda: _open(controller, actions), is_of_session=True)


def _open(controller: SessionController, actions: Actions) -> None:
    journal = controller.session.journal
    with ui.dialog(value=True) as dialog, ui.card().classes("w-full max-w-none").style("width: min(1100px, 94vw)"):
        dialog.props('aria-label="Recordings of this session"')
        ui.label("Recordings of this session").classes("heading")
        with ui.element("div").classes("recordings text-lg"):
            for number, recorded in enumerate(journal.recorded, 1):
                _row(controller, actions, dialog, number, recorded)
        ui.button("Close", on_click=dialog.close).props("outline")
    dialog.on("hide", dialog.delete)


def _row(controller: SessionController, actions: Actions, dialog: ui.dialog, number: int, recorded: Recorded) -> None:
    journal = controller.session.journal
    with ui.column().classes("gap-0 min-w-0"):
        ui.label(f"{number}. {_title(recorded)}").classes("break-words max-w-full")
        entered = local_time(journal.entered.get(recorded.file, ""))
        at = f"{entered:%H:%M:%S} · " if entered is not None else ""
        ui.label(f"{at}{recorded.file}").classes("quiet text-sm break-all")
    with ui.column().classes("gap-0 quiet min-w-0"):
        ui.label(_decision(journal, recorded.file))
        if note := journal.notes.get(recorded.file):
            ui.label(f"note: {note}")

    def undo() -> None:
        controller.reviewer.undo(recorded.file)

    button = ui.button("Undo", on_click=lambda: _perform(actions, dialog, undo)).props("outline").classes("small")
    button.mark(f"undo-{recorded.file}").set_enabled(recorded.file in journal.verdicts)
    with ui.row().classes("items-center gap-2"):
        setup = journal.setup
        if recorded.cuff is None or setup is None:
            return
        cuff = ui.select(list(setup.cuffs), value=recorded.cuff, label="cuff").props("dense")
        test = ui.select(list(TESTS), value=recorded.test, label="test").props("dense")
        repeat = ui.select(list(range(1, setup.repeats + 1)), value=recorded.repeat, label="repeat").props("dense")

        def assign() -> None:
            controller.reviewer.assign(recorded.file, str(cuff.value), test.value, int(repeat.value))

        button = ui.button("Assign to this trial", on_click=lambda: _perform(actions, dialog, assign))
        button.props("outline no-wrap").classes("small").mark(f"assign-{recorded.file}")


def _open_note(controller: SessionController, actions: Actions) -> None:
    """A dialog for the note on the session."""
    with ui.dialog(value=True) as dialog, ui.card().classes("w-full max-w-none").style("width: min(700px, 94vw)"):
        dialog.props('aria-label="Note on the session"')
        note = ui.textarea("Note on this session", value=controller.session.journal.notes.get("", ""))
        note.props("autofocus autogrow outlined").classes("w-full").mark("session-note")

        def save() -> None:
            controller.session.note("", note.value or "")

        with ui.row():
            ui.button("Save", on_click=lambda: _perform(actions, dialog, save)).props("unelevated color=primary")
            ui.button("Close", on_click=dialog.close).props("outline")
    dialog.on("hide", dialog.delete)


async def _perform(actions: Actions, dialog: ui.dialog, action: Any) -> None:
    dialog.close()
    await actions.run(action)


def _title(recorded: Recorded) -> str:
    donning = f", donning {recorded.donning}" if recorded.donning != "1" else ""
    return describe_trial(recorded.cuff, recorded.test, recorded.repeat, recorded.condition) + donning


def _decision(journal: Journal, file: str) -> str:
    verdict = journal.verdicts.get(file)
    assigned = ", assigned by the operator" if file in journal.assignments else ""
    if verdict is None:
        return "no decision yet" + assigned
    reason = f": {verdict.reason}" if verdict.reason else ""
    return ("kept" if verdict.choice == "accept" else "redone") + reason + assigned

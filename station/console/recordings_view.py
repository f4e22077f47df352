"""All recordings of the session, to undo a decision or to assign a recording to another trial."""

from __future__ import annotations

from typing import Any

from nicegui import ui

from station.console.actions import Actions
from station.journal import Journal, Recorded
from station.protocol import describe_trial
from station.session.controller import SessionController

TESTS = ("static", "dynamic")


def add_recordings(controller: SessionController, actions: Actions) -> None:
    """Add the buttons that undo the last decision and open the list, if there are recordings."""
    journal = controller.session.journal
    if journal.verdicts:
        last = list(journal.verdicts)[-1]
        button = actions.add("Undo", "u", controller.reviewer.undo)
        button.tooltip(f"undo the decision on {last}: {_decision(journal, last)}")
    if journal.recorded:
        actions.add("Recordings", "t", lambda: _open(controller, actions))


def _open(controller: SessionController, actions: Actions) -> None:
    journal = controller.session.journal
    with ui.dialog(value=True) as dialog, ui.card().classes("w-full max-w-none").style("width: min(1100px, 94vw)"):
        ui.label("Recordings of this session").classes("heading")
        with ui.grid(columns="auto auto auto 1fr").classes("items-center gap-x-6 gap-y-2 w-full text-lg"):
            for recorded in journal.recorded:
                _row(controller, actions, dialog, journal, recorded)
        ui.button("Close", on_click=dialog.close).props("outline")
    dialog.on("hide", dialog.delete)


def _row(
    controller: SessionController, actions: Actions, dialog: ui.dialog, journal: Journal, recorded: Recorded
) -> None:
    ui.label(_title(recorded)).tooltip(recorded.file)
    ui.label(_decision(journal, recorded.file)).classes("quiet")

    def undo() -> None:
        controller.reviewer.undo(recorded.file)

    button = ui.button("Undo", on_click=lambda: _perform(actions, dialog, undo)).props("outline").classes("small")
    button.mark(f"undo-{recorded.file}").set_enabled(recorded.file in journal.verdicts)
    with ui.row().classes("items-center gap-2 no-wrap"):
        setup = journal.setup
        if recorded.cuff is None or setup is None:
            return
        cuff = ui.select(list(setup.cuffs), value=recorded.cuff).props("dense")
        test = ui.select(list(TESTS), value=recorded.test).props("dense")
        repeat = ui.select(list(range(1, setup.repeats + 1)), value=recorded.repeat).props("dense")

        def assign() -> None:
            controller.reviewer.assign(recorded.file, str(cuff.value), test.value, int(repeat.value))

        button = ui.button("Assign to this trial", on_click=lambda: _perform(actions, dialog, assign))
        button.props("outline no-wrap").classes("small").mark(f"assign-{recorded.file}")


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

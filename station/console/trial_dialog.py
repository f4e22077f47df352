"""What can be done with a trial of the plan: record it next, skip it, redo it."""

from __future__ import annotations

from nicegui import ui

from station.console.actions import Action, Actions
from station.protocol import TrialSpec
from station.session.controller import SessionController
from station.session.plan_status import PlanStatus


def offer_trial(controller: SessionController, plan: PlanStatus, trial: TrialSpec, actions: Actions) -> None:
    """Open the dialog of one trial; the session may have changed since, and then refuses."""
    with ui.dialog(value=True) as dialog, ui.card().classes("gap-3"):
        dialog.props(f'aria-label="{trial.title}"')
        ui.label(trial.title).classes("heading")
        if trial in plan.done:
            _offer_redo(controller, trial, actions, dialog)
        else:
            _offer_order(controller, plan, trial, actions, dialog)
        ui.button("Close", on_click=dialog.close).props("flat")
    dialog.on("hide", dialog.delete)


def _offer_order(
    controller: SessionController, plan: PlanStatus, trial: TrialSpec, actions: Actions, dialog: ui.dialog
) -> None:
    def skip() -> None:
        controller.session.skip(trial)

    if trial != plan.spec:
        _button("Record it next", lambda: controller.session.choose(trial), actions, dialog)
    if trial not in plan.skipped:
        _button("Skip it", skip, actions, dialog)


def _offer_redo(controller: SessionController, trial: TrialSpec, actions: Actions, dialog: ui.dialog) -> None:
    reason = ui.input("Reason to redo it").classes("w-full").mark("redo-reason")

    def redo() -> None:
        controller.reviewer.redo(trial, reason.value or "")

    def redo_donned_anew() -> None:
        controller.reviewer.redo(trial, reason.value or "", is_donned_anew=True)

    _button("Redo it", redo, actions, dialog)
    if trial.cuff is not None:
        ui.label("Migration is known only for trials since the cuff was donned; donned anew, its repeats start again.")
        _button("Don the cuff anew and redo", redo_donned_anew, actions, dialog)


def _button(name: str, action: Action, actions: Actions, dialog: ui.dialog) -> None:
    async def press() -> None:
        dialog.close()
        await actions.run(action)

    ui.button(name, on_click=press).props("outline")

"""The next trial: the preparation at the bench, its place in the plan, and the time left."""

from __future__ import annotations

from functools import partial

from nicegui import ui

from station.console.actions import Action, Actions
from station.console.wearer_form import offer_wearer
from station.protocol import BODY_TESTS, CONDITION_NAMES, TrialSpec
from station.session.controller import SessionController
from station.session.plan_status import PlanState, PlanStatus, preparation

STAGES: dict[PlanState, str] = {"kept": "done", "skipped": "skipped", "next": "current", "to come": ""}
"""State of a trial → class of its place in the plan."""


def show(controller: SessionController, plan: PlanStatus, actions: Actions) -> None:
    spec, left = plan.spec, controller.session.minutes_left
    assert spec is not None  # noqa: S101  (without one the page shows the summary)
    ui.label(preparation(plan, controller.session.config)).classes("cue").mark("order")
    with ui.row().classes("items-baseline gap-6"):
        ui.label(f"next: {spec.title}").classes("text-3xl").mark("next")
        ui.label(f"about {left} min left in this session").classes("text-xl quiet").mark("time")
    if plan.has_pause:
        _show_pause(controller)
    show_plan(controller, plan, actions)
    actions.add("Arm", "a", controller.runner.arm, kind="main")
    skip = actions.add("Skip this trial", "n", lambda: _skip(controller, spec), mark="skip")
    _explain(skip, "it is not recorded; its place in the plan offers it again")
    offer_wearer(controller, actions)
    add_exits(controller, actions)


def show_recorder(controller: SessionController, plan: PlanStatus, actions: Actions) -> None:
    """A trial of this session runs without this console, which sees it when it has ended."""
    with ui.row().classes("items-center gap-4 no-wrap"):
        ui.spinner(size="3rem")
        ui.label("A trial of this session is being recorded").classes("cue").mark("recorder")
    ui.label("The console that began it was ended, or runs elsewhere. The verdict is shown here when the trial ends.")
    show_plan(controller, plan, actions)
    add_exits(controller, actions)


def _skip(controller: SessionController, spec: TrialSpec) -> None:
    controller.session.skip(spec)


def show_plan(controller: SessionController, plan: PlanStatus, actions: Actions) -> None:
    """Show every trial of the plan, a row per cuff and one of the wearer; a click offers what can be done with it."""
    rows: dict[str, list[TrialSpec]] = {}
    for trial in plan.trials:
        rows.setdefault(trial.cuff or ("wearer" if trial.test in BODY_TESTS else "load cell"), []).append(trial)
    with ui.element("div").classes("plan mt-4").mark("plan"):
        for subject, trials in rows.items():
            ui.label(subject).classes("heading")
            with ui.element("div").classes("stages"):
                for trial in trials:
                    _chip(controller, plan, actions, trial)


def _chip(controller: SessionController, plan: PlanStatus, actions: Actions, trial: TrialSpec) -> None:
    state = plan.trial_state(trial)
    chip = ui.element("button").classes(f"stage {STAGES[state]}").mark(f"trial-{trial.title}")
    subject = trial.cuff or ("wearer" if trial.test in BODY_TESTS else "load cell")
    chip.props(f'type=button aria-label="{_short_name(trial)}, {subject}: {state}"')
    with chip:
        ui.label(_short_name(trial))
    chip.on("click", lambda: _offer_trial(controller, plan, trial, actions))


def _short_name(trial: TrialSpec) -> str:
    if trial.cuff is not None:
        return f"{trial.test} {trial.repeat}"
    return trial.test if trial.condition is None else f"{trial.test}, {CONDITION_NAMES[trial.condition]}"


def add_exits(controller: SessionController, actions: Actions) -> None:
    """Add the buttons that leave the plan before its end, with the effect of each as a tooltip."""
    leave = actions.add("Session list", "l", controller.session.leave, mark="leave", is_apart=True)
    _explain(
        leave,
        "return to the list of sessions; this rehearsal is deleted"
        if controller.session.is_rehearsal
        else "return to the list of sessions, where this session can be resumed",
    )
    report = actions.add("Skip to report", "e", controller.runner.end_early, mark="end-early", is_apart=True)
    _explain(report, "fit and report the trials so far; the plan can be continued afterwards")


def _explain(button: ui.button, text: str) -> None:
    """Add a tooltip in line with the button's end, so that it does not cover the buttons of a decision."""
    with button:
        ui.tooltip(text).props('anchor="top right" self="bottom right"')


def _show_pause(controller: SessionController) -> None:
    """Count down the pause; the next trial may be armed earlier."""
    left = ui.label().classes("figure").mark("rest")

    def count() -> None:
        seconds = controller.reviewer.rest_left_s
        left.text = f"{seconds:.0f} s" if seconds > 0 else "pause over"

    ui.timer(0.5, count)


def _offer_trial(controller: SessionController, plan: PlanStatus, trial: TrialSpec, actions: Actions) -> None:
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
    if trial != plan.spec:
        _dialog_button("Record it next", lambda: controller.session.choose(trial), actions, dialog)
    if trial not in plan.skipped:
        _dialog_button("Skip it", lambda: _skip(controller, trial), actions, dialog)


def _offer_redo(controller: SessionController, trial: TrialSpec, actions: Actions, dialog: ui.dialog) -> None:
    reason = ui.input("Reason to redo it").classes("w-full").mark("redo-reason")

    def redo(*, is_donned_anew: bool = False) -> None:
        controller.reviewer.redo(trial, reason.value or "", is_donned_anew=is_donned_anew)

    _dialog_button("Redo it", redo, actions, dialog)
    if trial.cuff is not None:
        ui.label("Migration is known only for trials since the cuff was donned; donned anew, its repeats start again.")
        _dialog_button("Don the cuff anew and redo", partial(redo, is_donned_anew=True), actions, dialog)


def _dialog_button(name: str, action: Action, actions: Actions, dialog: ui.dialog) -> None:
    async def press() -> None:
        dialog.close()
        await actions.run(action)

    ui.button(name, on_click=press).props("outline")

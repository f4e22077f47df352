"""The next trial: what to do at the bench before it is armed, and where in the plan it stands."""

from __future__ import annotations

from nicegui import ui

from station.console.actions import Actions
from station.protocol import TrialSpec
from station.session.agenda import Agenda, order_of
from station.session.desk import Desk


def show(desk: Desk, plan: Agenda, actions: Actions) -> None:
    spec = plan.spec
    assert spec is not None  # noqa: S101  (the page shows the summary then)
    ui.label(order_of(plan, desk.session.config.protocol.pause_s)).classes("cue").mark("order")
    of_cuff = "bounce calibration" if spec.cuff is None else f"{spec.cuff}: {spec.test}, repeat {spec.repeat}"
    ui.label(f"next: {of_cuff}").classes("text-3xl").mark("next")
    if plan.has_pause:
        _rest(desk)
    show_plan(plan)
    actions.add("Arm", "a", desk.runner.arm, kind="main")
    actions.add("Leave", "l", desk.session.leave, mark="leave", is_apart=True)
    actions.add("End early", "e", desk.runner.end_early, is_apart=True)


def show_plan(plan: Agenda) -> None:
    """Every trial of the plan, a row a cuff: kept, next, skipped or to come."""
    rows: dict[str, list[TrialSpec]] = {}
    for trial in plan.trials:
        rows.setdefault(trial.cuff or "load cell", []).append(trial)
    with ui.grid(columns="auto 1fr").classes("items-center gap-x-6 gap-y-3 w-full mt-4").mark("plan"):
        for name, trials in rows.items():
            ui.label(name).classes("heading")
            with ui.element("div").classes("stages"):
                for trial in trials:
                    words = "bounce" if trial.cuff is None else f"{trial.test} {trial.repeat}"
                    ui.label(words).classes(f"stage {_state_of(trial, plan)}")


def _state_of(trial: TrialSpec, plan: Agenda) -> str:
    if trial in plan.done:
        return "done"
    if trial in plan.skipped:
        return "skipped"
    return "current" if trial == plan.spec else ""


def _rest(desk: Desk) -> None:
    """Counts down; nobody is kept from arming earlier, a wearer may have rested already."""
    left = ui.label().classes("figure").mark("rest")

    def count() -> None:
        seconds = desk.reviewer.rest_left_s
        left.text = f"{seconds:.0f} s" if seconds > 0 else "rested"

    ui.timer(0.5, count)

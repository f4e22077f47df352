"""The end of a session: the cuffs' table, what they do to the muscles, the report."""

from __future__ import annotations

from nicegui import ui

from station.console.actions import Actions
from station.console.next_view import show_plan
from station.session.agenda import Agenda
from station.session.desk import Desk


def show(desk: Desk, plan: Agenda, actions: Actions) -> None:
    ui.label(headline_of(plan)).classes("cue").mark("complete")
    if plan.undecided is not None:
        words = f"{plan.undecided.file} waits for keep or redo; it counts until it is redone."
        ui.label(words).classes("text-xl doubtful").mark("undecided")
    if desk.reviewer.progress:
        with ui.row().classes("items-center"):
            ui.spinner(size="2rem")
            ui.label(desk.reviewer.progress).classes("text-xl")
    summary = desk.session.summary
    if summary is None:
        show_plan(plan)
        button = actions.add("Fit, assess and report", "f", desk.reviewer.finish, kind="main", mark="finish")
        button.set_enabled(not desk.reviewer.progress)
    else:
        if summary.rows:
            columns = [{"name": key, "label": key, "field": key, "align": "left"} for key in summary.rows[0]]
            ui.table(columns=columns, rows=list(summary.rows)).props("flat wrap-cells").classes("text-xl").mark(
                "cuffs-table"
            )
        for sentence in summary.findings:
            ui.label(sentence).classes("text-xl").mark("finding")
        ui.link("Open the report", "/report", new_tab=True).classes("text-2xl").mark("report")
    actions.add("Leave", "l", desk.session.leave, mark="leave", is_apart=True)
    if desk.session.is_ending:
        actions.add("Back to the plan", "b", desk.session.resume_plan, mark="back")


def headline_of(plan: Agenda) -> str:
    """What there is of the plan; complete only where every trial was accepted."""
    done, skipped = len(plan.done), len(plan.skipped)
    if done == len(plan.trials):
        return "Every trial of the plan is accepted"
    rest = f", {skipped} skipped" if skipped else ""
    return f"{done} of {len(plan.trials)} trials of the plan are accepted{rest}"

"""The end of a session: table of the cuffs, findings of the assessment, link to the report."""

from __future__ import annotations

import time

from nicegui import ui

from documents.interval import UNBROKEN, counted
from station.console.actions import Actions
from station.console.next_view import show_plan
from station.console.wearer_form import offer_wearer
from station.progress import time_left
from station.session.controller import SessionController
from station.session.plan_status import PlanStatus
from station.session.summary import Summary

PROGRESS_S = 0.5


def show(controller: SessionController, plan: PlanStatus, actions: Actions) -> None:
    ui.label(plan_headline(plan)).classes("cue").mark("complete")
    if plan.undecided is not None:
        text = f"{plan.undecided.file} waits for a decision; the fit uses it unless it is redone."
        ui.label(text).classes("text-xl doubtful").mark("undecided")
    if controller.reviewer.progress:
        _show_progress(controller)
    summary = controller.session.summary
    if summary is None:
        show_plan(controller, plan, actions)
        button = actions.add("Fit, assess and report", "f", controller.reviewer.finish, kind="main", mark="finish")
        button.set_enabled(not controller.reviewer.progress)
    else:
        _show_summary(summary)
    offer_wearer(controller, actions)
    actions.add("Session list", "l", controller.session.leave, mark="leave", is_apart=True)
    if controller.session.is_ending:
        actions.add("Back to the plan", "b", controller.session.resume_plan, mark="back")


def _show_summary(summary: Summary) -> None:
    """The answer and the report first, then the table of the cuffs; the other findings are folded."""
    answer, *others = summary.findings or ("",)
    if answer:
        ui.label(answer).classes("text-2xl font-bold").mark("finding")
    ui.link("Open the report", "/report", new_tab=True).classes("text-2xl").mark("report")
    rows = [{key: text.replace(UNBROKEN, " ") for key, text in row.items()} for row in summary.rows]
    if rows:
        columns = [
            {"name": key, "label": key, "field": key, "align": "left"} for key in summary.rows[0] if key != "verdict"
        ]
        ui.table(columns=columns, rows=rows).props("flat wrap-cells").classes("text-xl").mark("cuffs-table")
    for row in rows:
        if "verdict" in row:
            ui.label(f"{row['cuff']}: {row['verdict']}").classes("text-xl doubtful").mark("doubt")
    if others:
        with ui.expansion("Details").classes("w-full text-lg").mark("details"):
            for sentence in others:
                ui.label(sentence).classes("text-lg break-words").mark("finding")


def _show_progress(controller: SessionController) -> None:
    """A bar for each stage so far, with the time left of the current one."""
    with ui.row().classes("items-center"):
        ui.spinner(size="2rem")
        ui.label(controller.reviewer.progress).classes("text-xl")
    stages = ui.element("div").classes("progress").props("role=status").mark("progress")

    def tick() -> None:
        stages.clear()
        with stages:
            for stage in controller.reviewer.stages:
                is_over = stage.done >= stage.total
                ui.label(stage.name).classes("text-lg")
                bar = ui.linear_progress(stage.part, show_value=False).props("size=14px rounded")
                bar.props(f'aria-label="{stage.name}"')
                left = time_left(stage.name, time.perf_counter() - stage.begun_s, stage.done, stage.total)
                ui.label("done" if is_over else left or "begun").classes("text-lg quiet")

    ui.timer(PROGRESS_S, tick)


def plan_headline(plan: PlanStatus) -> str:
    """Accepted trials of the plan; complete only if all of them are accepted."""
    done, skipped = len(plan.done), len(plan.skipped)
    if done == len(plan.trials):
        return "Every trial of the plan is accepted"
    skips = f", {skipped} skipped" if skipped else ""
    return f"{done} of {counted(len(plan.trials), 'trial')} of the plan are accepted{skips}"

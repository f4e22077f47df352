"""Keep or redo, with the reasons, while the cuff is still on."""

from __future__ import annotations

from collections.abc import Sequence

from nicegui import ui

from station.console.actions import Actions, Kind
from station.console.charts import force_over_displacement
from station.journal import Choice, Recorded
from station.session.agenda import redo_loses_migration
from station.session.desk import Desk
from station.session.judgement import Judgement

ICONS = {"good": "check_circle", "doubtful": "error_outline", "bad": "replay"}
HEADLINES = {"good": "no problems found", "doubtful": "usable, with doubts", "bad": "better redo it"}


def show(desk: Desk, recorded: Recorded, actions: Actions) -> None:
    actions.add("Leave", "l", desk.session.leave, mark="leave", is_apart=True)
    actions.add("End early", "e", desk.runner.end_early, is_apart=True)
    judged = desk.session.judgement
    if judged is None or judged.file != recorded.file:
        with ui.row().classes("items-center"):
            ui.spinner(size="3rem")
            ui.label(f"looking at {recorded.file}").classes("cue")
        return
    _headline(judged)
    with ui.row().classes("w-full gap-8 items-start no-wrap"):
        with ui.column().classes("grow gap-2"):
            _figures(judged)
            marks = _marks(desk, judged)
        if judged.path:
            ui.echart(force_over_displacement([list(point) for point in judged.path])).classes("w-2/5 h-72").mark(
                "loop"
            )
    _decision(desk, recorded, judged, marks, actions)


def _headline(judged: Judgement) -> None:
    with ui.row().classes("items-center gap-4 no-wrap"):
        ui.icon(ICONS[judged.grade], size="3.5rem").classes(judged.grade).mark(f"grade-{judged.grade}")
        ui.label(f"{judged.title}: {HEADLINES[judged.grade]}").classes("cue").mark("advice")
    for reason in judged.reasons:
        ui.label(reason).classes(f"text-2xl {judged.grade}").mark("reason")
    for doubt in judged.doubts:
        ui.label(doubt).classes("text-xl doubtful").mark("doubt")


def _figures(judged: Judgement) -> None:
    columns = [
        {"name": name, "label": label, "field": name, "align": "left"}
        for name, label in (
            ("quantity", ""),
            ("this", "this trial (95 %)"),
            ("earlier", "earlier repeats"),
            ("so_far", "donning so far (95 %)"),
        )
    ]
    rows = [
        {"quantity": row.quantity, "this": row.this, "earlier": row.earlier, "so_far": row.so_far}
        for row in judged.rows
    ]
    if rows:
        ui.table(columns=columns, rows=rows, row_key="quantity").props("flat wrap-cells").classes("text-xl").mark(
            "figures"
        )
    shown = {f"so far: {doubt}" for doubt in judged.doubts}
    for note in judged.notes:
        if note not in shown:
            ui.label(note).classes("text-lg quiet")


def _marks(desk: Desk, judged: Judgement) -> list[ui.input]:
    known = desk.session.journal.marks.get(judged.file, {})
    return [ui.input(f"mark {number} was", value=known.get(number, "")) for number in range(1, judged.marks + 1)]


def _decision(desk: Desk, recorded: Recorded, judged: Judgement, marks: Sequence[ui.input], actions: Actions) -> None:
    is_costly = redo_loses_migration(recorded, desk.session.journal)
    with actions.form:
        if is_costly:
            ui.label(
                f"To redo it, don the {recorded.cuff} cuff anew: it may have migrated in this trial. Redone as it is "
                "worn, migration of this donning stays unknown."
            ).classes("text-lg doubtful").mark("cost")
        reason = ui.input("Why (needed to redo)", value="" if judged.advice == "accept" else "; ".join(judged.reasons))
        reason.classes("w-full").mark("why")

    def decide(choice: Choice, *, is_donned_anew: bool = False) -> None:
        for number, name in enumerate(marks, 1):
            if name.value:
                desk.reviewer.name_mark(number, name.value)
        desk.reviewer.decide(choice, reason.value or "", is_donned_anew=is_donned_anew)

    def keep() -> None:
        decide("accept")

    def redo() -> None:
        decide("redo")

    def redo_donned_anew() -> None:
        decide("redo", is_donned_anew=True)

    is_kept = judged.advice == "accept"
    actions.add("Keep", "k", keep, kind="main" if is_kept else "other")
    advised: Kind = "other" if is_kept else "main"
    if is_costly:
        actions.add("Don the cuff anew and redo", "d", redo_donned_anew, kind=advised, mark="don-anew")
        actions.by_key["r"] = redo_donned_anew
        actions.add("Redo as worn", "w", redo, mark="redo")
    else:
        actions.add("Redo", "r", redo, kind=advised)
        if recorded.cuff is not None:
            actions.add("Don the cuff anew and redo", "d", redo_donned_anew, mark="don-anew")

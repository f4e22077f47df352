"""The verdict on a recording with its reasons, and the decision to keep or redo it while the cuff is still on."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from nicegui import ui

from documents.interval import UNBROKEN
from documents.message import Message, join_sentences
from station.console.actions import Actions, Kind
from station.console.charts import force_over_motion
from station.console.kept_form import forget_form, keep_form
from station.console.next_view import add_exits
from station.journal import Choice, Recorded
from station.messages.session_messages import VerdictCode
from station.protocol import describe_trial
from station.session.controller import SessionController
from station.session.judgement import MISSING, Judgement
from station.session.plan_status import redo_loses_migration

ICONS = {"good": "check_circle", "doubtful": "error_outline", "bad": "replay"}


def show(controller: SessionController, recorded: Recorded, actions: Actions) -> None:
    add_exits(controller, actions)
    judgement = controller.session.judgement
    if judgement is None or judgement.file != recorded.file:
        with ui.row().classes("items-center"):
            ui.spinner(size="3rem")
            work = "checking" if recorded.cuff is None else "fitting"
            title = describe_trial(recorded.cuff, recorded.test, recorded.repeat, recorded.condition)
            ui.label(f"{work} {title}").classes("cue")
        return
    _headline(judgement)
    with ui.element("div").classes("verdict"):
        with ui.column().classes("gap-2"):
            _figures(judgement)
            marks = _marks(controller, judgement)
            note = ui.input("Note on this trial", value=controller.session.journal.notes.get(recorded.file, ""))
            note.classes("w-full").mark("trial-note")
        if judgement.drawing:
            ui.html(judgement.drawing, sanitize=False).classes("drawing").mark("drawing")
        if judgement.path:
            ui.echart(force_over_motion([list(point) for point in judgement.path])).classes("h-72").mark("loop")
    _decision(controller, recorded, judgement, [note, *marks], actions)


def _headline(judgement: Judgement) -> None:
    with ui.row().classes("items-center gap-4 no-wrap"):
        ui.icon(ICONS[judgement.grade], size="3.5rem").classes(judgement.grade).mark(f"grade-{judgement.grade}")
        headline = Message(VerdictCode(f"verdict.{judgement.grade}"))
        ui.label(f"{judgement.title}: {headline}").classes("cue").mark("advice")
    for reason in judgement.reasons:
        ui.label(str(reason)).classes(f"text-2xl {judgement.grade}").mark("reason")
    for doubt in judgement.doubts:
        ui.label(doubt).classes("text-xl doubtful").mark("doubt")


def _figures(judgement: Judgement) -> None:
    """Table of the quantities; columns and rows without a figure are left out."""
    headings = {"quantity": "", "this": "this trial (95 %)" if judgement.figures else "this trial"}
    if any(row.earlier != MISSING for row in judgement.rows):
        headings |= {"earlier": "earlier repeats", "so_far": "donning so far (95 %)"}
    columns = [{"name": name, "label": label, "field": name, "align": "left"} for name, label in headings.items()]
    rows = [
        {name: getattr(row, name).replace(UNBROKEN, " ") for name in headings}  # a telephone breaks an interval
        for row in judgement.rows
        if any(getattr(row, name) != MISSING for name in headings if name != "quantity")
    ]
    if rows:
        ui.table(columns=columns, rows=rows, row_key="quantity").props("flat wrap-cells").classes("text-xl").mark(
            "figures"
        )
    if not judgement.notes:
        return
    # The reasons of a redo come before all else; the notes of such a trial are a click away.
    is_redo = judgement.advice == "redo"
    with ui.expansion("Details").classes("text-lg").mark("details") if is_redo else ui.column().classes("gap-2"):
        for note in judgement.notes:
            ui.label(note).classes("text-lg quiet break-words")


def _marks(controller: SessionController, judgement: Judgement) -> list[ui.input]:
    known = controller.session.journal.marks.get(judgement.file, {})
    return [ui.input(f"Name of mark {number}", value=known.get(number, "")) for number in range(1, judgement.marks + 1)]


def _decision(
    controller: SessionController, recorded: Recorded, judgement: Judgement, typed: Sequence[ui.input], actions: Actions
) -> None:
    """typed are the fields of the note on the trial and of the names of its marks."""
    note, *marks = typed
    is_costly = redo_loses_migration(recorded, controller.session.journal)
    with actions.form:
        if is_costly:
            ui.label(
                f"The {recorded.cuff} cuff may have migrated in this trial. To redo the trial, don the cuff anew; "
                "if it is redone as worn, the migration of this donning stays unknown."
            ).classes("text-lg doubtful").mark("cost")
        reason = ui.input(
            "Reason (needed to redo)", value="" if judgement.advice == "accept" else join_sentences(judgement.reasons)
        )
        reason.classes("w-full").mark("why")
    form = f"verdict of {recorded.file}"
    keep_form(form, {"reason": reason, "note": note} | {str(number): field for number, field in enumerate(marks, 1)})

    def decide(choice: Choice, *, is_donned_anew: bool = False) -> None:
        for number, name in enumerate(marks, 1):
            if name.value:
                controller.reviewer.name_mark(number, name.value)
        controller.session.note(recorded.file, note.value or "")
        controller.reviewer.decide(choice, reason.value or "", is_donned_anew=is_donned_anew)
        forget_form(form)

    redo, redo_donned_anew = partial(decide, "redo"), partial(decide, "redo", is_donned_anew=True)
    is_kept = judgement.advice == "accept"
    actions.add("Keep", "k", partial(decide, "accept"), kind="main" if is_kept else "other")
    advised: Kind = "other" if is_kept else "main"
    if is_costly:
        actions.add("Don the cuff anew and redo", "dr", redo_donned_anew, kind=advised, mark="don-anew")
        actions.add("Redo as worn", "w", redo, mark="redo")
    else:
        actions.add("Redo", "r", redo, kind=advised)
        if recorded.cuff is not None:
            actions.add("Don the cuff anew and redo", "d", redo_donned_anew, mark="don-anew")

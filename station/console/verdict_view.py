"""Accept or redo, with the reasons, while the cuff is still on."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from typing import Any

from nicegui import ui

from station.console.charts import force_over_displacement
from station.journal import Choice, Recorded
from station.session.desk import Desk
from station.session.judgement import Judgement


def show(
    desk: Desk, recorded: Recorded, act: Callable[..., Any], acts: dict[str, Callable[[], Awaitable[None] | None]]
) -> None:
    judged = desk.judgement
    if judged is None or judged.file != recorded.file:
        with ui.row().classes("items-center"):
            ui.spinner(size="3rem")
            ui.label(f"looking at {recorded.file}").classes("cue")
        return
    _headline(judged)
    with ui.row().classes("w-full gap-8 items-start lg:flex-nowrap"):
        with ui.column().classes("grow"):
            _figures(judged)
            marks = _marks(desk, judged)
        if judged.path:
            ui.echart(force_over_displacement([list(point) for point in judged.path])).classes(
                "w-full lg:w-2/5 h-80"
            ).mark("loop")
    _decision(desk, recorded, judged, marks, act, acts)


def _headline(judged: Judgement) -> None:
    good = judged.advice == "accept"
    with ui.row().classes("items-center gap-4 no-wrap"):
        ui.icon("check_circle" if good else "replay", color="positive" if good else "negative", size="4rem")
        ui.label(f"{judged.title}: {'nothing speaks against it' if good else 'better redo it'}").classes("cue").mark(
            "advice"
        )
    for reason in judged.reasons:
        ui.label(reason).classes("text-2xl text-negative").mark("reason")


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
    for note in judged.notes:
        ui.label(note).classes("text-xl opacity-80")


def _marks(desk: Desk, judged: Judgement) -> list[ui.input]:
    known = desk.journal.marks.get(judged.file, {})
    return [ui.input(f"mark {number} was", value=known.get(number, "")) for number in range(1, judged.marks + 1)]


def _decision(
    desk: Desk,
    recorded: Recorded,
    judged: Judgement,
    marks: Sequence[ui.input],
    act: Callable[..., Any],
    acts: dict[str, Callable[[], Awaitable[None] | None]],
) -> None:
    reason = ui.input("Why (needed to redo)", value="" if judged.advice == "accept" else "; ".join(judged.reasons))
    reason.classes("w-full").mark("why")

    def decide(choice: Choice, *, is_donned_anew: bool = False) -> None:
        for number, name in enumerate(marks, 1):
            if name.value:
                desk.name_mark(number, name.value)
        desk.decide(choice, reason.value or "", is_donned_anew=is_donned_anew)

    def keep() -> None:
        decide("accept")

    def redo() -> None:
        decide("redo")

    def redo_donned_anew() -> None:
        decide("redo", is_donned_anew=True)

    acts |= {"keep": keep, "redo": redo}
    if recorded.cuff is not None:
        acts["don_anew"] = redo_donned_anew
    with ui.row():
        ui.button("Keep (k)", on_click=lambda: act(keep)).props("" if judged.advice == "accept" else "outline").mark(
            "keep"
        )
        ui.button("Redo (r)", on_click=lambda: act(redo)).props("outline" if judged.advice == "accept" else "").mark(
            "redo"
        )
        again = ui.button("Don the cuff anew and redo (d)", on_click=lambda: act(redo_donned_anew)).props("outline")
        again.mark("don-anew").set_visibility(recorded.cuff is not None)

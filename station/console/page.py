"""The one page: what it shows follows from where the session stands, so every browser shows the same."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any

from nicegui import ui

from station.console import setup_view, summary_view, trial_view, verdict_view
from station.console.desk import Desk, DeskRefusal
from station.journal import JournalError
from station.simulation import SimulationError

REFRESH_S = 0.1
STYLE = """
.cue { font-size: clamp(1.8rem, 4.5vw, 4.2rem); line-height: 1.15; font-weight: 600; }
.figure { font-size: clamp(2.2rem, 5vw, 5rem); line-height: 1; font-variant-numeric: tabular-nums; }
.alarm { background: #b71c1c; color: white; font-size: clamp(2rem, 5vw, 4.5rem); font-weight: 800; }
.q-btn { font-size: 1.4rem; }
.q-table th, .q-table tbody td { font-size: 1.15rem; padding: 7px 8px; }
.q-field, .q-field__native, .q-field__label, .q-toggle__label, .q-chip { font-size: 1.3rem; }
"""
KEYS = {"a": "arm", "m": "mark", "s": "stop", "k": "keep", "r": "redo"}


def show_page(desk: Desk) -> None:
    """Builds the page for one browser."""
    ui.add_css(STYLE)
    ui.colors(primary="#1d4e89")
    page = _Page(desk)
    page.build()


class _Page:
    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        self._shown: tuple[Any, ...] = ()
        self._ticks: list[Callable[[], None]] = []
        self._acts: dict[str, Callable[[], Awaitable[None] | None]] = {}

    def build(self) -> None:
        with ui.header(elevated=True).classes("items-center justify-between"):
            self._where = ui.label().classes("text-2xl")
            with ui.row().classes("items-center"):
                ui.label("a arm · m mark · s stop · k keep · r redo").classes("text-lg opacity-80 gt-sm")
                dark = ui.dark_mode(None)
                ui.button(
                    icon="contrast", on_click=lambda: dark.toggle() if dark.value is not None else dark.enable()
                ).props('flat color=white aria-label="light or dark"')
        self._body()
        ui.keyboard(on_key=self._on_key)
        ui.timer(REFRESH_S, self._tick)

    @ui.refreshable_method
    def _body(self) -> None:
        desk = self._desk
        self._ticks, self._acts = [], {}
        with ui.column().classes("w-full max-w-screen-2xl mx-auto gap-4"):
            if desk.message:
                ui.label(desk.message).classes("text-xl").mark("message")
            if desk.folder is None:
                setup_view.show(desk, self.act)
            elif desk.live is not None:
                self._ticks.append(trial_view.show_running(desk, desk.live, self.act, self._acts))
            elif (plan := desk.agenda) is not None and plan.undecided is not None:
                verdict_view.show(desk, plan.undecided, self.act, self._acts)
            elif plan is not None and plan.spec is not None:
                trial_view.show_next(desk, plan, self.act, self._acts)
            else:
                summary_view.show(desk, self.act)

    async def act(self, what: Callable[[], Awaitable[None] | None]) -> None:
        """Does what a button says; a refusal is a sentence on the page."""
        try:
            done = what()
            if done is not None:
                await done
        except (DeskRefusal, JournalError, SimulationError) as refused:
            ui.notify(str(refused), type="negative", multi_line=True, timeout=8000, close_button="noted")
        self._tick()

    async def _on_key(self, event: Any) -> None:
        act = self._acts.get(KEYS.get(str(event.key).lower(), ""))
        if act is not None and event.action.keydown and not event.action.repeat:
            await self.act(act)

    def _tick(self) -> None:
        desk, plan = self._desk, self._desk.agenda
        waits = plan.undecided.file if plan and plan.undecided else None
        stands = (
            desk.folder,
            desk.live is None,
            waits,
            desk.judgement,
            desk.message,
            desk.progress,
            len(plan.done) if plan else 0,
        )
        if stands != self._shown:
            self._shown = stands
            self._where.text = _where(desk)
            self._body.refresh()
        for tick in self._ticks:
            tick()


def _where(desk: Desk) -> str:
    setup = desk.journal.setup
    if desk.folder is None or setup is None:
        return "station"
    rehearsal = "REHEARSAL, nothing is kept · " if desk.is_rehearsal else ""
    return f"{rehearsal}subject {setup.subject} · session {setup.number}"

"""The one page: what it shows follows from where the session stands, so every browser shows the same."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any

from nicegui import ui

from station.bench.simulation import SimulationError
from station.console import setup_view, summary_view, trial_view, verdict_view
from station.console.announcer import Announcer
from station.journal import JournalError
from station.session.desk import Desk, DeskRefusal
from station.session.live import Live

REFRESH_S = 0.08
"""A little more often than the ten times a second that are promised: a busy machine is late now and then."""
STYLE = """
.cue { font-size: clamp(2rem, 5.2vw, 5.5rem); line-height: 1.15; font-weight: 600; }
.figure { font-size: clamp(2.6rem, 6.6vw, 7rem); line-height: 1; font-weight: 500; font-variant-numeric: tabular-nums; }
.alarm { background: #b71c1c; color: white; font-size: clamp(2rem, 5vw, 5rem); font-weight: 800; }
.nicegui-header { padding: 4px 16px; }
.nicegui-header.simulated { background: var(--q-warning) !important; }
.q-btn { font-size: 1.5rem; text-transform: none; }
.q-table th, .q-table tbody td { font-size: 1.3rem; padding: 6px 8px; }
.q-field, .q-field__native, .q-field__label, .q-toggle__label, .q-chip { font-size: 1.3rem; }
.q-badge { font-size: clamp(1.5rem, 3vw, 3rem); line-height: 1; padding: 0.3em; }
:focus-visible { outline: 4px solid #f28c28; outline-offset: 2px; }
.body--dark .text-primary { --q-primary: #9cc2ff; }
.body--dark .text-negative { --q-negative: #ff9d94; }
.body--dark .text-positive { --q-positive: #6fd98a; }
.body--dark .q-field, .body--dark .q-toggle { --q-primary: #9cc2ff; }
.body--dark .nicegui-link { color: #9cc2ff; }
.body--dark canvas { filter: invert(1) hue-rotate(180deg); }
"""
KEYS = {
    "a": "arm",
    "m": "mark",
    "s": "stop",
    "i": "silence",
    "k": "keep",
    "r": "redo",
    "d": "don_anew",
    "f": "finish",
}


def show_page(desk: Desk) -> None:
    """Builds the page for one browser."""
    ui.add_css(STYLE)
    ui.colors(primary="#1d4e89", positive="#1b7f3b", warning="#a34a00")
    page = _Page(desk)
    page.build()


class _Page:
    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        self._shown: tuple[Any, ...] = ()
        self._ticks: list[Callable[[], None]] = []
        self._acts: dict[str, Callable[[], Awaitable[None] | None]] = {}

    def build(self) -> None:
        with ui.header(elevated=True).classes("items-center justify-between") as self._header:
            with ui.row().classes("items-center gap-3 no-wrap text-xl"):
                self._simulated = ui.label("SIMULATED DATA").classes("text-weight-bold")
                self._where = ui.label()
            with ui.row().classes("items-center"):
                self._sound = ui.switch("sound").props("dark color=orange").mark("sound")
                self._sound.tooltip("a tone and the words of every new step; an alarm sounds in any case")
                ui.button(icon="contrast").props('flat color=white aria-label="light or dark"').on(
                    "click", js_handler="() => Quasar.Dark.toggle()"
                )
        self._body()  # empty until the first tick, which comes once the page is connected: what is typed before is lost
        ui.keyboard(on_key=self._on_key, ignore=["input", "select", "textarea"])
        ui.timer(REFRESH_S, self._tick)

    @ui.refreshable_method
    def _body(self) -> None:
        desk = self._desk
        self._ticks, self._acts = [], {}
        if not self._shown:
            ui.label("connecting to the station").classes("text-xl")
            return
        with ui.column().classes("w-full max-w-screen-2xl mx-auto gap-3"):
            if desk.message:
                ui.label(desk.message).classes("text-xl").mark("message")
            if desk.folder is None:
                setup_view.show(desk, self.act)
            elif desk.live is not None:
                self._ticks.append(self._running(desk.live))
            elif (plan := desk.agenda) is not None and plan.undecided is not None:
                verdict_view.show(desk, plan.undecided, self.act, self._acts)
            elif plan is not None and plan.spec is not None:
                trial_view.show_next(desk, plan, self.act, self._acts)
            else:
                summary_view.show(desk, self.act, self._acts)

    def _running(self, live: Live) -> Callable[[], None]:
        look = trial_view.show_running(self._desk, live, self.act, self._acts)
        announcer = Announcer()

        def tick() -> None:
            look()
            announcer.tell(trial_view.cue_of(live), live.unseen_alarm, has_sound=bool(self._sound.value))

        return tick

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
        held = event.modifiers
        is_for_the_browser = held.ctrl or held.alt or held.meta  # as Ctrl+R, which must not redo a trial
        if act is not None and event.action.keydown and not event.action.repeat and not is_for_the_browser:
            await self.act(act)

    def _tick(self) -> None:
        desk, plan = self._desk, self._desk.agenda
        self._simulated.set_visibility(desk.is_simulated)
        self._header.classes(add="simulated") if desk.is_simulated else self._header.classes(remove="simulated")
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

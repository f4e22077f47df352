"""The one page: what it shows follows from where the session stands, so every browser shows the same."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from nicegui import ui

from station.bench.simulation import SimulationError
from station.console import next_view, running_view, setup_view, summary_view, verdict_view
from station.console.actions import Act, Actions
from station.console.audio_alerts import AudioAlerts
from station.console.recordings_view import add_recordings
from station.journal import JournalError
from station.session.agenda import Agenda
from station.session.desk import Desk
from station.session.live import Live
from station.session.open_session import CommandRefused

REFRESH_S = 0.08
"""A little more often than the ten times a second that are promised: a busy machine is late now and then."""
HERE = Path(__file__).parent
SCRIPTS = "".join(
    f"<script>{(HERE / name).read_text(encoding='utf-8')}</script>" for name in ("freshness.js", "markers.js")
)


def show_page(desk: Desk) -> None:
    """Builds the page for one browser."""
    ui.add_css(HERE / "style.css")
    ui.add_head_html(SCRIPTS)
    ui.colors(primary="#1d4e89", positive="#1b7f3b", warning="#a34a00")
    page = _Page(desk)
    page.build()


class _Page:
    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        self._shown: tuple[Any, ...] = ()
        self._tick_view: Callable[[], None] = lambda: None
        self._actions: Actions | None = None

    def build(self) -> None:
        self._header = ui.header().classes("items-center justify-between no-wrap")
        with self._header:
            with ui.row().classes("items-center gap-5 no-wrap"):
                self._simulated = ui.label("SIMULATED DATA").classes("simulated").mark("simulated")
                self._rec = ui.element("div").classes("rec").mark("rec")
                with self._rec:
                    self._dot = ui.element("div").classes("rec-dot")
                    self._rec_label = ui.label()
                with ui.column().classes("gap-0"):
                    self._title = ui.label().classes("title").mark("title")
                    self._subtitle = ui.label().classes("subtitle").mark("subtitle")
            with ui.row().classes("items-center no-wrap shrink-0"):
                ui.label().classes("age").mark("age")
                self._sound = ui.switch("sound").props("dark color=orange").mark("sound")
                self._sound.tooltip("a tone and the words of every new step; an alarm sounds in any case")
                ui.button(icon="contrast").props('flat color=white aria-label="light or dark"').classes("small").on(
                    "click", js_handler="() => Quasar.Dark.toggle()"
                )
        with ui.footer():
            self._refusal = ui.row().classes("refusal items-center").props("role=alert").mark("refusal")
            with self._refusal:
                self._refusal_label = ui.label()
                ui.button("noted", on_click=lambda: self._refuse("")).props("flat color=white").classes("small")
            self._form = ui.column().classes("w-full gap-1")
            self._buttons = ui.row().classes("actions")
        self._refuse("")
        self._body()  # empty until the first tick, which comes once the page is connected: what is typed before is lost
        ui.keyboard(on_key=self._on_key, ignore=["input", "select", "textarea"])
        ui.timer(REFRESH_S, self._tick)

    @ui.refreshable_method
    def _body(self) -> None:
        desk = self._desk
        self._tick_view = lambda: None
        actions = self._actions = Actions(self.run, self._buttons, self._form)
        if not self._shown:
            ui.label("connecting to the station").classes("text-xl")
            return
        with ui.column().classes("screen" + (" running" if desk.runner.live is not None else "")):
            if desk.session.message:
                ui.label(desk.session.message).classes("text-lg quiet").mark("message")
            plan = desk.session.agenda
            if desk.session.folder is None or plan is None:
                setup_view.show(desk, actions)
            elif desk.runner.live is not None:
                self._tick_view = self._running(desk.runner.live, actions)
            elif desk.session.is_ending:
                summary_view.show(desk, plan, actions)
            elif plan.undecided is not None:
                verdict_view.show(desk, plan.undecided, actions)
            elif plan.spec is not None:
                next_view.show(desk, plan, actions)
            else:
                summary_view.show(desk, plan, actions)
            if desk.session.folder is not None and desk.runner.live is None:
                add_recordings(desk, actions)

    def _running(self, live: Live, actions: Actions) -> Callable[[], None]:
        look = running_view.show(self._desk, live, actions)
        announcer = AudioAlerts()

        def tick() -> None:
            look()
            announcer.tell(running_view.cue_of(live), live.unseen_alarm, has_sound=bool(self._sound.value))

        return tick

    async def run(self, act: Act) -> None:
        """Does what a button says; a refusal is a sentence above the buttons, until something is done."""
        try:
            done = act()
            if done is not None:
                await done
        except (CommandRefused, JournalError, SimulationError) as refused:
            self._refuse(str(refused))
        else:
            self._refuse("")
        self._tick()

    def _refuse(self, sentence: str) -> None:
        self._refusal_label.text = sentence
        self._refusal.set_visibility(bool(sentence))

    async def _on_key(self, event: Any) -> None:
        letters = (str(event.key).lower(), str(event.key.code).removeprefix("Key").lower())  # the second: other scripts
        by_key = {} if self._actions is None or self._actions.is_covered else self._actions.by_key
        act = next((by_key[letter] for letter in letters if letter in by_key), None)
        held = event.modifiers
        is_for_the_browser = held.ctrl or held.alt or held.meta  # as Ctrl+R, which must not redo a trial
        if act is not None and event.action.keydown and not event.action.repeat and not is_for_the_browser:
            await self.run(act)

    def _tick(self) -> None:
        desk, plan = self._desk, self._desk.session.agenda
        stands: tuple[Any, ...] = (
            (desk.session.folder, desk.runner.live) if desk.runner.live is not None else self._stands(plan)
        )
        if stands != self._shown:
            self._shown = stands
            if desk.runner.live is None:
                ui.run_javascript("window.station?.leave()")
            self._body.refresh()
        self._show_header()
        self._tick_view()

    def _stands(self, plan: Agenda | None) -> tuple[Any, ...]:
        """What a page shows between two trials."""
        desk, journal = self._desk, self._desk.session.journal
        now = (
            desk.session.folder,
            desk.session.judgement,
            desk.session.message,
            desk.reviewer.progress,
            desk.session.summary,
            desk.session.is_ending,
        )
        return (*now, plan, tuple(journal.verdicts.items()), journal.recorded)

    def _show_header(self) -> None:
        live, state = self._desk.runner.live, self._desk.runner.live.latest["state"] if self._desk.runner.live else ""
        is_recording = state in ("recording", "closing")
        self._title.text, self._subtitle.text = titles_of(self._desk)
        self._simulated.set_visibility(self._desk.session.is_simulated)
        self._rec.set_visibility(live is not None)
        self._dot.set_visibility(is_recording)
        if live is not None:
            self._rec_label.text = f"REC {live.latest['recorded_s']:.0f} s" if is_recording else state_word(state)
        self._header.classes(
            add="header-recording" if is_recording else "header-armed" if live else "",
            remove="header-armed" if is_recording or not live else "header-recording",
        )
        if not is_recording:
            self._header.classes(remove="header-recording")


def state_word(state: str) -> str:
    return {"idle": "OPENING", "armed": "ARMED"}.get(state, state.upper())


def titles_of(desk: Desk) -> tuple[str, str]:
    """What the page is about now, and whose session it is."""
    setup, plan = desk.session.journal.setup, desk.session.agenda
    if desk.session.folder is None or setup is None or plan is None:
        return "station", ""
    rehearsal = "REHEARSAL, nothing is kept · " if desk.session.is_rehearsal else ""
    whose = f"{rehearsal}subject {setup.subject} · session {setup.number}"
    if desk.runner.live is None:
        return whose, f"{len(plan.done)} of {len(plan.trials)} trials done"
    spec = desk.runner.live.spec
    number = 1 + next((n for n, trial in enumerate(plan.trials) if trial.title == spec.title), 0)
    repeats = f" of {setup.repeats}" if spec.cuff is not None else ""
    return f"{spec.title}{repeats}", f"trial {number} of {len(plan.trials)} · {whose}"

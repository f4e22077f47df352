"""The only page: its view follows from the state of the session, so that every browser shows the same.

Sound is a tone and the spoken instruction of a new step, if it is switched on; an alarm always. A browser plays no
sound before the first key or click on its page; the one that armed the trial suffices.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from nicegui import ui

from documents.interval import counted
from fitting.trial.mass_checks import MassCheckError
from station.console import next_view, running_view, setup_view, summary_view, verdict_view
from station.console.actions import Action, Actions
from station.console.live_view import PATH as LIVE_PATH
from station.console.recordings_view import add_recordings
from station.errors import StationError
from station.session.controller import SessionController
from station.session.plan_status import PlanStatus
from station.session.trial_runner import LiveTrial

REFRESH_S = 0.08
"""A little more often than ten times a second, because a busy machine is sometimes late."""
HERE = Path(__file__).parent
SCRIPTS = "".join(
    f"<script>{(HERE / name).read_text(encoding='utf-8')}</script>"
    for name in ("freshness.js", "keys.js", "view3d.js", "markers.js")
)
STEP, ALARM = [880], [1760, 1320, 1760, 1320]
"""Frequencies [Hz] of consecutive tones."""
ALARM_INTERVAL_S = 1.5
SOUND = """
(() => {
    const audio = window.stationAudio ??= new AudioContext();
    audio.resume();
    %(tones)s.forEach((hertz, number) => {
        const tone = new OscillatorNode(audio, {type: "square", frequency: hertz});
        const from = audio.currentTime + 0.18 * number;
        tone.connect(new GainNode(audio, {gain: 0.2})).connect(audio.destination);
        tone.start(from);
        tone.stop(from + 0.15);
    });
    speechSynthesis.cancel();
    speechSynthesis.speak(Object.assign(new SpeechSynthesisUtterance(%(text)s), {lang: "en-US"}));
})()
"""
ui.tooltip.default_props("delay=800")  # a view may put a button under a pointer that has just clicked


def show_page(controller: SessionController) -> None:
    """Build the page for one browser."""
    ui.add_css(HERE / "style.css")
    ui.add_head_html(SCRIPTS)
    ui.colors(primary="#1d4e89", positive="#1b7f3b", warning="#a34a00")
    page = _Page(controller)
    page.build()


class _Page:
    def __init__(self, controller: SessionController) -> None:
        self._controller = controller
        self._shown: tuple[Any, ...] = ()
        self._tick_view: Callable[[], None] = lambda: None

    def build(self) -> None:
        self._client = ui.context.client
        self._client.content.props("tabindex=0 role=main")  # it scrolls by keys
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
                self._sound = ui.switch("sound").props("dark color=orange").classes("aside").mark("sound")
                self._sound.tooltip("a tone and the spoken instruction of every new step; an alarm sounds in any case")
                live = (
                    ui.button(icon="accessibility_new")
                    .props('flat color=white aria-label="live muscles"')
                    .classes("small aside")
                )
                live.on("click", js_handler=f"() => window.open('{LIVE_PATH}', 'live')")
                live.tooltip("muscle effort while the wearer moves, on a page of its own")
                ui.button(icon="contrast").props('flat color=white aria-label="light or dark"').classes(
                    "small aside"
                ).on("click", js_handler="() => Quasar.Dark.toggle()")
        with ui.footer():
            self._refusal = ui.row().classes("refusal items-center").props("role=alert").mark("refusal")
            with self._refusal:
                self._refusal_label = ui.label()
                ui.button("Close", on_click=lambda: self._refuse("")).props("flat color=white").classes("small")
            self._form = ui.column().classes("w-full gap-1")
            self._buttons = ui.row().classes("actions")
        self._refuse("")
        self._body()  # empty until the first tick, when the page is connected: input before it would be lost
        ui.timer(REFRESH_S, self._tick)

    @ui.refreshable_method
    def _body(self) -> None:
        controller = self._controller
        self._tick_view = lambda: None
        actions = Actions(self.run, self._buttons, self._form)
        if not self._shown:
            ui.label("connecting to the station").classes("text-xl")
            return
        with ui.column().classes("screen" + (" running" if controller.runner.live is not None else "")):
            if controller.session.message:
                ui.label(controller.session.message).classes("text-lg quiet break-words max-w-full").mark("message")
            plan = controller.session.plan
            if controller.session.folder is None or plan is None:
                setup_view.show(controller, actions)
            elif controller.runner.live is not None:
                self._tick_view = self._running(controller.runner.live, actions)
            elif controller.session.is_recorded_elsewhere:
                next_view.show_recorder(controller, plan, actions)
            elif controller.session.is_ending:
                summary_view.show(controller, plan, actions)
            elif plan.undecided is not None:
                verdict_view.show(controller, plan.undecided, actions)
            elif plan.spec is not None:
                next_view.show(controller, plan, actions)
            else:
                summary_view.show(controller, plan, actions)
            if controller.session.folder is not None and controller.runner.live is None:
                add_recordings(controller, actions)

    def _running(self, live: LiveTrial, actions: Actions) -> Callable[[], None]:
        update_view = running_view.show(self._controller, live, actions)
        alerts = AudioAlerts()

        def tick() -> None:
            update_view()
            alarm = None if live.unseen_alarm is None else str(live.unseen_alarm)
            step, instruction = running_view.guide_step(live), running_view.instruction_text(live)
            alerts.update(step, instruction, alarm, has_sound=bool(self._sound.value))

        return tick

    async def run(self, action: Action) -> None:
        """Perform the action of a button; a refusal is shown above the buttons until the next action.

        The action has the place of forms as its context: it, or a tick meanwhile, may replace the view of the button.
        """
        try:
            with self._form:
                awaitable = action()
                if awaitable is not None:
                    await awaitable
        except (StationError, MassCheckError) as refused:
            self._refuse(str(refused))
        else:
            self._refuse("")
        with self._client:
            self._tick()

    def _refuse(self, sentence: str) -> None:
        self._refusal_label.text = sentence
        self._refusal.set_visibility(bool(sentence))

    def _tick(self) -> None:
        controller, plan = self._controller, self._controller.session.plan
        shown: tuple[Any, ...] = (
            (controller.session.folder, controller.runner.live)
            if controller.runner.live is not None
            else self._state_between_trials(plan)
        )
        if shown != self._shown:
            self._shown = shown
            if controller.runner.live is None:
                ui.run_javascript("window.station?.clearAge()")
            self._body.refresh()
        self._show_header()
        self._tick_view()

    def _state_between_trials(self, plan: PlanStatus | None) -> tuple[Any, ...]:
        """Everything that a view between two trials depends on."""
        controller, journal = self._controller, self._controller.session.journal
        now = (
            controller.session.folder,
            controller.session.judgement,
            controller.session.message,
            controller.reviewer.progress,
            controller.session.summary,
            controller.session.is_ending,
            controller.session.is_recorded_elsewhere,
        )
        return (*now, plan, tuple(journal.verdicts.items()), journal.recorded)

    def _show_header(self) -> None:
        live, state = (
            self._controller.runner.live,
            self._controller.runner.live.latest.state if self._controller.runner.live else "",
        )
        is_recording = state in ("recording", "closing")
        self._title.text, self._subtitle.text = page_titles(self._controller)
        self._simulated.set_visibility(self._controller.session.is_simulated)
        self._rec.set_visibility(live is not None)
        self._dot.set_visibility(is_recording)
        if live is not None:
            self._rec_label.text = f"REC {live.latest.recorded_s:.0f} s" if is_recording else state_label(state)
        self._header.classes(
            add="header-recording" if is_recording else "header-armed" if live else "",
            remove="header-armed" if is_recording or not live else "header-recording",
        )
        if not is_recording:
            self._header.classes(remove="header-recording")


def state_label(state: str) -> str:
    return {"idle": "OPENING", "armed": "ARMED"}.get(state, state.upper())


def page_titles(controller: SessionController) -> tuple[str, str]:
    """Title and subtitle: trial, subject and session."""
    setup, plan = controller.session.journal.setup, controller.session.plan
    if controller.session.folder is None or setup is None or plan is None:
        return "station", ""
    rehearsal = "REHEARSAL, not stored · " if controller.session.is_rehearsal else ""
    session = f"{rehearsal}subject {setup.subject} · session {setup.number}"
    if controller.runner.live is None:
        return session, f"{len(plan.done)} of {counted(len(plan.trials), 'trial')} done"
    spec = controller.runner.live.spec
    number = 1 + next((n for n, trial in enumerate(plan.trials) if trial.title == spec.title), 0)
    repeats = f" of {setup.repeats}" if spec.cuff is not None else ""
    return f"{spec.title}{repeats}", f"trial {number} of {len(plan.trials)} · {session}"


class AudioAlerts:
    """Sound of one page during one trial."""

    def __init__(self) -> None:
        self._spoken: object = None
        self._alarmed_s = 0.0

    def update(self, step: object, instruction: str, alarm: str | None, *, has_sound: bool) -> None:
        """Speak the instruction of a new step; repeat an alarm until the operator has seen it."""
        if alarm is not None:
            if time.perf_counter() - self._alarmed_s >= ALARM_INTERVAL_S:
                self._alarmed_s = time.perf_counter()
                _sound(ALARM, alarm)
            return
        if has_sound and step != self._spoken:
            _sound(STEP, instruction)
        self._spoken = step


def _sound(tones: list[int], text: str) -> None:
    ui.run_javascript(SOUND % {"tones": json.dumps(tones), "text": json.dumps(text)})

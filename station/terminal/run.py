"""`station record` without a test: a whole session on the terminal, or as lines of JSON.

Events are shown as text for people, or as JSON for programs.
"""

from __future__ import annotations

import asyncio
import json
import re
import signal
import sys
import textwrap
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import asdict
from pathlib import Path
from typing import TextIO

from rich.console import Console, Group
from rich.live import Live as LiveRegion
from rich.text import Text

from documents.interval import counted
from documents.message import Message
from documents.plain_data import finite_or_none
from recordings.samples import DeviceIdentity
from station.bench.session_folder import SIMULATED_FOLDER, check_folder, is_for_simulated
from station.bench.simulation import SimulatedBench, clock_port, is_served_by_simulator, simulator_settings
from station.bench.trial_recorder import TrialRefused
from station.config import StationConfig
from station.end_signals import end_signals
from station.errors import StationError
from station.exit_code import DONE, FAILED, LOSSY
from station.journal import Setup, read_journal
from station.messages.session_messages import CommandCode, VerdictCode
from station.protocol import describe_trial
from station.session.controller import SessionController
from station.session.trial_runner import LiveTrial
from station.terminal import events
from station.terminal.commands import (
    Action,
    Command,
    Request,
    SessionOutput,
    is_interactive,
    listen_to_lines,
    listening_to_keys,
)
from station.terminal.events import SessionEvent
from station.terminal.sequencer import SessionSequencer

SIMULATOR = (DeviceIdentity("station simulate", "", is_simulated=True),)
NARROWEST = 40
GRADE_STYLES = {"good": "green", "doubtful": "yellow", "bad": "bold red"}
KEYS_BETWEEN = "a arm  r redo last  d re-don  n skip  x other  t trials  p pause  e end  ? keys"
KEYS_RECORDING = "s stop  m mark  r redo  d re-don  p pause after it  e end  ? all keys"


class SetupMissing(StationError):
    """A new session without a subject."""

    exit_code = 2


def plan_session(
    config: StationConfig, folder: Path, subject: str | None, operator: str, cuffs: tuple[str, ...], repeats: int | None
) -> Setup | None:
    """The plan of a new session; None if the folder holds one and no option differs.

    Raises SetupMissing, JournalError.
    """
    existing = read_journal(folder).setup
    if existing is not None and (subject, operator, cuffs, repeats) == (None, "", (), None):
        return None
    if existing is None and subject is None:
        raise SetupMissing(Message(CommandCode.NEW_SESSION, {"folder": str(folder)}))
    conditions = config.body.conditions if config.body is not None else ()
    known = existing or Setup(
        "", "", tuple(config.cuffs), config.protocol.repeats, config.bounce is not None, conditions=conditions
    )
    return Setup(
        subject or known.subject,
        operator or known.operator,
        cuffs or known.cuffs,
        repeats or known.repeats,
        known.has_bounce,
        known.number if existing is not None else _number(folder),
        known.step_masses_kg,
        known.conditions,
    )


def run_session(
    config: StationConfig,
    folder: Path,
    setup: Setup | None,
    *,
    is_headless: bool = False,
    is_simulated: bool = False,
    speed: float | None = None,
    seed: int = 1,
) -> int:
    """Run the session and return the exit code.

    setup None resumes the session of the folder. speed is the pace of the simulated world; without is_simulated, that
    of `station simulate`, at the configuration's addresses. Raises CommandRefused, JournalError, SimulationError, and
    TrialRefused before the session begins.
    """
    with ExitStack() as stack:
        bench = None
        if is_simulated:
            bench = stack.enter_context(SimulatedBench(simulator_settings(config), speed or 1.0, seed, outlives=True))
            config = bench.configure(config)
        is_simulator = not is_simulated and (speed is not None or is_served_by_simulator(config))
        if is_simulator and (refusal := check_folder(folder, SIMULATOR)):
            raise TrialRefused(refusal)
        port = clock_port(config) if is_simulator else None
        controller = SessionController(config, speed or 1.0, bench, port)
        stack.callback(controller.close)
        if setup is None:
            controller.session.resume(folder)
        else:
            controller.session.begin(setup, folder=folder)
        return asyncio.run(_run(controller, is_headless=is_headless, is_simulated=is_simulated))


def practice_folder(folder: Path) -> Path:
    """The folder of a session of simulated data: below a folder of that name."""
    return folder if is_for_simulated(folder) else folder.parent / SIMULATED_FOLDER / folder.name


async def _run(controller: SessionController, *, is_headless: bool, is_simulated: bool) -> int:
    loop, requests = asyncio.get_running_loop(), asyncio.Queue[Request]()

    def post(request: Request) -> None:
        with suppress(RuntimeError):  # the session has just ended
            loop.call_soon_threadsafe(requests.put_nowait, request)

    for number in end_signals():  # once: the running trial ends cleanly, and then the session; twice: at once
        signal.signal(number, lambda *_: post(Command(Action.END)))
    with ExitStack() as stack:
        output = _output(stack, post, is_headless=is_headless)
        warming = asyncio.create_task(controller.reviewer.warm_up())
        waits_for_start = controller.session.config.mocap.control == "start"
        sequencer = SessionSequencer(
            controller, output, requests, is_simulated=is_simulated, waits_for_start=waits_for_start
        )
        await sequencer.run()
        warming.cancel()
    if sequencer.is_refused:
        return FAILED
    return DONE if sequencer.has_summary or not sequencer.is_complete else LOSSY


def _output(stack: ExitStack, post: Callable[[Request], None], *, is_headless: bool) -> SessionOutput:
    if is_headless:
        listen_to_lines(post)
        return JsonOutput(sys.stdout)
    if not is_interactive():
        listen_to_lines(post)
        return TextOutput(SessionConsole(stderr=True), sys.stdout, is_interactive=False)
    output = stack.enter_context(TextOutput(SessionConsole(stderr=True), sys.stdout, is_interactive=True))
    stack.enter_context(listening_to_keys(post, output.show_typed))
    return output


def _number(folder: Path) -> str:
    """The label of the session in file names: the letters and digits of its folder's name."""
    return "".join(letter for letter in folder.name if letter.isascii() and letter.isalnum())[:32] or "1"


class SessionConsole(Console):
    """Keeps the process alive if its reader has ended, unlike the console of rich."""

    def on_broken_pipe(self) -> None:
        self.quiet = True


class TextOutput:
    """A context manager. paths receives the path of every recording that is kept, and of the report, one per line."""

    def __init__(self, console: Console, paths: TextIO, *, is_interactive: bool) -> None:
        self._console, self._paths = console, paths
        self._folder = Path()
        self._typed: str | None = None  # a prompt, and what is being typed after it
        self._trial = ""
        self._live: LiveTrial | None = None
        self._region = LiveRegion(console=console, auto_refresh=False, transient=True) if is_interactive else None

    def __enter__(self) -> TextOutput:
        if self._region is not None:
            self._region.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._region is not None:
            self._region.stop()

    def show_trial(self, live: LiveTrial | None) -> None:
        self._live = live
        self._draw()

    def show_typed(self, text: str | None) -> None:
        """A prompt with what is being typed after it; None if nothing is."""
        self._typed = text
        self._draw()

    def show_event(self, event: SessionEvent) -> None:
        match event:
            case events.SessionOpened():
                self._print_opening(event)
            case events.NextTrial():
                self._print_next(event)
            case events.StateChanged(state="armed"):
                self._print("  Armed: the trial begins with the capture.", "cyan")
            case events.StateChanged(state="recording"):
                self._print(f"  REC: {event.problems}" if event.problems else "  REC", "bold red")
            case events.StateChanged() | events.Status():
                pass
            case events.CueChanged():
                self._print(f"  {event.step}/{event.steps}  {event.sentence}")
            case events.WarningRaised():
                self._print_warning(event)
            case events.TrialEnded():
                lost = f", {counted(event.lost_samples, 'sample')} lost" if event.lost_samples else ""
                state = "recorded" if event.accepted else "recorded, NOT ACCEPTED"
                self._print(f"  {state}{lost}: {event.sentence}")
            case events.VerdictGiven():
                self._print_verdict(event)
            case _:
                self._print_session_event(event)

    def _print_session_event(self, event: SessionEvent) -> None:
        match event:
            case events.Decided():
                self._print_decision(event)
            case events.TrialSkipped():
                title = describe_trial(event.cuff, event.test, event.repeat, event.condition)
                self._print(f"  Skipped: {title}.")
            case events.PlanListed():
                self._print_plan(event)
            case events.Waiting():
                self._print(f"  > {event.sentence}", "bold yellow")
                self._print(f"    {' · '.join(event.commands)}")
            case events.CommandAnswered():
                for line in event.sentence.splitlines():
                    self._print(f"  {line}", "yellow" if event.is_refused else "")
            case events.SummaryStarted() | events.SummaryProgressed():
                text = event.sentence if isinstance(event, events.SummaryStarted) else f"  {event.stage}"
                self._print(f"{text[0].upper()}{text[1:]}")
            case events.SummaryFinished():
                self._print_summary(event)
            case events.SessionClosed():
                kept = f"{event.done} of {counted(event.trials, 'trial')} kept, {event.skipped} skipped"
                self._print(f"{kept}; {event.sentence}.", "bold")
            case _:
                pass

    def _print_opening(self, event: events.SessionOpened) -> None:
        self._folder = Path(event.folder)
        simulated = "SIMULATED DEVICES, practice only. " if event.is_simulated else ""
        self._print(f"{simulated}Subject {event.subject}, session {event.session}, in {event.folder}", "bold")
        done = f"{event.done} of {counted(event.trials, 'trial')} kept, {event.skipped} skipped"
        self._print(f"  {done}. Type ? for the keys." if self._region else f"  {done}. `help` lists the commands.")

    def _print_next(self, event: events.NextTrial) -> None:
        title = describe_trial(event.cuff, event.test, event.repeat, event.condition)
        self._trial = f"{event.number}/{event.trials} {title}"
        self._print(f"[{event.number}/{event.trials}] {title} · about {event.minutes_left} min left", "bold")
        self._print(f"  {event.order}.")

    def _print_warning(self, event: events.WarningRaised) -> None:
        bell = "\a" if event.code == "alarm" and self._region is not None else ""
        retry = f" Next attempt within {event.retry_s:g} s." if event.retry_s is not None else ""
        style = "bold white on red" if event.code == "alarm" else "red"
        self._print(f"{bell}  ! {event.sentence}.{retry}", style)

    def _print_verdict(self, event: events.VerdictGiven) -> None:
        headline = Message(VerdictCode(f"verdict.{event.grade}"))
        self._print(f"  {event.title}: {headline}", GRADE_STYLES[event.grade])
        rows = [row for row in event.rows if row.this != "-"]
        width = max((len(row.quantity) for row in rows), default=0)
        for row in rows:
            so_far = f"   so far {row.so_far}" if row.so_far not in ("-", row.this) else ""
            self._print(f"    {row.quantity:<{width}}  {row.this}{so_far}")
        for reason in event.reasons:
            self._print(f"    - {reason}", GRADE_STYLES[event.grade])
        for doubt in event.doubts:
            self._print(f"    - {doubt}", "yellow")
        for note in event.notes:
            self._print(f"    {note}", "dim")

    def _print_decision(self, event: events.Decided) -> None:
        place = " elsewhere" if event.by == "elsewhere" else ""
        if event.choice == "accept":
            self._print(f"  Kept{place}: {event.file}", "green")
            self._print_path(str(self._folder / event.file))
        else:
            anew = ", the cuff donned anew" if event.is_donned_anew else ""
            self._print(f"  To be redone{place}{anew}: {event.file} ({event.reason})", "yellow")

    def _print_summary(self, event: events.SummaryFinished) -> None:
        for row in event.cuffs:
            for heading, text in row.items():
                self._print(f"  {heading}: {text}" if heading == "cuff" else f"    {heading:<14} {text}")
        for finding in event.findings:
            self._print(f"  {finding}")
        self._print_path(event.report)

    def _print_plan(self, event: events.PlanListed) -> None:
        for trial in event.trials:
            self._print(f"  #{trial.number:<3} {trial.state:<8} {trial.title}")

    def _print_path(self, path: str) -> None:
        """On a line of its own: above the key line where both are on the terminal, else on stdout."""
        with suppress(OSError, ValueError):  # the reader has ended; the session continues
            if self._region is not None and self._paths.isatty():
                self._console.print(path, highlight=False, markup=False, soft_wrap=True)
            else:
                print(path, file=self._paths, flush=True)

    def _print(self, text: str, style: str = "") -> None:
        """Print one paragraph, on a terminal wrapped to its width and indented like its first line."""
        if self._console.is_terminal:
            indent = " " * (len(text) - len(text.lstrip()))
            width = max(self._console.width, NARROWEST)
            text = textwrap.fill(text, width, subsequent_indent=indent + "  ", break_on_hyphens=False)
        with suppress(OSError, ValueError):
            self._console.print(text, style=style, highlight=False, markup=False, soft_wrap=True)

    # -- the running trial ---------------------------------------------------------------------------------------

    def _draw(self) -> None:
        if self._region is not None:
            with suppress(OSError, ValueError):
                self._region.update(Group(*self._lines()), refresh=True)

    def _lines(self) -> list[Text]:
        width = max(self._console.width, NARROWEST) - 1
        lines = [] if self._live is None else _trial_lines(self._live, self._trial)
        if self._typed is not None:
            lines.append(Text(f"{self._typed}_   (Enter: done, Esc: cancel)", "bold yellow"))
        else:
            is_recorded = self._live is not None and self._live.takes_marks
            lines += [Text(line, "dim") for line in _key_lines(KEYS_RECORDING if is_recorded else KEYS_BETWEEN, width)]
        for line in lines:
            line.truncate(width, overflow="ellipsis")
        return lines


def _key_lines(keys: str, width: int) -> list[str]:
    """Wrapped between two keys, never within one."""
    unbroken = re.sub(r"(?<=\S) (?=\S)", "\u00a0", keys)
    return [line.replace("\u00a0", " ") for line in textwrap.wrap(unbroken, width)]


def _trial_lines(live: LiveTrial, title: str) -> list[Text]:
    """Two lines: the state with its figures, and the current instruction."""
    latest = live.latest
    is_recorded = latest.state == "recording"
    clock = f"{latest.recorded_s:.0f} s" if is_recorded else ""
    if latest.state == "armed":
        clock = f"for {latest.waited_s:.0f} s, {latest.left_s:.0f} s left"
    force = f"{live.force[-1][1]:.1f} N" if live.force else "- N"
    unit, digits = ("deg", 0) if live.is_of_wearer else ("mm", 1)
    motion = f"{live.motion[-1][1]:+.{digits}f} {unit}" if live.motion else f"- {unit}"
    level = latest.sync_v
    sync = f"sync {level:.1f} V" if level is not None else "sync -"
    lost = f"  lost {latest.lost_samples}" if latest.lost_samples else ""
    state = "REC" if is_recorded else latest.state
    first = Text(f"{state} {clock}  {force}  {motion}  {sync}{lost}  {title}", "bold red" if is_recorded else "cyan")
    cue = live.cue
    left = f" ({cue.left_s:.0f} s)" if is_recorded and cue.left_s is not None else ""
    second = f"{cue.sentence}{left} · {cue.rest.value}" if is_recorded else latest.sentence
    lines = [first, Text(second, "bold")]
    if live.unseen_alarm is not None:
        lines.insert(0, Text(f"{live.unseen_alarm}   (i: silence)", "bold white on red"))
    return lines


class JsonOutput:
    def __init__(self, out: TextIO) -> None:
        self._out = out

    def show_event(self, event: SessionEvent) -> None:
        line = json.dumps({"event": event.event, **finite_or_none(asdict(event))}, ensure_ascii=False, allow_nan=False)
        with suppress(OSError, ValueError):  # the reader has ended; the session continues and its journal has it
            print(line, file=self._out, flush=True)

    def show_trial(self, live: LiveTrial | None) -> None:
        """The status is an event, once a second."""

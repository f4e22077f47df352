"""A session as text: lines that stay, and on a terminal the running trial below them."""

from __future__ import annotations

import textwrap
from contextlib import suppress
from pathlib import Path
from typing import TextIO

from rich.console import Console, Group
from rich.live import Live as LiveRegion
from rich.text import Text

from station.session.live import Live
from station.terminal import events
from station.terminal.events import Event

NARROWEST = 40
KEYS_BETWEEN = "a arm  r redo last  d re-don  n skip  p pause  e end  ? all keys"
KEYS_RECORDING = "s stop  m mark  r redo  d re-don  p pause after it  e end  ? all keys"


class SessionConsole(Console):
    """Does not end the process with its reader, as rich's own does."""

    def on_broken_pipe(self) -> None:
        self.quiet = True


class TextFace:
    """A context manager. paths takes one path a line: of every recording that is kept, and of the report."""

    def __init__(self, console: Console, paths: TextIO, *, is_interactive: bool) -> None:
        self._console, self._paths = console, paths
        self._folder = Path()
        self._typed: str | None = None  # the reason that is being typed
        self._trial = ""
        self._live: Live | None = None
        self._region = LiveRegion(console=console, auto_refresh=False, transient=True) if is_interactive else None

    def __enter__(self) -> TextFace:
        if self._region is not None:
            self._region.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._region is not None:
            self._region.stop()

    def show(self, live: Live | None) -> None:
        self._live = live
        self._draw()

    def show_typed(self, text: str | None) -> None:
        """The reason that is being typed for a redo; None: none is."""
        self._typed = text
        self._draw()

    def tell(self, event: Event) -> None:
        match event:
            case events.SessionOpened():
                self._open(event)
            case events.NextTrial():
                self._trial = f"{event.number}/{event.trials} {_trial(event.cuff, event.test, event.repeat)}"
                self._say(f"[{event.number}/{event.trials}] {_trial(event.cuff, event.test, event.repeat)}", "bold")
                self._say(f"  {event.order}.")
            case events.StateChanged(state="armed"):
                self._say("  Armed: the trial begins with the capture.", "cyan")
            case events.StateChanged(state="recording"):
                self._say(f"  REC{event.sentence.removeprefix('recording').replace('; ', ': ', 1)}", "bold red")
            case events.StateChanged() | events.Status():
                pass
            case events.Cued():
                self._say(f"  {event.step}/{event.steps}  {event.sentence}")
            case events.Warned():
                self._warn(event)
            case events.TrialEnded():
                lost = f", {event.lost_samples} samples lost" if event.lost_samples else ""
                state = "recorded" if event.accepted else "recorded, NOT ACCEPTED"
                self._say(f"  {state}{lost}: {event.sentence}")
            case events.VerdictGiven():
                self._judge(event)
            case _:
                self._tell_of_the_session(event)

    def _tell_of_the_session(self, event: Event) -> None:
        match event:
            case events.Decided():
                self._decide(event)
            case events.Skipped():
                self._say(f"  Skipped: {_trial(event.cuff, event.test, event.repeat)}.")
            case events.Waiting():
                self._say(f"  > {event.sentence}", "bold yellow")
                self._say(f"    {' · '.join(event.commands)}")
            case events.Answered():
                for line in event.sentence.splitlines():
                    self._say(f"  {line}", "yellow" if event.is_refused else "")
            case events.SummingUp():
                self._say(f"{event.sentence[0].upper()}{event.sentence[1:]}: a minute or two.")
            case events.SummedUp():
                for row in event.cuffs:
                    for heading, text in row.items():
                        self._say(f"  {heading}: {text}" if heading == "cuff" else f"    {heading:<14} {text}")
                for finding in event.findings:
                    self._say(f"  {finding}")
                self._path(event.report)
            case events.SessionClosed():
                counted = f"{event.done} of {event.trials} trials kept, {event.skipped} skipped"
                self._say(f"{counted}; {event.sentence}.", "bold")
            case _:
                pass

    def _open(self, event: events.SessionOpened) -> None:
        self._folder = Path(event.folder)
        simulated = "SIMULATED DEVICES, practice only. " if event.is_simulated else ""
        self._say(f"{simulated}Subject {event.subject}, session {event.session}, in {event.folder}", "bold")
        done = f"{event.done} of {event.trials} trials kept, {event.skipped} skipped"
        self._say(f"  {done}. Type ? for the keys." if self._region else f"  {done}. `help` lists the commands.")

    def _warn(self, event: events.Warned) -> None:
        bell = "\a" if event.code == "alarm" and self._region is not None else ""
        again = f" Trying again every {event.retry_s:g} s at most." if event.retry_s is not None else ""
        style = "bold white on red" if event.code == "alarm" else "red"
        self._say(f"{bell}  ! {event.sentence}.{again}", style)

    def _judge(self, event: events.VerdictGiven) -> None:
        is_good = event.advice == "accept"
        state = "no problems found" if is_good else "better redo it"
        self._say(f"  {event.title}: {state}", "green" if is_good else "bold red")
        for row in event.rows:
            if row.this != "-":
                so_far = f"   so far {row.so_far}" if row.so_far not in ("-", row.this) else ""
                self._say(f"    {row.quantity:<14} {row.this}{so_far}")
        for reason in event.reasons:
            self._say(f"    - {reason}", "red")
        for note in event.notes:
            self._say(f"    {note}", "dim")

    def _decide(self, event: events.Decided) -> None:
        who = {"station": "", "operator": "", "elsewhere": " elsewhere"}[event.by]
        if event.choice == "accept":
            self._say(f"  Kept{who}: {event.file}", "green")
            self._path(str(self._folder / event.file))
        else:
            anew = ", the cuff donned anew" if event.is_donned_anew else ""
            self._say(f"  To be redone{who}{anew}: {event.file} ({event.reason})", "yellow")

    def _path(self, path: str) -> None:
        with suppress(OSError, ValueError):  # nobody reads it any more; the session goes on
            print(path, file=self._paths, flush=True)

    def _say(self, text: str, style: str = "") -> None:
        """One paragraph; on a terminal wrapped to it, its lines indented as the first."""
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
            lines.append(Text(f"why? {self._typed}_   (Enter takes it, Esc drops it)", "bold yellow"))
        else:
            is_recorded = self._live is not None and self._live.takes_marks
            lines.append(Text(KEYS_RECORDING if is_recorded else KEYS_BETWEEN, "dim"))
        for line in lines:
            line.truncate(width, overflow="ellipsis")
        return lines


def _trial_lines(live: Live, title: str) -> list[Text]:
    """Two lines: the state with its figures, and what to do now."""
    told = live.latest
    is_recorded = told["state"] == "recording"
    clock = f"{told['recorded_s']:.0f} s" if is_recorded else ""
    if told["state"] == "armed":
        clock = f"for {told['waited_s']:.0f} s, {told['left_s']:.0f} s left"
    force = f"{live.force[-1][1]:.1f} N" if live.force else "- N"
    moved = f"{live.displacement[-1][1]:+.1f} mm" if live.displacement else "- mm"
    level = told.get("sync_v")
    sync = f"sync {level:.1f} V" if level is not None else "sync -"
    lost = f"  lost {told['lost_samples']}" if told.get("lost_samples") else ""
    state = "REC" if is_recorded else told["state"]
    first = Text(f"{state} {clock}  {force}  {moved}  {sync}{lost}  {title}", "bold red" if is_recorded else "cyan")
    cue = live.cue
    left = f" ({cue.left_s:.0f} s)" if is_recorded and cue.left_s is not None else ""
    second = f"{cue.sentence}{left} · {cue.rest.value}" if is_recorded else str(told["sentence"])
    lines = [first, Text(second, "bold")]
    if live.unseen_alarm is not None:
        lines.insert(0, Text(f"{live.unseen_alarm}   (i: seen)", "bold white on red"))
    return lines


def _trial(cuff: str | None, test: str, repeat: int) -> str:
    return "bounce calibration" if cuff is None else f"{cuff}: {test}, repeat {repeat}"

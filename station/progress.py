"""Progress on stderr: on a terminal a bar per stage, elsewhere one plain line when a stage ends.

A stage is what a Progress is called with. On a terminal its bar shows the time elapsed and an estimate of the time
left. In a pipe or a log there are no bars and no control characters: `recording trials: 25 of 25 in 71 s`.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from time import perf_counter

from rich import progress as bars
from rich.console import Console
from rich.text import Text

Progress = Callable[[str, int, int], None]
"""Called with the stage, how much of it is done, and of how much. The call with 0 starts the stage's clock."""
Clock = Callable[[], float]


@contextmanager
def busy(words: str) -> Iterator[None]:
    """While something is done whose length nobody knows. Nothing is drawn where there is no terminal."""
    with Console(stderr=True).status(words):
        yield


def silent(what: str, done: int, total: int) -> None:
    """Progress that nobody watches."""


@contextmanager
def progress_bars(console: Console, clock: Clock = perf_counter) -> Iterator[Progress]:
    """Yields a Progress that shows every stage, from its first call on; the clock is in seconds.

    Any thread may call it. Calls that come when the block has ended are ignored.
    """
    # Colours may be forced in a log by an environment variable; a bar that moves needs a real terminal.
    is_terminal = console.is_interactive and console.file.isatty()
    shown = _Bars(console, clock) if is_terminal else _Lines(console, clock)
    lock, is_open = threading.Lock(), True  # the compilation reports from a thread of its own

    def report(what: str, done: int, total: int) -> None:
        with lock:
            if is_open:
                shown.report(what, done, total)

    try:
        yield report
    finally:
        with lock:
            is_open = False
            shown.close()


@dataclass
class _Stage:
    """How far a stage has come; seconds of the clock."""

    start_s: float
    last_s: float
    done: int
    total: int
    is_told: bool = False


class _Lines:
    """A line when a stage is done. One that ends early has its line at the end, with the time of its last report."""

    def __init__(self, console: Console, clock: Clock) -> None:
        self._console, self._clock = console, clock
        self._stages: dict[str, _Stage] = {}

    def report(self, what: str, done: int, total: int) -> None:
        now = self._clock()
        stage = self._stages.setdefault(what, _Stage(now, now, done, total))
        stage.last_s, stage.done, stage.total = now, done, total
        if done >= total:
            self._tell(what, stage)

    def close(self) -> None:
        for what, stage in self._stages.items():
            self._tell(what, stage)

    def _tell(self, what: str, stage: _Stage) -> None:
        if not stage.is_told:
            stage.is_told = True
            line = f"{what}: {stage.done} of {stage.total} in {_seconds(stage.last_s - stage.start_s)}"
            self._console.print(line, markup=False, highlight=False, soft_wrap=True)


class _Bars:
    """A bar per stage, drawn from the first call on."""

    def __init__(self, console: Console, clock: Clock) -> None:
        columns = (bars.TextColumn("{task.description}"), bars.BarColumn(), bars.MofNCompleteColumn())
        self._bars = bars.Progress(
            *columns, bars.TimeElapsedColumn(), _TimeLeftColumn(), console=console, get_time=clock
        )
        self._tasks: dict[str, bars.TaskID] = {}

    def report(self, what: str, done: int, total: int) -> None:
        self._bars.start()
        if what not in self._tasks:
            self._tasks[what] = self._bars.add_task(what, total=total)
        self._bars.update(self._tasks[what], completed=done, total=total)

    def close(self) -> None:
        if self._tasks:
            self._bars.stop()


class _TimeLeftColumn(bars.ProgressColumn):
    """Elapsed time times the part that is left over the part that is done: steps are few, and of about one length.

    Rich's own column takes the last 30 s only, in which a trial or a kernel may not end.
    """

    def render(self, task: bars.Task) -> Text:
        if task.finished or not task.elapsed or not task.completed or task.total is None:
            return Text()
        left = task.elapsed * (task.total - task.completed) / task.completed
        return Text(f"about {_seconds(left)} left")


def _seconds(duration_s: float) -> str:
    """To a tenth below ten seconds, then to the second; from two minutes on in minutes."""
    if duration_s < 9.95:
        return f"{duration_s:.1f} s"
    whole = math.floor(duration_s + 0.5)
    return f"{whole} s" if whole < 120 else f"{whole // 60} min {whole % 60:02d} s"

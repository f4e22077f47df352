"""Progress on stderr: on a terminal a bar per stage, elsewhere one plain line when a stage ends.

A Progress is called with the name of a stage. On a terminal its bar shows the time elapsed and an estimate of the time
left. In a pipe or a log there are no bars and no control characters: `recording trials: 25 of 25 in 71 s`.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from time import perf_counter
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Task, TaskID

Progress = Callable[[str, int, int], None]
"""Called with stage, number of finished steps, and total. The call with 0 starts the clock of the stage."""
Clock = Callable[[], float]
COMPILING = "compiling the solver"
"""A stage beside the others, of kernels that take from 10 ms to 10 s."""


@contextmanager
def busy(activity: str) -> Iterator[None]:
    """Show an activity of unknown duration. Nothing is drawn without a terminal."""
    from rich.console import Console  # the worker and the console have no terminal

    with Console(stderr=True).status(activity):
        yield


def silent(stage: str, done: int, total: int) -> None:
    """A Progress that shows nothing."""


def with_part(progress: Progress, part: str) -> Progress:
    """A Progress that adds the name of a part to the names of its stages."""
    return lambda stage, done, total: progress(f"{stage}, {part}", done, total)


@contextmanager
def progress_bars(console: Console, clock: Clock = perf_counter) -> Iterator[Progress]:
    """Yield a Progress that shows every stage from its first call on; clock: in seconds.

    Any thread may call it. Calls after the end of the block are ignored.
    """
    # Colours may be forced in a log by an environment variable; a bar that moves needs a real terminal.
    is_terminal = console.is_interactive and console.file.isatty()
    shown = _Bars(console, clock) if is_terminal else _PlainProgress(console, clock)
    lock, is_open = threading.Lock(), True  # the compilation reports from a thread of its own

    def report(stage: str, done: int, total: int) -> None:
        with lock:
            if is_open:
                shown.report(stage, done, total)

    try:
        yield report
    finally:
        with lock:
            is_open = False
            shown.close()


@dataclass
class _Stage:
    """State of a stage; times in seconds of the clock."""

    start_s: float
    last_s: float
    done: int
    total: int
    is_printed: bool = False


class _PlainProgress:
    """A line per finished stage; an unfinished stage has its line at the end, with the time of its last report."""

    def __init__(self, console: Console, clock: Clock) -> None:
        self._console, self._clock = console, clock
        self._stages: dict[str, _Stage] = {}

    def report(self, stage: str, done: int, total: int) -> None:
        now = self._clock()
        state = self._stages.setdefault(stage, _Stage(now, now, done, total))
        state.last_s, state.done, state.total = now, done, total
        if done >= total:
            self._print(stage, state)

    def close(self) -> None:
        for name, stage in self._stages.items():
            self._print(name, stage)

    def _print(self, name: str, stage: _Stage) -> None:
        if not stage.is_printed:
            stage.is_printed = True
            line = f"{name}: {stage.done} of {stage.total} in {_seconds(stage.last_s - stage.start_s)}"
            self._console.print(line, markup=False, highlight=False, soft_wrap=True)


class _Bars:
    """A bar per stage, drawn from the first call on."""

    def __init__(self, console: Console, clock: Clock) -> None:
        from rich import progress as bars
        from rich.text import Text

        class TimeLeftColumn(bars.ProgressColumn):
            """Estimate of the remaining time from the mean duration of the finished steps.

            Rich's own column uses the last 30 s only, in which no trial or kernel may end.
            """

            def render(self, task: Task) -> Text:
                if task.finished or not task.elapsed or task.total is None:
                    return Text()
                return Text(time_left(task.description, task.elapsed, task.completed, task.total))

        columns = (bars.TextColumn("{task.description}"), bars.BarColumn(), bars.MofNCompleteColumn())
        times = (bars.TimeElapsedColumn(), TimeLeftColumn())
        self._bars = bars.Progress(*columns, *times, console=console, get_time=clock)
        self._tasks: dict[str, TaskID] = {}

    def report(self, stage: str, done: int, total: int) -> None:
        self._bars.start()
        if stage not in self._tasks:
            self._tasks[stage] = self._bars.add_task(stage, total=total)
        self._bars.update(self._tasks[stage], completed=done, total=total)

    def close(self) -> None:
        if self._tasks:
            self._bars.stop()


@dataclass
class StageProgress:
    """A stage as views show it; begun_s on time.perf_counter()."""

    name: str
    begun_s: float
    done: int
    total: int

    @property
    def part(self) -> float:
        """From 0 to 1."""
        return self.done / self.total if self.total else 0.0


def time_left(stage: str, elapsed_s: float, done: float, total: float) -> str:
    """Estimate of the time left, from the mean duration of the finished steps; empty before the first one and where
    steps differ too much.
    """
    if stage == COMPILING or not done:
        return ""
    return f"about {_whole_seconds(elapsed_s * (total - done) / done)} left"


def _seconds(duration_s: float) -> str:
    """Tenths of a second below 10 s, then seconds."""
    return f"{duration_s:.1f} s" if duration_s < 9.95 else _whole_seconds(duration_s)


def _whole_seconds(duration_s: float) -> str:
    """Seconds; from two minutes on, minutes and seconds."""
    whole = math.floor(duration_s + 0.5)
    return f"{whole} s" if whole < 120 else f"{whole // 60} min {whole % 60:02d} s"

"""What a terminal shows on stderr while a thing takes longer than a moment: a bar, or words until it is done."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich import progress as bars
from rich.console import Console

Progress = Callable[[str, int, int], None]
"""Called with what is being done, how much of it is done, and of how much."""


@contextmanager
def busy(words: str) -> Iterator[None]:
    """While something is done whose length nobody knows. Nothing is drawn where there is no terminal."""
    with Console(stderr=True).status(words):
        yield


def silent(what: str, done: int, total: int) -> None:
    """Progress that nobody watches."""


@contextmanager
def progress_bars(console: Console) -> Iterator[Progress]:
    """Yields a Progress that draws, from the first call on."""
    columns = (bars.TextColumn("{task.description}"), bars.BarColumn(), bars.MofNCompleteColumn())
    tasks: dict[str, bars.TaskID] = {}
    drawn = bars.Progress(*columns, bars.TimeElapsedColumn(), console=console)

    def report(what: str, done: int, total: int) -> None:
        drawn.start()
        if what not in tasks:
            tasks[what] = drawn.add_task(what, total=total)
        drawn.update(tasks[what], completed=done, total=total)

    try:
        yield report
    finally:
        if tasks:
            drawn.stop()

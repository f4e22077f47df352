"""Compile the solver's kernels ahead in other processes, and show compilation as a stage of the progress."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from types import TracebackType

import typer

from solver.compile_ahead import BEGIN_WITH, KERNELS, CompilationCount, is_first_use, shares
from station.progress import Progress

STAGE = "compiling the solver"
FIRST_USE = "The solver is compiled, once on this machine; this takes 10 to 15 s on an idle machine."
COMMAND = (sys.executable, "-m", "solver.compile_ahead", "--with-parent")


def compilation_beside(context: typer.Context) -> CompilationAhead:
    """Compilation beside a verb, which on the first use on this machine starts before the other imports of the verb.

    They take as long as its own. It ends with the verb. compilation_shown starts it if something is compiled later.
    """
    commands = [(*COMMAND, BEGIN_WITH, share) for share in shares(os.cpu_count() or 1)]
    beside = context.with_resource(CompilationAhead(*commands))
    if is_first_use():
        beside.ensure_started()
    return beside


class CompilationAhead:
    """A context manager: other processes compile during it, from ensure_started on.

    This module imports little, so that they start before the other imports of a verb. A failure only costs time: a
    kernel that is not compiled is compiled at its first use.
    """

    def __init__(self, *commands: Sequence[str]) -> None:
        self._commands = commands or (COMMAND,)
        self._is_started = False
        self._children: list[subprocess.Popen[str]] = []
        self._readers: list[threading.Thread] = []
        self._is_complete = False

    def __enter__(self) -> CompilationAhead:
        return self

    def ensure_started(self) -> None:
        """Start the processes unless they have been started, even if they have ended since."""
        if self._is_started:
            return
        self._is_started = True
        with suppress(OSError):
            for command in self._commands:
                self._children.append(_start(command))

    def show(self, progress: Progress) -> None:
        """Report every kernel from now on, in threads, until the children end."""
        for child in self._children:
            assert child.stdout is not None  # noqa: S101 (a pipe)
            self._readers.append(threading.Thread(target=self._report, args=(child.stdout, progress), daemon=True))
            self._readers[-1].start()

    def wait(self) -> bool:
        """Wait until the children that are shown have ended. Returns whether every kernel is compiled."""
        for reader in self._readers:
            reader.join()
        return self._is_complete and all(child.wait() == 0 for child in self._children)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for child in self._children:
            child.kill()  # kernels on the disk are complete
        for child in self._children:
            child.wait()
        for reader in self._readers:
            reader.join()
        for child in self._children:
            for pipe in (child.stdin, child.stdout):
                if pipe is not None:
                    pipe.close()
        self._children.clear()

    def _report(self, counts: Iterable[str], progress: Progress) -> None:
        """Show progress unless all kernels are on the disk already."""
        is_shown = False
        for line in counts:
            try:
                count = json.loads(line)
                ready, total = int(count["ready"]), int(count["kernels"])
            except (ValueError, TypeError, KeyError):
                continue
            self._is_complete = ready == total
            is_shown = is_shown or not self._is_complete
            if is_shown:
                progress(STAGE, ready, total)


def _start(command: Sequence[str]) -> subprocess.Popen[str]:
    return subprocess.Popen(  # noqa: S603 (our own module)
        command,
        stdin=subprocess.PIPE,  # the child ends when it closes, so it never outlives this process
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        encoding="utf-8",
        creationflags=getattr(subprocess, "BELOW_NORMAL_PRIORITY_CLASS", 0),  # Windows; elsewhere it is nice
    )


@contextmanager
def compilation_shown(progress: Progress, beside: CompilationAhead) -> Iterator[None]:
    """Show compilation in this process as a separate stage, instead of a warning per kernel.

    When it begins, a message says how long it takes, because a log shows no stage before it ends, and the other
    processes are started unless they were. This process loads the kernels that are ready by then.
    """
    has_begun = False

    def report(ready: int, total: int) -> None:
        from solver.compiled import keeps_code  # imports the compiler

        nonlocal has_begun
        if not has_begun and keeps_code():
            print(FIRST_USE, file=sys.stderr, flush=True)
            beside.ensure_started()
        has_begun = True
        progress(STAGE, min(ready, total - 1), total)

    with CompilationCount(report):
        yield
    if has_begun:
        progress(STAGE, len(KERNELS), len(KERNELS))

"""Compile the solver's kernels ahead in other processes, and show compilation as a stage of the progress."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import TracebackType

import typer

from solver.compile_ahead import KERNELS, CompilationCount, is_first_use, shares
from station.child import Child
from station.progress import COMPILING, Progress

FIRST_USE = "The solver is compiled, once on this machine; this takes 10 to 15 s on an idle machine."


def compile_in_background(context: typer.Context) -> CompilationAhead:
    """Compilation beside a verb, which on the first use on this machine starts before the other imports of the verb.

    They take as long as its own. It ends with the verb. compilation_shown starts it if something is compiled later.
    """
    beside = context.with_resource(CompilationAhead(*shares(os.cpu_count() or 1)))
    if is_first_use():
        beside.ensure_started()
    return beside


def _start(share: str) -> Child:
    priority = getattr(subprocess, "BELOW_NORMAL_PRIORITY_CLASS", 0)  # Windows; elsewhere it is nice
    return Child("station.assessment.compiling_process", share, stderr=subprocess.DEVNULL, creationflags=priority)


class CompilationAhead:
    """A context manager: other processes compile during it, from ensure_started on.

    This module imports little, so that they start before the other imports of a verb. A failure only costs time: a
    kernel that is not compiled is compiled at its first use.
    """

    def __init__(self, *shares: str, start: Callable[[str], Child] = _start) -> None:
        self._shares, self._start = shares or ("",), start
        self._is_started = False
        self._children: list[Child] = []
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
            for share in self._shares:
                self._children.append(self._start(share))

    def show(self, progress: Progress) -> None:
        """Report every kernel from now on, in threads, until the children end."""
        for child in self._children:
            self._readers.append(threading.Thread(target=self._report, args=(child, progress), daemon=True))
            self._readers[-1].start()

    def wait(self) -> bool:
        """Wait until the children that are shown have ended. Returns whether every kernel is compiled."""
        for reader in self._readers:
            reader.join()
        return self._is_complete and all(child.process.wait() == 0 for child in self._children)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for child in self._children:
            child.process.kill()  # kernels on the disk are complete
        for reader in self._readers:
            reader.join()
        for child in self._children:
            child.ensure_ended()
        self._children.clear()

    def _report(self, child: Child, progress: Progress) -> None:
        """Show progress unless all kernels are on the disk already."""
        is_shown = False
        for count in child:
            ready, total = count["ready"], count["kernels"]
            self._is_complete = ready == total
            is_shown = is_shown or not self._is_complete
            if is_shown:
                progress(COMPILING, ready, total)


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
        progress(COMPILING, min(ready, total - 1), total)

    with CompilationCount(report):
        yield
    if has_begun:
        progress(COMPILING, len(KERNELS), len(KERNELS))

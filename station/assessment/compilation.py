"""Compile the solver's kernels ahead in a second process, and show compilation as a stage of the progress."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from types import TracebackType

import typer

from solver.compile_ahead import KERNELS, LAST_FIRST, CompilationCount, is_first_use
from station.progress import Progress

STAGE = "compiling the solver"
FIRST_USE = "The solver is compiled, once on this machine; this takes about 15 s on two idle processors."
COMMAND = (sys.executable, "-m", "solver.compile_ahead", "--with-parent")


def compilation_beside(context: typer.Context) -> CompilationAhead:
    """Compilation beside a verb, which on the first use on this machine starts before the other imports of the verb.

    They take as long as its own. It ends with the verb. compilation_shown starts it if something is compiled later.
    """
    beside = context.with_resource(CompilationAhead((*COMMAND, LAST_FIRST)))
    if is_first_use():
        beside.ensure_started()
    return beside


class CompilationAhead:
    """A context manager: a second process compiles during it, from ensure_started on.

    This module imports little, so that the process starts before the other imports of a verb. A failure only costs
    time: a kernel that is not compiled is compiled at its first use.
    """

    def __init__(self, command: Sequence[str] = COMMAND) -> None:
        self._command = command
        self._is_started = False
        self._child: subprocess.Popen[str] | None = None
        self._reader: threading.Thread | None = None
        self._is_complete = False

    def __enter__(self) -> CompilationAhead:
        return self

    def ensure_started(self) -> None:
        """Start the second process unless it has been started, even if it has ended since."""
        if self._is_started:
            return
        self._is_started = True
        try:
            self._child = subprocess.Popen(  # noqa: S603 (our own module)
                self._command,
                stdin=subprocess.PIPE,  # the child ends when it closes, so it never outlives this process
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                text=True,
                encoding="utf-8",
                creationflags=getattr(subprocess, "BELOW_NORMAL_PRIORITY_CLASS", 0),  # Windows; elsewhere it is nice
            )
        except OSError:
            self._child = None

    def show(self, progress: Progress) -> None:
        """Report every kernel from now on, in a thread, until the child ends."""
        if self._child is not None and self._child.stdout is not None:
            self._reader = threading.Thread(target=self._report, args=(self._child.stdout, progress), daemon=True)
            self._reader.start()

    def wait(self) -> bool:
        """Wait until the child that is shown has ended. Returns whether every kernel is compiled."""
        if self._child is None or self._reader is None:
            return False
        self._reader.join()
        return self._child.wait() == 0 and self._is_complete

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        child, self._child = self._child, None
        if child is None:
            return
        child.kill()  # kernels on the disk are complete
        child.wait()
        if self._reader is not None:
            self._reader.join()
        for pipe in (child.stdin, child.stdout):
            if pipe is not None:
                pipe.close()

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


@contextmanager
def compilation_shown(progress: Progress, beside: CompilationAhead) -> Iterator[None]:
    """Show compilation in this process as a separate stage, instead of a warning per kernel.

    When it begins, a message says how long it takes, because a log shows no stage before it ends, and the second
    process is started unless it was. This process loads the kernels that are ready by then.
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

"""The solver's compilation, once on a machine: ahead in a second process, and as a stage of the progress."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import TracebackType

from station.progress import Progress

STAGE = "compiling the solver"
COMMAND = (sys.executable, "-m", "solver.compile_ahead", "--with-parent")


class CompilationAhead:
    """A context manager: a second process compiles from its start on, and ends with it at the latest.

    Its failure costs time only: what is not compiled is compiled where it is needed.
    """

    def __init__(self, progress: Progress, command: Sequence[str] = COMMAND) -> None:
        self._progress, self._command = progress, command
        self._child: subprocess.Popen[str] | None = None
        self._reader = threading.Thread(target=self._show, daemon=True)
        self._is_complete = False

    def __enter__(self) -> CompilationAhead:
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
            self._reader.start()
        except OSError:
            self._child = None
        return self

    def wait(self) -> bool:
        """Wait until the child has ended. Returns whether every kernel is compiled."""
        if self._child is None:
            return False
        self._reader.join()
        return self._child.wait() == 0 and self._is_complete

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        child, self._child = self._child, None
        if child is None:
            return
        child.kill()  # what it has written to the disk is whole
        child.wait()
        self._reader.join()
        for pipe in (child.stdin, child.stdout):
            if pipe is not None:
                pipe.close()

    def _show(self) -> None:
        """In a thread of its own, until the child ends. Where all is on disk already there is nothing to show."""
        stdout = self._child.stdout if self._child else None
        is_shown = False
        for line in stdout or ():
            try:
                counted = json.loads(line)
                ready, total = int(counted["ready"]), int(counted["kernels"])
            except (ValueError, TypeError, KeyError):
                continue
            self._is_complete = ready == total
            is_shown = is_shown or not self._is_complete
            if is_shown:
                self._progress(STAGE, ready, total)


@contextmanager
def compilation_shown(progress: Progress) -> Iterator[None]:
    """While kernels may be compiled in this process: that is a stage of its own, in place of a warning for each."""
    from solver.compile_ahead import KERNELS, CompilationCount  # the compiler behind it takes long to import

    has_begun = False

    def report(ready: int, total: int) -> None:
        nonlocal has_begun
        has_begun = True
        progress(STAGE, min(ready, total - 1), total)

    with CompilationCount(report):
        yield
    if has_begun:
        progress(STAGE, len(KERNELS), len(KERNELS))

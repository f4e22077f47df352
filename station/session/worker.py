"""The process in which a session fits and assesses."""

from __future__ import annotations

import asyncio
import os
import signal
import threading
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection, wait
from typing import Any

from station.progress import Progress, silent


class Worker:
    """Runs functions of modules, one after the other, in another process; a killed process is replaced."""

    def __init__(self) -> None:
        self._lifeline, self._end_of_worker = _CONTEXT.Pipe()
        self._reports, self._end_for_reports = _CONTEXT.Pipe(duplex=False)
        self._on_progress: Progress = silent
        self._pool = self._one_process()

    async def run(self, work: Callable[..., Any], *arguments: Any) -> Any:
        """Raises the error of the function, and BrokenProcessPool if a second process is killed by it as well."""
        try:
            return await self._submit(work, *arguments)
        except BrokenProcessPool:  # a system short of memory kills the largest process
            self._pool = self._one_process()
            return await self._submit(work, *arguments)

    async def run_with_progress(self, on_progress: Progress, work: Callable[..., Any], *arguments: Any) -> Any:
        """The same for a function whose last argument is a Progress; on_progress is called in another thread."""
        if self._on_progress is silent:
            threading.Thread(target=self._receive_reports, name="progress of the worker", daemon=True).start()
        self._on_progress = on_progress
        return await self.run(_report_progress, work, *arguments)

    def _receive_reports(self) -> None:
        with suppress(EOFError, OSError):
            while True:
                report = self._reports.recv()
                self._on_progress(*report)

    def _submit(self, work: Callable[..., Any], *arguments: Any) -> asyncio.Future[Any]:
        """The process starts at its first task, and must ignore Ctrl-C while it imports, which takes seconds."""
        handler = signal.signal(signal.SIGINT, signal.SIG_IGN)
        try:
            return asyncio.get_running_loop().run_in_executor(self._pool, work, *arguments)
        finally:
            signal.signal(signal.SIGINT, handler)

    def close(self) -> None:
        """End the process, also in the middle of a function: this program would wait for it before it exits."""
        self._pool.shutdown(wait=False, cancel_futures=True)
        self._lifeline.close()

    def _one_process(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(1, _CONTEXT, _initialise, (self._end_of_worker, self._end_for_reports))


_CONTEXT = get_context("spawn")
_REPORTS: list[Connection] = []
"""In the worker: the pipe of its progress."""


def _report_progress(work: Callable[..., Any], *arguments: Any) -> Any:
    """In the worker: run the function with a Progress that reports to the console."""
    return work(*arguments, lambda stage, done, total: _REPORTS[0].send((stage, done, total)))


def _initialise(lifeline: Connection, reports: Connection) -> None:
    """Lower the priority below that of recorder and console, and end with the parent or its end of the lifeline.

    Without the watching thread, the process of a pool would outlive a parent that was killed. Ctrl-C in a terminal
    reaches the whole group; it ends the console, not the worker.
    """
    _REPORTS.append(reports)
    if hasattr(os, "nice"):  # not on Windows
        os.nice(10)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()
    if parent is not None:
        threading.Thread(target=_end_after, args=(parent.sentinel, lifeline), name="parent", daemon=True).start()


def _end_after(parent: int, lifeline: Connection) -> None:
    wait([parent, lifeline])
    os._exit(0)

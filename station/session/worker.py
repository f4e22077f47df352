"""The process in which a session fits and assesses."""

from __future__ import annotations

import asyncio
import os
import signal
import threading
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context, parent_process
from multiprocessing.process import BaseProcess
from typing import Any


class Worker:
    """Runs functions of modules, one after the other, in a process beside; one that is killed is replaced."""

    def __init__(self) -> None:
        self._pool = _one_process()

    async def run(self, work: Callable[..., Any], *arguments: Any) -> Any:
        """Raises what the function raises, and BrokenProcessPool where a second process dies of it, too."""
        try:
            return await self._started(work, *arguments)
        except BrokenProcessPool:  # a system short of memory kills the largest
            self._pool = _one_process()
            return await self._started(work, *arguments)

    def _started(self, work: Callable[..., Any], *arguments: Any) -> asyncio.Future[Any]:
        """The process starts at its first work, deaf to Ctrl-C from its first line on: it takes seconds to import."""
        heard = signal.signal(signal.SIGINT, signal.SIG_IGN)
        try:
            return asyncio.get_running_loop().run_in_executor(self._pool, work, *arguments)
        finally:
            signal.signal(signal.SIGINT, heard)

    def close(self) -> None:
        self._pool.shutdown(wait=False, cancel_futures=True)


def _one_process() -> ProcessPoolExecutor:
    return ProcessPoolExecutor(1, get_context("spawn"), _serve)


def _serve() -> None:
    """Gives way to whatever records or shows, and ends with its parent.

    A pool's process outlives a parent that was killed, waiting for work for ever; this one does not. Ctrl-C in a
    terminal reaches the whole group; it is for the console to end.
    """
    if hasattr(os, "nice"):  # not on Windows
        os.nice(10)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()
    if parent is not None:
        threading.Thread(target=_end_after, args=(parent,), name="parent", daemon=True).start()


def _end_after(parent: BaseProcess) -> None:
    parent.join()
    os._exit(0)

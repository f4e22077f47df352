"""The process in which a session fits and assesses."""

from __future__ import annotations

import asyncio
import os
import pickle
import threading
import traceback
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from queue import SimpleQueue
from typing import Any, NoReturn

from station.child import Child, ProcessLink, exit_at_once
from station.errors import StationError
from station.progress import Progress, silent

NICENESS = 10
"""Recorder and console have priority."""


class WorkerKilled(StationError):
    """Two processes were killed by the same function, or the worker was closed."""

    def __init__(self) -> None:
        super().__init__("the process that fits was killed; check the free memory of this computer")


class Worker:
    """Runs functions of modules, one after the other, in another process; a killed process is replaced.

    The process starts at the first function. Closing kills it in any state, and the thread that waits for it is a
    daemon, so that the end of this program waits for neither. An executor of processes would be joined at that end.
    """

    def __init__(self) -> None:
        self._tasks: SimpleQueue[tuple[Future[Any], bytes, Progress] | None] = SimpleQueue()
        self._thread: threading.Thread | None = None
        self._child: Child | None = None
        self._is_closed = False
        self._changing = threading.Lock()

    async def run(self, work: Callable[..., Any], *arguments: Any) -> Any:
        """Raises the error of the function, and WorkerKilled if a second process is killed by it as well."""
        return await self._submit((work, arguments, False), silent)

    async def run_with_progress(self, on_progress: Progress, work: Callable[..., Any], *arguments: Any) -> Any:
        """The same for a function whose last argument is a Progress; on_progress is called in another thread."""
        return await self._submit((work, arguments, True), on_progress)

    async def _submit(self, task: tuple[Callable[..., Any], tuple[Any, ...], bool], on_progress: Progress) -> Any:
        if self._is_closed:
            raise WorkerKilled
        if self._thread is None:
            self._thread = threading.Thread(target=self._execute_tasks, name="worker", daemon=True)
            self._thread.start()
        future: Future[Any] = Future()
        self._tasks.put((future, pickle.dumps(task), on_progress))
        return await asyncio.wrap_future(future)

    def close(self) -> None:
        """Kill the process, also in the middle of a function, and also if it is suspended."""
        with self._changing:
            self._is_closed = True
            if self._child is not None:
                self._child.process.kill()
        self._tasks.put(None)

    def _execute_tasks(self) -> None:
        for future, task, on_progress in iter(self._tasks.get, None):
            if not future.set_running_or_notify_cancel():
                continue
            try:
                result = self._execute(task, on_progress)
            except Exception as error:
                future.set_exception(error)
            else:
                future.set_result(result)
        self._discard_child()

    def _execute(self, task: bytes, on_progress: Progress) -> Any:
        for _ in range(2):  # a system short of memory kills the largest process
            child = self._ensure_started()
            with suppress(OSError):  # it was killed, and sends nothing
                child.send_bytes(task)
            while (answer := child.receive_bytes()) is not None:
                kind, value = pickle.loads(answer)  # noqa: S301  (the pipe has no other end than our child)
                if kind == "result":
                    return value
                if kind == "error":
                    raise value
                self._report(value, on_progress)
            self._discard_child()
        raise WorkerKilled

    def _report(self, progress: tuple[str, int, int], on_progress: Progress) -> None:
        try:
            on_progress(*progress)
        except Exception:
            self._discard_child()  # its next answers are of this function
            raise

    def _ensure_started(self) -> Child:
        with self._changing:
            if self._is_closed:
                raise WorkerKilled
            if self._child is None:
                self._child = Child("station.session.worker")
            return self._child

    def _discard_child(self) -> None:
        with self._changing:
            child, self._child = self._child, None
        if child is not None:
            child.ensure_ended()


def main(parent: ProcessLink) -> NoReturn:
    """Run the functions that the parent sends; end at once with the parent, also in the middle of a function."""
    if hasattr(os, "nice"):  # not on Windows
        os.nice(NICENESS)
    tasks: SimpleQueue[bytes] = SimpleQueue()
    threading.Thread(target=_receive, args=(parent, tasks), name="parent", daemon=True).start()
    while True:
        answer = _answer(parent, tasks.get())
        with suppress(OSError):  # the parent has ended
            parent.send_bytes(answer)


def _receive(parent: ProcessLink, tasks: SimpleQueue[bytes]) -> None:
    for task in iter(parent.receive_bytes, None):
        tasks.put(task)
    exit_at_once(0)


def _answer(parent: ProcessLink, task: bytes) -> bytes:
    def report(*progress: object) -> None:
        parent.send_bytes(pickle.dumps(("progress", progress)))

    try:
        work, arguments, has_progress = pickle.loads(task)  # noqa: S301  (the pipe has no other end than our parent)
        return pickle.dumps(("result", work(*arguments, *([report] if has_progress else []))))
    except Exception as error:
        error.add_note(traceback.format_exc())
        with suppress(Exception):  # an error that cannot be pickled
            return pickle.dumps(("error", error))
        return pickle.dumps(("error", RuntimeError(f"{type(error).__name__}: {error}")))

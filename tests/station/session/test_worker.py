import asyncio
import ctypes
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Awaitable, Callable
from pathlib import Path
from unittest.mock import Mock

import psutil
import pytest

from station.progress import Progress
from station.session.worker import Worker, WorkerKilled
from tests.timeout import scaled_timeout

ROOT = Path(__file__).parents[3]


def run(work: Callable[[Worker], Awaitable[None]]) -> None:
    """With a worker that is closed afterwards."""

    async def whole() -> None:
        worker = Worker()
        await work(worker)
        worker.close()

    asyncio.run(whole())


async def until_exists(path: Path) -> None:
    async with asyncio.timeout(scaled_timeout(60.0)):
        while not path.exists():
            await asyncio.sleep(0.01)


def test_a_worker_that_is_killed_is_replaced() -> None:
    async def kill(worker: Worker) -> None:
        first = await worker.run(os.getpid)
        psutil.Process(first).kill()
        second = await worker.run(os.getpid)
        assert len({first, second, os.getpid()}) == 3
        with pytest.raises(WorkerKilled):
            await worker.run(os._exit, 1)

    run(kill)


def _work_in_steps(steps: int, progress: Progress) -> str:
    for done in range(steps + 1):
        progress("counting", done, steps)
    return "counted"


def test_the_progress_of_a_function_reaches_the_console() -> None:
    reported: list[tuple[str, int, int]] = []

    async def count(worker: Worker) -> None:
        assert await worker.run_with_progress(lambda *stage: reported.append(stage), _work_in_steps, 3) == "counted"
        async with asyncio.timeout(scaled_timeout(60.0)):
            while len(reported) < 4:
                await asyncio.sleep(0.01)

    run(count)
    assert reported == [("counting", done, 3) for done in range(4)]


def test_a_closed_worker_ends_in_the_middle_of_a_function(tmp_path: Path) -> None:
    """A summary takes minutes, and its process must not outlive the program."""
    pid = tmp_path / "pid"

    async def begin(worker: Worker) -> None:
        work = asyncio.ensure_future(worker.run(_work_for_ever, pid))
        await until_exists(pid)
        work.cancel()

    run(begin)
    assert_ended(pid)


def _work_for_ever(pid: Path) -> None:
    _note(pid)
    threading.Event().wait()


def _note(pid: Path) -> None:
    pid.with_suffix(".new").write_text(str(os.getpid()))
    pid.with_suffix(".new").rename(pid)


def assert_ended(pid: Path) -> None:
    psutil.wait_procs([psutil.Process(int(pid.read_text()))] if _runs(pid) else [], scaled_timeout(60.0))
    assert not _runs(pid)


def _runs(pid: Path) -> bool:
    return psutil.pid_exists(int(pid.read_text()))


def _ignores_ctrl_c() -> bool:
    """Whether it did so from its first line on: what a process is started with is in no signal() call of its own."""
    return signal.getsignal(signal.SIGINT) is signal.SIG_IGN


def test_ctrl_c_reaches_the_console_and_not_the_worker() -> None:
    async def ask(worker: Worker) -> None:
        assert await worker.run(_ignores_ctrl_c)

    heard = signal.getsignal(signal.SIGINT)
    run(ask)
    assert signal.getsignal(signal.SIGINT) is heard


def _block_the_interpreter(pid: Path) -> None:
    """For ever, in a library's code that keeps Python's lock: no thread of this process notices anything."""
    _note(pid)
    if sys.platform == "win32":
        ctypes.PyDLL("kernel32").Sleep(-1)
    else:
        ctypes.PyDLL(None).pause()


def close_while_blocked(pid: Path) -> None:
    """A program that closes its worker as soon as that is blocked, and ends."""

    async def begin(worker: Worker) -> None:
        work = asyncio.ensure_future(worker.run(_block_the_interpreter, pid))
        await until_exists(pid)
        work.cancel()

    run(begin)


def test_a_program_ends_although_a_library_blocks_its_worker(tmp_path: Path) -> None:
    pid = tmp_path / "pid"
    program = f"import sys, pathlib, {__name__} as it; it.close_while_blocked(pathlib.Path(sys.argv[1]))"
    command = [sys.executable, "-c", program, pid]
    ran = subprocess.run(command, cwd=ROOT, timeout=scaled_timeout(60.0), check=False)  # noqa: S603
    assert ran.returncode == 0
    assert_ended(pid)


class Unpicklable(Exception):
    def __init__(self) -> None:
        super().__init__("the lock")
        self.lock = threading.Lock()


def _fail(error: type[Exception]) -> None:
    raise error


def _report_badly(progress: Progress) -> None:
    progress("counting", 0, 1)


def test_an_error_of_a_function_is_raised_and_the_worker_continues() -> None:
    async def fail(worker: Worker) -> None:
        first = await worker.run(os.getpid)
        for error, raised in ((ZeroDivisionError, ZeroDivisionError), (Unpicklable, RuntimeError)):
            with pytest.raises(raised):
                await worker.run(_fail, error)
        with pytest.raises(LookupError):
            await worker.run_with_progress(Mock(side_effect=LookupError), _report_badly)
        last = await worker.run(os.getpid)
        assert first != last, "what a function sends after an error of its observer is discarded with its process"
        worker.close()
        with pytest.raises(WorkerKilled):
            await worker.run(os.getpid)

    run(fail)

from __future__ import annotations

import asyncio
import os
import signal
import subprocess
import sys
from concurrent.futures.process import BrokenProcessPool

import pytest

from station.session.worker import Worker

OF_THE_FIT = {"scipy.signal", "scipy.stats", "numba"}


@pytest.mark.parametrize("process", ["station.terminal.sequencer", "station.console.server"])
def test_only_the_worker_imports_the_fit(process: str) -> None:
    """It takes seconds, for which an operator would wait when a session or the console starts."""
    code = f"import sys, {process}; print(*{OF_THE_FIT} & sys.modules.keys())"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)  # noqa: S603
    assert ran.stdout.split() == []


def test_a_worker_that_is_killed_is_replaced() -> None:
    async def whole() -> tuple[int, int]:
        worker = Worker()
        first = await worker.run(os.getpid)
        os.kill(first, signal.SIGKILL)
        second = await worker.run(os.getpid)
        with pytest.raises(BrokenProcessPool):
            await worker.run(os._exit, 1)
        worker.close()
        return first, second

    first, second = asyncio.run(whole())
    assert len({first, second, os.getpid()}) == 3


def _ignores_ctrl_c() -> bool:
    """Whether it did so from its first line on: what a process is started with is in no signal() call of its own."""
    return signal.getsignal(signal.SIGINT) is signal.SIG_IGN


def test_ctrl_c_reaches_the_console_and_not_the_worker() -> None:
    async def whole() -> bool:
        worker = Worker()
        is_deaf = await worker.run(_ignores_ctrl_c)
        worker.close()
        return bool(is_deaf)

    heard = signal.getsignal(signal.SIGINT)
    assert asyncio.run(whole())
    assert signal.getsignal(signal.SIGINT) is heard

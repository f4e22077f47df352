from __future__ import annotations

import asyncio
import os
import signal
from concurrent.futures.process import BrokenProcessPool

import pytest

from station.console.worker import Worker


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

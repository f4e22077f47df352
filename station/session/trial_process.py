"""The other end of a recorder process: what it tells, and the wishes it is sent."""

from __future__ import annotations

import asyncio
import json
import sys
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from station.config import StationConfig
from station.journal import Recorded
from station.protocol import TrialSpec

DETACHED: dict[str, Any] = (
    {"creationflags": 0x0800_0000 | 0x0000_0200}  # CREATE_NO_WINDOW and CREATE_NEW_PROCESS_GROUP
    if sys.platform == "win32"
    else {"start_new_session": True}
)
"""A terminal that is closed, and its Ctrl-C or Ctrl-Break, reach the session and not the trial that it records."""
LONGEST_LINE = 4 * 2**20
"""Bytes; a line that came after a page stood still for minutes is long."""


class TrialProcess:
    """One trial on its way. What it tells goes to on_telemetry as plain data, in the event loop's thread."""

    def __init__(self, child: asyncio.subprocess.Process) -> None:
        self._child = child
        self.recorded: Recorded | None = None
        self.refusal: str | None = None

    @classmethod
    async def start(
        cls, config: StationConfig, folder: Path, spec: TrialSpec, clock_port: int | None, speed: float | None
    ) -> TrialProcess:
        """Starts the recorder; it opens the devices, arms and waits for the edge by itself.

        clock_port is that of a simulated bench's clock, None for a real bench; speed is the pace of its world.
        """
        child = await asyncio.create_subprocess_exec(
            sys.executable,
            "-m",
            "station.session.trial_daemon",
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            limit=LONGEST_LINE,
            **DETACHED,
        )
        trial = cls(child)
        request = {"config": config.model_dump(mode="json"), "folder": str(folder), "spec": asdict(spec)}
        await trial._wish({**request, "clock_port": clock_port, "speed": speed})
        return trial

    async def follow(self, on_telemetry: Callable[[dict[str, Any]], None]) -> None:
        """Returns when the recorder has ended: `recorded` holds its account, or `refusal` a sentence."""
        assert self._child.stdout is not None  # noqa: S101  (it was asked for above)
        async for line in self._child.stdout:
            if not line.endswith(b"\n"):  # the recorder was killed in mid word
                break
            said = json.loads(line)
            if "result" in said:
                self.recorded = Recorded(**said["result"])
            elif "refused" in said:
                self.refusal = said["refused"]
            else:
                on_telemetry(said)
        code = await self._child.wait()
        if self.recorded is None and self.refusal is None:
            self.refusal = f"the recorder ended with code {code} in mid trial; what it had written is kept"

    async def stop(self) -> None:
        """Once: the trial ends cleanly. Twice: at once."""
        await self._wish({"stop": True})

    async def mark(self) -> None:
        await self._wish({"mark": True})

    async def _wish(self, wish: dict[str, Any]) -> None:
        if self._child.stdin is None or self._child.returncode is not None:
            return
        try:
            self._child.stdin.write(json.dumps(wish).encode() + b"\n")
            await self._child.stdin.drain()
        except (BrokenPipeError, ConnectionResetError):  # it ended meanwhile, and follow() tells how
            return

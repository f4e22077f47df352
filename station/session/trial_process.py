"""Client of a recorder process: its telemetry and result, and the commands sent to it."""

from __future__ import annotations

import asyncio
import json
import sys
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from station.config import StationConfig
from station.journal import Recorded
from station.messages.codes import RefusalCode
from station.messages.message import Message
from station.protocol import TrialSpec

DETACHED: dict[str, Any] = (
    {"creationflags": 0x0800_0000 | 0x0000_0200}  # CREATE_NO_WINDOW and CREATE_NEW_PROCESS_GROUP
    if sys.platform == "win32"
    else {"start_new_session": True}
)
"""Closing the terminal, Ctrl-C or Ctrl-Break in it end the session, and not the trial that is being recorded."""
LONGEST_LINE = 4 * 2**20
"""Bytes; a line is long if the console did not read for minutes."""
_RECORDED = TypeAdapter(Recorded)


class TrialProcess:
    """One running trial. Its telemetry goes to on_telemetry as plain data, in the thread of the event loop."""

    def __init__(self, child: asyncio.subprocess.Process) -> None:
        self._child = child
        self.recorded: Recorded | None = None
        self.refusal: str | None = None
        self.refusal_code = ""

    @classmethod
    async def start(
        cls, config: StationConfig, folder: Path, spec: TrialSpec, clock_port: int | None, speed: float | None
    ) -> TrialProcess:
        """Start the recorder; it opens the devices, arms and waits for the edge.

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
        await trial._send({**request, "clock_port": clock_port, "speed": speed})
        return trial

    async def follow(self, on_telemetry: Callable[[dict[str, Any]], None]) -> None:
        """Return when the recorder has ended: `recorded` holds the result, or `refusal` and its code the reason."""
        assert self._child.stdout is not None  # noqa: S101  (it was requested in start())
        async for line in self._child.stdout:
            if not line.endswith(b"\n"):  # the recorder was killed while writing
                break
            message = json.loads(line)
            if "result" in message:
                self.recorded = _RECORDED.validate_python(message["result"])
            elif "refused" in message:
                self.refusal, self.refusal_code = message["refused"], message["code"]
            else:
                on_telemetry(message)
        code = await self._child.wait()
        if self.recorded is None and self.refusal is None:
            self.refusal = str(Message(RefusalCode.RECORDER_ENDED, {"exit_code": str(code)}))

    async def stop(self) -> None:
        """End the trial: cleanly at the first call, at once at the second."""
        await self._send({"stop": True})

    async def mark(self) -> None:
        await self._send({"mark": True})

    async def _send(self, command: dict[str, Any]) -> None:
        if self._child.stdin is None or self._child.returncode is not None:
            return
        try:
            self._child.stdin.write(json.dumps(command).encode() + b"\n")
            await self._child.stdin.drain()
        except (BrokenPipeError, ConnectionResetError):  # it ended meanwhile, and follow() returns its result
            return

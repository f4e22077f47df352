"""Client of a recorder process: its telemetry and result, and the commands sent to it."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from concurrent.futures import CancelledError
from contextlib import suppress
from dataclasses import asdict
from itertools import chain
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from pydantic import TypeAdapter

from station.child import DETACHED, Child
from station.config import StationConfig
from station.journal import Recorded
from station.messages.codes import RefusalCode
from station.messages.message import Message
from station.protocol import TrialSpec

END_TIMEOUT_S = 10.0
"""Wall seconds for a recorder to end after it has closed its link."""
_RECORDED = TypeAdapter(Recorded)


class TrialProcess:
    """One running trial. Its telemetry goes to on_telemetry as plain data, in the thread of the event loop."""

    def __init__(self, child: Child) -> None:
        self._child = child
        self._commands: SimpleQueue[dict[str, Any] | None] = SimpleQueue()
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
        trial = cls(await asyncio.to_thread(Child, "station.session.trial_daemon", **DETACHED))
        request = {"config": config.model_dump(mode="json"), "folder": str(folder), "spec": asdict(spec)}
        trial._commands.put({**request, "clock_port": clock_port, "speed": speed})
        threading.Thread(target=trial._send_commands, name="commands to the recorder", daemon=True).start()
        return trial

    async def follow(self, on_telemetry: Callable[[dict[str, Any]], None]) -> None:
        """Return when the recorder has ended: `recorded` holds the result, or `refusal` and its code the reason.

        One message waits at most, so that a console that is too slow still answers its pages: the recorder drops its
        oldest telemetry.
        """
        loop = asyncio.get_running_loop()
        messages: asyncio.Queue[dict[str, Any] | None] = asyncio.Queue(1)

        def receive() -> None:
            with suppress(RuntimeError, CancelledError):  # the loop is closed; the recorder continues
                for message in chain(self._child, [None]):
                    asyncio.run_coroutine_threadsafe(messages.put(message), loop).result()

        threading.Thread(target=receive, name="messages of the recorder", daemon=True).start()
        while (message := await messages.get()) is not None:
            if "result" in message:
                self.recorded = _RECORDED.validate_python(message["result"])
            elif "refused" in message:
                self.refusal, self.refusal_code = message["refused"], message["code"]
            else:
                on_telemetry(message)
        self._commands.put(None)
        code = await asyncio.to_thread(self._child.ensure_ended, END_TIMEOUT_S)
        if self.recorded is None and self.refusal is None:
            self.refusal = str(Message(RefusalCode.RECORDER_ENDED, {"exit_code": str(code)}))

    def stop(self) -> None:
        """End the trial: cleanly at the first call, at once at the second."""
        self._commands.put({"stop": True})

    def mark(self) -> None:
        self._commands.put({"mark": True})

    def _send_commands(self) -> None:
        """In a thread, because a recorder that still starts does not receive yet."""
        with suppress(OSError):  # it has ended, and follow() returns its result
            for command in iter(self._commands.get, None):
                self._child.send(command)

"""A session without a page on a simulated bench, and a scripted operator who answers its events."""

from __future__ import annotations

import asyncio
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from station.bench.simulation import SimulatedBench, simulator_settings
from station.config import StationConfig, load_config
from station.journal import Setup
from station.session.controller import SessionController
from station.session.trial_runner import LiveTrial
from station.terminal.commands import Request, parse_command
from station.terminal.events import SessionEvent
from station.terminal.sequencer import SessionSequencer
from tests.station.child_process import end_process
from tests.station.console.served import write_config
from tests.station.session.benched import ThreadedBench, ThreadedWorker
from tests.timeout import scaled_timeout

SETUP = Setup("P01", "ab", ("hand",), 1, has_bounce=False, number="monday")
PATIENCE_S = 200.0

Kind = TypeVar("Kind", bound=SessionEvent)
Answer = Callable[[SessionEvent], str | None]
"""The operator's command after an event, as a line; None: no command; "": the input ends."""


@contextmanager
def remote_bench(
    folder: Path, *, control: str = "start", timeout_s: float = 60.0
) -> Iterator[tuple[SimulatedBench, StationConfig]]:
    """A bench that is as fast as it is handled. Its captures are started by the station, or by any client."""
    folder.mkdir(exist_ok=True)
    config = load_config(write_config(folder, hold_s=4.0, swing_s=5.0))
    with ThreadedBench({**simulator_settings(config), "operator": {"capture": "remote"}}, None, 3) as bench:
        data = bench.configure(config).model_dump(mode="json")
        data["mocap"]["control"] = control
        data["sync"]["timeout_s"] = timeout_s
        yield bench, StationConfig(**data)


class ScriptedOutput:
    """Keeps every event; the answers to it are commands."""

    def __init__(self, requests: asyncio.Queue[Request], answer: Answer) -> None:
        self.events: list[SessionEvent] = []
        self._requests, self._answer = requests, answer

    def show_event(self, event: SessionEvent) -> None:
        self.events.append(event)
        line = self._answer(event)
        if line is not None:
            self._requests.put_nowait(parse_command(line) if line else None)

    def show_trial(self, live: LiveTrial | None) -> None: ...

    def of(self, kind: type[Kind]) -> list[Kind]:
        return [event for event in self.events if isinstance(event, kind)]


def lead(
    bench: SimulatedBench | None, config: StationConfig, folder: Path, answer: Answer, setup: Setup | None = SETUP
) -> ScriptedOutput:
    """A session from where it stands until an answer ends it."""

    async def whole() -> ScriptedOutput:
        requests: asyncio.Queue[Request] = asyncio.Queue()
        output = ScriptedOutput(requests, answer)
        controller = SessionController(config, None, bench)
        controller.reviewer._worker = ThreadedWorker()
        try:
            if setup is None:
                controller.session.resume(folder)
            else:
                controller.session.begin(setup, folder=folder)
            sequencer = SessionSequencer(
                controller, output, requests, is_simulated=True, waits_for_start=config.mocap.control == "start"
            )
            async with asyncio.timeout(scaled_timeout(PATIENCE_S)):
                await sequencer.run()
        finally:
            controller.close()
        return output

    return asyncio.run(whole())


class Headless:
    """`station record --headless` in its own process; a context manager that ends the process.

    program starts Python; variables are added to its environment.
    """

    def __init__(
        self, folder: Path, *options: str, program: str = sys.executable, variables: Mapping[str, str] | None = None
    ) -> None:
        self.events: list[dict[str, Any]] = []
        self.child = subprocess.Popen(  # noqa: S603  (our own words)
            [program, "-c", "from station.cli import main; main()", "record", "--headless", *options],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            cwd=folder,
            env={name: value for name, value in os.environ.items() if not name.startswith("PYTEST")}
            | dict(variables or {}),
        )

    def __enter__(self) -> Headless:
        return self

    def __exit__(self, *_: object) -> None:
        end_process(self.child)

    def send(self, line: str) -> None:
        assert self.child.stdin is not None
        self.child.stdin.write(line.encode() + b"\n")
        self.child.stdin.flush()

    def until(
        self, event: str, *, on_event: Callable[[dict[str, Any]], None] = lambda _: None, **fields: object
    ) -> dict[str, Any]:
        """Read events up to the first one with these fields; on_event takes all that come before it."""
        assert self.child.stdout is not None and self.child.stderr is not None
        for line in self.child.stdout:
            read = json.loads(line)
            self.events.append(read)
            if read["event"] == event and all(read[name] == value for name, value in fields.items()):
                return dict(read)
            on_event(read)
        raise AssertionError(f"ended without {event} {fields}: {self.events[-3:]} {self.child.stderr.read().decode()}")

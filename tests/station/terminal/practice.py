"""A session without a page on a simulated bench, and an operator who answers what it tells."""

from __future__ import annotations

import asyncio
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from station.bench.simulation import SimulatedBench, simulator_settings
from station.config import StationConfig, load_config
from station.journal import Setup
from station.session.desk import Desk
from station.session.live import Live
from station.terminal.commands import parse_command
from station.terminal.conductor import Conductor, Request
from station.terminal.events import Event
from tests.station.console.served import write_config
from tests.timeout import scaled_timeout

SETUP = Setup("P01", "ab", ("hand",), 1, has_bounce=False, number="monday")
PATIENCE_S = 200.0

Kind = TypeVar("Kind", bound=Event)
Answer = Callable[[Event], str | None]
"""What the operator says to an event, as a line; None: nothing."""


@contextmanager
def remote_bench(
    folder: Path, *, control: str = "start", timeout_s: float = 60.0
) -> Iterator[tuple[SimulatedBench, StationConfig]]:
    """A bench that is as fast as it is handled. Its captures are started by the station, or by any client."""
    folder.mkdir(exist_ok=True)
    config = load_config(write_config(folder, swing_s=5.0))
    with SimulatedBench({**simulator_settings(config), "operator": {"capture": "remote"}}, None, 3) as bench:
        data = bench.pointed_at(config).model_dump(mode="json")
        data["mocap"]["control"] = control
        data["sync"]["timeout_s"] = timeout_s
        yield bench, StationConfig(**data)


class ScriptedFace:
    """Keeps every event; the answers to it are commands."""

    def __init__(self, requests: asyncio.Queue[Request], answer: Answer) -> None:
        self.events: list[Event] = []
        self._requests, self._answer = requests, answer

    def tell(self, event: Event) -> None:
        self.events.append(event)
        line = self._answer(event)
        if line is not None:
            self._requests.put_nowait(parse_command(line))

    def show(self, live: Live | None) -> None: ...

    def of(self, kind: type[Kind]) -> list[Kind]:
        return [event for event in self.events if isinstance(event, kind)]


def lead(
    bench: SimulatedBench, config: StationConfig, folder: Path, answer: Answer, setup: Setup | None = SETUP
) -> ScriptedFace:
    """A session from where it stands until an answer ends it."""

    async def whole() -> ScriptedFace:
        requests: asyncio.Queue[Request] = asyncio.Queue()
        face = ScriptedFace(requests, answer)
        desk = Desk(config, None, bench)
        try:
            if setup is None:
                desk.session.resume(folder)
            else:
                desk.session.begin(setup, folder=folder)
            conductor = Conductor(
                desk, face, requests, is_simulated=True, waits_for_start=config.mocap.control == "start"
            )
            async with asyncio.timeout(scaled_timeout(PATIENCE_S)):
                await conductor.run()
        finally:
            desk.close()
        return face

    return asyncio.run(whole())


class Headless:
    """`station record --headless` in a process of its own; a context manager that leaves none behind."""

    def __init__(self, folder: Path, *options: str) -> None:
        self.events: list[dict[str, Any]] = []
        self.child = subprocess.Popen(  # noqa: S603  (our own words)
            [sys.executable, "-c", "from station.cli import main; main()", "record", "--headless", *options],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            cwd=folder,
            env={name: value for name, value in os.environ.items() if not name.startswith("PYTEST")},
        )

    def __enter__(self) -> Headless:
        return self

    def __exit__(self, *_: object) -> None:
        if self.child.poll() is None:
            self.child.kill()
        self.child.wait()
        for pipe in (self.child.stdin, self.child.stdout, self.child.stderr):
            assert pipe is not None
            pipe.close()

    def say(self, line: str) -> None:
        assert self.child.stdin is not None
        self.child.stdin.write(line.encode() + b"\n")
        self.child.stdin.flush()

    def until(self, event: str, **fields: object) -> dict[str, Any]:
        """Reads events up to the one that is asked for."""
        assert self.child.stdout is not None and self.child.stderr is not None
        for line in self.child.stdout:
            told = json.loads(line)
            self.events.append(told)
            if told["event"] == event and all(told[name] == value for name, value in fields.items()):
                return dict(told)
        raise AssertionError(f"ended without {event} {fields}: {self.events[-3:]} {self.child.stderr.read().decode()}")

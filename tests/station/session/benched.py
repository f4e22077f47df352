"""A simulated bench whose captures the station starts itself, and the recorder's process beside it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

from recordings.manifest import TestKind
from station.bench.bench_clock import BenchClock
from station.bench.simulation import SimulatedBench, simulator_settings
from station.config import StationConfig, load_config
from station.protocol import TrialSpec
from tests.station.console.served import write_config

DYNAMIC = TrialSpec("hand", "dynamic", 1)


@contextmanager
def simulated_bench(
    folder: Path, *, speed: float | None = None, test: TestKind = "dynamic", hold_s: float = 7.0, swing_s: float = 5.0
) -> Iterator[tuple[SimulatedBench, StationConfig]]:
    """The bench, as fast as it is handled unless a speed is given, and the configuration that points at it.

    Control of the capture is included.
    """
    folder.mkdir(exist_ok=True)
    config = load_config(write_config(folder, hold_s=hold_s, swing_s=swing_s))
    settings = {**simulator_settings(config), "operator": {"capture": "remote"}}
    with SimulatedBench(settings, speed, 3) as bench:
        bench.tell({"don": "hand"})
        bench.tell({"trial": {"cuff": "hand", "test": test}})
        yield bench, bench.pointed_at(config)


class Recorder:
    """The recorder's process, spoken to as the console does; a context manager that leaves none behind.

    One that does not begin at once is there already when its trial is asked for, by begin(). Where the clock of its
    bench is given, the world goes on only as the test reads what the recorder tells, so that nothing is missed;
    let_go() leaves the world to the recorder.
    """

    def __init__(
        self,
        config: StationConfig,
        folder: Path,
        clock_port: int | None = None,
        *,
        spec: TrialSpec = DYNAMIC,
        begins_at_once: bool = True,
    ) -> None:
        self._begins_at_once = begins_at_once
        self._hold = ExitStack()
        self._clock = None if clock_port is None else self._hold.enter_context(BenchClock(clock_port))
        self._request = {
            "config": config.model_dump(mode="json"),
            "folder": str(folder),
            "spec": asdict(spec),
            "clock_port": clock_port,
            "speed": None,
        }
        self._home = str(folder.parent)  # what a recorder that is killed leaves there is the next one's

    def __enter__(self) -> Recorder:
        self.child = subprocess.Popen(
            [sys.executable, "-m", "station.session.trial_daemon"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env={name: value for name, value in os.environ.items() if not name.startswith("PYTEST")}
            | {"HOME": self._home, "USERPROFILE": self._home},
        )
        if self._begins_at_once:
            self.begin()
        return self

    def begin(self) -> None:
        self.wish(self._request)

    def let_go(self) -> None:
        self._hold.close()
        self._clock = None

    def __exit__(self, *_: object) -> None:
        self.let_go()
        if self.child.poll() is None:
            self.child.kill()
        self.child.wait()
        for pipe in (self.child.stdin, self.child.stdout, self.child.stderr):
            assert pipe is not None
            pipe.close()

    def wish(self, wish: dict[str, Any]) -> None:
        assert self.child.stdin is not None
        self.child.stdin.write(json.dumps(wish).encode() + b"\n")
        self.child.stdin.flush()

    def until(self, is_met: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """Reads what it tells, up to the line that is asked for."""
        assert self.child.stdout is not None
        line = b""
        for line in self.child.stdout:
            said: dict[str, Any] = json.loads(line)
            if is_met(said):
                return said
            if self._clock is not None and said.get("state") != "idle":
                self._clock.step()
        raise AssertionError(f"the recorder ended without that: {line.decode()} {self.errors()}")

    def end(self) -> dict[str, Any]:
        """Its last word."""
        return self.until(lambda said: "result" in said or "refused" in said)

    def errors(self) -> str:
        assert self.child.stderr is not None
        return self.child.stderr.read().decode()


def has_recorded(seconds: float) -> Callable[[dict[str, Any]], bool]:
    return lambda said: said.get("state") == "recording" and said["recorded_s"] >= seconds

"""A simulated bench whose captures the station starts, and the recorder process."""

from __future__ import annotations

import json
import os
import pickle
import subprocess
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

from documents.message import Message
from drivers.simulators.requests import answer_or_refusal
from drivers.simulators.simulated_bench import bench_from_options, describe_bench
from recordings.manifest import TestKind
from station.bench.bench_clock import BenchClock
from station.bench.simulation import SimulatedBench, SimulationError, simulator_settings
from station.child import Child
from station.config import StationConfig, load_config, parse_config
from station.messages.setup_messages import SimulationCode
from station.progress import Progress
from station.protocol import TrialSpec
from station.session.worker import Worker
from tests.station.console.served import write_config

DYNAMIC = TrialSpec("hand", "dynamic", 1)


WAIST = {"anchor_markers": [f"anchor_{number}" for number in (1, 2, 3, 4)], "cuff_markers": ["cuff_1"]}


def config_at(ports: Mapping[str, int], **more: dict[str, Any]) -> StationConfig:
    """A waist cuff and the devices of a simulated bench at these ports; keys that the sections have, too."""
    sections = {"daq": {"grpc_target": f"127.0.0.1:{ports['ni']}"}, "mocap": {"port": ports["qtm"]}}
    sections["cuffs"] = {"waist": WAIST}
    return parse_config(sections | {name: sections.get(name, {}) | keys for name, keys in more.items()}, "test")


def as_sent(message: dict[str, Any]) -> dict[str, Any]:
    """The message as another process receives it."""
    received: dict[str, Any] = json.loads(json.dumps(message))
    return received


class ThreadedBench(SimulatedBench):
    """The simulated bench in threads of this process: the start of one of its own takes a second of processor."""

    def __enter__(self) -> ThreadedBench:
        with ExitStack() as running:
            self._bench = running.enter_context(bench_from_options(self._settings))
            self.ready = as_sent(describe_bench(self._bench))
            self._running = running.pop_all()
        return self

    def request(self, request: dict[str, Any]) -> dict[str, Any]:
        answer = as_sent(answer_or_refusal(self._bench, as_sent(request)))
        if "error" in answer:
            raise SimulationError(Message(SimulationCode.REFUSED, {"reason": str(answer["error"])}))
        return answer

    def close(self) -> None:
        self._running.close()


class ThreadedWorker(Worker):
    """The worker in a thread of this process, which has imported the fit already."""

    def _execute(self, task: bytes, on_progress: Progress) -> Any:
        work, arguments, has_progress = pickle.loads(task)  # noqa: S301  (our own)
        return pickle.loads(pickle.dumps(work(*arguments, *([on_progress] if has_progress else []))))  # noqa: S301


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
    with ThreadedBench(settings, speed, 3) as bench:
        bench.request({"don": "hand"})
        bench.request({"trial": {"cuff": "hand", "test": test}})
        yield bench, bench.configure(config)


class Recorder:
    """The recorder process, controlled as by the console; a context manager that ends the process.

    With begins_at_once=False the process waits for begin(). With a clock port, the world advances only as the test
    reads the telemetry, so that nothing is missed; let_go() leaves the world to the recorder.
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
        self.child = Child(
            "station.session.trial_daemon",
            stderr=subprocess.PIPE,
            env={name: value for name, value in os.environ.items() if not name.startswith("PYTEST")}
            | {"HOME": self._home, "USERPROFILE": self._home},
        )
        if self._begins_at_once:
            self.begin()
        return self

    def begin(self) -> None:
        self.send(self._request)

    def let_go(self) -> None:
        self._hold.close()
        self._clock = None

    def __exit__(self, *_: object) -> None:
        self.let_go()
        self.child.ensure_ended()
        if self.child.process.stderr is not None:
            self.child.process.stderr.close()

    def send(self, command: dict[str, Any]) -> None:
        self.child.send(command)

    def until(self, is_met: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """Receive messages up to the first one that meets the condition."""
        message: dict[str, Any] = {}
        for message in self.child:
            if is_met(message):
                return message
            if self._clock is not None and message.get("state") != "idle":
                self._clock.step()
        raise AssertionError(f"the recorder ended without that: {message} {self.errors()}")

    def end(self) -> dict[str, Any]:
        """The result or the refusal."""
        return self.until(lambda message: "result" in message or "refused" in message)

    def errors(self) -> str:
        assert self.child.process.stderr is not None
        return self.child.process.stderr.read().decode()


def has_recorded(seconds: float) -> Callable[[dict[str, Any]], bool]:
    return lambda message: message.get("state") == "recording" and message["recorded_s"] >= seconds

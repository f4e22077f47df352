"""The simulated bench as a child process: started, told which trial comes next, and gone when we are."""

from __future__ import annotations

import json
import subprocess
import sys
from types import TracebackType
from typing import Any

from station.config import StationConfig, parse_config


class SimulationError(Exception):
    """The simulated bench did not start or did not answer; one sentence."""


class SimulatedBench:
    """A context manager; the child ends with its standard input, so it never outlives this process."""

    def __init__(self, settings: dict[str, Any], speed: float, seed: int) -> None:
        self.ready: dict[str, Any] = {}
        self._request = {**settings, "speed": speed, "seed": seed}
        self._child: subprocess.Popen[str] | None = None

    def __enter__(self) -> SimulatedBench:
        self._child = subprocess.Popen(
            [sys.executable, "-m", "drivers.simulators"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            encoding="utf-8",
        )
        self.ready = self.tell(self._request)
        return self

    def tell(self, request: dict[str, Any]) -> dict[str, Any]:
        """Sends one request and returns the answer. Raises SimulationError if it is refused or nobody answers."""
        child = self._child
        if child is None or child.stdin is None or child.stdout is None:
            raise SimulationError("the simulated bench is not running")
        try:
            child.stdin.write(json.dumps(request) + "\n")
            child.stdin.flush()
        except OSError as error:
            raise SimulationError(f"the simulated bench ended with code {child.poll()}") from error
        line = child.stdout.readline()
        if not line:
            raise SimulationError(f"the simulated bench ended with code {child.wait(5)}")
        answer: dict[str, Any] = json.loads(line)
        if "error" in answer:
            raise SimulationError(f"the simulated bench refused: {answer['error']}")
        return answer

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        child = self._child
        if child is None:
            return
        if child.stdin is not None:
            child.stdin.close()
        try:
            child.wait(5)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()
        if child.stdout is not None:
            child.stdout.close()

    def pointed_at(self, config: StationConfig) -> StationConfig:
        """The configuration with the addresses of this bench in the place of its own."""
        data = config.model_dump(mode="json")
        data["daq"]["grpc_target"] = f"127.0.0.1:{self.ready['ports']['ni']}"
        data["mocap"] |= {"host": "127.0.0.1", "port": self.ready["ports"]["qtm"]}
        return parse_config(data, "the simulated bench")

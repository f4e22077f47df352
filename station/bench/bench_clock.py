"""The clock of a simulated bench as the clock of the station: it advances once the station has handled all items."""

from __future__ import annotations

import json
import socket
import time
from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import suppress
from types import TracebackType
from typing import Any

from drivers.errors import DeviceCode, DeviceLost, DeviceUnavailable

BLOCK_S = 0.05
"""Wall seconds between two steps of a paced world: the blocks of a real bench."""
LONGEST_STEP_S = 0.5
"""World seconds; the step of a world that is as fast as it is handled."""
CONNECT_TIMEOUT_S = 5.0
ANSWER_TIMEOUT_S = 120.0
"""Wall seconds for a step that may wait for other stations and for a busy machine."""
RATE_WINDOW_S = 5.0
SHORTEST_RATE_WINDOW_S = 1.0
SLOW_FRACTION = 0.95
"""Fraction of the set pace; below it the operator sees a warning."""


class BenchClock:
    """A context manager, and the SteppedClock of one trial (protocol: drivers/simulators/simulated_bench.py).

    port is that of the bench's clock on this machine. speed sets its world's pace, in world seconds per wall second;
    None leaves it. Raises DeviceUnavailable if no simulated bench answers.
    """

    timeout_scale = 10.0

    def __init__(self, port: int, speed: float | None = None) -> None:
        self._name = f"the clock of the simulated bench at 127.0.0.1:{port}"
        self._port, self._speed = port, speed
        self._now_s = 0.0
        self._step_s = LONGEST_STEP_S
        self._pace: float | None = None
        self._start_utc_ns = 0
        self._connection: socket.socket | None = None
        self._history: deque[tuple[float, float]] = deque()

    def __enter__(self) -> BenchClock:
        try:
            self._connection = socket.create_connection(("127.0.0.1", self._port), CONNECT_TIMEOUT_S)
        except (OSError, OverflowError) as error:
            reason = getattr(error, "strerror", None) or error
            raise DeviceUnavailable(
                f"{self._name} does not answer ({reason}); start `station simulate` first, or record a real bench "
                "without --speed",
                DeviceCode.NO_SERVER,
            ) from error
        self._lines = self._connection.makefile("rb")
        try:
            self._attach(self._connection)
        except BaseException:
            self.close()
            raise
        return self

    def _attach(self, connection: socket.socket) -> None:
        connection.settimeout(ANSWER_TIMEOUT_S)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        try:
            attached = self._request({"attach": "the station", "speed": self._speed})
            self._now_s, self._start_utc_ns = float(attached["now"]), int(attached["start_utc_ns"])
            self._pace = attached["speed"]
        except (ValueError, TypeError, KeyError) as error:
            raise DeviceUnavailable(
                f"{self._name} is not a clock: another program listens on this port; correct [simulation.ports] clock",
                DeviceCode.NO_ANSWER,
            ) from error
        if self._pace is not None:
            self._step_s = min(BLOCK_S * self._pace, LONGEST_STEP_S)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Detach, and return when the bench has confirmed it: its world continues without this station."""
        connection, self._connection = self._connection, None
        if connection is None:
            return
        with suppress(OSError):  # the bench may have ended
            connection.settimeout(CONNECT_TIMEOUT_S)
            connection.shutdown(socket.SHUT_WR)
            self._lines.read()
        self._lines.close()
        connection.close()

    def utc_ns(self) -> int:
        return self._start_utc_ns + round(self._now_s * 1e9)

    def wall_utc_ns(self) -> int:
        return time.time_ns()

    def station_s(self) -> float:
        return self._now_s

    def wall_s(self) -> float:
        return time.perf_counter()

    def step(self, ports: Sequence[int] = ()) -> Mapping[int, int | None]:
        self._now_s += self._step_s  # first, because items of the step may arrive before its answer
        answer = self._request({"advance_to": self._now_s, "ports": list(ports)})
        self._history.append((time.perf_counter(), self._now_s))
        while self._history[-1][0] - self._history[0][0] > RATE_WINDOW_S:
            self._history.popleft()
        sizes: dict[int, int | None] = {}
        for sent in answer["sent"].values():
            for port, size in sent.items():
                sizes[int(port)] = sizes.get(int(port)) if size is None else size  # a port may be used again elsewhere
        return sizes

    def pending_devices(self) -> int:
        return len(self._request({"advance_to": self._now_s})["pending"])

    @property
    def slow_rate(self) -> float | None:
        """Recent world seconds per wall second, if that is less than the set pace; else None."""
        history = tuple(self._history)  # views read it in their own threads
        if self._pace is None or len(history) < 2:
            return None
        (wall_0, world_0), (wall_1, world_1) = history[0], history[-1]
        if wall_1 - wall_0 < SHORTEST_RATE_WINDOW_S:
            return None
        rate = (world_1 - world_0) / (wall_1 - wall_0)
        return rate if rate < SLOW_FRACTION * self._pace else None

    def _request(self, request: dict[str, Any]) -> dict[str, Any]:
        if self._connection is None:
            raise DeviceLost(f"{self._name} is closed", DeviceCode.CLOSED)
        try:
            self._connection.sendall(json.dumps(request).encode() + b"\n")
            line = self._lines.readline()
        except ConnectionError:
            line = b""
        except OSError as error:
            raise DeviceLost(
                f"{self._name} does not answer any more ({error.strerror or error})", DeviceCode.DISCONNECTED
            ) from error
        if not line.endswith(b"\n"):
            raise DeviceLost("the simulated devices ended during the trial; start them again", DeviceCode.DISCONNECTED)
        answer: dict[str, Any] = json.loads(line)
        if "error" in answer:
            raise DeviceLost(f"{self._name} refused: {answer['error']}")
        return answer

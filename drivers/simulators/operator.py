"""The operator at the mocap PC: starts a capture some seconds after all devices stream, unless a client has control."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress

from drivers.simulators.world import World


class Operator:
    """One capture for each time that all devices begin to stream; a client that takes control is left alone.

    A new capture starts at least delay_s after the end of the previous one. clients: functions that return the client
    of each device, false without one. Another client begins anew, also one that came between two steps.
    """

    def __init__(
        self, world: World, delay_s: float, clients: Sequence[Callable[[], object]], is_controlled: Callable[[], bool]
    ) -> None:
        self._world = world
        self._delay_s = delay_s
        self._clients = clients
        self._found: list[object] = []
        self._is_controlled = is_controlled
        self._since: float | None = None  # when everything began to stream, world time
        self._is_done = False

    def step(self, now: float) -> None:
        found = [client() for client in self._clients]
        if found != self._found:
            self._found, self._since, self._is_done = found, None, False
        if not all(found):
            return
        if self._is_controlled():
            self._is_done = True
        elif self._since is None:
            self._since = now
        elif not self._is_done and now >= max(self._since, self._last_end()) + self._delay_s:
            with suppress(ValueError):  # a fault or a request began one meanwhile
                self._world.start_capture()
                self._is_done = True

    def _last_end(self) -> float:
        """When the latest capture ended or will end, world time; −∞ before the first."""
        capture = self._world.capture
        return -math.inf if capture is None else capture.end

    def find_slow_client(self) -> str | None:
        return None

    def drop_slow_client(self) -> None: ...

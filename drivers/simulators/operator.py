"""The person at the mocap PC: starts a capture some seconds after everything streams, unless a client is in control."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from contextlib import suppress

from drivers.simulators.world import World

_GLANCE_S = 0.005  # wall


class Operator:
    """One capture for each time that all devices begin to stream; a client that takes control is left alone."""

    def __init__(
        self, world: World, delay_s: float, streams: Sequence[Callable[[], bool]], is_controlled: Callable[[], bool]
    ) -> None:
        self._world = world
        self._delay_s = delay_s
        self._streams = streams
        self._is_controlled = is_controlled
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="mocap operator", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        self._ending.set()
        self._thread.join()

    def _watch(self) -> None:
        since: float | None = None  # when everything began to stream, world time
        is_done = False
        while not self._ending.wait(_GLANCE_S):
            if not all(is_streaming() for is_streaming in self._streams):
                since, is_done = None, False
            elif self._is_controlled():
                is_done = True
            elif since is None:
                since = self._world.now()
            elif not is_done and self._world.now() >= since + self._delay_s:
                with suppress(ValueError):  # an earlier capture still runs: its end is waited for
                    self._world.start_capture()
                    is_done = True

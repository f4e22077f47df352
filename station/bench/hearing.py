"""When each stream was last heard of: one that should flow and is silent is lost, whatever the reason."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from recordings.samples import Event, Stream
from station.clock import Clock

SILENCE_S = 3.0
"""Station seconds after which a stream that should flow counts as lost."""
DEAF_S = 1.0
"""Station seconds between two looks, which are 20 ms or a step of the simulated bench apart, after which it was the
station that stood still."""


class Hearing:
    """Follows the streams of a trial; times are station seconds.

    device_of names the device of each stream: while it says that it is away, its silence is no news. Its driver brings
    it back, or gives up in an error of its own.
    """

    def __init__(self, clock: Clock, streams: Sequence[Stream], device_of: Mapping[str, str]) -> None:
        self._clock, self._streams, self._device_of = clock, tuple(streams), device_of
        self._absences: dict[str, str] = {}  # by device, in one word of Loss
        self._last_s: dict[str, float] = {}
        self._listens_since_s = self._looked_s = clock.station_s()

    def look(self) -> float | None:
        """To be called all the time. For how long nobody did, where that is to be told: no device was silent then."""
        paused_s, self._looked_s = self._clock.station_s() - self._looked_s, self._clock.station_s()
        if paused_s < DEAF_S:
            return None
        self._listens_since_s = self._looked_s
        return paused_s

    def hear(self, stream: str) -> None:
        self._last_s[stream] = self._clock.station_s()

    def last_s(self, stream: str) -> float | None:
        """When it was last heard of; None before the first time."""
        return self._last_s.get(stream)

    def follow(self, event: Event) -> None:
        """A device tells that its connection is lost, or restored."""
        if event.kind == "connection_lost":
            self._absences[event.source] = "disconnected"
        elif event.kind == "connection_restored":
            self._absences.pop(event.source, None)
            for stream in (name for name, device in self._device_of.items() if device == event.source):
                self.hear(stream)

    def lose(self, device: str, cause: str) -> None:
        """The device is lost for good; what it was away for before keeps its cause."""
        self._absences.setdefault(device, cause)

    def device_of(self, stream: str) -> str:
        return self._device_of.get(stream, "")

    def absence(self, stream: str) -> str:
        """Why the stream's device is away, as in Loss; "" while it is not."""
        return self._absences.get(self.device_of(stream), "")

    def silent(self, expected: Sequence[str], since_s: float) -> tuple[Stream, float] | None:
        """The first of the expected streams that was silent for too long since then, and for how long."""
        now = self._clock.station_s()
        for stream in self._streams:
            quiet_s = now - max(self._last_s.get(stream.name, since_s), since_s, self._listens_since_s)
            if stream.name in expected and quiet_s > SILENCE_S and not self.absence(stream.name):
                return stream, quiet_s
        return None

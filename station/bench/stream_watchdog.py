"""Detect streams that have stopped delivering samples.

A stream is silent when no sample has arrived for SILENCE_TIMEOUT_S although its device is connected. A disconnected
device is not reported here: its driver reconnects it or raises DeviceLost.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from recordings.samples import Event, Stream
from station.clock import Clock

SILENCE_TIMEOUT_S = 3.0
"""Station seconds without a sample."""
STALL_THRESHOLD_S = 1.0
"""Station seconds between two polls. The station polls every 20 ms, or once a step of the simulated bench; a longer gap
means that the station itself was suspended."""


@dataclass(frozen=True)
class SilentStream:
    stream: Stream
    silence_s: float


class StreamWatchdog:
    """Arrival time of the last sample of every stream. All times are station seconds.

    device_by_stream maps the name of a stream to the name of its device.
    """

    def __init__(self, clock: Clock, streams: Sequence[Stream], device_by_stream: Mapping[str, str]) -> None:
        self._clock, self._streams, self._device_by_stream = clock, tuple(streams), device_by_stream
        self._absences: dict[str, str] = {}  # device -> cause, as in Loss
        self._last_arrival_s: dict[str, float] = {}
        self._resumed_s = self._polled_s = clock.station_s()

    def record_arrival(self, stream: str) -> None:
        """Note that a sample of the stream has just arrived."""
        self._last_arrival_s[stream] = self._clock.station_s()

    def last_arrival_s(self, stream: str) -> float | None:
        """Arrival time of the last sample; None before the first."""
        return self._last_arrival_s.get(stream)

    def handle_event(self, event: Event) -> None:
        """Update the connection state from a connection_lost or connection_restored event."""
        if event.kind == "connection_lost":
            self._absences[event.source] = "disconnected"
        elif event.kind == "connection_restored":
            self._absences.pop(event.source, None)
            for stream in (name for name, device in self._device_by_stream.items() if device == event.source):
                self.record_arrival(stream)

    def mark_lost(self, device: str, cause: str) -> None:
        """Note that the device is lost for good. A cause that was noted before stays."""
        self._absences.setdefault(device, cause)

    def device_of(self, stream: str) -> str:
        return self._device_by_stream.get(stream, "")

    def is_needed(self, device: str, needed: Sequence[str]) -> bool:
        """Whether the device is unknown or has one of the needed streams."""
        streams = [stream for stream, owner in self._device_by_stream.items() if owner == device]
        return not streams or any(stream in needed for stream in streams)

    def absence(self, stream: str) -> str:
        """Cause of the disconnection of the stream's device, as in Loss; "" while it is connected."""
        return self._absences.get(self.device_of(stream), "")

    def poll(self) -> float | None:
        """Duration of a stall of the station itself, or None. Call at every tick.

        A stall (suspended computer, swapping) restarts the silence timers, because the devices kept streaming.
        """
        stall_s, self._polled_s = self._clock.station_s() - self._polled_s, self._clock.station_s()
        if stall_s < STALL_THRESHOLD_S:
            return None
        self._resumed_s = self._polled_s
        return stall_s

    def find_silent_stream(self, expected: Sequence[str], since_s: float) -> SilentStream | None:
        """First of the expected streams whose last sample is older than the time-out."""
        now = self._clock.station_s()
        for stream in self._streams:
            silence_s = now - max(self._last_arrival_s.get(stream.name, since_s), since_s, self._resumed_s)
            if stream.name in expected and silence_s > SILENCE_TIMEOUT_S and not self.absence(stream.name):
                return SilentStream(stream, silence_s)
        return None

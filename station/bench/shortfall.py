"""What the end of a trial can no longer receive: how far each stream falls short of it."""

from __future__ import annotations

from collections.abc import Sequence

from recordings.samples import Loss, Samples, Stream
from station.bench.stream_clock import StreamClock
from station.bench.stream_watchdog import StreamWatchdog

SHORT_S = 0.1
"""Station seconds by which the DAQ's last sample may lie before the capture's end, whose message travels too."""


class Shortfall:
    """Follows how far the streams of the DAQ and of the load cell have come; frames end with the capture.

    A stream whose device is away, or lost for good, falls short whatever it is.
    """

    def __init__(self, streams: Sequence[Stream], watchdog: StreamWatchdog) -> None:
        self._streams, self._watchdog = tuple(streams), watchdog
        self._clocks = {name: StreamClock() for name in ("/force", "/sync")}
        self._last_device_ns: dict[str, int] = {}

    def feed(self, samples: Samples) -> None:
        """Takes a block that holds at least one sample."""
        self._last_device_ns[samples.stream] = int(samples.device_time_ns[-1])
        if samples.stream in self._clocks:
            self._clocks[samples.stream].update(samples)

    def reached_ns(self, stream: str) -> int:
        """UTC [ns] of the last sample of a stream of the DAQ or the load cell; 0 before the first."""
        return self._clocks[stream].host_ns

    def behind(self, end_ns: int, by_s: float) -> list[tuple[Stream, float]]:
        """Streams of the DAQ and of the load cell that fall short of a moment by more than by_s, and by how much."""
        found = [
            (stream, (end_ns - self._clocks[stream.name].host_ns) * 1e-9)
            for stream in self._streams
            if stream.name in self._clocks
        ]
        return [(stream, behind_s) for stream, behind_s in found if behind_s > by_s]

    def losses(self, end_ns: int, end_s: float, since_s: float) -> list[Loss]:
        """What is missing of each stream up to the end, by UTC [ns] and station seconds, of a trial since since_s.

        Counted are the streams whose device is away, and those of the DAQ that fall short by more than SHORT_S.
        """
        behind_s = {stream.name: behind for stream, behind in self.behind(end_ns, SHORT_S)}
        found = []
        for stream in self._streams:
            cause = self._watchdog.absence(stream.name)
            missing_s = behind_s.get(stream.name, 0.0)
            if cause and stream.name not in self._clocks:
                missing_s = end_s - max(self._watchdog.last_arrival_s(stream.name) or 0.0, since_s)
            if count := round(missing_s * stream.rate_hz):
                last_ns = self._last_device_ns.get(stream.name, 0)
                found.append(Loss(stream.name, cause or "silent", 0, count, last_ns, end_ns))
        return found

"""Samples that are missing at the end of a trial, stream by stream."""

from __future__ import annotations

from collections.abc import Sequence

from recordings.samples import Loss, Samples, Stream
from station.bench.stream_clock import StreamClock
from station.bench.stream_watchdog import StreamWatchdog

SHORT_S = 0.1
"""Station seconds by which the DAQ's last sample may precede the end of the capture, whose message also takes time."""


class Shortfall:
    """Tracks the last sample of the DAQ's and the load cell's streams; frames end with the capture.

    A stream whose device is disconnected or lost is short in any case.
    """

    def __init__(self, streams: Sequence[Stream], watchdog: StreamWatchdog) -> None:
        self._streams, self._watchdog = tuple(streams), watchdog
        self._clocks = {name: StreamClock() for name in ("/force", "/sync")}
        self._last: dict[str, tuple[int, int]] = {}  # number and device time of the last sample

    def update(self, samples: Samples) -> None:
        """Take a block with at least one sample."""
        self._last[samples.stream] = int(samples.sample_numbers[-1]), int(samples.device_time_ns[-1])
        if samples.stream in self._clocks:
            self._clocks[samples.stream].update(samples)

    def last_sample_ns(self, stream: str) -> int:
        """UTC [ns] of the last sample of a stream of the DAQ or the load cell; 0 before the first."""
        return self._clocks[stream].host_ns

    def find_short_streams(self, end_ns: int, tolerance_s: float) -> list[tuple[Stream, float]]:
        """Streams of the DAQ and the load cell whose last sample precedes end_ns by more than tolerance_s [s]."""
        gaps = [
            (stream, (end_ns - self._clocks[stream.name].host_ns) * 1e-9)
            for stream in self._streams
            if stream.name in self._clocks
        ]
        return [(stream, gap_s) for stream, gap_s in gaps if gap_s > tolerance_s]

    def losses(self, end_ns: int, end_s: float, since_s: float) -> list[Loss]:
        """Missing samples of every stream up to the end (UTC [ns] and station seconds) of a trial since since_s.

        Included are streams whose device is disconnected, and those of the DAQ that are short by more than SHORT_S.
        """
        gap_s = {stream.name: gap for stream, gap in self.find_short_streams(end_ns, SHORT_S)}
        losses = []
        for stream in self._streams:
            cause = self._watchdog.absence(stream.name)
            missing_s = gap_s.get(stream.name, 0.0)
            if cause and stream.name not in self._clocks:
                missing_s = end_s - max(self._watchdog.last_arrival_s(stream.name) or 0.0, since_s)
            if count := round(missing_s * stream.rate_hz):
                number, last_ns = self._last.get(stream.name, (-1, 0))
                losses.append(Loss(stream.name, cause or "silent", number + 1, count, last_ns, end_ns))
        return losses

"""Check that the frames of a capture are complete from its first one: QTM numbers them from 1 at the start."""

from __future__ import annotations

from collections.abc import Sequence

from recordings.samples import Event, Loss, Samples, Stream

LATENESS = 0.1
"""Disagreement of both clocks about the time since the edge: this fraction of it, plus as many seconds."""


class FirstFrameCheck:
    """Finds the first block of /markers of a capture, and the frames that are missing before it.

    Frames whose numbers continue from before the edge (a live preview without a capture) carry no such information;
    the driver counts what is missing among them.
    """

    def __init__(self, streams: Sequence[Stream]) -> None:
        self._rate_hz = sum(stream.rate_hz for stream in streams if stream.name == "/markers")
        self._edge_host_ns: int | None = None
        self._is_awaited = True
        self._first: Samples | None = None

    def set_edge(self, host_ns: int) -> Loss | None:
        """The capture began at this host time [UTC, ns]; its frames may have arrived before the edge."""
        self._edge_host_ns = host_ns
        return self._missed()

    def handle_event(self, event: Event) -> None:
        """Frame numbers that restart belong to a capture."""
        self._is_awaited |= event.kind in ("numbering_restarted", "capture_replaced")

    def update(self, block: Samples) -> Loss | None:
        """Take a block with at least one frame; return the frames that are missing before it, once they are known."""
        if not self._is_awaited:
            return None
        self._is_awaited, self._first = False, block
        return self._missed()

    def _missed(self) -> Loss | None:
        if self._first is None or self._edge_host_ns is None:
            return None
        first, self._first = self._first, None
        number = int(first.sample_numbers[0])
        since_edge_s = (first.host_time_ns - self._edge_host_ns) * 1e-9
        if since_edge_s < 0 or not 1 < number <= (since_edge_s * (1 + LATENESS) + LATENESS) * self._rate_hz:
            return None
        return Loss(first.stream, "late", 1, number - 1, int(first.device_time_ns[0]), first.host_time_ns)

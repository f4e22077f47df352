"""Whether a capture's frames came from its first one on: QTM numbers them from 1 at the capture's start."""

from __future__ import annotations

from collections.abc import Sequence

from recordings.samples import Event, Loss, Samples, Stream

LATENESS = 0.1
"""Part of the time since the edge, and seconds besides, by which both clocks may disagree about it."""


class FirstFrame:
    """Watches for the first block of /markers that belongs to a capture.

    Frames whose numbers run on from before the edge (live preview that knows of no capture) tell nothing by their
    number: what is missing among them the driver sees.
    """

    def __init__(self, streams: Sequence[Stream]) -> None:
        self._rate_hz = sum(stream.rate_hz for stream in streams if stream.name == "/markers")
        self._edge_host_ns: int | None = None
        self._is_awaited = True
        self._first: Samples | None = None

    def edge(self, host_ns: int) -> Loss | None:
        """The capture began at this moment of the host's clock [UTC, ns]; its frames may have been here sooner."""
        self._edge_host_ns = host_ns
        return self._missed()

    def follow(self, event: Event) -> None:
        """Numbers that start again are those of a capture."""
        self._is_awaited |= event.kind in ("numbering_restarted", "capture_replaced")

    def feed(self, block: Samples) -> Loss | None:
        """Takes a block with at least one frame; what should have come before it, once that is known."""
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

"""The 5 V sync line, block by block: its level, its edges and its glitches, and the samples from before its edge."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeGuard

import numpy as np

from documents.message import Message
from recordings.samples import Item, Loss, Samples
from station.messages.bench_messages import TrialCode

GLITCH_NS = 5_000_000
"""A level that lasts less is a glitch: it neither starts nor ends a trial."""


@dataclass(frozen=True)
class Edge:
    """A crossing of the threshold at the first sample beyond it; is_glitch: the line returned within GLITCH_NS."""

    rising: bool
    sample_number: int
    device_time_ns: int
    from_v: float
    to_v: float
    is_glitch: bool = False


def wrong_polarity(fall: Edge) -> Message[TrialCode]:
    """The message for a falling edge where a rising one was expected."""
    return Message(TrialCode.WRONG_POLARITY, {"from_v": fall.from_v, "to_v": fall.to_v})


class SyncLine:
    """Level and edges of /sync. level_v is the voltage of the last sample, None before the first."""

    def __init__(self, threshold_v: float) -> None:
        self.threshold_v = threshold_v
        self.level_v: float | None = None
        self._unsettled: Edge | None = None  # the line may still return, in this block or the next

    @property
    def is_high(self) -> bool:
        return self.level_v is not None and self.level_v >= self.threshold_v

    @property
    def has_settled(self) -> bool:
        """Whether the level has lasted longer than a glitch."""
        return self._unsettled is None

    def missing_edge(self, timeout_s: float, fall: Edge | None) -> Message[TrialCode]:
        """The message for a time-out without a rising edge; fall is the latest unexplained falling edge."""
        if fall is not None:
            figures = {"timeout_s": timeout_s, "from_v": fall.from_v, "to_v": fall.to_v}
            return Message(TrialCode.NO_SYNC_EDGE_FELL, figures)
        if self.level_v is None:
            return Message(TrialCode.NO_SYNC_EDGE_NO_SAMPLES, {"timeout_s": timeout_s})
        code = TrialCode.NO_SYNC_EDGE_HIGH if self.is_high else TrialCode.NO_SYNC_EDGE_LOW
        return Message(code, {"timeout_s": timeout_s, "level_v": self.level_v, "threshold_v": self.threshold_v})

    def update(self, samples: Samples) -> list[Edge]:
        """Take a block; return the edges and glitches that it settles, in order. A glitch is two crossings.

        An edge within GLITCH_NS of the end of a block is returned with the next block.
        """
        if not len(samples.device_time_ns):
            return []
        settled: list[Edge] = []
        for edge in self._crossings(samples):
            before, self._unsettled = self._unsettled, edge
            if before is not None and edge.device_time_ns - before.device_time_ns < GLITCH_NS:
                settled.append(replace(before, is_glitch=True))
                self._unsettled = None
            elif before is not None:
                settled.append(before)
        if self._unsettled is not None and samples.device_time_ns[-1] - self._unsettled.device_time_ns >= GLITCH_NS:
            settled.append(self._unsettled)
            self._unsettled = None
        return settled

    def _crossings(self, samples: Samples) -> list[Edge]:
        """Crossings of the threshold in this block, also one between the previous block and this one.

        A sample that is no number shows no level: the line keeps that of the sample before.
        """
        known = np.flatnonzero(np.isfinite(samples.values[:, 0]))
        if not len(known):
            return []
        volts = samples.values[known, 0].astype(np.float64)
        before = np.concatenate(([volts[0] if self.level_v is None else self.level_v], volts[:-1]))
        crossings = np.flatnonzero((before >= self.threshold_v) != (volts >= self.threshold_v))
        self.level_v = float(volts[-1])
        return [
            Edge(
                rising=bool(volts[i] >= self.threshold_v),
                sample_number=int(samples.sample_numbers[known[i]]),
                device_time_ns=int(samples.device_time_ns[known[i]]),
                from_v=float(before[i]),
                to_v=float(volts[i]),
            )
            for i in crossings
        ]


class FallingEdges:
    """The latest falling edge, and the latest start and stop that the mocap system reported. Times: station seconds."""

    def __init__(self) -> None:
        self._fall: tuple[float, Edge] | None = None
        self._started_s: float | None = None
        self._stopped_s: float | None = None

    def add(self, edge: Edge, now_s: float) -> None:
        self._fall = now_s, edge

    def handle_event(self, kind: str, now_s: float) -> None:
        """Take the kind of an event; only "capture_started" and "capture_stopped" matter."""
        if kind == "capture_started":
            self._started_s = now_s
        elif kind == "capture_stopped":
            self._stopped_s = now_s

    @property
    def unexplained(self) -> Edge | None:
        """The latest falling edge, unless the end of a capture explains it."""
        return self._fall[1] if self._fall and not _coincide(self._fall[0], self._stopped_s) else None

    def inverted_start(self, now_s: float) -> Edge | None:
        """The falling edge that coincided with the start of a capture, once neither can arrive late any more."""
        if self._fall is None or self._started_s is None or not _coincide(self._fall[0], self._started_s):
            return None
        return self._fall[1] if now_s - max(self._fall[0], self._started_s) > LATENESS_S else None


def _coincide(first_s: float, second_s: float | None) -> bool:
    return second_s is not None and abs(first_s - second_s) < LATENESS_S


PRE_ROLL_S = 2.0
"""Station seconds kept from before the edge."""
LATENESS_S = 1.0
"""Station seconds by which samples of one device may arrive after those of another; the pre-roll is longer by it."""


class PreRoll:
    """The items of the last few seconds, in the order of arrival."""

    def __init__(self, is_daq_stream: Callable[[str], bool] = lambda stream: stream != "/markers") -> None:
        """is_daq_stream: whether a stream, by name, is on the clock of the sync line."""
        self._items: deque[Item] = deque()
        self._is_daq_stream = is_daq_stream

    def append(self, item: Item) -> None:
        """Keep the item, and drop those that are too old."""
        self._items.append(item)
        oldest_ns = item.host_time_ns - int((PRE_ROLL_S + LATENESS_S) * 1e9)
        while self._items and self._items[0].host_time_ns < oldest_ns:
            self._items.popleft()

    def drop_before(self, fall_device_ns: int) -> None:
        """The sync line fell: earlier samples of the DAQ belong to an earlier capture."""
        kept = ((_from(item, fall_device_ns) if self._has_daq_time(item) else item) for item in self._items)
        self._items = deque(item for item in kept if item is not None)

    def drop_frames(self) -> None:
        """The frames so far are from an earlier capture or a preview; their numbers are unrelated to this capture."""
        self._items = deque(
            item for item in self._items if not (isinstance(item, Samples | Loss) and item.stream == "/markers")
        )

    def take_from(self, edge_device_ns: int) -> list[Item]:
        """Remove and return the items: force and sync from 2 s before the edge, and all of the other streams."""
        first_ns = edge_device_ns - int(PRE_ROLL_S * 1e9)
        kept = [item for item in self._items if not (self._has_daq_time(item) and _ends_before(item, first_ns))]
        self._items.clear()
        return kept

    def _has_daq_time(self, item: Item) -> TypeGuard[Samples | Loss]:
        return isinstance(item, Samples | Loss) and self._is_daq_stream(item.stream)


def _from(item: Samples | Loss, device_time_ns: int) -> Item | None:
    """The part of a DAQ block from this device time on, None if there is none."""
    if isinstance(item, Loss):
        return item if item.last_device_time_ns >= device_time_ns else None
    first = int(np.searchsorted(item.device_time_ns, device_time_ns))
    if first == len(item.device_time_ns):
        return None
    return replace(
        item,
        sample_numbers=item.sample_numbers[first:],
        device_time_ns=item.device_time_ns[first:],
        values=item.values[first:],
    )


def _ends_before(item: Samples | Loss, device_time_ns: int) -> bool:
    """Whether a block of the DAQ ends before this device time; False for a loss."""
    return isinstance(item, Samples) and len(item.device_time_ns) > 0 and int(item.device_time_ns[-1]) < device_time_ns

"""A running trial as views see it: its state at one moment, the rates of its streams, and a view with its own thread.

When a view falls behind, the oldest items are dropped and counted.
"""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections import deque
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from pydantic import BaseModel

from documents.interval import counted
from documents.message import Message, join_sentences
from recordings.manifest import DataOrigin
from recordings.samples import Item, Samples, Stream
from station.messages.bench_messages import TrialCode

OPENING = (Message(TrialCode.OPENING),)
JOIN_TIMEOUT_S = 5.0
"""Wall seconds to wait at the end for a view that is stuck."""


class TrialState(Enum):
    IDLE = "idle"
    ARMED = "armed"
    RECORDING = "recording"
    CLOSING = "closing"
    CLOSED = "closed"
    FAILED = "failed"


@dataclass(frozen=True)
class Snapshot:
    """left_s: station seconds until the time-out of an armed trial; 0 in other states.

    messages are the state, and what will keep the trial from being accepted. edge_device_ns is the time of the sync
    edge on the clock of /sync, None before it; recording is the file, None where the recorder has not named it;
    origin is what its devices report.
    """

    state: TrialState
    messages: tuple[Message[TrialCode], ...] = OPENING
    sync_level_v: float | None = None
    waited_s: float = 0.0
    recorded_s: float = 0.0
    lost_samples: int = 0
    marks: int = 0
    streams: tuple[Stream, ...] = ()
    left_s: float = 0.0
    edge_device_ns: int | None = None
    recording: Path | None = None
    origin: DataOrigin = DataOrigin.UNKNOWN

    @property
    def sentence(self) -> str:
        return join_sentences(self.messages)


class StreamTelemetry(BaseModel):
    """Rates [Hz] as received and as declared, and samples so far of one stream."""

    rate_hz: float
    nominal_hz: float
    samples: int


class TrialTelemetry(BaseModel):
    """The running trial as its recorder sends it to the console: its state, and its data since the last message.

    Times are station seconds since the first sample; at is the wall clock, None before the recorder has sent any. codes
    are those of the messages and of their causes, problems the sentences after the first. Curves are (time [s], force
    [N]), (time, displacement [mm]) and (time, elevation [deg]); emg_uv is the RMS [µV] of each channel, points the last
    position [mm] of each marker in seen, None for a hidden one.
    """

    at: float | None = None
    state: str = TrialState.IDLE.value
    codes: tuple[str, ...] = tuple(message.code.value for message in OPENING)
    sentence: str = join_sentences(OPENING)
    problems: str = ""
    sync_v: float | None = None
    waited_s: float = 0.0
    left_s: float = 0.0
    recorded_s: float = 0.0
    edge_s: float | None = None
    lost_samples: int = 0
    marks: int = 0
    dropped: int = 0
    slow_rate: float | None = None
    disk_left_s: float | None = None
    streams: dict[str, StreamTelemetry] = {}
    force: list[tuple[float, float]] = []
    displacement: list[tuple[float, float]] = []
    elevation: list[tuple[float, float]] = []
    emg_uv: dict[str, float] = {}
    seen: dict[str, bool] = {}
    points: list[list[float] | None] = []
    events: list[str] = []


class BackgroundView(ABC):
    """A context manager around a trial. offer() and show() return at once, even while the thread is busy."""

    def __init__(self, name: str, refresh_s: float, backlog: int | None) -> None:
        """backlog: items that may wait; None: all, and the end waits until they are handled."""
        self.dropped = 0
        self._refresh_s = refresh_s
        self._backlog: deque[Item] = deque(maxlen=backlog)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def offer(self, item: Item) -> None:
        if len(self._backlog) == self._backlog.maxlen:
            self.dropped += 1
        self._backlog.append(item)

    @abstractmethod
    def show(self, snapshot: Snapshot) -> None: ...

    @abstractmethod
    def _handle(self, item: Item) -> None:
        """Take one item, in the thread of the view."""

    def _refresh(self) -> None:
        """Take all items since the last refresh."""
        while self._backlog:
            self._handle(self._backlog.popleft())

    def _run(self) -> None:
        while not self._stop.wait(self._refresh_s):
            self._refresh()
        self._refresh()

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop.set()
        self._thread.join(None if self._backlog.maxlen is None else JOIN_TIMEOUT_S)


class StreamTally:
    """Last value of one stream, and its rate over the last `refreshes` refreshes of the view."""

    def __init__(self, refreshes: int = 12) -> None:
        self.total = 0
        self.last = ""
        self._history: deque[tuple[float, int]] = deque(maxlen=refreshes)

    def add(self, samples: Samples) -> None:
        self.total += len(samples.values)
        if not len(samples.values):
            return
        last = samples.values[-1]
        if samples.stream == "/markers":
            seen = int(np.isfinite(last[:, 0]).sum())
            self.last = f"{seen} of {counted(len(last), 'marker')} seen"
        else:
            self.last = f"{float(last[0]):+.3f}"

    def rate(self, station_s: float) -> float:
        self._history.append((station_s, self.total))
        (t0, n0), (t1, n1) = self._history[0], self._history[-1]
        return (n1 - n0) / (t1 - t0) if t1 > t0 else 0.0

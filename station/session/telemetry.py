"""What a session shows of a running trial: lines of JSON, twenty a second, from the recorder's process.

A line holds when it was written (at, Unix seconds), the trial's state, the rate of each stream, where each marker is
(points, mm, null where it is hidden, in the order of seen), and what came since the line before. When nobody reads them
the view falls behind and drops; the recorder does not notice.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from recordings.manifest import CuffSite, LoadCell
from recordings.samples import Event, Item, Loss, Samples
from station.bench.background_view import BackgroundView
from station.bench.bench_clock import BenchClock
from station.bench.disk import RESERVE_BYTES, bytes_free
from station.bench.live import StreamTally
from station.bench.live_displacement import LiveDisplacement
from station.bench.snapshot import Snapshot, TrialState

REFRESH_S = 0.05
RATE_REFRESHES = 60
BACKLOG = 2000
POINT_S = 0.025
"""Station seconds between two points of a curve."""
GLANCE_S = 2.0
"""Wall seconds between two looks at the disk."""


@dataclass
class _Since:
    """What came since the last line."""

    force: list[tuple[float, float]] = field(default_factory=list)  # s, N
    displacement: list[tuple[float, float]] = field(default_factory=list)  # s, mm
    words: list[str] = field(default_factory=list)


class Telemetry(BackgroundView):
    """A view of one trial. Times are station seconds since the view's first sample.

    bench_clock is that of a simulated bench, which is told where it is slower than it should be.
    """

    def __init__(
        self,
        out: TextIO,
        cuff: CuffSite | None,
        load_cell: LoadCell,
        folder: Path,
        bench_clock: BenchClock | None = None,
    ) -> None:
        super().__init__("telemetry", REFRESH_S, BACKLOG)
        self._out, self._cuff, self._load_cell = out, cuff, load_cell
        self._disk = _DiskTime(folder)
        self._bench_clock = bench_clock
        self._snapshot = Snapshot(TrialState.IDLE, "opening the devices")
        self._tallies: dict[str, StreamTally] = {}
        self._since = _Since()
        self._first_host_ns: int | None = None
        self._offset_ns: dict[str, int] = {}  # by stream
        self._now_s = 0.0
        self._displacement: LiveDisplacement | None = None
        self._seen: dict[str, bool] = {}
        self._points: list[list[float] | None] = []
        self._sync_v: float | None = None

    def show(self, snapshot: Snapshot) -> None:
        self._snapshot = snapshot

    def _refresh(self) -> None:
        super()._refresh()
        line = json.dumps(self._line(), allow_nan=False)
        self._since = _Since()
        try:
            self._out.write(line + "\n")
            self._out.flush()
        except (OSError, ValueError):  # nobody reads any more: the console is gone, the trial goes on
            return

    def _line(self) -> dict[str, Any]:
        shown, nominal = self._snapshot, {stream.name: stream.rate_hz for stream in self._snapshot.streams}
        return {
            "at": time.time(),
            "state": shown.state.value,
            "sentence": shown.sentence,
            "sync_v": self._sync_v if shown.sync_level_v is None else shown.sync_level_v,
            "waited_s": shown.waited_s,
            "left_s": shown.left_s,
            "recorded_s": shown.recorded_s,
            "edge_s": self._edge_s(),
            "lost_samples": shown.lost_samples,
            "marks": shown.marks,
            "dropped": self.dropped,
            "slow_rate": self._bench_clock.slow_rate if self._bench_clock is not None else None,
            "disk_left_s": self._disk.left_s(self._now_s),
            "streams": {
                name: {"rate_hz": tally.rate(self._now_s), "nominal_hz": nominal.get(name, 0.0), "samples": tally.total}
                for name, tally in self._tallies.items()
            },
            "force": self._since.force,
            "displacement": self._since.displacement,
            "seen": self._seen,
            "points": self._points,
            "words": self._since.words,
        }

    def _edge_s(self) -> float | None:
        """When the sync edge was; None before it."""
        edge_ns, offset_ns = self._snapshot.edge_device_ns, self._offset_ns.get("/sync")
        if edge_ns is None or offset_ns is None or self._first_host_ns is None:
            return None
        return (edge_ns + offset_ns - self._first_host_ns) * 1e-9

    def _take(self, item: Item) -> None:
        if isinstance(item, Event):
            self._since.words.append(item.text)
        elif isinstance(item, Loss):
            self._since.words.append(f"lost {item.count} samples of {item.stream}: {item.cause}")
        elif len(item.values):
            self._tallies.setdefault(item.stream, StreamTally(RATE_REFRESHES)).add(item)
            self._disk.bytes_taken += item.values.nbytes + item.device_time_ns.nbytes
            self._take_samples(item, self._times(item))

    def _take_samples(self, samples: Samples, times: NDArray[np.float64]) -> None:
        self._now_s = max(self._now_s, float(times[-1]))
        if samples.stream == "/force":
            newtons = samples.values[:, 0] * self._load_cell.newtons_per_unit * self._load_cell.polarity
            self._since.force += _thinned(times, newtons)
        elif samples.stream == "/sync":
            self._sync_v = float(samples.values[-1, 0])
        elif samples.stream == "/markers":
            self._take_markers(samples, times)

    def _take_markers(self, samples: Samples, times: NDArray[np.float64]) -> None:
        labels: Mapping[str, tuple[str, ...]] = {stream.name: stream.labels for stream in self._snapshot.streams}
        there = labels.get("/markers", ())
        if len(there) != samples.values.shape[1]:
            return
        last = samples.values[-1, :, :3].astype(np.float64)
        self._points = [point.round(1).tolist() if np.isfinite(point).all() else None for point in last]
        self._seen = {name: point is not None for name, point in zip(there, self._points, strict=True)}
        if self._cuff is None:
            return
        if self._displacement is None:
            self._displacement = LiveDisplacement(self._cuff, there)
        self._since.displacement += _thinned(times, self._displacement.take(samples.values))

    def _times(self, samples: Samples) -> NDArray[np.float64]:
        """Seconds by the device's clock, laid onto the host's by the block that was least delayed so far."""
        last_ns, host_ns = int(samples.device_time_ns[-1]), samples.host_time_ns
        self._first_host_ns = host_ns if self._first_host_ns is None else self._first_host_ns
        offset_ns = min(self._offset_ns.get(samples.stream, host_ns - last_ns), host_ns - last_ns)
        self._offset_ns[samples.stream] = offset_ns
        return np.asarray((samples.device_time_ns + (offset_ns - self._first_host_ns)) * 1e-9)


class _DiskTime:
    """How long the disk lasts at the rate at which samples came so far, uncompressed."""

    def __init__(self, folder: Path) -> None:
        self.bytes_taken = 0
        self._folder = folder
        self._free: int | None = None
        self._next_look_s = -math.inf

    def left_s(self, passed_s: float) -> float | None:
        """Seconds until only the reserve is left; None while nothing has come, or where the disk does not answer."""
        if time.monotonic() >= self._next_look_s:
            self._next_look_s = time.monotonic() + GLANCE_S
            try:
                self._free = bytes_free(self._folder)
            except OSError:
                self._free = None
        if self._free is None or not self.bytes_taken or passed_s <= 0:
            return None
        return max(0.0, self._free - RESERVE_BYTES) * passed_s / self.bytes_taken


def _thinned(times: NDArray[np.float64], values: NDArray[np.floating]) -> list[tuple[float, float]]:
    """Some points of a block, evenly spread; what is NaN is left out."""
    count = min(len(times), 1 + math.ceil((times[-1] - times[0]) / POINT_S))
    chosen = np.unique(np.linspace(0, len(times) - 1, count).round().astype(int))
    points = [(round(float(times[i]), 4), round(float(values[i]), 4)) for i in chosen]
    return [point for point in points if np.isfinite(point[1])]

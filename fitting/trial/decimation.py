"""Decimate a recording to at most 20 rows per second while it is read, for clock fits and maximum rates.

A row covers BIN seconds of samples. It keeps the number and the device time of the last sample, the least delay, and
the mean value if no sample is missing. For the sync line, the samples at every threshold crossing are kept instead.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from recordings.manifest import Manifest
from recordings.reader import Track
from recordings.samples import Item, Samples, Stream

BIN = 0.05
"""Seconds of a row; pulls are much slower."""
BLOCKS_AT_ONCE = 100
"""Blocks that are decimated together, which is three times faster than one at a time."""


@dataclass(frozen=True)
class Rows:
    """Some samples of one stream: numbers, device_time_ns, host_time_ns (n,) int64; values (n, columns) float64."""

    numbers: NDArray[np.int64]
    device_time_ns: NDArray[np.int64]
    host_time_ns: NDArray[np.int64]
    values: NDArray[np.float64]

    def __getitem__(self, chosen: slice | NDArray[np.bool_]) -> Rows:
        return Rows(self.numbers[chosen], self.device_time_ns[chosen], self.host_time_ns[chosen], self.values[chosen])


@dataclass(frozen=True)
class MarkerMotion:
    """Labels of the pulled point and of its anchor; without an anchor the motion is in the mocap frame."""

    pulled: Sequence[str]
    anchor: Sequence[str]

    def of(self, values: NDArray[np.float32], labels: Sequence[str]) -> NDArray[np.float64]:
        """(frames, markers, 4) → (frames, 3) in the file's unit; NaN if a marker is missing."""
        if not {*self.pulled, *self.anchor} <= set(labels):
            return np.full((len(values), 3), np.nan)
        columns = values[:, :, :3].astype(np.float64)
        position: NDArray[np.float64] = columns[:, [labels.index(label) for label in self.pulled]].mean(axis=1)
        if self.anchor:
            position -= columns[:, [labels.index(label) for label in self.anchor]].mean(axis=1)
        return position


def marker_motion(manifest: Manifest) -> MarkerMotion:
    """Motion of the cuff relative to its anchor, of the bouncing weight, or of the wearer's elbow against his trunk."""
    if manifest.cuff is not None:
        return MarkerMotion(manifest.cuff.cuff_markers, manifest.cuff.anchor_markers)
    if manifest.body is not None:
        return MarkerMotion(manifest.body.arm[1:] or manifest.body.body[:1], manifest.body.trunk)
    return MarkerMotion(manifest.bounce.labels if manifest.bounce else (), ())


class Decimator:
    """Decimate a recording while it is read. Decimated /markers have values (n, 3), the position of MarkerMotion."""

    def __init__(self, manifest: Manifest, streams: Iterable[Stream]) -> None:
        self._motion = marker_motion(manifest)
        self._in_force = {stream.name: stream for stream in streams}
        self._reducers = {stream.name: _reducer(manifest, stream) for stream in self._in_force.values()}
        self._pending: dict[str, list[Samples]] = {name: [] for name in self._reducers}

    def take(self, item: Stream | Item) -> None:
        if isinstance(item, Stream):
            self._flush(item.name)
            self._in_force[item.name] = item
        elif isinstance(item, Samples) and item.values.shape[1] == self._columns(item.stream):
            self._pending[item.stream].append(item)
            if len(self._pending[item.stream]) >= BLOCKS_AT_ONCE:
                self._flush(item.stream)

    def tracks(self) -> dict[str, Track]:
        """The decimated tracks by name. Call once, after the last item."""
        for name in self._pending:
            self._flush(name)
        return {name: reducer.track() for name, reducer in self._reducers.items()}

    def _columns(self, name: str) -> int | None:
        """Number of columns of a block; None where its labels were lost with a damaged chunk."""
        return len(self._in_force[name].labels) if name in self._in_force else None

    def _flush(self, name: str) -> None:
        blocks = self._pending.get(name)
        if not blocks:
            return
        values = np.concatenate([block.values for block in blocks])
        rows = Rows(
            np.concatenate([block.sample_numbers for block in blocks]).astype(np.int64),
            np.concatenate([block.device_time_ns for block in blocks]),
            np.repeat([block.host_time_ns for block in blocks], [len(block.sample_numbers) for block in blocks]),
            _values(values, self._motion, self._in_force[name]),
        )
        self._reducers[name].take(rows)
        blocks.clear()


def decimate(manifest: Manifest, tracks: Mapping[str, Track]) -> dict[str, Track]:
    """Decimate tracks that are in memory."""
    motion = marker_motion(manifest)
    reduced = {}
    for name, track in tracks.items():
        reducer = _reducer(manifest, track.stream)
        values = _values(track.values, motion, track.stream)
        reducer.take(Rows(track.sample_numbers.astype(np.int64), track.device_time_ns, track.host_time_ns, values))
        reduced[name] = reducer.track()
    return reduced


def highest_rate(numbers: NDArray[np.int64], means: NDArray[np.float64], rate_hz: float) -> float:
    """Highest rate of change per second between neighbouring rows; means (n, columns) of samples taken at rate_hz."""
    width = _samples_per_row(rate_hz)
    steps = np.linalg.norm(np.diff(means, axis=0), axis=1)[np.diff(numbers // width) == 1]
    return float(steps[np.isfinite(steps)].max(initial=0.0)) * rate_hz / width


def _reducer(manifest: Manifest, stream: Stream) -> _Means | _Crossings:
    return _Crossings(stream, manifest.sync_threshold_v) if stream.name == "/sync" else _Means(stream)


def _values(
    values: NDArray[np.float64] | NDArray[np.float32], motion: MarkerMotion, stream: Stream
) -> NDArray[np.float64]:
    return motion.of(values, stream.labels) if values.ndim == 3 else values.astype(np.float64)  # type: ignore[arg-type]


def _samples_per_row(rate_hz: float) -> int:
    return max(1, round(rate_hz * BIN))


@dataclass
class _Means:
    """Means of force or markers; samples of an incomplete row are kept for the next block."""

    stream: Stream
    rows: list[Rows] = field(default_factory=list)
    waiting: Rows | None = None

    def take(self, block: Rows) -> None:
        samples = block if self.waiting is None else _joined([self.waiting, block])
        ends = self._ends(samples)
        last = int(ends[-2]) if len(ends) > 1 else 0
        self.waiting = samples[last:]
        if last:
            self.rows.append(self._means(samples[:last], ends[:-1]))

    def track(self) -> Track:
        if self.waiting is not None:
            self.rows.append(self._means(self.waiting, self._ends(self.waiting)))
            self.waiting = None
        return _track(self.stream, _joined(self.rows))

    def _ends(self, samples: Rows) -> NDArray[np.int64]:
        """Indices at which rows end, including the last."""
        width = _samples_per_row(self.stream.rate_hz)
        is_new = (np.diff(samples.numbers // width) != 0) | (np.diff(samples.numbers) <= 0)
        return np.append(np.flatnonzero(is_new) + 1, len(samples.numbers))

    def _means(self, samples: Rows, ends: NDArray[np.int64]) -> Rows:
        starts = np.append(0, ends[:-1])
        delay = np.minimum.reduceat(samples.host_time_ns - samples.device_time_ns, starts)
        counts = np.diff(ends, prepend=0)
        means = np.add.reduceat(samples.values, starts) / counts[:, None]
        means[counts < _samples_per_row(self.stream.rate_hz)] = np.nan
        device = samples.device_time_ns[ends - 1]
        return Rows(samples.numbers[ends - 1], device, device + delay, means)


@dataclass
class _Crossings:
    """The sync line: its first and last sample, NaN samples, and the two samples around every crossing.

    If the line never crosses the threshold, its highest sample is kept for the message. The last sample is kept for the
    next block, because the line may cross between the blocks.
    """

    stream: Stream
    threshold_v: float
    rows: list[Rows] = field(default_factory=list)
    waiting: Rows | None = None
    is_waiting_kept: bool = True
    least_delay_ns: int | None = None
    highest: Rows | None = None

    def take(self, block: Rows) -> None:
        delay_ns = int((block.host_time_ns - block.device_time_ns).min())
        self.least_delay_ns = delay_ns if self.least_delay_ns is None else min(delay_ns, self.least_delay_ns)
        samples = block if self.waiting is None else _joined([self.waiting, block])
        volts = samples.values[:, 0]
        kept = ~np.isfinite(volts)
        kept[0] |= self.is_waiting_kept
        crosses = np.diff(volts >= self.threshold_v)
        kept[:-1] |= crosses
        kept[1:] |= crosses
        top = int(volts.argmax())
        if self.highest is None or volts[top] > self.highest.values[0, 0]:
            self.highest = samples[top : top + 1]
        self.rows.append(samples[:-1][kept[:-1]])
        self.waiting, self.is_waiting_kept = samples[-1:], bool(kept[-1])

    def track(self) -> Track:
        rows = _joined([*self.rows, *([] if self.waiting is None else [self.waiting])])
        if self.highest is not None and self.highest.values[0, 0] < self.threshold_v:
            is_between = rows.numbers[0] < self.highest.numbers[0] < rows.numbers[-1]
            rows = _joined([rows[:1], self.highest, rows[-1:]]) if is_between else rows
        delay_ns = 0 if self.least_delay_ns is None else self.least_delay_ns
        return _track(self.stream, replace(rows, host_time_ns=rows.device_time_ns + delay_ns))


def _joined(parts: Sequence[Rows]) -> Rows:
    if not parts:
        nothing = np.zeros(0, np.int64)
        return Rows(nothing, nothing, nothing, np.zeros((0, 1)))
    return Rows(
        np.concatenate([part.numbers for part in parts]),
        np.concatenate([part.device_time_ns for part in parts]),
        np.concatenate([part.host_time_ns for part in parts]),
        np.concatenate([part.values for part in parts]),
    )


def _track(stream: Stream, rows: Rows) -> Track:
    return Track(stream, rows.numbers.astype(np.uint64), rows.device_time_ns, rows.host_time_ns, rows.values)

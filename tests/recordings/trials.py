"""A small trial to write into files, and ways to compare what comes back."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from mcap.records import ChunkIndex

from recordings.manifest import CuffSite, LoadCell, Manifest, TrialOutcome
from recordings.packing import pack
from recordings.reader import Recording
from recordings.samples import Event, Item, Loss, Samples, Stream
from recordings.writer import RecordingWriter

START_NS = 1_790_000_000_123_456_789
ACCEPTED = TrialOutcome(accepted=True, state="closed", sentence="the mocap capture ended")

MANIFEST = Manifest(
    cuff=CuffSite("hand", "arm", ("anchor_1", "anchor_2", "anchor_3"), ("cuff_1",)),
    test="static",
    repeat=2,
    run=1,
    donning="hand-1",
    start="sync_edge",
    sync_threshold_v=2.5,
    load_cell=LoadCell("daq", 50 * 9.80665 / 5, 1, "LSB-0815"),
    start_utc_ns=START_NS,
    effective_config={"daq": {"sample_rate_hz": 1000, "force_range_v": 10.0}, "sync": None, "names": ["ä", "漢"]},
    versions={"cuffstation": "0.1.0"},
)
FORCE = Stream("/force", "V", ("force",), 1000.0, "NI Dev1/ai0 (127.0.0.1:31763)", "01A2B3C4")
SYNC = Stream("/sync", "V", ("sync",), 1000.0, "NI Dev1/ai1 (127.0.0.1:31763)")
MARKERS = Stream("/markers", "mm", ("anchor_1", "anchor_2", "anchor_3", "cuff_1"), 100.0, "QTM 127.0.0.1:22223")
STREAMS = (FORCE, SYNC, MARKERS)


def scalars(stream: str, first: int, count: int, seed: int = 0) -> Samples:
    """A block at 1 kHz as a 12-bit converter on ±10 V gives it."""
    numbers = np.arange(first, first + count, dtype=np.uint64)
    codes = np.random.default_rng([seed, first]).integers(-2048, 2048, (count, 1))
    times = numbers.astype(np.int64) * 1_000_000
    return Samples(stream, numbers, times, _arrival(int(times[-1])), codes * (20 / 4096))


def frames(first: int, count: int, markers: int = 4, seed: int = 0) -> Samples:
    """A block of marker frames at 100 Hz, one marker in ten missing."""
    random = np.random.default_rng([seed, first])
    numbers = np.arange(first, first + count, dtype=np.uint64)
    values = random.normal(500, 100, (count, markers, 4)).astype(np.float32)
    values[random.random((count, markers)) < 0.1] = np.nan
    times = numbers.astype(np.int64) * 10_000_000
    return Samples("/markers", numbers, times, _arrival(int(times[-1])), values)


def trial(seconds: float, block_s: float = 0.1) -> Iterator[Item]:
    """What the devices deliver in order of arrival: three streams, an event now and then, and one noted loss."""
    yield Event("armed", "all devices are open", START_NS, "station")
    scalar_count, frame_count = round(1000 * block_s), round(100 * block_s)
    for i in range(round(seconds / block_s)):
        yield scalars("/force", i * scalar_count, scalar_count)
        yield scalars("/sync", i * scalar_count, scalar_count, seed=1)
        yield frames(i * frame_count, frame_count)
        if i % 10 == 1:
            yield Event("mark", f"weight {i} added", _arrival(i * round(block_s * 1e9)), "operator")


def record(path: Path, items: Sequence[Item], outcome: TrialOutcome = ACCEPTED) -> Path:
    """Writes a recording whose chunks hold three items each, whatever the wall clock does.

    It syncs in this thread: one in the background that is late on a busy machine would make a chunk longer.
    """
    wall = WallClock()
    writer = RecordingWriter(path, MANIFEST, STREAMS, clock=wall, sync=lambda _: None, background=lambda work: work())
    for i, item in enumerate(items):
        wall.now += 0.2 if i % 3 == 2 else 0.0
        writer.write(item)
    writer.close(outcome)
    return path


class WallClock:
    """Monotonic seconds that pass when a test says so."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def bits(items: Sequence[Stream | Item]) -> list[Any]:
    """Items as something that is equal only where every bit is."""
    return [(getattr(item, "host_time_ns", None), pack(item)) for item in items]


def items_of(recording: Recording) -> list[Any]:
    return bits(list(recording.items()))


def chunk_starts(path: Path) -> list[int]:
    """Where each chunk begins, as the mcap package's own reader of whole files sees it."""
    return [chunk.chunk_start_offset for chunk in _chunks(path)]


def chunk_ends(path: Path) -> list[int]:
    """Where each chunk ends, in the same way."""
    return [chunk.chunk_start_offset + chunk.chunk_length for chunk in _chunks(path)]


def skipped(first: int, count: int) -> Loss:
    return Loss("/markers", "skipped", first, count, (first - 1) * 10_000_000, _arrival(first * 10_000_000))


def _chunks(path: Path) -> list[ChunkIndex]:
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    return summary.chunk_indexes


def _arrival(device_time_ns: int) -> int:
    """Host time of a block: the device's clock began with the trial, and a block is on its way for 3 ms."""
    return START_NS + device_time_ns + 3_000_000

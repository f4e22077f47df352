"""Wrote format_1.mcap on 2026-11-21, and is kept to tell what is in it. The file is never made again.

Run as `python -m tests.recordings.golden.make_format_1 NEW_FILE.mcap` it writes such a file with the code of today.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from recordings.manifest import CuffSite, LoadCell, Manifest, TrialOutcome
from recordings.samples import Event, Loss, Samples, Stream
from recordings.writer import RecordingWriter

START_NS = 1_795_000_000_000_000_000
LABELS = ("anchor_1", "anchor_2", "anchor_3", "cuff_1")
STREAMS = (
    Stream("/force", "V", ("force",), 1000.0, "NI Dev1/ai0 (127.0.0.1:31763)", "01A2B3C4"),
    Stream("/sync", "V", ("sync",), 1000.0, "NI Dev1/ai1 (127.0.0.1:31763)", "01A2B3C4"),
    Stream("/markers", "mm", LABELS, 100.0, "QTM 127.0.0.1:22223"),
)
MANIFEST = Manifest(
    cuff=CuffSite("elbow", "arm", LABELS[:3], LABELS[3:]),
    test="dynamic",
    repeat=3,
    run=2,
    donning="elbow-1",
    start="sync_edge",
    sync_threshold_v=2.5,
    load_cell=LoadCell("daq", 98.0665, -1, "LSB-0815"),
    start_utc_ns=START_NS,
    effective_config={"daq": {"sample_rate_hz": 1000}, "mocap": {"host": "127.0.0.1"}},
    versions={"cuffstation": "0.1.0"},
)


def write_golden(path: Path) -> None:
    """One second: force a 1 Hz sine, sync rising at 0.25 s, a marker hidden, frames skipped, labels re-ordered."""
    writer = RecordingWriter(path, MANIFEST, STREAMS)
    writer.write(Event("armed", "all devices are open; waiting for the sync edge", START_NS, "station"))
    for first in range(0, 1000, 100):
        numbers = np.arange(first, first + 100, dtype=np.uint64)
        times = numbers.astype(np.int64) * 1_000_000
        arrival_ns = START_NS + int(times[-1]) + 4_000_000
        force = np.round(np.sin(2 * np.pi * times * 1e-9) / 20 * 4096)[:, None] * 20 / 4096
        writer.write(Samples("/force", numbers, times, arrival_ns, force))
        writer.write(Samples("/sync", numbers, times, arrival_ns, np.where(times < 250_000_000, 0.0, 5.0)[:, None]))
        if first == 500:
            writer.write(Loss("/markers", "skipped", 51, 2, 500_000_000, arrival_ns))
        if first == 700:
            writer.describe(replace(STREAMS[2], labels=LABELS[::-1]))
        writer.write(_markers(first // 10, arrival_ns))
    writer.close(TrialOutcome(accepted=True, state="closed", sentence="the mocap capture ended"))


def _markers(first: int, arrival_ns: int) -> Samples:
    numbers = np.arange(first, first + 10, dtype=np.uint64)
    if first == 50:
        numbers = numbers[[0, 3, 4, 5, 6, 7, 8, 9]]
    times = numbers.astype(np.int64) * 10_000_000
    marker = np.arange(4) if first < 70 else np.arange(4)[::-1]
    values = np.zeros((len(numbers), 4, 4), np.float32)
    values[..., 0] = 100 * marker
    values[..., 1] = numbers[:, None]
    values[..., 3] = 0.5
    if first == 20:
        values[:5, 3] = np.nan
    return Samples("/markers", numbers, times, arrival_ns, values)


if __name__ == "__main__":
    write_golden(Path(sys.argv[1]))

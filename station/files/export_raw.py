"""Export a recording without a common clock: one table per stream, with counts, times and values of its device."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np

from recordings.reader import Track, open_recording
from station.whole_file import write_whole

AXES = ("x", "y", "z")


def write_raw(path: Path, stem: Path, reason: str) -> list[Path]:
    """Write the tables and their sidecar, which gives the reason why there is no common clock."""
    recording = open_recording(path)
    tables = {}
    for stream in recording.streams:
        track = recording.load(stream.name)
        table = stem.with_name(f"{stem.name}_{stream.name.strip('/')}_raw.csv")
        names, values = _columns(track)
        columns = [
            track.sample_numbers.tolist(),
            (1e-9 * track.device_time_ns).round(9).tolist(),
            track.host_time_ns.tolist(),
            *values.T.tolist(),
        ]
        titles = ("sample_number", "device_time_s", "arrived_utc_ns", *names)
        rows = (",".join(map(_text, row)) for row in zip(*columns, strict=True))
        write_whole(table, "\n".join((",".join(titles), *rows)) + "\n")
        tables[table] = {"unit": stream.unit, "device": stream.source, "samples": len(track.sample_numbers)}
    sidecar = stem.with_name(f"{stem.name}_raw.csv.json")
    content = {
        "recording": path.name,
        "clock": f"each device's own: {reason}",
        "files": {table.name: description for table, description in tables.items()},
    }
    write_whole(sidecar, json.dumps(content, indent=2, ensure_ascii=False) + "\n")
    return [*tables, sidecar]


def _text(number: float) -> str:
    return "" if math.isnan(number) else repr(number)


def _columns(track: Track) -> tuple[list[str], np.ndarray]:
    """Names, and values (n, names) in the unit of the device."""
    unit, labels = track.stream.unit, track.stream.labels
    if track.values.ndim == 2:
        return [f"{track.stream.name.strip('/')}_{unit.lower()}"], track.values
    names = [f"{label}_{axis}_{unit}" for label in labels for axis in AXES]
    return names, track.values[:, :, : len(AXES)].reshape(len(track.values), len(names)).astype(np.float64)

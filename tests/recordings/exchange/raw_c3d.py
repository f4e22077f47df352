"""A C3D file of 16-bit integers, byte by byte after the C3D User Guide, with whatever contradiction is wanted."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np

POINTS, FRAMES, CHANNELS, PER_FRAME, SCALE = 3, 60, 2, 4, 0.1
POSITIONS = np.arange(FRAMES * POINTS * 3).reshape(FRAMES, POINTS, 3) + 10


def write_raw_c3d(
    path: Path,
    labels: Sequence[str] = ("a", "b", "c"),
    *,
    header_analog: int = CHANNELS * PER_FRAME,
    used_analog: int = CHANNELS,
    processor: int = 84,
) -> Path:
    """POSITIONS × 0.1 mm at 100 Hz and 2 channels at 400 Hz, which are there whatever the counts say."""
    width = max(map(len, labels))
    parameters = b"".join(
        [
            _group(1, b"POINT"),
            _parameter(1, b"USED", 2, (), struct.pack("<h", POINTS)),
            _parameter(1, b"FRAMES", 2, (), struct.pack("<h", FRAMES)),
            _parameter(1, b"DATA_START", 2, (), struct.pack("<h", 4)),
            _parameter(1, b"SCALE", 4, (), struct.pack("<f", SCALE)),
            _parameter(1, b"RATE", 4, (), struct.pack("<f", 100)),
            _parameter(1, b"UNITS", -1, (2,), b"mm"),
            _parameter(1, b"LABELS", -1, (width, len(labels)), "".join(x.ljust(width) for x in labels).encode()),
            _group(2, b"ANALOG"),
            _parameter(2, b"USED", 2, (), struct.pack("<h", used_analog)),
            _parameter(2, b"RATE", 4, (), struct.pack("<f", 400)),
            _parameter(2, b"GEN_SCALE", 4, (), struct.pack("<f", 1)),
            _parameter(2, b"SCALE", 4, (CHANNELS,), struct.pack("<2f", 1, 1)),
            _parameter(2, b"OFFSET", 2, (CHANNELS,), struct.pack("<2h", 0, 0)),
            _parameter(2, b"LABELS", -1, (2, CHANNELS), b"f1f2"),
        ]
    )
    section = (bytes([1, 0x50, 2, processor]) + parameters).ljust(1024, b"\0")
    header = struct.pack("<BB5HfHHf", 2, 0x50, POINTS, header_analog, 1, FRAMES, 0, SCALE, 4, PER_FRAME, 100.0)
    points = np.concatenate([POSITIONS, np.zeros((FRAMES, POINTS, 1), dtype=int)], axis=2).reshape(FRAMES, -1)
    analog = np.full((FRAMES, CHANNELS * PER_FRAME), 7)
    path.write_bytes(header.ljust(512, b"\0") + section + np.hstack([points, analog]).astype("<i2").tobytes())
    return path


def _group(number: int, name: bytes) -> bytes:
    return struct.pack("<bb", len(name), -number) + name + struct.pack("<hb", 3, 0)


def _parameter(group: int, name: bytes, kind: int, dimensions: Sequence[int], data: bytes) -> bytes:
    rest = struct.pack("<bb", kind, len(dimensions)) + bytes(dimensions) + data + b"\0"
    return struct.pack("<bb", len(name), group) + name + struct.pack("<h", 2 + len(rest)) + rest

"""A C3D file byte by byte after the C3D User Guide, with whatever numbers or contradiction are wanted."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

POINTS, FRAMES, CHANNELS, PER_FRAME, SCALE = 3, 60, 2, 4, 0.1
POSITIONS = np.arange(FRAMES * POINTS * 3).reshape(FRAMES, POINTS, 3) + 10
INTEL, DEC, MIPS = 84, 85, 86
CHARACTER, INTEGER, REAL = -1, 2, 4


def write_raw_c3d(
    path: Path,
    labels: Sequence[str] = ("a", "b", "c"),
    *,
    header_analog: int = CHANNELS * PER_FRAME,
    used_analog: int = CHANNELS,
    processor: int = INTEL,
    is_real: bool = False,
    rate: float = 100.0,
    offset: float = 0,
    offset_kind: int = INTEGER,
    analog_format: str = "",
    gen_scale: float = 1.0,
    counts: NDArray[np.int64] | None = None,
    unit: str = "mm",
) -> Path:
    """POSITIONS × 0.1 (or POSITIONS, if real) at 100 Hz and 2 channels at 400 Hz, which are there whatever is stated.

    counts (FRAMES × PER_FRAME, CHANNELS): stored numbers of the channels, whose SCALE is 1 and 0.5.
    """
    numbers = _Numbers(processor)
    scale = -SCALE if is_real else SCALE
    width = max(map(len, labels))
    stated_format = [(2, "FORMAT", CHARACTER, (len(analog_format),), analog_format.encode())] if analog_format else []
    parameters = [
        (1, "USED", INTEGER, (), numbers.integers(POINTS)),
        (1, "FRAMES", INTEGER, (), numbers.integers(FRAMES)),
        (1, "DATA_START", INTEGER, (), numbers.integers(4)),
        (1, "SCALE", REAL, (), numbers.reals(scale)),
        (1, "RATE", REAL, (), numbers.reals(rate)),
        (1, "UNITS", CHARACTER, (len(unit),), unit.encode()),
        (1, "LABELS", CHARACTER, (width, len(labels)), "".join(x.ljust(width) for x in labels).encode()),
        (2, "USED", INTEGER, (), numbers.integers(used_analog)),
        (2, "RATE", REAL, (), numbers.reals(rate * PER_FRAME)),
        (2, "GEN_SCALE", REAL, (), numbers.reals(gen_scale)),
        (2, "SCALE", REAL, (CHANNELS,), numbers.reals(1, 0.5)),
        (2, "OFFSET", offset_kind, (CHANNELS,), numbers.of(offset_kind, offset, offset)),
        *stated_format,
        (2, "LABELS", CHARACTER, (2, CHANNELS), b"f1f2"),
    ]
    records = [_record(numbers, -1, "POINT", b"\0"), _record(numbers, -2, "ANALOG", b"\0")]
    records += [
        _record(numbers, group, name, struct.pack("bB", kind, len(dimensions)) + bytes(dimensions) + data + b"\0")
        for group, name, kind, dimensions, data in parameters
    ]
    section = (bytes([1, 0x50, 2, processor]) + b"".join(records)).ljust(1024, b"\0")
    counted = numbers.integers(POINTS, header_analog, 1, FRAMES, 0)
    header = b"\2\x50" + counted + numbers.reals(scale) + numbers.integers(4, PER_FRAME) + numbers.reals(rate)
    points = np.concatenate([POSITIONS, np.zeros((FRAMES, POINTS, 1), dtype=int)], axis=2).reshape(FRAMES, -1)
    stored = np.full((FRAMES * PER_FRAME, CHANNELS), 7) if counts is None else counts
    frames = np.hstack([points, stored.reshape(FRAMES, -1)])
    data = numbers.reals(*frames.ravel()) if is_real else numbers.integers(*frames.ravel())
    path.write_bytes(header.ljust(512, b"\0") + section + data)
    return path


class _Numbers:
    """Numbers in the bytes of a processor."""

    def __init__(self, processor: int) -> None:
        self._order, self._is_vax = ">" if processor == MIPS else "<", processor == DEC

    def integers(self, *values: float) -> bytes:
        """Of either sign: 40000 and −25536 are the same 16 bits."""
        return (np.array(values).astype(np.int64) & 0xFFFF).astype(f"{self._order}u2").tobytes()

    def reals(self, *values: float) -> bytes:
        """VAX: the halves of four times the number, exchanged."""
        if not self._is_vax:
            return np.array(values, f"{self._order}f4").tobytes()
        return (4 * np.array(values, "<f4")).view("<u2").reshape(-1, 2)[:, ::-1].tobytes()

    def of(self, kind: int, *values: float) -> bytes:
        return self.reals(*values) if kind == REAL else self.integers(*values)


def _record(numbers: _Numbers, group: int, name: str, body: bytes) -> bytes:
    return struct.pack("<bb", len(name), group) + name.encode() + numbers.integers(2 + len(body)) + body

"""The parameter section of a C3D file, after the C3D User Guide (c3d.org), and the numbers of its three processors.

Every length in the section is compared with the bytes that are there before anything is read.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

CHARACTER, BYTE, INTEGER, REAL = -1, 1, 2, 4
INTEL, DEC, MIPS = 84, 85, 86
ENTRIES_CONTINUED = 9
"""LABELS, LABELS2 … LABELS9: a dimension counts at most 255 entries, and the next parameter has the rest."""


@dataclass(frozen=True)
class Processor:
    """Numbers as Intel, DEC (VAX) and MIPS (SGI) write them."""

    code: int

    @property
    def order(self) -> Literal["<", ">"]:
        return ">" if self.code == MIPS else "<"

    def integers(self, data: bytes, *, is_signed: bool) -> NDArray[Any]:
        """16-bit integers."""
        return np.frombuffer(data, f"{self.order}i2" if is_signed else f"{self.order}u2")

    def reals(self, data: bytes) -> NDArray[np.float32]:
        """32-bit floating point. VAX has the 16-bit halves exchanged and an exponent that is larger by 2."""
        if self.code != DEC:
            return np.frombuffer(data, f"{self.order}f4")
        halves = np.frombuffer(data, "<u2").reshape(-1, 2).astype(np.uint32)
        with np.errstate(invalid="ignore"):
            return ((halves[:, 0] << 16) | halves[:, 1]).view(np.float32) / np.float32(4.0)


@dataclass(frozen=True)
class Parameter:
    """Its type, dimensions and bytes."""

    kind: int
    dimensions: tuple[int, ...]
    data: bytes


class C3dParameters:
    """The parameters of a file by group and name, both in capitals. Raises ValueError for a damaged section."""

    def __init__(self, section: bytes, processor: Processor) -> None:
        self._processor = processor
        groups: dict[int, str] = {}
        found: list[tuple[int, str, Parameter]] = []
        for number, name, body in _records(section, processor):
            if number < 0:
                groups.setdefault(-number, name)
            else:
                found.append((number, name, _parameter(name, body)))
        self._by_name = {(groups[number], name): made for number, name, made in reversed(found) if number in groups}

    def texts(self, group: str, name: str) -> list[str]:
        """A text parameter with its continuations."""
        return [text for part in self._parts(group, name) for text in _texts(part)]

    def numbers(self, group: str, name: str, *, is_signed: bool = True) -> Array:
        """(entries,) of a parameter of numbers with its continuations; empty where it has none."""
        parts = [self._values(part, is_signed=is_signed) for part in self._parts(group, name)]
        return np.concatenate(parts) if parts else np.zeros(0)

    def number(self, group: str, name: str) -> float | None:
        """The first of the numbers, integers without sign; None without one or where it is not finite."""
        values = self.numbers(group, name, is_signed=False)
        return float(values[0]) if len(values) and np.isfinite(values[0]) else None

    def _parts(self, group: str, name: str) -> Iterator[Parameter]:
        for suffix in ("", *map(str, range(2, ENTRIES_CONTINUED + 1))):
            part = self._by_name.get((group, name + suffix))
            if part is not None:
                yield part

    def _values(self, part: Parameter, *, is_signed: bool) -> Array:
        if part.kind == REAL:
            return self._processor.reals(part.data).astype(np.float64)
        if part.kind == INTEGER:
            return self._processor.integers(part.data, is_signed=is_signed).astype(np.float64)
        if part.kind == BYTE:
            return np.frombuffer(part.data, np.int8 if is_signed else np.uint8).astype(np.float64)
        return np.zeros(0)


def _records(section: bytes, processor: Processor) -> Iterator[tuple[int, str, bytes]]:
    """Group number, negative for a group itself, name in capitals, and the bytes behind the length of each record."""
    at = 4  # behind the header of the section
    while at + 2 <= len(section):
        length, number = struct.unpack_from("bb", section, at)  # a negative length marks a locked record
        if length == 0 or number == 0:
            return
        end_of_name = at + 2 + abs(length)
        name = section[at + 2 : end_of_name].decode("latin-1").strip().upper()
        if end_of_name + 2 > len(section):
            raise ValueError(f"the record {name!r} ends beyond the parameters")
        size = _size(section[end_of_name : end_of_name + 2], processor, len(section) - end_of_name)
        end = end_of_name + size if size else len(section)
        if end > len(section) or size == 1:
            raise ValueError(f"the record {name!r} states a length of {size} bytes")
        yield number, name, section[end_of_name + 2 : end]
        if size == 0:
            return
        at = end


def _size(data: bytes, processor: Processor, room: int) -> int:
    """Of a record; c3d.org's samples of SGI computers have one length in the order of Intel."""
    sizes = [int.from_bytes(data, "big" if order == ">" else "little") for order in (processor.order, "<")]
    return next((size for size in sizes if size <= room), sizes[0])


def _parameter(name: str, body: bytes) -> Parameter:
    if len(body) < 2:
        raise ValueError(f"the parameter {name!r} has no type")
    kind, count = struct.unpack_from("bB", body)
    dimensions = tuple(body[2 : 2 + count])
    size = math.prod(dimensions) * abs(kind)
    data = body[2 + count : 2 + count + size]
    if kind not in (CHARACTER, BYTE, INTEGER, REAL) or len(dimensions) < count or len(data) < size:
        raise ValueError(f"the parameter {name!r} has {size} bytes of type {kind}, and {len(body)} are there")
    return Parameter(kind, dimensions, data)


def _texts(part: Parameter) -> list[str]:
    """The strings of a text parameter, whose first dimension is their length."""
    if part.kind != CHARACTER:
        return []
    width = part.dimensions[0] if part.dimensions else 1
    count = math.prod(part.dimensions[1:])
    texts = [part.data[width * i : width * (i + 1)] for i in range(count)]
    return [_decoded(text).rstrip("\0").strip() for text in texts]


def _decoded(text: bytes) -> str:
    try:
        return text.decode("utf-8")
    except UnicodeDecodeError:
        return text.decode("latin-1")

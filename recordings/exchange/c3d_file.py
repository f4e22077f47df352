"""A C3D file as arrays, after the C3D User Guide (c3d.org): header, parameters and frames of all three processors.

The numbers of points and analog values are in a file twice, in the header and in the parameters. Where they differ,
one of the two shifts every frame after the first, and only the size of the file shows which. Nothing is read that the
size of the file does not cover.

Every length in the parameter section is compared with the bytes that are there before anything is read.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, Literal, NoReturn

import numpy as np
from numpy.typing import NDArray

from documents.interval import counted
from documents.plain_data import shortened
from documents.regular_file import describe_failure, open_regular
from recordings.errors import ForeignFile, RecordingCode

BLOCK = 512
SIGNATURE = 0x50
MOST_COUNTED = 0xFFFF
LARGEST, LARGEST_PARAMETERS = 2 * 2**30, 2**20
"""Bytes; an hour of 100 markers at 200 Hz has 1.2 GB, and parameters are counted in at most 255 blocks."""
RATE_TOLERANCE = 0.01
EXPORT_AGAIN = "open it in the program that wrote it, and export it again"
Array = NDArray[np.float64]

CHARACTER, BYTE, INTEGER, REAL = -1, 1, 2, 4
INTEL, DEC, MIPS = 84, 85, 86
POSITIVE = (("POINT", "RATE"), ("ANALOG", "RATE"))
FINITE = (
    *POSITIVE,
    *(("POINT", name) for name in ("USED", "SCALE", "DATA_START", "FRAMES", "LONG_FRAMES")),
    *(("ANALOG", name) for name in ("USED", "GEN_SCALE")),
)
"""Parameters of one number, of which the header has another statement that must not replace a damaged one."""
ENTRIES_CONTINUED = 9
"""LABELS, LABELS2 … LABELS9: a dimension counts at most 255 entries, and the next parameter has the rest."""


@dataclass(frozen=True)
class C3dHeader:
    """Content of the first block.

    parameters_start, start       of the parameters and of the first frame [bytes]
    points, analog_values, per_frame  of a frame; analog values are those of all channels and samples together
    first, last  frames, counted from any number; a last one of 65535 means this one or any later one
    scale        of integer coordinates; negative if the numbers are floating point
    """

    parameters_start: int
    start: int
    points: int
    analog_values: int
    per_frame: int
    first: int
    last: int
    scale: float
    rate_hz: float


@dataclass(frozen=True)
class C3dLayout:
    """Points, analog channels and samples of each channel in a frame; frames; bytes of a number, 4 if it is real."""

    points: int
    channels: int
    per_frame: int
    frames: int
    number_size: int

    @property
    def analog_values(self) -> int:
        return self.channels * self.per_frame

    def size(self, points: int, analog_values: int) -> int:
        """Bytes of the frames, with these numbers of a frame."""
        return self.frames * (4 * points + analog_values) * self.number_size


@dataclass(frozen=True, eq=False)
class C3dFile:
    """A file whose parts agree.

    values  (frames, 4 × points + channels × per_frame) as they are stored: 32-bit floats, or 16-bit signed integers
    """

    path: Path
    header: C3dHeader
    parameters: C3dParameters
    layout: C3dLayout
    values: NDArray[Any]

    @property
    def is_real(self) -> bool:
        return self.layout.number_size == 4

    @property
    def rate_hz(self) -> float:
        """Frame rate. Raises ForeignFile where there is none."""
        stated = self.parameters.number("POINT", "RATE")
        rate = self.header.rate_hz if stated is None else stated
        if not 0 < rate < np.inf:
            _refuse(self.path, RecordingCode.FOREIGN_NO_RATE, "has no sampling rate; export it again with its rates")
        return rate

    @property
    def notes(self) -> tuple[str, ...]:
        """Of a frame rate that the header contradicts."""
        rate, other = self.rate_hz, self.header.rate_hz
        if not 0 < other < np.inf or abs(other / rate - 1) <= RATE_TOLERANCE:
            return ()
        return (f"{self.path} has POINT:RATE {rate:g} and {other:g} Hz in its header: POINT:RATE is used",)

    @property
    def first_frame(self) -> int:
        """Index from 0 of the first frame in the capture."""
        return max(0, self.header.first - 1)


def read_c3d_file(path: Path) -> C3dFile:
    """Raises ForeignFile where it is no C3D file, is cut, or its parts contradict each other."""
    try:
        with open_regular(path) as file:
            size = file.seek(0, 2)
            return _read(path, file, size)
    except OSError as error:
        raise ForeignFile(
            f"{path} cannot be read: {describe_failure(error)}", RecordingCode.FOREIGN_UNREADABLE
        ) from error


def _read(path: Path, file: BinaryIO, size: int) -> C3dFile:
    header, processor, blocks = _header(path, file)
    if size > LARGEST:
        _refuse(path, RecordingCode.FOREIGN_WRONG_TYPE, f"is larger than {LARGEST >> 30} GiB; export a part of it")
    parameters = _parameters(path, file, size, header, processor, blocks)
    if header.start <= header.parameters_start:
        header = replace(header, start=BLOCK * (int(parameters.number("POINT", "DATA_START") or 1) - 1))
    layout = _layout(path, size, header, parameters)
    file.seek(header.start)
    data = file.read(layout.size(layout.points, layout.analog_values))
    values = processor.reals(data) if layout.number_size == 4 else processor.integers(data, is_signed=True)
    table = values.reshape(layout.frames, 4 * layout.points + layout.analog_values)
    return C3dFile(path, header, parameters, layout, table)


def _refuse(path: Path, code: RecordingCode, complaint: str) -> NoReturn:
    raise ForeignFile(f"{path} {complaint}", code)


def _header(path: Path, file: BinaryIO) -> tuple[C3dHeader, Processor, int]:
    """The header, the processor and the number of blocks of the parameters."""
    file.seek(0)
    block = file.read(BLOCK)
    is_c3d = len(block) == BLOCK and block[1] == SIGNATURE and block[0] > 1
    file.seek(BLOCK * (block[0] - 1) if is_c3d else 0)
    preamble = file.read(4)
    if not is_c3d or len(preamble) < 4 or preamble[3] not in (INTEL, DEC, MIPS):
        complaint = "does not begin as a C3D file does; was it renamed, or cut?"
        _refuse(path, RecordingCode.FOREIGN_WRONG_TYPE, complaint)
    processor = Processor(preamble[3])
    points, analog, first, last = struct.unpack(f"{processor.order}4H", block[2:10])
    start, per_frame = struct.unpack(f"{processor.order}2H", block[16:20])
    scale, rate = (float(processor.reals(block[at : at + 4])[0]) for at in (12, 20))
    parameters_start = BLOCK * (block[0] - 1)
    made = C3dHeader(parameters_start, BLOCK * (start - 1), points, analog, per_frame, first, last, scale, rate)
    return made, processor, preamble[2]


def _parameters(
    path: Path, file: BinaryIO, size: int, header: C3dHeader, processor: Processor, blocks: int
) -> C3dParameters:
    """The parameters, which end where the frames begin, or else after so many blocks."""
    start = header.parameters_start
    end = header.start if header.start > start else start + BLOCK * blocks
    if end > size:
        complaint = f"is cut: its parameters end at byte {end}, and it has {size}; {EXPORT_AGAIN}"
        _refuse(path, RecordingCode.FOREIGN_CUT, complaint)
    file.seek(start)
    try:
        parameters = C3dParameters(file.read(min(end - start, LARGEST_PARAMETERS)), processor)
    except ValueError as error:
        raise ForeignFile(
            f"{path} cannot be read as C3D: {error}; {EXPORT_AGAIN}", RecordingCode.FOREIGN_DAMAGED
        ) from error
    has_channels = bool(parameters.number("ANALOG", "USED"))
    for group, name in FINITE:
        number = parameters.number(group, name)
        is_positive = (group, name) in POSITIVE and (group == "POINT" or has_channels)
        if number is not None and not (np.isfinite(number) and (number > 0 or not is_positive)):
            expected = "a positive number" if is_positive else "a finite number"
            complaint = f"has {group}:{name} = {number:g}, expected {expected}; {EXPORT_AGAIN}"
            _refuse(path, RecordingCode.FOREIGN_DAMAGED, complaint)
    return parameters


def _layout(path: Path, size: int, header: C3dHeader, parameters: C3dParameters) -> C3dLayout:
    """Raises ForeignFile where header and parameters contradict each other and the size does not back the parameters.

    A header that counts channels instead of values is a case that it backs.
    """
    number = partial(parameters.number, "POINT")
    used, channels = number("USED"), parameters.number("ANALOG", "USED")
    points = header.points if used is None else int(used)
    per_frame = _samples_per_frame(header, parameters, int(channels or 0))
    if channels is None:
        channels = header.analog_values // max(1, per_frame)
    frames = _frames(header, parameters)
    real, integer = (C3dLayout(points, int(channels), per_frame, frames, size) for size in (4, 2))
    in_header, scale = (header.points, header.analog_values), number("SCALE") or header.scale
    room = size - header.start

    def fits(layout: C3dLayout, counts: tuple[int, int]) -> bool:
        """Whether the frames end with the file, whose last block is filled up."""
        return 0 <= room - layout.size(*counts) < BLOCK

    layout, other = (real, integer) if header.scale < 0 else (integer, real)
    if (scale < 0) != (header.scale < 0) and fits(other, in_header) and not fits(layout, in_header):
        layout = other
    counts = layout.points, layout.analog_values
    missing = layout.size(*counts) - room
    if missing > 0 and not (in_header != counts and fits(layout, in_header)):
        frame = max(1, layout.size(*counts) // max(1, frames))
        complaint = f"announces {counted(frames, 'frame')} and holds {max(0, room // frame)}; {EXPORT_AGAIN}"
        _refuse(path, RecordingCode.FOREIGN_CUT, complaint)
    if in_header != counts and fits(layout, in_header):
        complaint = (
            f"contradicts itself: its header counts {_listed(*in_header)}, its parameters {_listed(*counts)} a frame; "
            f"{EXPORT_AGAIN}"
        )
        _refuse(path, RecordingCode.FOREIGN_CONTRADICTORY, complaint)
    for count in _frames_in_parameters(parameters) if missing <= -BLOCK else ():
        if count > frames and fits(replace(layout, frames=count), counts):
            complaint = f"contradicts itself: its header counts {counted(frames, 'frame')}, its parameters {count}"
            _refuse(path, RecordingCode.FOREIGN_CONTRADICTORY, f"{complaint}; {EXPORT_AGAIN}")
    if header.last == MOST_COUNTED and missing <= -BLOCK:
        complaint = f"counts {frames} frames and holds more; {EXPORT_AGAIN}, in parts of fewer than {MOST_COUNTED}"
        _refuse(path, RecordingCode.FOREIGN_CONTRADICTORY, complaint)
    return layout


def _samples_per_frame(header: C3dHeader, parameters: C3dParameters, channels: int) -> int:
    """By the two rates, of which the quotient is rounded, where the header does not confirm another number."""
    rates = parameters.number("ANALOG", "RATE"), parameters.number("POINT", "RATE") or header.rate_hz
    if not rates[0] or not rates[1]:
        return header.per_frame
    quotient = rates[0] / rates[1]
    nearest = round(quotient) if 0.5 <= quotient < MOST_COUNTED else 0
    if nearest and channels * nearest == header.analog_values:
        return nearest
    is_confirmed = channels * header.per_frame == header.analog_values
    is_whole = nearest > 0 and abs(quotient / nearest - 1) <= RATE_TOLERANCE
    return header.per_frame if is_confirmed or not is_whole else nearest


def _frames(header: C3dHeader, parameters: C3dParameters) -> int:
    """By the header, whose 16 bits may be too few: then by the parameters that programs have added for that."""
    counted = header.last - header.first + 1
    if counted > 0 and header.last < MOST_COUNTED:
        return counted
    return max(0, counted, *_frames_in_parameters(parameters))


def _frames_in_parameters(parameters: C3dParameters) -> list[int]:
    first, last = (parameters.numbers("TRIAL", f"ACTUAL_{end}_FIELD", is_signed=False)[:2] for end in ("START", "END"))
    found = [parameters.number("POINT", "LONG_FRAMES"), parameters.number("POINT", "FRAMES")]
    if len(first) == len(last) == 2:
        found.append(float((last - first) @ (1, MOST_COUNTED + 1)) + 1)
    return [int(count) for count in found if count is not None and abs(count) < 2**31]


def _listed(points: int, analog_values: int) -> str:
    return f"{counted(points, 'point')} and {counted(analog_values, 'analog value')}"


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
        """The first of the numbers, integers without sign; None without one."""
        values = self.numbers(group, name, is_signed=False)
        return float(values[0]) if len(values) else None

    def _parts(self, group: str, name: str) -> Iterator[Parameter]:
        for suffix in ("", *map(str, range(2, ENTRIES_CONTINUED + 1))):
            part = self._by_name.get((group, name + suffix))
            if part is not None:
                yield part

    def _values(self, part: Parameter, *, is_signed: bool) -> Array:
        if part.kind == REAL:
            with np.errstate(invalid="ignore"):  # a signalling NaN
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
            raise ValueError(f"the record {shortened(name)} ends beyond the parameters")
        size = _size(section[end_of_name : end_of_name + 2], processor, len(section) - end_of_name)
        end = end_of_name + size if size else len(section)
        if end > len(section) or size == 1:
            raise ValueError(f"the record {shortened(name)} states a length of {size} bytes")
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
        raise ValueError(f"the parameter {shortened(name)} has no type")
    kind, count = struct.unpack_from("bB", body)
    dimensions = tuple(body[2 : 2 + count])
    size = math.prod(dimensions) * abs(kind)
    data = body[2 + count : 2 + count + size]
    if kind not in (CHARACTER, BYTE, INTEGER, REAL) or len(dimensions) < count or len(data) < size:
        raise ValueError(f"the parameter {shortened(name)} has {size} bytes of type {kind}, and {len(body)} are there")
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

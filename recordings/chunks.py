"""Read messages from an MCAP file that is whole, cut anywhere, or damaged.

mcap's own readers stop at the first damage or need the index at the end, so the records are framed here. A chunk is
valid if its CRC is correct. After damage, the next valid chunk is searched byte by byte.

Time and memory grow at most linearly with the size of the file, whatever it holds: see Allowance, which limits the cost
per byte of the file, so that a few kilobytes cannot unpack to gigabytes. Recorded files are far below them: samples
take twice the size of the file, and a message takes about 100 bytes.
"""

from __future__ import annotations

import os
import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, NoReturn

import zstandard
from lz4.frame import LZ4FrameDecompressor
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Header, McapRecord, Message, Schema
from mcap.stream_reader import get_chunk_data_stream
from mcap.writer import MCAP0_MAGIC

from documents.regular_file import open_regular
from recordings.errors import RecordingCode, RecordingError
from recordings.topics import PROFILE, SCHEMA_OF_TOPIC

LARGEST_CHUNK = 64 * 2**20
"""Bytes. The writer closes a chunk at 1 MiB; a length beyond this is damage, and is not allocated."""
UNPACKED, UNPACKED_PER_BYTE = 64 * 2**20, 50
"""Bytes that the chunks of a file may unpack to: a constant, plus this for every byte of the file."""
RECORDS, BYTES_PER_RECORD = 20_000, 8
"""Records that the chunks may hold: a constant, plus one for every BYTES_PER_RECORD of the file."""
SEARCHED_AGAIN = 4
"""Bytes that searches after damage may read again, as a multiple of the size of the file."""
_PREFIX = struct.Struct("<BQ")
_KNOWN = frozenset(int(opcode) for opcode in Opcode)
_FIRST_PRIVATE_OPCODE = 0x80
_PARSED = frozenset({Opcode.HEADER, Opcode.CHUNK, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE})
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time; the rest is the message's own
_DECLARATIONS: dict[int, type[Schema] | type[Channel]] = {Opcode.SCHEMA: Schema, Opcode.CHANNEL: Channel}
_CHUNK_START = re.compile(rb"\x06(?=.{36}\x04\0\0\0zstd)", re.DOTALL)  # opcode, length, times, size, CRC, "zstd"
_CHUNK_START_LENGTH = 45
_CHUNK_HEAD = struct.Struct("<xQ36xQ")  # the record's length, and behind "zstd" that of the compressed bytes
_SEARCH_WINDOW = 2**16


@dataclass(frozen=True)
class Entry:
    """One message as it stands in the file; chunk_offset is the byte where its chunk begins."""

    topic: str
    schema: str
    log_time_ns: int
    sequence: int
    data: bytes
    chunk_offset: int


@dataclass(frozen=True)
class Damage:
    """Bytes from offset up to end that could not be read, and why; end is the file's size where nothing follows.

    is_cut  whether the file merely ends here, within or before a record, as when its writer was killed
    """

    offset: int
    end: int
    reason: str
    is_cut: bool = False

    def __str__(self) -> str:
        where = f"bytes {self.offset} to {self.end}" if self.end > self.offset else f"byte {self.offset}"
        return f"damage at {where}: {self.reason}"


def read_entries(path: Path) -> Iterator[Entry | Damage]:
    """Every readable message and every damage, in file order, with one chunk in memory at a time.

    Raises RecordingError if the file cannot be opened, the disk fails, or the file unpacks to far more than a recorder
    writes; other damage is returned.
    """
    channels: dict[int, tuple[str, str]] = {}
    schemas: dict[int, str] = {}
    try:
        with open_regular(path) as file:
            for offset, found in _walk(file):
                match found:
                    case Header(profile=profile) if profile == PROFILE:
                        # The ids are part of the format, so that a lost first chunk does not orphan the rest.
                        channels.update(enumerate(SCHEMA_OF_TOPIC.items(), start=1))
                    case Schema(id=number, name=name):
                        schemas[number] = name
                    case Channel(id=number, topic=topic, schema_id=schema):
                        channels[number] = (topic, schemas.get(schema, ""))
                    case Message(channel_id=number) if number in channels:
                        topic, name = channels[number]
                        yield Entry(topic, name, found.log_time, found.sequence, found.data, offset)
                    case Damage():
                        yield found
    except OSError as error:
        raise RecordingError(f"{path} cannot be read: {error.strerror or error}", RecordingCode.UNREADABLE) from error
    except Excess as error:
        raise RecordingError(
            f"{path} {error}; no recorder wrote it, and it is not read", RecordingCode.TOO_LARGE
        ) from error


class _BrokenError(Exception):
    """The bytes here are not the record they should be.

    is_cut      they are its beginning, and the file ends
    read_up_to  where those end that were looked at
    """

    def __init__(self, reason: str, *, is_cut: bool = False, read_up_to: int = 0) -> None:
        super().__init__(reason)
        self.is_cut, self.read_up_to = is_cut, read_up_to


def _walk(file: BinaryIO) -> Iterator[tuple[int, McapRecord | Damage]]:
    """The header, the records inside chunks and the damages, each with the offset of the record it stands in."""
    size = file.seek(0, os.SEEK_END)
    allowance = Allowance(size)
    offset = 0
    is_unchunked = True  # as other tools may write a file; after a chunk or damage, records outside of one do not count
    after_last_chunk = 0  # a search begins here, because a wrong length may have led past a good chunk
    while offset < size:
        try:
            opcode, records, end = _read_record(file, offset, size, allowance)
        except _BrokenError as error:
            start, broken = allowance.search_again(after_last_chunk, offset), offset
            is_unchunked = False
            opcode, (offset, records, end) = Opcode.CHUNK, _find_chunk(file, start, size, allowance)
            yield offset, Damage(min(broken, offset), offset, str(error), error.is_cut and offset == size)
            if offset == size:
                return
        if opcode == Opcode.FOOTER:
            return
        is_unchunked = is_unchunked and opcode != Opcode.CHUNK
        for record in records:
            if opcode in (Opcode.HEADER, Opcode.CHUNK) or is_unchunked:
                yield offset, record
        offset = end
        after_last_chunk = end if opcode == Opcode.CHUNK else after_last_chunk
    reason = "the file ends before its index, as when its writer was killed"
    yield size, Damage(size, size, reason, is_cut=True)


def _read_record(file: BinaryIO, offset: int, size: int, allowance: Allowance) -> tuple[int, list[McapRecord], int]:
    """(opcode, records to look at, end offset) of what begins at the offset; the magic counts as a record, too."""
    file.seek(offset)
    if offset == 0:
        if file.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
            raise _BrokenError("an MCAP file begins differently")
        return 0, [], len(MCAP0_MAGIC)
    prefix = file.read(_PREFIX.size)
    if len(prefix) < _PREFIX.size:
        raise _BrokenError("the file ends within a record", is_cut=True)
    opcode, length = _PREFIX.unpack(prefix)
    end = offset + _PREFIX.size + length
    if end > size:
        there = size - offset - _PREFIX.size
        raise _BrokenError(f"the record here has {length} bytes, of which {there} are there", is_cut=opcode in _KNOWN)
    if opcode == Opcode.FOOTER and end + len(MCAP0_MAGIC) != size:
        raise _BrokenError("the file has its last record here, and does not end with it")
    if opcode not in _KNOWN and opcode < _FIRST_PRIVATE_OPCODE:
        raise _BrokenError(f"no MCAP record has the opcode {opcode}")
    if opcode not in _PARSED:
        return opcode, [], end
    if length > LARGEST_CHUNK:
        raise _BrokenError(f"the record here has {length} bytes, expected at most {LARGEST_CHUNK}")
    try:
        return opcode, _parse(opcode, file.read(length), allowance), end
    except Excess:
        raise
    except Exception as error:  # whatever a parser trips over, the bytes are not the record they should be
        raise _BrokenError(f"the record here is damaged ({str(error) or 'it ends early'})", read_up_to=end) from error


def _parse(opcode: int, body: bytes, allowance: Allowance) -> list[McapRecord]:
    stream = ReadDataStream(BytesIO(body))
    if opcode == Opcode.HEADER:
        return [Header.read(stream)]
    if opcode != Opcode.CHUNK:
        allowance.hold(1)
        record = _record(opcode, body)
        return [] if record is None else [record]
    chunk = Chunk.read(stream)
    if stream.count != len(body):
        raise ValueError(f"a chunk of {stream.count} bytes in a record of {len(body)}")
    if chunk.uncompressed_size > LARGEST_CHUNK:
        raise ValueError(f"a chunk announces {chunk.uncompressed_size} bytes")
    # The compressed bytes state their size too, and it is theirs that would be allocated.
    if chunk.compression == "zstd" and zstandard.frame_content_size(chunk.data) != chunk.uncompressed_size:
        raise ValueError("a chunk announces two different sizes")
    if chunk.compression not in {"zstd", "lz4", ""}:
        raise ValueError(f"a chunk is compressed by {chunk.compression!r}, expected zstd or lz4")
    allowance.unpack(chunk.uncompressed_size)
    return list(_chunk_records(_without_lz4(chunk), allowance))


def _without_lz4(chunk: Chunk) -> Chunk:
    """The chunk, unpacked if it is compressed by lz4, whose frames need not state their size."""
    if chunk.compression != "lz4":
        return chunk
    data = LZ4FrameDecompressor().decompress(chunk.data, max_length=chunk.uncompressed_size + 1)
    if len(data) != chunk.uncompressed_size:
        raise ValueError("a chunk announces another size than it has")
    return replace(chunk, compression="", data=data)


def _chunk_records(chunk: Chunk, allowance: Allowance) -> Iterator[McapRecord]:
    """Its schemas, channels and messages; the package's own way takes three times as long, and most of a reading."""
    stream, size = get_chunk_data_stream(chunk, validate_crc=True)
    data, place, left = stream.read(size), 0, allowance.records
    try:
        while place < size and left >= 0:
            left -= 1
            opcode, length = _PREFIX.unpack_from(data, place)
            place += _PREFIX.size
            if place + length > size:
                raise ValueError(f"a record of {length} bytes where its chunk has {size - place}")
            record = _record(opcode, data[place : place + length])
            if record is not None:
                yield record
            place += length
    finally:
        allowance.hold(allowance.records - left)


def _record(opcode: int, body: bytes) -> McapRecord | None:
    """A message, schema or channel; None of any other record."""
    if opcode == Opcode.MESSAGE:
        channel, sequence, log_time, publish_time = _MESSAGE.unpack_from(body)
        data = body[_MESSAGE.size :]
        return Message(channel, log_time=log_time, data=data, publish_time=publish_time, sequence=sequence)
    declaration = _DECLARATIONS.get(opcode)
    return None if declaration is None else declaration.read(ReadDataStream(BytesIO(body)))


def _find_chunk(file: BinaryIO, start: int, size: int, allowance: Allowance) -> tuple[int, list[McapRecord], int]:
    """The next whole chunk as (offset, records, end); at the size of the file where there is none."""
    search_from = start
    for offset in _chunk_heads(file, start, size):
        if offset < search_from:
            continue
        try:
            _, records, end = _read_record(file, offset, size, allowance)
        except _BrokenError as error:
            search_from = allowance.search_again(offset + 1, error.read_up_to)
        else:
            return offset, records, end
    return size, [], size


def _chunk_heads(file: BinaryIO, start: int, size: int) -> Iterator[int]:
    """Offsets of bytes that look like a compressed chunk whose two lengths agree."""
    while start < size:
        file.seek(start)
        window = file.read(_SEARCH_WINDOW + _CHUNK_HEAD.size)
        for found in _CHUNK_START.finditer(window, 0, _SEARCH_WINDOW + _CHUNK_START_LENGTH - 1):
            if found.start() + _CHUNK_HEAD.size <= len(window):
                length, of_data = _CHUNK_HEAD.unpack_from(window, found.start())
                if length == _CHUNK_HEAD.size - _PREFIX.size + of_data:
                    yield start + found.start()
        start += _SEARCH_WINDOW


class Excess(RecordingError):
    """The file exceeds the limits for its size."""

    general_code = RecordingCode.TOO_LARGE


class Allowance:
    """Remaining allowance while a file of `size` bytes is read."""

    def __init__(self, size: int) -> None:
        self._size = size
        self._unpacked = self._most_unpacked = UNPACKED + UNPACKED_PER_BYTE * size
        self._searched_again = SEARCHED_AGAIN * size
        self.records = self._most_records = RECORDS + size // BYTES_PER_RECORD

    def unpack(self, count: int) -> None:
        """Raises Excess where these bytes are too many."""
        self._unpacked -= count
        if self._unpacked < 0:
            self._exceed(f"unpacks to more than {self._most_unpacked} bytes")

    def hold(self, records: int) -> None:
        """Raises Excess where these records are too many."""
        self.records -= records
        if self.records < 0:
            self._exceed(f"holds more than {self._most_records} records")

    def search_again(self, start: int, end: int) -> int:
        """Where a search continues after `start` to `end` held nothing: at `start`, while it may be read again."""
        self._searched_again -= max(0, end - start)
        return start if self._searched_again >= 0 else max(start, end)

    def _exceed(self, what: str) -> NoReturn:
        raise Excess(f"{what} in a file of {self._size} bytes")

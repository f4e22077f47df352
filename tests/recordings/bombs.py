"""Recordings of a few kilobytes that would unpack to gigabytes, or be searched for minutes: bytes, made by hand."""

import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import zstandard

from recordings import topics
from tests.recordings.trials import chunk_ends, record, trial

_CLASSES = topics.wire_classes()
_CHUNK_LIMIT = 64 * 2**20


def events_bomb(path: Path) -> Path:
    """One chunk of some kilobytes with as many events as it may hold, 1.9 million."""
    return _file(path, chunk(_message(topics.EVENTS) * 1_900_000))


def empty_records_bomb(path: Path) -> Path:
    """Chunks of seven million empty records each."""
    return _file(path, chunk(_record(0x80, b"") * (_CHUNK_LIMIT // 9)) * 20)


def zeros_bomb(path: Path) -> Path:
    """Chunks of 64 MB in one message of a topic that is not ours; 4 MB of them unpack to 40 GB."""
    one = chunk(_record(0x05, struct.pack("<HIQQ", 999, 0, 0, 0) + bytes(_CHUNK_LIMIT - 100)))
    return _file(path, one * (4_000_000 // len(one)))


def fake_heads_bomb(path: Path) -> Path:
    """4 MB of what looks like the beginning of a chunk; both lengths of each reach to the end of the file."""
    count = 4_000_000 // 80
    heads = [_head(of_data=80 * (count - i) - 53, size=2**20) for i in range(count)]
    return _file(path, b"\xff" + b"".join(head + _frame_header(2**20).ljust(27, b"\0") for head in heads))


def nested_heads_bomb(path: Path) -> Path:
    """4 MB of chunks, each within the one before it, whose compressed bytes decode up to the last one's."""
    raw = b"\x00" * 120_000
    frame = zstandard.ZstdCompressor(level=1).compress(raw)
    count = 4_000_000 // 200
    parts = []
    for i in range(count):
        rest = 200 * (count - i) - 53
        parts.append((_head(of_data=rest, size=len(raw)) + frame).ljust(200, b"\x06")[:200])
    return _file(path, b"\xff" + b"".join(parts))


def hidden_chunks_bomb(path: Path) -> Path:
    """Small chunks inside of a record, each followed by a long run of empty records up to a broken one."""
    small = chunk(_record(0x80, b""))
    inside = (small + _record(0x80, b"") * 3) * (1_000_000 // (len(small) + 27))
    run = _record(0x80, b"") * 40_000
    return _file(path, _record(0x80, inside[:1_000_000]) + run + b"\x7f" * 20)


def valueless_bomb(path: Path) -> Path:
    """Blocks of some bytes that announce a million samples each, without a value."""
    return _file(path, chunk(_message(topics.FORCE, sample_count=1_000_000, sample_number_step=1) * 10_000))


def skipping_bomb(path: Path) -> Path:
    """Blocks of a million zeros whose sample numbers skip every other one."""
    block = _message(topics.FORCE, sample_count=1_000_000, sample_number_step=2, values=bytes(8_000_000))
    return _file(path, chunk(block * 7))


BOMBS: dict[str, Callable[[Path], Path]] = {
    "events": events_bomb,
    "empty records": empty_records_bomb,
    "zeros": zeros_bomb,
    "fake heads": fake_heads_bomb,
    "nested heads": nested_heads_bomb,
    "hidden chunks": hidden_chunks_bomb,
    "no values": valueless_bomb,
    "skipping": skipping_bomb,
}


def chunk_with_an_event() -> bytes:
    """What a search is to find."""
    return chunk(_message(topics.EVENTS, kind="mark", text="here", source="operator"))


def chunk(data: bytes) -> bytes:
    """An MCAP chunk with the right CRC."""
    packed = zstandard.ZstdCompressor(level=3).compress(data)
    return _head(of_data=len(packed), size=len(data), crc=zlib.crc32(data)) + packed


def _head(*, of_data: int, size: int, crc: int = 1) -> bytes:
    fixed = struct.pack("<QQQII4sQ", 0, 0, size, crc, 4, b"zstd", of_data)
    return struct.pack("<BQ", 0x06, len(fixed) + of_data) + fixed


def _frame_header(size: int) -> bytes:
    """Of a single-segment zstd frame that states its content's size in four bytes (RFC 8878, 3.1.1.1)."""
    return b"\x28\xb5\x2f\xfd" + bytes([0b10100000]) + struct.pack("<I", size)


def _record(opcode: int, body: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(body)) + body


def _message(topic: str, **fields: Any) -> bytes:
    channel = list(topics.SCHEMA_OF_TOPIC).index(topic) + 1
    body: bytes = _CLASSES[topics.SCHEMA_OF_TOPIC[topic]](**fields).SerializeToString()
    return _record(0x05, struct.pack("<HIQQ", channel, 0, 0, 0) + body)


def _file(path: Path, data: bytes) -> Path:
    """A recording cut during its trial, which has its manifest, and these bytes after it."""
    whole = record(path, list(trial(0.5)))
    path.write_bytes(whole.read_bytes()[: chunk_ends(whole)[-2]] + data)
    return path

"""The index of the chunks, which MCAP puts at the end of a file: kept encoded while the file is written.

The package keeps an object for each chunk, some 600 bytes; a trial has ten chunks a second. Encoded it is a hundred
bytes, of which few change from one chunk to the next, so that compressed it is some 30. The file is the same.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from typing import Any, Self

from mcap.data_stream import RecordBuilder
from mcap.records import ChunkIndex
from mcap.writer import Writer


def keep_index_encoded(writer: Writer) -> None:
    """To be called before the first chunk.

    The package offers no door for this. Should it rename its list, nothing breaks and memory grows as it used to;
    a test sees it.
    """
    writer._Writer__chunk_indices = _EncodedIndex()  # type: ignore[attr-defined]


class _EncodedIndex:
    """What the package needs of its list: entries are appended, and at the end written one after the other."""

    def __init__(self) -> None:
        self._deflate = zlib.compressobj(level=1)
        self._encoded = bytearray()

    def append(self, entry: ChunkIndex) -> None:
        record = RecordBuilder()
        entry.write(record)
        self._encoded += self._deflate.compress(record.end())  # type: ignore[no-untyped-call]

    def __iter__(self) -> Iterator[Self]:
        """Itself, as the one entry that writes all."""
        yield self

    def write(self, summary: Any) -> None:
        """Once, when the file is finished."""
        summary.write(zlib.decompress(self._encoded + self._deflate.flush()))

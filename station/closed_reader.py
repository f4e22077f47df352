"""Output whose reader closes early, as `station info FILE | head -1`: the rest is discarded, and the verb continues."""

from __future__ import annotations

import errno
import io
import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

CLOSED = {errno.EPIPE, errno.EINVAL} if sys.platform == "win32" else {errno.EPIPE}
"""What a write to a pipe without a reader fails with."""


class ClosableOutput(io.FileIO):
    """A file descriptor that accepts everything, also after its reader has closed the pipe."""

    def write(self, data: ReadableBuffer, /) -> int:
        try:
            return super().write(data)
        except OSError as error:
            if error.errno not in CLOSED:
                raise
            return memoryview(data).nbytes


def without_broken_pipe(stream: io.TextIOWrapper) -> io.TextIOWrapper:
    """The stream; where it is a file or a pipe, it discards what its reader no longer takes."""
    is_unbuffered = isinstance(stream.buffer, io.FileIO)  # by PYTHONUNBUFFERED
    if not (is_unbuffered or isinstance(getattr(stream.buffer, "raw", None), io.FileIO)):
        return stream
    raw = ClosableOutput(stream.fileno(), "wb", closefd=False)
    output: Any = raw if is_unbuffered else io.BufferedWriter(raw)
    return io.TextIOWrapper(
        output, stream.encoding, stream.errors, line_buffering=stream.line_buffering, write_through=stream.write_through
    )

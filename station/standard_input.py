"""Lines that are typed or piped into the station."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Iterator
from typing import TextIO

READ_SIZE = 4096
LONGEST_LINE = 10_000
POLL_INTERVAL_S = 0.05


def read_lines(stream: TextIO | None) -> Iterator[str]:
    """Lines of sys.stdin as they arrive, until it ends or cannot be read. For a thread of its own.

    They are read from the file descriptor, so that no lock of the stream is held when the process ends. A service may
    have no standard input.
    """
    if stream is None:
        return
    rest = b""
    while data := _read(stream):
        *lines, rest = (rest + data).split(b"\n")
        rest = rest[-LONGEST_LINE:]
        for line in lines:
            yield _decode(line)
    if rest:
        yield _decode(rest)


def _decode(line: bytes) -> str:
    return line.decode("utf-8", errors="replace").lstrip("\ufeff")  # PowerShell sends a byte order mark


def _read(stream: TextIO) -> bytes:
    try:
        descriptor = stream.fileno()
        if sys.platform == "win32":
            _wait_for_data(descriptor)
        return os.read(descriptor, READ_SIZE)
    except (OSError, ValueError):  # closed, or the terminal belongs to another job
        return b""


def _wait_for_data(descriptor: int) -> None:
    """Wait without a pending read, which would block the libraries that query standard handles while they load.

    Raises OSError at the end of the pipe. A console or file is read at once.
    """
    if sys.platform == "win32":
        import _winapi
        import msvcrt

        handle, pause = msvcrt.get_osfhandle(descriptor), threading.Event()
        if _winapi.GetFileType(handle) == _winapi.FILE_TYPE_PIPE:
            while not _winapi.PeekNamedPipe(handle, 0)[0]:
                pause.wait(POLL_INTERVAL_S)

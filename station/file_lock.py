"""File lock between processes; the operating system releases the lock of a process that dies."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from documents.regular_file import append_to_regular


@contextmanager
def locked(path: Path, wait_s: float) -> Iterator[None]:
    """Hold the lock of this name. Its file remains, empty.

    Raises TimeoutError if another process holds it for longer than wait_s, and OSError if it cannot be acquired.
    """
    from filelock import FileLock, Timeout  # a tenth of the time in which a command that locks nothing starts

    append_to_regular(path).close()  # filelock < 3.20 truncates the file, so it must not be a link
    lock = FileLock(path, timeout=wait_s)
    try:
        lock.acquire()
    except Timeout as error:
        raise TimeoutError(errno.ETIMEDOUT, f"another process holds {path}") from error
    except NotImplementedError as error:  # a file system without locks, such as some network drives
        raise OSError(errno.ENOLCK, "its file system has no locks") from error
    try:
        yield
    finally:
        lock.release()

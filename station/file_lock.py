"""One process at a time: a lock that the operating system takes back from a process that dies."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from documents.regular_file import append_to_regular


@contextmanager
def locked(path: Path, wait_s: float) -> Iterator[None]:
    """Holds the lock of this name, a file that stays behind empty.

    Raises TimeoutError where another holds it for longer than wait_s, any other OSError where it cannot be had at all.
    """
    append_to_regular(path).close()  # filelock before 3.20 empties the file it locks: no link to another
    lock = FileLock(path, timeout=wait_s)
    try:
        lock.acquire()
    except Timeout as error:
        raise TimeoutError(errno.ETIMEDOUT, f"another process holds {path}") from error
    except NotImplementedError as error:  # filelock's word for a file system without locks, as some network drives are
        raise OSError(errno.ENOLCK, "its file system has no locks") from error
    try:
        yield
    finally:
        lock.release()

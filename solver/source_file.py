"""The files that a problem is given in: regular ones, and none larger than such a file can be.

Loads name the file of their data, which may be a device without an end or a pipe that waits for ever.
"""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

LARGEST_TABLE, LARGEST_MODEL, LARGEST_SUIT = 128 * 2**20, 64 * 2**20, 32 * 2**10
"""Bytes of a motion or other table, of an OpenSim document, of a suit in TOML, whose dotted keys cost their square."""


def read_source(path: Path, most_bytes: int) -> bytes:
    """All of a regular file. OSError for anything else, and for more than most_bytes."""
    descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    with os.fdopen(descriptor, "rb", closefd=True) as file:
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            raise OSError(errno.EINVAL, "a pipe or a device, expected a regular file", str(path))
        content = file.read(most_bytes + 1)
    if len(content) > most_bytes:
        raise OSError(
            errno.EFBIG, f"more than {most_bytes / 1e6:.3g} MB, the most that is read of such a file", str(path)
        )
    return content

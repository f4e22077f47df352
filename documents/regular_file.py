"""Read, append to, replace and lock regular files only: a pipe blocks, a device has no end, a link leads elsewhere.

Errors are OSError; errno is their code. The operating system releases the lock of a process that dies.
"""

from __future__ import annotations

import errno
import os
import shutil
import stat
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import BinaryIO, TypeVar

T = TypeVar("T")

LARGEST_TABLE, LARGEST_MODEL, LARGEST_SUIT = 128 * 2**20, 64 * 2**20, 32 * 2**10
"""Largest sizes [bytes]: a motion or other table, an OpenSim document, a suit in TOML."""

PIECE = 2**20
DRAFTS, HELD = ".draft-", ".held"
"""Prefix of the folders of drafts, and the file in each of them that its process keeps locked."""
REPLACE_TIMEOUT_S, REPLACE_PAUSE_S = 3.0, 0.1
"""Wall seconds: a virus scanner holds a new file for about one."""

_NO_WAIT = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)  # opening a pipe would wait for its writer
_NO_LINK = getattr(os, "O_NOFOLLOW", 0)
_own_drafts: set[Path] = set()
"""A lock of this process is no obstacle to itself on some network drives."""


def ensure_path(argument: str, value: object) -> Path:
    """The path that was given in Python. Raises TypeError, which names the argument, for anything else."""
    if not isinstance(value, str | os.PathLike):
        raise TypeError(f"{argument} should be a path, and got a {type(value).__name__}")
    return Path(value)


def open_regular(path: Path) -> BinaryIO:
    """A regular file, or a link to one, open for reading. OSError for anything else."""
    return os.fdopen(_checked(os.open(path, os.O_RDONLY | _NO_WAIT), path), "rb")


def read_regular(path: Path, most_bytes: int) -> bytes:
    """Content of a regular file. OSError for anything else, and for more than most_bytes."""
    content = bytearray()
    with open_regular(path) as file:  # in pieces: read(n) reserves n bytes, of which a small file needs few
        while len(content) <= most_bytes and (piece := file.read(min(PIECE, most_bytes + 1 - len(content)))):
            content += piece
    if len(content) > most_bytes:
        raise OSError(
            errno.EFBIG, f"larger than {most_bytes / 1e6:.3g} MB, the largest file of this kind that is read", str(path)
        )
    return bytes(content)


def describe_failure(error: Exception) -> str:
    """Why a file cannot be read, without its path: the sentence around it has the path."""
    return (error.strerror if isinstance(error, OSError) else None) or str(error)


def sync_file(descriptor: int) -> None:
    """os.fsync, whose error is about the drive: on Windows it is "Bad file descriptor" whatever the drive answers."""
    try:
        os.fsync(descriptor)
    except OSError as error:
        raise OSError(error.errno, f"the drive did not flush it to the disk ({error.strerror})") from error


def append_to_regular(path: Path) -> BinaryIO:
    """Open a file for reading and appending; create it if it does not exist.

    OSError for a symbolic link and for a file with a second hard link: writing would change a file elsewhere.
    """
    if path.is_symlink():
        raise OSError(errno.ELOOP, "a symbolic link, expected a regular file; remove the link", str(path))
    flags = os.O_RDWR | os.O_APPEND | os.O_CREAT | _NO_WAIT | _NO_LINK
    descriptor = _checked(os.open(path, flags, 0o666), path)
    if os.fstat(descriptor).st_nlink > 1:
        os.close(descriptor)
        raise OSError(errno.EMLINK, "a file with a second hard link, expected one without; copy it", str(path))
    return os.fdopen(descriptor, "a+b")


@contextmanager
def replaced(path: Path, *, with_folder: bool = True) -> Iterator[Path]:
    """A temporary path of the same name; its file replaces `path` when the block ends without an error.

    An OSError names the path, not the temporary one, unless the block failed at another file. with_folder: create the
    folder if it does not exist.
    """
    draft = None
    try:
        if with_folder:
            path.parent.mkdir(parents=True, exist_ok=True)
        with draft_folder(path.parent) as folder:
            draft = folder / path.name
            yield draft
            replace_file(draft, path)
    except OSError as error:
        named = str(error.filename or draft)
        if error.errno is None or (draft is not None and str(draft.parent) not in named):
            raise
        raise OSError(error.errno, error.strerror, str(path)) from error


@contextmanager
def draft_folder(parent: Path) -> Iterator[Path]:
    """A folder for one draft, removed when the block ends. Those of processes that were killed are removed before."""
    for left in parent.glob(f"{DRAFTS}*"):
        _remove_if_left(left)
    with ExitStack() as stack:
        yield _held_folder(stack, parent)


def _held_folder(stack: ExitStack, parent: Path) -> Path:
    while True:  # until no other process has taken the folder, not yet locked, for one that was left
        # a virus scanner may still read the draft when its folder is removed
        made = tempfile.TemporaryDirectory(prefix=DRAFTS, dir=parent, ignore_cleanup_errors=True)
        folder = Path(stack.enter_context(made))
        _own_drafts.add(folder)
        stack.callback(_own_drafts.discard, folder)
        try:
            stack.enter_context(locked(folder / HELD, wait_s=0.0))
        except (TimeoutError, FileNotFoundError):
            continue
        except OSError as error:
            if error.errno != errno.ENOLCK:
                raise
        if (folder / HELD).exists():
            return folder


def _remove_if_left(folder: Path) -> None:
    """Remove the folder of a draft if no process holds it."""
    if folder in _own_drafts:
        return
    with suppress(OSError):
        folder.rmdir()  # its process was killed before it locked the folder
    if (folder / HELD).exists():
        with suppress(OSError):
            with locked(folder / HELD, wait_s=0.0):
                shutil.rmtree(folder, ignore_errors=True)
            shutil.rmtree(folder, ignore_errors=True)  # on Windows, the open file was in the way


def replace_file(draft: Path, path: Path) -> None:
    """Rename draft to path, in place of a file of that name, once no other program has one of the two open."""
    once_released(lambda: draft.replace(path), path)


def once_released(act: Callable[[], T], path: Path) -> T:
    """Act on a file. On Windows, try for REPLACE_TIMEOUT_S while another program has it open without sharing."""
    give_up_s = time.perf_counter() + REPLACE_TIMEOUT_S
    while True:
        try:
            return act()
        except PermissionError as error:
            if sys.platform != "win32":
                raise
            if path.is_dir():  # which Windows calls a lack of permission
                raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path)) from error
            if time.perf_counter() > give_up_s:
                in_use = "open in another program, or read-only; close it there and run the command again"
                raise PermissionError(errno.EACCES, in_use, str(path)) from error
            time.sleep(REPLACE_PAUSE_S)


def _checked(descriptor: int, path: Path) -> int:
    mode = os.fstat(descriptor).st_mode
    if stat.S_ISREG(mode):
        return descriptor
    os.close(descriptor)
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    raise OSError(errno.EINVAL, "a pipe or a device, expected a regular file", str(path))


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

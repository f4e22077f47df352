"""The file system as Windows has it, laid over the one of this machine, for the process that asks for it.

Refuses to delete, rename or replace a file that is open anywhere in this process; opens no folder; os.rename replaces
nothing; names that Windows gives no file are refused, as are paths of 260 characters. Names differ by case only here.
Does not imitate: files that are open in another process, locks on byte ranges, short names, attributes.
"""

import builtins
import errno
import io
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from station.protocol import LONGEST_PATH, windows_name_fault


def behave_as_windows(monkeypatch: pytest.MonkeyPatch, below: Path) -> None:
    """From now on, for all files below this folder."""
    for name in ("unlink", "remove", "rename", "replace", "rmdir"):
        monkeypatch.setattr(os, name, _guarded(getattr(os, name), name, below))
    for module, name in ((builtins, "open"), (io, "open"), (os, "open"), (os, "mkdir")):
        monkeypatch.setattr(module, name, _named(getattr(module, name), name, below))
    monkeypatch.setattr(shutil, "_use_fd_functions", False)


def _guarded(call: Callable[..., Any], name: str, below: Path) -> Callable[..., Any]:
    def guarded(*paths: Any, **options: Any) -> Any:
        for path in paths:
            if _is_below(path, below) and name != "rmdir" and _is_open(path):
                raise PermissionError(errno.EACCES, "it is being used by another process", os.fspath(path))
        if name == "rename" and _is_below(paths[1], below) and os.path.lexists(paths[1]):
            raise FileExistsError(errno.EEXIST, "it exists", os.fspath(paths[1]))
        return call(*paths, **options)

    return guarded


def _named(call: Callable[..., Any], name: str, below: Path) -> Callable[..., Any]:
    def named(path: Any, *arguments: Any, **options: Any) -> Any:
        if not isinstance(path, int) and _is_below(path, below):
            if why := windows_name_fault(Path(os.fsdecode(path)).name):
                raise OSError(errno.EINVAL, why, os.fspath(path))
            if len(os.path.abspath(path)) > LONGEST_PATH:  # noqa: PTH100  (as the system counts)
                raise FileNotFoundError(errno.ENOENT, "the path is too long", os.fspath(path))
            if name == "open" and os.path.isdir(path):  # noqa: PTH112
                raise PermissionError(errno.EACCES, "it is a folder", os.fspath(path))
        return call(path, *arguments, **options)

    return named


def _is_below(path: Any, below: Path) -> bool:
    return not isinstance(path, int) and Path(os.fsdecode(path)).absolute().is_relative_to(below)


def _is_open(path: Any) -> bool:
    """In this process, by any descriptor."""
    try:
        wanted = Path(os.fsdecode(path)).stat()
    except OSError:
        return False
    for number in os.listdir("/proc/self/fd"):  # noqa: PTH208
        try:
            if os.path.samestat(os.fstat(int(number)), wanted):
                return True
        except OSError:  # closed meanwhile
            continue
    return False

"""The folders of a command line: those that it reads, and the one that it writes its results to."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from documents.message import Message
from station.errors import StationError
from station.exit_code import WRONG_USAGE
from station.messages.assessment_messages import InputCode
from station.messages.setup_messages import FolderCode


def require_folder(folder: Path, refusal: Callable[[Message[Any]], Exception]) -> None:
    """Raise the refusal for a path that is no folder."""
    if not folder.is_dir():
        raise refusal(Message(FolderCode.NOT_A_FOLDER, {"folder": str(folder)}))


class NotAFolder(StationError):
    """The output of the command line, or a folder above it, is a file."""

    exit_code = WRONG_USAGE


def ensure_folder(output: Path) -> None:
    """Raise NotAFolder or PermissionError, before anything is computed, if results cannot be written to output.

    Windows refuses a folder only when a file is written into it.
    """
    found = next(path for path in (output, *output.absolute().parents) if path.exists())
    if not found.is_dir():
        raise NotAFolder(Message(InputCode.OUTPUT_IS_FILE, {"path": str(found)}))
    if not os.access(found, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(found))

"""The folder that a command writes its results to."""

from __future__ import annotations

from pathlib import Path

from documents.message import Message
from station.errors import StationError
from station.exit_code import WRONG_USAGE
from station.messages.assessment_messages import InputCode


class NotAFolder(StationError):
    """The output of the command line, or a folder above it, is a file."""

    exit_code = WRONG_USAGE


def ensure_folder(output: Path) -> None:
    """Raise NotAFolder, before anything is computed, if results cannot be written to output."""
    found = next(path for path in (output, *output.absolute().parents) if path.exists())
    if not found.is_dir():
        raise NotAFolder(Message(InputCode.OUTPUT_IS_FILE, {"path": str(found)}))

"""File names that Windows does not allow, so that a session can move between systems."""

from __future__ import annotations

from pathlib import Path

from station.messages.codes import RefusalCode
from station.messages.message import Message

LONGEST_PATH = 259
"""Characters, unless the administrator of the computer allows more."""
SUFFIX_LENGTH = 16
"""Characters that a recovery or a draft appends."""
FORBIDDEN = '<>:"/\\|?*'
RESERVED = {"CON", "PRN", "AUX", "NUL", *(f"{port}{digit}" for port in ("COM", "LPT") for digit in "123456789")}


def windows_name_fault(name: str) -> str:
    """Why Windows does not allow a file of this name, as a clause; "" if it does."""
    wrong = sorted({letter for letter in name if letter in FORBIDDEN or ord(letter) < 32})
    if wrong:
        return f"contains {' '.join(map(repr, wrong))}, which Windows does not allow in a file name"
    if name.partition(".")[0].rstrip(" ").upper() in RESERVED:
        return f"is {name.partition('.')[0]}, a device name on Windows"
    if name != name.rstrip(". "):
        return "ends in a dot or a space, which Windows removes"
    return ""


def check_path_length(path: Path) -> Message[RefusalCode] | None:
    """Refusal of a path that is too long for Windows; None if it is short enough."""
    excess = len(str(path.absolute())) + SUFFIX_LENGTH - LONGEST_PATH
    if excess <= 0:
        return None
    return Message(RefusalCode.PATH_TOO_LONG, {"path": str(path), "excess": excess, "longest": LONGEST_PATH})

"""Names that Windows gives no file, so that a session can move between systems."""

from __future__ import annotations

from pathlib import Path

LONGEST_PATH = 259
"""Characters, unless the computer's administrator allows more."""
SUFFIX_ROOM = 16
"""Characters for what a recovery or a draft appends."""
FORBIDDEN = '<>:"/\\|?*'
RESERVED = {"CON", "PRN", "AUX", "NUL", *(f"{port}{digit}" for port in ("COM", "LPT") for digit in "123456789")}


def why_no_windows_name(name: str) -> str:
    """A clause that says why no file can be called so on Windows; "" where one can."""
    wrong = sorted({letter for letter in name if letter in FORBIDDEN or ord(letter) < 32})
    if wrong:
        return f"holds {' '.join(map(repr, wrong))}, which no file name on Windows may"
    if name.partition(".")[0].rstrip(" ").upper() in RESERVED:
        return f"is {name.partition('.')[0]}, a device of Windows"
    if name != name.rstrip(". "):
        return "ends in a dot or a blank, which Windows drops"
    return ""


def why_path_too_long(path: Path) -> str:
    """A sentence, where the path leaves Windows no room; "" where it does."""
    length = len(str(path.absolute())) + SUFFIX_ROOM
    if length <= LONGEST_PATH:
        return ""
    return (
        f"{path} is {length - LONGEST_PATH} characters too long for Windows, which takes {LONGEST_PATH}; "
        "give --session a shorter path"
    )

"""SHA256SUMS: the hash of every recording and result in a session folder at the time the station wrote it.

The format is that of sha256sum, so that `sha256sum -c SHA256SUMS` checks a folder without the station.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable
from pathlib import Path

from documents.regular_file import read_regular
from fitting.results.seal import Standing
from station.file_lock import locked
from station.messages.file_codes import ChainCode
from station.messages.message import Message
from station.whole_file import write_whole

CHECKSUMS_FILE = "SHA256SUMS"
LINE = re.compile(r"([0-9a-f]{64}) [ *]([^/\\\n]+)")
LARGEST = 1 << 24
"""Bytes: a hundred thousand files."""
LOCK_WAIT_S = 10.0


def sha256_of(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def read_checksums(folder: Path) -> dict[str, str]:
    """File name → SHA-256; empty if there is no SHA256SUMS. Malformed lines are ignored."""
    try:
        text = read_regular(folder / CHECKSUMS_FILE, LARGEST).decode("utf-8", "replace")
    except OSError:
        return {}
    return {found[2]: found[1] for line in text.splitlines() if (found := LINE.fullmatch(line))}


def write_checksums(*paths: Path) -> None:
    """Record the current hash of every file in the SHA256SUMS of its folder."""
    for folder in {path.parent for path in paths}:
        with locked(folder / f".{CHECKSUMS_FILE}.lock", LOCK_WAIT_S):
            sums = read_checksums(folder) | {path.name: sha256_of(path) for path in paths if path.parent == folder}
            write_whole(folder / CHECKSUMS_FILE, "".join(f"{sums[name]}  {name}\n" for name in sorted(sums)))


def standing_of(path: Path, sha256: str | None = None) -> Standing:
    """Compare a file with its recorded hash; sha256, if it is known, saves reading the file again."""
    recorded = read_checksums(path.parent).get(path.name)
    if not path.is_file():
        return Standing.MISSING
    if recorded is None:
        return Standing.UNRECORDED
    return Standing.AS_RECORDED if (sha256 or sha256_of(path)) == recorded else Standing.CHANGED


def changed_files(paths: Iterable[Path]) -> list[Message[ChainCode]]:
    """A message for every file whose hash differs from the recorded one."""
    return [
        Message(ChainCode.CHANGED, {"file": path.name, "sums": CHECKSUMS_FILE})
        for path in paths
        if standing_of(path) is Standing.CHANGED
    ]

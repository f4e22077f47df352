"""SHA256SUMS: the hash of every recording and result of a session's folder as it was when the station wrote it.

The format is that of sha256sum, so that `sha256sum -c SHA256SUMS` checks a folder without the station.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable
from pathlib import Path

from documents.regular_file import read_regular
from fitting.seal import Standing
from station.file_lock import locked
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
    """File name → SHA-256; empty where nothing was recorded. Lines that are none are passed over."""
    try:
        text = read_regular(folder / CHECKSUMS_FILE, LARGEST).decode("utf-8", "replace")
    except OSError:
        return {}
    return {found[2]: found[1] for line in text.splitlines() if (found := LINE.fullmatch(line))}


def write_checksums(*paths: Path) -> None:
    """Records the files as they are now, each in the SHA256SUMS of its own folder."""
    for folder in {path.parent for path in paths}:
        with locked(folder / f".{CHECKSUMS_FILE}.lock", LOCK_WAIT_S):
            sums = read_checksums(folder) | {path.name: sha256_of(path) for path in paths if path.parent == folder}
            write_whole(folder / CHECKSUMS_FILE, "".join(f"{sums[name]}  {name}\n" for name in sorted(sums)))


def standing_of(path: Path, sha256: str | None = None) -> Standing:
    """How a file stands to what was recorded of it; sha256 spares reading it again."""
    recorded = read_checksums(path.parent).get(path.name)
    if not path.is_file():
        return Standing.MISSING
    if recorded is None:
        return Standing.UNRECORDED
    return Standing.AS_RECORDED if (sha256 or sha256_of(path)) == recorded else Standing.CHANGED


def changed_files(paths: Iterable[Path]) -> list[str]:
    """A sentence for each file that is not what it was when it was recorded."""
    return [
        f"{path.name} has changed since it was recorded: its SHA-256 is not the one in {CHECKSUMS_FILE}"
        for path in paths
        if standing_of(path) is Standing.CHANGED
    ]

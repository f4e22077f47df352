"""The recordings in the folder of a session. Apart from their fit, which takes long to import."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from recordings.errors import RecordingError
from recordings.reader import read_manifest

RECORDINGS = "[!.]*.mcap"
"""Hidden files are not in the list of hashes, so they are not read."""


def recordings_in(folder: Path) -> list[Path]:
    """The recordings of a session; a recovered or completed file replaces its original."""
    files = sorted(folder.glob(RECORDINGS))
    replaced = {_original_of(path) for path in files if _is(path, "recovered") or _is(path, "completed")}
    return [path for path in files if path not in replaced]


def pulls_in(folder: Path) -> list[Path]:
    """As recordings_in, without the poses and motions of the wearer, which a fit of a cuff does not use."""
    return [path for path in recordings_in(folder) if not _is_of_wearer(path)]


def originals_in(folder: Path) -> list[Path]:
    """As recordings_in, without recovered copies whose original exists: they contain no other data."""
    files = {path for path in folder.glob(RECORDINGS) if not _is(path, "completed")}
    kept = [path for path in files if not (_is(path, "recovered") and _original_of(path) in files)]
    completed = {_original_of(path): path for path in folder.glob(RECORDINGS) if _is(path, "completed")}
    return sorted({completed.get(path, path) for path in kept} | set(completed.values()))


def _is_of_wearer(path: Path) -> bool:
    """False for an unreadable manifest, so that the fit reports the file."""
    with suppress(RecordingError, OSError):
        return read_manifest(path).body is not None
    return False


def _is(path: Path, kind: str) -> bool:
    return path.suffixes[-2:-1] == [f".{kind}"]


def _original_of(path: Path) -> Path:
    return path.with_suffix("").with_suffix(".mcap")

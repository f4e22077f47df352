"""The recordings in the folder of a session. Apart from their fit, which takes long to import."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from mcap.writer import MCAP0_MAGIC

from recordings.errors import RecordingError
from recordings.manifest import Manifest
from recordings.reader import read_manifest

RECORDINGS = "[!.]*.mcap"
"""Hidden files are those of other programs, such as the `._` files of macOS."""


def recordings_in(folder: Path) -> list[Path]:
    """The recordings of a session; a whole recovered or completed file of the same trial replaces its original."""
    files, others = sorted(folder.glob(RECORDINGS)), useless_copies_in(folder)
    replaced = {_find_original(path) for path in files if _is_copy(path) and path not in others}
    return [path for path in files if path not in replaced and path not in others]


def useless_copies_in(folder: Path) -> list[Path]:
    """Recovered or completed files that have the name of a readable recording, and are cut or of another trial."""
    copies = [path for path in sorted(folder.glob(RECORDINGS)) if _is_copy(path)]
    return [path for path in copies if not _can_replace(path, _find_original(path))]


def pulls_in(folder: Path) -> list[Path]:
    """As recordings_in, without the poses and motions of the wearer, which a fit of a cuff does not use."""
    return [path for path in recordings_in(folder) if not _is_of_wearer(path)]


def motions_in(folder: Path) -> dict[Path, Manifest]:
    """The motions of the wearer with their manifests, also those of a maximal contraction."""
    found = {}
    for path in recordings_in(folder):
        with suppress(RecordingError, OSError):
            found[path] = read_manifest(path)
    return {path: manifest for path, manifest in found.items() if manifest.test == "motion"}


def originals_in(folder: Path) -> list[Path]:
    """As recordings_in, without recovered copies whose original exists: they contain no other data."""
    others = useless_copies_in(folder)
    files = {path for path in folder.glob(RECORDINGS) if not _is(path, "completed") and path not in others}
    kept = [path for path in files if not (_is(path, "recovered") and _find_original(path) in files)]
    completed = {_find_original(path): path for path in recordings_in(folder) if _is(path, "completed")}
    return sorted({completed.get(path, path) for path in kept} | set(completed.values()))


def _is_of_wearer(path: Path) -> bool:
    """False for an unreadable manifest, so that the fit reports the file."""
    with suppress(RecordingError, OSError):
        return read_manifest(path).body is not None
    return False


def _is_copy(path: Path) -> bool:
    return _is(path, "recovered") or _is(path, "completed")


def _can_replace(copy: Path, original: Path) -> bool:
    """Also where the original cannot be read: a recovered file holds the readable part of it."""
    try:
        replaced = _identity(read_manifest(original))
    except (RecordingError, OSError):
        return True
    with suppress(RecordingError, OSError), copy.open("rb") as file:
        file.seek(-len(MCAP0_MAGIC), os.SEEK_END)
        return file.read() == MCAP0_MAGIC and _identity(read_manifest(copy)) == replaced
    return False


def _identity(manifest: Manifest) -> tuple[object, ...]:
    cuff = manifest.cuff.name if manifest.cuff else None
    return cuff, manifest.test, manifest.repeat, manifest.donning, manifest.run, manifest.start_utc_ns


def _is(path: Path, kind: str) -> bool:
    return path.suffixes[-2:-1] == [f".{kind}"]


def _find_original(path: Path) -> Path:
    return path.with_suffix("").with_suffix(".mcap")

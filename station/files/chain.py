"""Verify the chain from the report to the recordings: the hashes of its inputs in every file against the files."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from documents.plain_data import PlainDataError, parse_json, read_json
from documents.regular_file import read_regular
from fitting.cuffs.cuffs_file import CUFFS_FILE, CuffsFileError, read_cuffs
from fitting.results.seal import SEAL, Standing, digest
from recordings.errors import RecordingError
from recordings.reader import survey_file
from solver.suit.suit import BUNDLED_SUIT
from station.assessment.assessment_json import ASSESSMENT_FILE
from station.checksums import CHECKSUMS_FILE, read_checksums, sha256_of
from station.errors import StationError
from station.messages.file_codes import ChainCode
from station.messages.message import Message
from station.recordings_of_session import recordings_in

REPORT_FILE, NUMBERS_FILE = "report.html", "report.json"
LARGEST_REPORT = 1 << 28
"""Bytes; the figures are in it."""
INPUTS = re.compile(r'<script type="application/json" id="inputs">(.*?)</script>', re.DOTALL)


class ChainError(StationError):
    """The folder cannot be verified."""


@dataclass(frozen=True)
class Link:
    """One step of the chain: the file that was read or written, and its comparison with the recorded hash.

    code: of the number of the report that does not agree with its source
    """

    what: str
    standing: Standing
    detail: str = ""
    code: str = ""

    def __str__(self) -> str:
        detail = f"{self.detail} [{self.code}]" if self.code else self.detail
        return f"{self.what}: {self.standing}" + (f" ({detail})" if detail else "")


def verify_folder(folder: Path) -> list[Link]:
    """Every link, and the damage inside recordings.

    Raises ChainError for a folder without files to verify, or with a pipe or device under the name of one of them.
    """
    if not folder.is_dir():
        raise ChainError(Message(ChainCode.NOT_A_FOLDER, {"folder": str(folder)}))
    _require_regular_files(folder)
    links = [*chain_of(folder), *damage_of(folder)]
    if not links:
        figures = {"folder": str(folder), "cuffs": CUFFS_FILE, "report": REPORT_FILE}
        raise ChainError(Message(ChainCode.NOTHING_TO_VERIFY, figures))
    return links


def chain_of(folder: Path, *, is_report_included: bool = True) -> list[Link]:
    """Every link from report.html to the recordings, by hash."""
    files = _Files(folder)
    links = [*_report_links(files)] if is_report_included else []
    return [
        *links,
        *_assessment_links(files),
        *_cuffs_links(files),
        *_checksum_links(files, is_report_included=is_report_included),
    ]


def damage_of(folder: Path) -> list[Link]:
    """A link for every recording that its CRCs show to be damaged; every recording is read to its end.

    A cut recording with a recovered copy has no link: the copy lists what is missing.
    """
    links = []
    for path in recordings_in(folder):
        try:
            damage = tuple(map(str, survey_file(path).damage))
        except (RecordingError, OSError) as error:
            damage = (str(error),)
        if damage:
            links.append(Link(f"{path.name}, its content", Standing.MISSING, damage[0]))
    return links


def _require_regular_files(folder: Path) -> None:
    """Reading a pipe would wait for its writer, and a device has no end."""
    for name in (CHECKSUMS_FILE, REPORT_FILE, ASSESSMENT_FILE, CUFFS_FILE, *read_checksums(folder)):
        path = folder / name
        if path.exists() and not path.is_file():
            raise ChainError(Message(ChainCode.NOT_REGULAR, {"path": str(path)}))


class _Files:
    """The files of the folder, every file hashed once."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.recorded = folder, read_checksums(folder)
        self.sha256 = cache(self._sha256)

    def link(self, reader: str, name: str, expected: str) -> Link:
        """Link of a file that was read by another one (reader), which recorded the expected hash."""
        return Link(f"{reader} ← {name}", self._compare(name, expected))

    def link_to_checksums(self, name: str) -> Link:
        """Link of a file to its hash in SHA256SUMS."""
        recorded = self.recorded.get(name)
        return Link(name, Standing.UNRECORDED if recorded is None else self._compare(name, recorded))

    def json(self, name: str) -> dict[str, Any]:
        """Content of a JSON object; empty for a file that is missing or not an object."""
        try:
            found = read_json(self.folder / name)
        except (OSError, PlainDataError):
            return {}
        return found if isinstance(found, dict) else {}

    def _compare(self, name: str, expected: str) -> Standing:
        found = self.sha256(name)
        if found is None:
            return Standing.MISSING
        return Standing.AS_RECORDED if found == expected else Standing.CHANGED

    def _sha256(self, name: str) -> str | None:
        path = self.folder / name
        return sha256_of(path) if path.name == name and path.is_file() else None


def _report_links(files: _Files) -> Iterator[Link]:
    path = files.folder / REPORT_FILE
    if not path.is_file():
        return
    yield files.link_to_checksums(REPORT_FILE)
    try:
        found = INPUTS.search(read_regular(path, LARGEST_REPORT).decode("utf-8", "replace"))
        inputs = parse_json(found[1]) if found else {}
    except (OSError, PlainDataError):
        inputs = {}
    for name, sha256 in _texts(inputs):
        yield files.link(REPORT_FILE, name, sha256)


def _assessment_links(files: _Files) -> Iterator[Link]:
    if not (files.folder / ASSESSMENT_FILE).is_file():
        return
    yield files.link_to_checksums(ASSESSMENT_FILE)
    plain = files.json(ASSESSMENT_FILE)
    for role, named in _texts(plain.get("inputs")):
        name, _, sha256 = named.rpartition(" ")
        if len(sha256) == 64:
            yield _input_link(files, role, name, sha256)
    worn = plain.get("cuffs")
    for cuff, figures in worn.items() if isinstance(worn, dict) else ():
        for key, figure in figures.items() if isinstance(figures, dict) else ():
            if isinstance(figure, dict) and figure.get("source") == Standing.BY_HAND:
                yield Link(f"{ASSESSMENT_FILE} ← {cuff}, {key} {figure.get('value')}", Standing.BY_HAND)


def _input_link(files: _Files, role: str, name: str, sha256: str) -> Link:
    """Link of an input of the assessment. Only the cuffs file is known to belong to this folder."""
    is_in_folder = role == "cuffs" and (name in files.recorded or files.sha256(name) is not None)
    if is_in_folder or files.sha256(name) == sha256:
        return files.link(ASSESSMENT_FILE, name, sha256)
    step = f"{ASSESSMENT_FILE} ← {name}"
    if sha256 == sha256_of(BUNDLED_SUIT):
        return Link(step, Standing.AS_RECORDED, "bundled with the station")
    return Link(step, Standing.UNRECORDED, "not in this folder")


def _cuffs_links(files: _Files) -> Iterator[Link]:
    path = files.folder / CUFFS_FILE
    if not path.is_file():
        return
    yield files.link_to_checksums(CUFFS_FILE)
    try:
        fits = read_cuffs(path)
    except CuffsFileError as error:
        yield Link(f"{CUFFS_FILE}, its content", Standing.CHANGED, str(error))
        return
    for name, fit in fits.items():
        remark = ", ".join(fit.remarks)
        yield Link(f"{CUFFS_FILE}, cuff {name}", fit.standing or Standing.UNRECORDED, remark)
    plain = files.json(CUFFS_FILE)
    seal = plain.get(SEAL)
    if isinstance(seal, dict):
        found = digest({key: value for key, value in plain.items() if key not in ("cuffs", SEAL)})
        is_kept = found == seal.get("session")
        yield Link(f"{CUFFS_FILE}, the session", Standing.AS_RECORDED if is_kept else Standing.CHANGED)
    yield from (files.link(CUFFS_FILE, name, sha256) for name, sha256 in _recordings(plain).items())


def _recordings(plain: Mapping[str, Any]) -> dict[str, str]:
    """File → SHA-256 of every recording that the fit read; files of older stations name only the trials it used."""
    recordings = plain.get("recordings")
    if isinstance(recordings, dict):
        return {name: str(entry.get("sha256")) for name, entry in recordings.items() if isinstance(entry, dict)}
    cuffs = plain.get("cuffs")
    used = [cuff.get("sources") for cuff in cuffs.values() if isinstance(cuff, dict)] if isinstance(cuffs, dict) else []
    return {name: sha256 for sources in used for name, sha256 in _texts(sources)}


def _checksum_links(files: _Files, *, is_report_included: bool) -> Iterator[Link]:
    """Links of the recordings, and of other files that the station wrote."""
    above = {REPORT_FILE, ASSESSMENT_FILE, CUFFS_FILE}
    names = {*files.recorded, *(path.name for path in files.folder.glob("*.mcap"))} - above
    for name in sorted(names if is_report_included else names - {NUMBERS_FILE}):
        yield files.link_to_checksums(name)
    absent = [name for name in sorted(above & set(files.recorded)) if not (files.folder / name).is_file()]
    for name in absent:
        if is_report_included or name != REPORT_FILE:
            yield Link(name, Standing.MISSING, f"recorded in {CHECKSUMS_FILE}")


def _texts(entries: Any) -> Iterator[tuple[str, str]]:
    """The pairs of an object whose values are strings."""
    for key, value in entries.items() if isinstance(entries, dict) else ():
        if isinstance(value, str):
            yield key, value

"""Verify the files of a session by its list of hashes, and every result by the hashes of its inputs.

The list is signed with an SSH key of the laboratory, and the signature verified, by ssh-keygen of OpenSSH.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from documents.plain_data import PlainDataError, read_json
from fitting.cuffs.cuffs_file import CUFFS_FILE, CuffsFileError, read_cuffs
from fitting.results.outcome import Standing
from recordings.errors import RecordingError
from recordings.reader import survey_file
from solver.suit.suit import BUNDLED_SUIT
from station.assessment.assessment_json import ASSESSMENT_FILE
from station.checksums import (
    CHECKSUMS_FILE,
    JOURNALS,
    SIGNATURE_FILE,
    files_below,
    is_below,
    is_session,
    journal_fault,
    list_folder,
    malformed_lines,
    read_checksums,
    sha256_of,
    standing_of,
    write_checksums,
)
from station.errors import StationError
from station.journal_lines import JOURNAL_FILE
from station.messages.file_messages import ChainCode
from station.messages.message import Message
from station.recordings_of_session import recordings_in

REPORT_FILE, NUMBERS_FILE = "report.html", "report.json"
LARGEST_REPORT = 1 << 28
"""Bytes; the figures are in it."""
NAMESPACE = "cuffstation"
TIMEOUT_S = 60.0


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


def add_files(folder: Path, paths: Sequence[Path]) -> None:
    """List files that another program added. Raises ChainError for a file that is not below the folder, or listed."""
    for path in paths:
        if list_folder(path) != folder.absolute() or standing_of(path) is not Standing.ADDED:
            raise ChainError(Message(ChainCode.NOT_ADDED, {"file": str(path), "folder": str(folder)}))
    write_checksums(*paths)


def chain_of(folder: Path, *, is_report_included: bool = True) -> list[Link]:
    """Every file of the folder by hash, and the inputs of its results."""
    files = _Files(folder)
    left_out = () if is_report_included else (REPORT_FILE, NUMBERS_FILE)
    return [
        *_file_links(files, left_out),
        *_assessment_links(files),
        *_cuffs_links(files),
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
    for name in (CHECKSUMS_FILE, REPORT_FILE, ASSESSMENT_FILE, CUFFS_FILE, JOURNAL_FILE, *read_checksums(folder)):
        path = folder / name
        if path.exists() and not path.is_file():
            raise ChainError(Message(ChainCode.NOT_REGULAR, {"path": str(path)}))


class _Files:
    """The files of the folder, every file hashed once."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.recorded = folder, read_checksums(folder)
        self.is_listed = (folder / CHECKSUMS_FILE).is_file()
        self.sha256 = cache(self._sha256)

    def link(self, reader: str, name: str, expected: str) -> Link:
        """Link of a file that was read by another one (reader), which recorded the expected hash."""
        return Link(f"{reader} ← {name}", self.compare(name, expected))

    def json(self, name: str) -> dict[str, Any]:
        """Content of a JSON object; empty for a file that is missing or not an object."""
        try:
            found = read_json(self.folder / name)
        except (OSError, PlainDataError):
            return {}
        return found if isinstance(found, dict) else {}

    def compare(self, name: str, expected: str) -> Standing:
        found = self.sha256(name)
        if found is None:
            return Standing.MISSING
        return Standing.AS_RECORDED if found == expected else Standing.CHANGED

    def _sha256(self, name: str) -> str | None:
        path = self.folder / name
        return sha256_of(path) if is_below(name) and path.is_file() else None


def _file_links(files: _Files, left_out: Collection[str]) -> Iterator[Link]:
    """A link for every file that is in the list or in the folder, and for what is wrong in the list itself.

    Files that are left out are not read: on Windows, another program may hold them open.
    """
    for line in malformed_lines(files.folder):
        yield _broken(f"{CHECKSUMS_FILE}, line {line}", Standing.CHANGED, ChainCode.LIST_LINE, line=line)
    if not files.is_listed and (files.folder / JOURNAL_FILE).is_file():
        yield _broken(CHECKSUMS_FILE, Standing.MISSING, ChainCode.LIST_MISSING, file=JOURNAL_FILE)
    of_session = is_session(files.folder)
    present = set(files_below(files.folder) if of_session else _RESULTS)
    first = [name for name in _RESULTS if name in files.recorded or name in present]
    for name in dict.fromkeys((*first, *sorted(present | set(files.recorded)))):
        if name in left_out:
            continue
        recorded = files.recorded.get(name)
        if name in JOURNALS and (files.folder / name).is_file():
            yield _journal_link(files, name, recorded)
        elif recorded is not None:
            yield Link(name, files.compare(name, recorded))
        elif of_session and files.is_listed:
            yield _broken(name, Standing.ADDED, ChainCode.ADDED, file=name, sums=CHECKSUMS_FILE)
        elif (files.folder / name).is_file():
            yield Link(name, Standing.UNRECORDED)


def _journal_link(files: _Files, name: str, recorded: str | None) -> Link:
    """Link of a journal. It may have lines that its hash in the list does not include, if they continue the others."""
    fault = journal_fault(files.folder / name, recorded)
    if fault is not None:
        return Link(name, Standing.CHANGED, str(fault), fault.code)
    if recorded is not None:
        return Link(name, Standing.AS_RECORDED)
    if files.is_listed:
        return _broken(name, Standing.ADDED, ChainCode.ADDED, file=name, sums=CHECKSUMS_FILE)
    return Link(name, Standing.UNRECORDED)


def _broken(what: str, standing: Standing, code: ChainCode, **figures: float | str) -> Link:
    return Link(what, standing, str(Message(code, figures)), code)


_RESULTS = (REPORT_FILE, NUMBERS_FILE, ASSESSMENT_FILE, CUFFS_FILE)


def _assessment_links(files: _Files) -> Iterator[Link]:
    if not (files.folder / ASSESSMENT_FILE).is_file():
        return
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
    try:
        fits = read_cuffs(path)
    except CuffsFileError as error:
        yield Link(f"{CUFFS_FILE}, its content", Standing.CHANGED, str(error))
        return
    for name, fit in fits.items():
        if fit.given:
            yield Link(f"{CUFFS_FILE}, cuff {name}", Standing.BY_HAND, ", ".join(fit.remarks))
    recordings = files.json(CUFFS_FILE).get("recordings")
    for name, entry in recordings.items() if isinstance(recordings, dict) else ():
        yield files.link(CUFFS_FILE, name, str(entry.get("sha256")) if isinstance(entry, dict) else "")


def _texts(entries: Any) -> Iterator[tuple[str, str]]:
    """The pairs of an object whose values are strings."""
    for key, value in entries.items() if isinstance(entries, dict) else ():
        if isinstance(value, str):
            yield key, value


class SignatureError(StationError):
    """The folder cannot be signed, or its signature cannot be verified."""


def sign(folder: Path, key: Path, links: Sequence[Link]) -> Path:
    """Sign the list of hashes of a folder without a broken link. Returns the path of the signature.

    key: a private key, or a public one whose private key is in an agent. A passphrase is read from the terminal.
    links: the verification of the folder
    """
    if broken := [str(link) for link in links if link.standing.is_break]:
        raise SignatureError(Message(ChainCode.BROKEN, {"folder": str(folder), "link": broken[0]}))
    write_checksums(*(folder / name for name in files_below(folder)))  # without a list, or with a longer journal
    signature = folder / SIGNATURE_FILE
    signature.unlink(missing_ok=True)
    answer = _ssh_keygen("-Y", "sign", "-f", str(key), "-n", NAMESPACE, str(folder / CHECKSUMS_FILE))
    if answer.returncode != 0 or not signature.is_file():
        raise SignatureError(Message(ChainCode.NOT_SIGNED, {"folder": str(folder), "reason": _one_line(answer)}))
    return signature


def signature_of(folder: Path, signers: Path | None) -> Link | None:
    """The link of the signature with the name of the signer; None for an unsigned folder without a list of signers.

    signers: the file of allowed signers of OpenSSH; without it, the owner of the key is not verified.
    """
    signature, sums = folder / SIGNATURE_FILE, folder / CHECKSUMS_FILE
    step = f"{SIGNATURE_FILE} ← {CHECKSUMS_FILE}"
    if not signature.is_file() or not sums.is_file():
        return None if signers is None else Link(step, Standing.MISSING, "the folder is not signed")
    if signers is None:
        answer = _ssh_keygen("-Y", "check-novalidate", "-n", NAMESPACE, "-s", str(signature), content=sums)
        return _link(step, answer, "; give --signers to verify the owner of the key")
    if not signers.is_file():
        raise SignatureError(Message(ChainCode.NO_SIGNERS, {"path": str(signers)}))
    found = _ssh_keygen("-Y", "find-principals", "-f", str(signers), "-s", str(signature))
    principal = found.stdout.strip().splitlines()
    if found.returncode != 0 or not principal:
        return Link(step, Standing.CHANGED, f"signed with a key that is not in {signers.name}")
    command = ("-Y", "verify", "-f", str(signers), "-I", principal[0], "-n", NAMESPACE, "-s", str(signature))
    return _link(step, _ssh_keygen(*command, content=sums))


def _link(step: str, answer: subprocess.CompletedProcess[str], remark: str = "") -> Link:
    standing = Standing.AS_RECORDED if answer.returncode == 0 else Standing.CHANGED
    return Link(step, standing, _one_line(answer) + (remark if answer.returncode == 0 else ""))


def _ssh_keygen(*arguments: str, content: Path | None = None) -> subprocess.CompletedProcess[str]:
    program = shutil.which("ssh-keygen")
    if program is None:
        raise SignatureError(Message(ChainCode.NO_SSH_KEYGEN))
    try:
        with Path(content or os.devnull).open("rb") as signed:
            return subprocess.run(  # noqa: S603  (no shell; the arguments are ours and the user's paths)
                [program, *arguments],
                stdin=signed,
                capture_output=True,
                check=False,
                encoding="utf-8",
                errors="replace",
                timeout=TIMEOUT_S,
            )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise SignatureError(Message(ChainCode.SSH_KEYGEN_FAILED, {"reason": str(error)})) from error


def _one_line(answer: subprocess.CompletedProcess[str]) -> str:
    """The output of ssh-keygen on one line."""
    return " ".join(f"{answer.stdout} {answer.stderr}".split()) or f"exit code {answer.returncode}"

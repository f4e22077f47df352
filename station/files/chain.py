"""Verify the files of a session by its list of hashes, and every result by the hashes of its inputs.

The list is signed with an SSH key of the laboratory, and the signature verified, by ssh-keygen of OpenSSH.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from documents.message import Message, because
from documents.plain_data import PlainDataError, read_json
from fitting.cuffs.cuffs_file import CUFFS_FILE, CuffsFileError, read_cuffs_document, wearable_cuffs
from fitting.results.codes import Standing
from recordings.errors import RecordingError
from recordings.reader import survey_file
from station.assessment.assessment_json import ASSESSMENT_FILE
from station.checksums import (
    CHECKSUMS_FILE,
    JOURNAL_FILE,
    SIGNATURE_FILE,
    Checksums,
    check_hash,
    files_below,
    is_session,
    list_folder,
    write_checksums,
)
from station.errors import StationError
from station.folders import require_folder
from station.messages.file_messages import ChainCode
from station.recordings_of_session import recordings_in
from station.sources import without_hash

REPORT_FILE, NUMBERS_FILE = "report.html", "report.json"
_RESULTS = (REPORT_FILE, NUMBERS_FILE, ASSESSMENT_FILE, CUFFS_FILE)
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

    @staticmethod
    def because(what: str, standing: Standing, reason: Message[Any] | None) -> Link:
        return Link(what, standing, str(reason or ""), reason.code if reason else "")

    def __str__(self) -> str:
        detail = f"{self.detail} [{self.code}]" if self.code else self.detail
        return f"{self.what}: {self.standing}" + (f" ({detail})" if detail else "")


def verify_folder(folder: Path) -> list[Link]:
    """Every link, and the damage inside recordings.

    Raises ChainError for a folder without files to verify, or with a pipe or device under the name of one of them.
    """
    require_folder(folder, ChainError)
    for name in (CHECKSUMS_FILE, *_RESULTS, JOURNAL_FILE, *Checksums(folder).sums):  # a pipe would wait for its writer
        if (folder / name).exists() and not (folder / name).is_file():
            raise ChainError(Message(ChainCode.NOT_REGULAR, {"path": str(folder / name)}))
    links = [*trace_chain(folder), *_damage(folder)]
    if not links:
        figures = {"folder": str(folder), "cuffs": CUFFS_FILE, "report": REPORT_FILE}
        raise ChainError(Message(ChainCode.NOTHING_TO_VERIFY, figures))
    return links


def add_files(folder: Path, paths: Sequence[Path]) -> None:
    """List files that another program added. Raises ChainError for a file that is not below the folder, or listed."""
    for path in paths:
        if list_folder(path) != folder.absolute() or check_hash(path) is not Standing.ADDED:
            raise ChainError(Message(ChainCode.NOT_ADDED, {"file": str(path), "folder": str(folder)}))
    write_checksums(*paths)


def trace_chain(folder: Path, *, is_report_included: bool = True) -> list[Link]:
    """Every file of the folder by hash, and the inputs of its results."""
    sums = Checksums(folder)
    left_out = () if is_report_included else (REPORT_FILE, NUMBERS_FILE)
    return [*_file_links(sums, left_out), *_assessment_links(sums), *_cuffs_links(sums)]


def _file_links(sums: Checksums, left_out: Collection[str]) -> Iterator[Link]:
    """A link for every file that is in the list or in the folder, and for what is wrong in the list itself.

    Files that are left out are not read: on Windows, another program may hold them open.
    """
    folder = sums.folder
    for line in sums.malformed:
        wrong = Message(ChainCode.LIST_LINE, {"line": line})
        yield Link.because(f"{CHECKSUMS_FILE}, line {line}", Standing.CHANGED, wrong)
    if (folder / JOURNAL_FILE).is_file() and not (folder / CHECKSUMS_FILE).is_file():
        yield Link.because(CHECKSUMS_FILE, Standing.MISSING, Message(ChainCode.LIST_MISSING, {"file": JOURNAL_FILE}))
    results = [name for name in _RESULTS if (folder / name).is_file()]
    present = {*sums.sums, *(files_below(folder) if is_session(folder) else results)}
    first = [name for name in _RESULTS if name in present]
    for name in dict.fromkeys((*first, *sorted(present))):
        if name not in left_out:
            yield Link.because(name, *sums.compare(name))


def _assessment_links(sums: Checksums) -> Iterator[Link]:
    """Inputs by their hashes in the assessment: only the file of cuffs is known to belong to this folder."""
    plain = _objects(sums.folder / ASSESSMENT_FILE)
    for role, named in plain.get("inputs", {}).items():
        name = without_hash(str(named))
        if name == named:  # bundled with the station
            continue
        found = sums.sha256(name)
        if named == f"{name} {found}":
            yield Link(f"{ASSESSMENT_FILE} ← {name}", Standing.AS_RECORDED)
        elif role == "cuffs" and (found or name in sums.sums):
            yield Link(f"{ASSESSMENT_FILE} ← {name}", Standing.CHANGED if found else Standing.MISSING)
        else:
            yield Link(f"{ASSESSMENT_FILE} ← {name}", Standing.UNRECORDED, "not in this folder")
    for cuff, figures in plain.get("cuffs", {}).items():
        for key, figure in figures.items() if isinstance(figures, dict) else ():
            if isinstance(figure, dict) and figure.get("source") == Standing.BY_HAND:
                yield Link(f"{ASSESSMENT_FILE} ← {cuff}, {key} {figure.get('value')}", Standing.BY_HAND)


def _cuffs_links(sums: Checksums) -> Iterator[Link]:
    path = sums.folder / CUFFS_FILE
    if not path.is_file():
        return
    try:
        document = read_cuffs_document(path)
    except CuffsFileError as error:
        yield Link(f"{CUFFS_FILE}, its content", Standing.CHANGED, str(error))
        return
    fits = wearable_cuffs(document)
    for name, fit in fits.items():
        if fit.given:
            yield Link(f"{CUFFS_FILE}, cuff {name}", Standing.BY_HAND, ", ".join(fit.remarks))
    fitted = {name: sha256 for fit in fits.values() for name, sha256 in fit.sources.items()}
    for name in document.recordings:
        standing = sums.compare(name)[0]
        is_another = not standing.is_break and sums.sha256(name) != fitted.get(name, sums.sha256(name))
        yield Link(f"{CUFFS_FILE} ← {name}", Standing.CHANGED if is_another else standing)


def _objects(path: Path) -> dict[str, dict[str, Any]]:
    """The objects of a JSON object; none for a file that is missing or not an object."""
    try:
        found = read_json(path)
    except (OSError, PlainDataError):
        return {}
    return {key: value for key, value in found.items() if isinstance(value, dict)} if isinstance(found, dict) else {}


def _damage(folder: Path) -> Iterator[Link]:
    """A link for every recording that its CRCs show to be damaged; every recording is read to its end.

    A cut recording with a recovered copy has no link: the copy lists what is missing.
    """
    for path in recordings_in(folder):
        try:
            damage = tuple(map(str, survey_file(path).damage))
        except (RecordingError, OSError) as error:
            damage = (str(error),)
        if damage:
            yield Link(f"{path.name}, its content", Standing.MISSING, damage[0])


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


def check_signature(folder: Path, signers: Path | None) -> Link | None:
    """The link of the signature with the name of the signer; None for an unsigned folder without a list of signers.

    signers: the file of allowed signers of OpenSSH; without it, the owner of the key is not verified.
    """
    signature, sums = folder / SIGNATURE_FILE, folder / CHECKSUMS_FILE
    step = f"{SIGNATURE_FILE} ← {CHECKSUMS_FILE}"
    if not signature.is_file() or not sums.is_file():
        return None if signers is None else Link(step, Standing.MISSING, "the folder is not signed")
    command: tuple[str, ...] = ("-n", NAMESPACE, "-s", str(signature))
    remark = ""
    if signers is None:
        command, remark = ("check-novalidate", *command), "; give --signers to verify the owner of the key"
    elif not signers.is_file():
        raise SignatureError(Message(ChainCode.NO_SIGNERS, {"path": str(signers)}))
    else:
        found = _ssh_keygen("-Y", "find-principals", "-f", str(signers), "-s", str(signature))
        principal = found.stdout.strip().splitlines()
        if found.returncode != 0 or not principal:
            return Link(step, Standing.CHANGED, f"signed with a key that is not in {signers.name}")
        command = ("verify", "-f", str(signers), "-I", principal[0], *command)
    answer = _ssh_keygen("-Y", *command, content=sums)
    if answer.returncode != 0:
        return Link(step, Standing.CHANGED, _one_line(answer))
    return Link(step, Standing.AS_RECORDED, _one_line(answer) + remark)


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
        raise SignatureError(Message(ChainCode.SSH_KEYGEN_FAILED, because(error))) from error


def _one_line(answer: subprocess.CompletedProcess[str]) -> str:
    """The output of ssh-keygen on one line."""
    return " ".join(f"{answer.stdout} {answer.stderr}".split()) or f"exit code {answer.returncode}"

"""SHA256SUMS: the hash of every file in a session folder and its subfolders at the time the station wrote it.

The format is that of sha256sum, so that `sha256sum -c SHA256SUMS` checks a folder without the station. Locks, drafts
and the address of a live process are not listed, because no result depends on them. Lines of JOURNALS contain the hash
of the lines before them, so that these files may grow after their hash was recorded. Files are written atomically, and
those of a session are entered into its list.
"""

from __future__ import annotations

import errno
import hashlib
import os
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path, PurePath, PurePosixPath

from documents.message import Message
from documents.plain_data import PlainDataError, parse_json
from documents.regular_file import DRAFTS, locked, once_released, read_regular, replaced
from fitting.results.codes import Standing
from fitting.trial.mass_checks import CHECKS_FILE
from station.messages.file_messages import ChainCode
from station.recordings_of_session import RECORDINGS

JOURNAL_FILE = "session.jsonl"
LARGEST_JOURNAL = 16 * 2**20
"""Bytes; the journal of a long day has a hundred thousand."""
CHECKSUMS_FILE = "SHA256SUMS"
JOURNALS = (JOURNAL_FILE, CHECKS_FILE)
SIGNATURE_FILE = f"{CHECKSUMS_FILE}.sig"
PASSING = re.compile(r"\.(live\.json|capture|draft-.*|DS_Store|_.*)|(?i:thumbs\.db|desktop\.ini)", re.DOTALL)
"""Files that come and go while a session is used: the address of a live process, the note of a running capture, drafts,
and the files of macOS and Windows.
"""
LOCK = re.compile(r"\..*\.lock", re.DOTALL)
"""A lock is empty."""
LINE = re.compile(r"(\\?)([0-9a-f]{64}) [ *](.+)", re.DOTALL)
LARGEST = 1 << 24
"""Bytes: a hundred thousand files."""
LOCK_WAIT_S = 10.0
ESCAPES = {"\\\\": "\\", "\\n": "\n", "\\r": "\r"}
"""Of sha256sum, in a line that begins with a backslash."""


def file_sha256(path: Path) -> str:
    with once_released(lambda: path.open("rb"), path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


class Checksums:
    """The list of a folder, and the comparison of its files with it; every file is hashed once.

    sums        relative name, with slashes → SHA-256; empty without a list
    malformed   numbers of lines that are not of the format, name a file elsewhere, or contradict another
    lists_all   whether a file that is not in the list was added: the list of a session has all files
    """

    def __init__(self, folder: Path) -> None:
        self.folder, self.sha256 = folder, cache(self._sha256)
        self.sums, self.malformed = _parsed(folder)
        self.lists_all = (folder / CHECKSUMS_FILE).exists() and is_session(folder)

    def compare(self, name: str) -> tuple[Standing, Message[ChainCode] | None]:
        """Standing of a file, and why."""
        path, recorded = self.folder / name, self.sums.get(name)
        if name in JOURNALS and path.is_file() and (fault := _journal_fault(path, recorded)):
            return Standing.CHANGED, fault
        if recorded is None and self.lists_all and os.path.lexists(path):  # also a link to a folder
            return Standing.ADDED, Message(ChainCode.ADDED, {"file": name, "sums": CHECKSUMS_FILE})
        if not path.is_file():
            return Standing.MISSING, None
        if recorded is None:
            return Standing.UNRECORDED, None
        if name in JOURNALS or recorded == self.sha256(name):
            return Standing.AS_RECORDED, None
        return Standing.CHANGED, Message(ChainCode.CHANGED, {"file": name, "sums": CHECKSUMS_FILE})

    def _sha256(self, name: str) -> str | None:
        path = self.folder / name
        return file_sha256(path) if _may_name(self.folder, name) and path.is_file() else None


def write_checksums(*paths: Path) -> None:
    """Record the current hash of every file in the list of its folder.

    The first list of a session has every file of the folder; later, a file is listed by the command that writes it, so
    that a file that another program adds is found.
    """
    for folder in {list_folder(path) for path in paths}:
        with locked(folder / f".{CHECKSUMS_FILE}.lock", LOCK_WAIT_S):
            is_first = is_session(folder) and not (folder / CHECKSUMS_FILE).exists()
            written = {name_in(folder, path) for path in paths if list_folder(path) == folder}
            listed = {*written, *files_below(folder)} if is_first else written
            sums = Checksums(folder).sums | {
                name: file_sha256(folder / name) for name in listed if name in written or (folder / name).is_file()
            }
            with replaced(folder / CHECKSUMS_FILE) as draft:
                draft.write_bytes(b"".join(_line(name, sums[name]) for name in sorted(sums)))


def list_in_session(path: Path) -> None:
    """Record the hash of a file that was written below a session folder; no effect elsewhere."""
    folder = list_folder(path)
    if Checksums(folder).lists_all and path.is_file() and _is_listed(folder, name_in(folder, path)):
        write_checksums(path)


def list_folder(path: Path) -> Path:
    """The folder whose list has the file: the session that contains it, else its own folder."""
    folders = path.absolute().parents
    return next((folder for folder in folders if (folder / CHECKSUMS_FILE).exists() and is_session(folder)), folders[0])


def is_session(folder: Path) -> bool:
    """Whether the folder has a journal or recordings. Its list then has all of its files."""
    return (folder / JOURNAL_FILE).exists() or any(folder.glob(RECORDINGS))


def name_in(folder: Path, path: Path) -> str:
    return path.absolute().relative_to(folder.absolute()).as_posix()


def is_below(name: str) -> bool:
    """Whether a relative name stays in its folder; on Windows, a backslash or a drive leads out of it, too."""
    path = PurePath(name)
    return bool(path.parts) and not path.anchor and ".." not in path.parts


def _may_name(folder: Path, name: str) -> bool:
    """Whether a file below the folder may have this name: names that are too long cannot be looked up."""
    if not is_below(name):
        return False
    try:
        (folder / name).is_file()
    except OSError as error:
        return error.errno != errno.ENAMETOOLONG
    return True


def files_below(folder: Path) -> Iterator[str]:
    """Names of all files of a folder and its subfolders that belong into its list."""
    for place, folders, files in os.walk(folder):
        folders[:] = [name for name in folders if not name.startswith(DRAFTS)]
        links = [name for name in folders if (Path(place) / name).is_symlink()]
        names = (name_in(folder, Path(place) / name) for name in (*files, *links))
        yield from (name for name in names if _is_listed(folder, name))


def check_hash(path: Path) -> Standing:
    """Compare a file with its recorded hash."""
    return _compared(path)[0]


def changed_files(paths: Iterable[Path]) -> list[Message[ChainCode]]:
    """A message for every file whose hash differs from the recorded one, or that is not in the list of its folder."""
    return [message for path in paths if (message := _compared(path)[1])]


def _compared(path: Path) -> tuple[Standing, Message[ChainCode] | None]:
    folder = list_folder(path)
    return Checksums(folder).compare(name_in(folder, path))


def _journal_fault(path: Path, recorded: str | None) -> Message[ChainCode] | None:
    """Reason why a journal differs from what was written; None if whole lines were appended.

    recorded: hash in the list, of the journal or of its first lines
    """
    content = read_regular(path, LARGEST_JOURNAL)
    lines = content[: content.rfind(b"\n") + 1].splitlines(keepends=True)
    above, known = hashlib.sha256(), set()
    for number, line in enumerate(lines, 1):
        known.add(above.hexdigest())
        if _previous(line) != above.hexdigest():
            return Message(ChainCode.JOURNAL_ORDER, {"file": path.name, "line": number})
        above.update(line)
    if recorded is None or recorded in known | {above.hexdigest()}:
        return None
    return Message(ChainCode.JOURNAL_CHANGED, {"file": path.name, "lines": len(lines), "sums": CHECKSUMS_FILE})


def _parsed(folder: Path) -> tuple[dict[str, str], list[int]]:
    try:
        content = read_regular(folder / CHECKSUMS_FILE, LARGEST)
    except OSError:
        return {}, []
    sums: dict[str, str] = {}
    malformed = []
    for number, line in enumerate(_decoded(content).split("\n"), 1):
        found = LINE.fullmatch(line.removesuffix("\r"))
        name = "" if found is None else _unescaped(found[3]) if found[1] else found[3]
        if line and not (found and _may_name(folder, name) and sums.setdefault(name, found[2]) == found[2]):
            malformed.append(number)
    return sums, malformed


def _decoded(content: bytes) -> str:
    try:
        return os.fsdecode(content)
    except UnicodeDecodeError:  # on Windows, where no file has such a name
        return content.decode(errors="surrogateescape")


def _is_listed(folder: Path, name: str) -> bool:
    """Neither passing, nor in a folder of drafts, nor the list itself."""
    *folders, last = PurePosixPath(name).parts
    if any(part.startswith(DRAFTS) for part in folders) or name in (CHECKSUMS_FILE, SIGNATURE_FILE):
        return False
    return not (PASSING.fullmatch(last) or (LOCK.fullmatch(last) and _is_empty(folder / name)))


def _is_empty(path: Path) -> bool:
    try:
        return path.lstat().st_size == 0
    except FileNotFoundError:  # on Windows, a lock that was released since
        return True


def _previous(line: bytes) -> str | None:
    """The hash of the lines before it that a line contains; None without one."""
    try:
        entry = parse_json(line)
    except PlainDataError:
        return None
    return str(entry.get("previous")) if isinstance(entry, dict) else None


def _line(name: str, sha256: str) -> bytes:
    escaped = name
    for text, sign in ESCAPES.items():
        escaped = escaped.replace(sign, text)
    return os.fsencode(f"{'' if escaped == name else chr(92)}{sha256}  {escaped}\n")


def _unescaped(name: str) -> str:
    return re.sub(r"\\.", lambda found: ESCAPES.get(found[0], found[0]), name)


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file completely, or leave the previous one. Bytes of names that are not UTF-8 are replaced."""
    with drafted(path) as draft:
        draft.write_bytes(content.encode(errors="replace") if isinstance(content, str) else content)


@contextmanager
def drafted(path: Path) -> Iterator[Path]:
    """A temporary path of the same name; its file replaces `path` when the block ends without an error.

    An OSError names the path, not the temporary one. A file below a session folder is entered into its list of hashes.
    """
    with replaced(path) as draft:
        yield draft
    list_in_session(path)

"""session.jsonl: the decisions of a session, one line each, only ever appended.

The recordings hold the measured data; the journal holds subject and plan, which trials count, which are repeated and
why, and the names of marks. No line is ever changed: a later line overrules an earlier one, and a line that a power
failure cut is ignored. The types of the lines write and read the file, and their schema is published in
docs/schemas/session.schema.json. Unknown keys are ignored, so that a later station may add some.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, RootModel

from documents.message import Message, because
from documents.plain_data import PlainDataError, parse_json
from documents.regular_file import append_to_regular, locked, read_regular, sync_file
from recordings.manifest import CuffSite, DataOrigin, TrialCondition, is_file_name
from station.checksums import JOURNAL_FILE, LARGEST_JOURNAL, write_checksums
from station.errors import StationError
from station.messages.bench_messages import TrialCode
from station.messages.session_messages import JournalCode
from station.protocol import TrialKey, TrialSpec

FORMAT: Literal[1] = 1
"""Format of a line. It increases if a key changes its meaning, not if one is added."""
MOST_REPEATS = 1000
LONGEST_NOTE = 10_000

Choice = Literal["accept", "redo"]


def _ensure_file_name(name: str) -> str:
    """A file in the session's folder. Raises ValueError for a path to elsewhere."""
    if not is_file_name(name, may_be_empty=True):
        raise ValueError(f"{name!r} is not a file name")
    return name


def _ensure_cuff_name(site: CuffSite) -> CuffSite:
    if not is_file_name(site.name):
        raise ValueError(f"{site.name!r} is not the name of a cuff")
    return site


FileName = Annotated[str, AfterValidator(_ensure_file_name)]
Repeats = Annotated[int, Field(ge=1, le=MOST_REPEATS)]


@dataclass(frozen=True)
class Setup:
    """Plan of a session: subject (a code, never a name), operator, cuffs, and the repeats of each test.

    step_masses_kg are the weights of a static test in loading order; empty: those of the configuration. conditions are
    those of the wearer's motions; empty: neither a pose nor a motion is planned.
    """

    subject: str
    operator: str
    cuffs: tuple[str, ...]
    repeats: Repeats
    has_bounce: bool = True
    number: str = "1"
    step_masses_kg: tuple[float, ...] = ()
    conditions: tuple[TrialCondition, ...] = ()


@dataclass(frozen=True)
class Recorded:
    """Outcome of one trial as the recorder reports it; file is its name in the session's folder.

    codes are the reason of its end, empty in the journals of older stations, and sentence renders them. origin is
    measured or simulated as the devices report it, unknown in the journals of older stations.
    """

    file: FileName
    cuff: str | None
    test: str
    repeat: int
    donning: str
    accepted: bool
    lost_samples: int
    sentence: str
    codes: tuple[Message[TrialCode], ...] = ()
    origin: str = DataOrigin.UNKNOWN
    condition: TrialCondition | None = None


@dataclass(frozen=True)
class Decision:
    """The operator's decision on one recording, and the reason."""

    choice: Choice
    reason: str


@dataclass(frozen=True)
class Assignment:
    """The trial that a recording is of, if it was recorded as another one."""

    cuff: Annotated[CuffSite, AfterValidator(_ensure_cuff_name)]
    test: Literal["static", "dynamic"]
    repeat: int
    donning: str


@dataclass(frozen=True, kw_only=True)
class JournalEntry:
    """Keys of every line: time of writing (UTC, ISO 8601), format, and the SHA-256 of all lines above, in hex.

    The journal adds previous when it writes the line; lines of older stations have none.
    """

    at: str
    format: Literal[1]
    previous: str | None = None
    kind: str

    def values(self) -> dict[str, Any]:
        """The keys of this kind of line."""
        shared = {field.name for field in fields(JournalEntry)}
        return {field.name: getattr(self, field.name) for field in fields(self) if field.name not in shared}


@dataclass(frozen=True, kw_only=True)
class FileEntry(JournalEntry):
    """A line on a recording."""

    file: FileName


@dataclass(frozen=True, kw_only=True)
class SetupEntry(Setup, JournalEntry):
    """Plan of the session. An empty step_masses_kg stands for the masses of the configuration.

    conditions are those of the wearer's motions; empty: neither a pose nor a motion is planned.
    """

    kind: Literal["setup"] = "setup"


@dataclass(frozen=True, kw_only=True)
class RecordedEntry(Recorded, JournalEntry):
    """A trial was recorded. codes, the reason of its end, are rendered in sentence."""

    kind: Literal["recorded"] = "recorded"


@dataclass(frozen=True, kw_only=True)
class VerdictEntry(Decision, FileEntry):
    """The operator's decision on a recording."""

    kind: Literal["verdict"] = "verdict"


@dataclass(frozen=True, kw_only=True)
class MarkEntry(FileEntry):
    """Name of a mark of a recording; marks are numbered from 1."""

    kind: Literal["mark"] = "mark"
    number: Annotated[int, Field(ge=0)]
    name: str


@dataclass(frozen=True, kw_only=True)
class DonnedEntry(JournalEntry):
    """A cuff was donned anew."""

    kind: Literal["donned"] = "donned"
    cuff: str


@dataclass(frozen=True, kw_only=True)
class SkippedEntry(TrialKey, JournalEntry):
    """A trial of the plan is skipped."""

    kind: Literal["skipped"] = "skipped"


@dataclass(frozen=True, kw_only=True)
class NextEntry(TrialKey, JournalEntry):
    """A trial of the plan is the next one, also if it was skipped before."""

    kind: Literal["next"] = "next"


@dataclass(frozen=True, kw_only=True)
class SessionNoteEntry(FileEntry):
    """A note on a recording, or on the session if file is empty; it replaces the previous one."""

    kind: Literal["note"] = "note"
    text: Annotated[str, Field(max_length=LONGEST_NOTE)]


@dataclass(frozen=True, kw_only=True)
class UndoneEntry(FileEntry):
    """The decision on a recording is undone, and with it the donning of donned_cuff that followed it."""

    kind: Literal["undone"] = "undone"
    donned_cuff: str | None


@dataclass(frozen=True, kw_only=True)
class AssignedEntry(Assignment, FileEntry):
    """The recording is of another trial than recorded; the file itself is unchanged."""

    kind: Literal["assigned"] = "assigned"


class JournalLine(RootModel[Any]):
    """One line of session.jsonl. A later line overrules an earlier one; no line is ever changed."""

    root: Annotated[
        SetupEntry
        | RecordedEntry
        | VerdictEntry
        | MarkEntry
        | DonnedEntry
        | SkippedEntry
        | NextEntry
        | SessionNoteEntry
        | UndoneEntry
        | AssignedEntry,
        Field(discriminator="kind"),
    ]


LOCK_WAIT_S = 10.0
"""Writing a line takes a millisecond, or as long as the disk needs for an fsync."""


class JournalError(StationError):
    """The journal cannot be read or written."""


@dataclass(frozen=True)
class Journal:
    """The state of the session after all lines; verdicts and names of marks are by file name of the recording.

    recorded    as assigned by the operator, if it was recorded as another trial;  assignments  by file name
    verdicts    in the order of the decisions;  an undone decision is not included
    chosen      trials that were chosen as the next one, the latest first
    notes       by file name; the session's under ""
    begun       UTC of the setup, as in the file; empty without one
    entered     UTC of the entry of each recording, as in the file, by file name
    """

    setup: Setup | None = None
    recorded: tuple[Recorded, ...] = ()
    verdicts: Mapping[str, Decision] = field(default_factory=dict)
    marks: Mapping[str, Mapping[int, str]] = field(default_factory=dict)
    donnings: Mapping[str, int] = field(default_factory=dict)  # cuff → how often it was donned anew
    skipped: frozenset[TrialSpec] = frozenset()  # trials of the plan that are not recorded
    assignments: Mapping[str, Assignment] = field(default_factory=dict)
    begun: str = ""
    chosen: tuple[TrialSpec, ...] = ()
    notes: Mapping[str, str] = field(default_factory=dict)
    entered: Mapping[str, str] = field(default_factory=dict)

    @property
    def redone(self) -> dict[str, str]:
        """File name → reason of every recording that does not count by decision of the operator."""
        return {name: decision.reason for name, decision in self.verdicts.items() if decision.choice == "redo"}


def read_journal(folder: Path) -> Journal:
    """The journal of a session's folder; empty if there is none. Raises JournalError with the number of a wrong line.

    An incomplete last line is ignored: it was being written at a power failure, and its decision is asked for again.
    """
    path = folder / JOURNAL_FILE
    try:
        text = read_regular(path, LARGEST_JOURNAL).decode("utf-8")
    except FileNotFoundError:
        return Journal()
    except (OSError, UnicodeDecodeError) as error:
        raise journal_error(JournalCode.UNREADABLE, path, **because(error)) from error
    lines = _JournalState()
    for number, line in enumerate(text.split("\n")[:-1], 1):
        try:
            lines.add(JournalLine.model_validate(parse_json(line)).root)
        except (ValueError, TypeError) as error:
            raise journal_error(JournalCode.WRONG_LINE, path, line=number, found=repr(line[:60])) from error
    return lines.journal()


def write_setup(folder: Path, setup: Setup) -> None:
    """Begin the journal and make its folder. Later lines do not: a session that was moved would have two."""
    _make(folder)
    _append(folder, "setup", **vars(setup))


def write_recorded(folder: Path, recorded: Recorded) -> None:
    _append(folder, "recorded", **vars(recorded))


def write_verdict(folder: Path, file: str, choice: Choice, reason: str) -> None:
    """Raises JournalError if a trial is to be repeated without a reason."""
    if choice == "redo" and not reason.strip():
        raise JournalError(Message(JournalCode.NO_REASON, {"file": file}))
    _append(folder, "verdict", file=file, choice=choice, reason=reason.strip())


def write_mark(folder: Path, file: str, number: int, name: str) -> None:
    """Name a mark of a recording; marks are numbered from 1."""
    _append(folder, "mark", file=file, number=number, name=name.strip())


def write_donned(folder: Path, cuff: str) -> None:
    """The cuff was taken off and donned anew: earlier recordings belong to another donning."""
    _append(folder, "donned", cuff=cuff)


def write_skipped(folder: Path, spec: TrialSpec) -> None:
    """A trial of the plan is skipped in this session."""
    _append(folder, "skipped", **_place(spec))


def write_next(folder: Path, spec: TrialSpec) -> None:
    """A trial of the plan is recorded next, also if it was skipped."""
    _append(folder, "next", **_place(spec))


def write_note(folder: Path, file: str, text: str) -> None:
    """A note on a recording, or on the session if file is empty; longer ones are cut."""
    _append(folder, "note", file=file, text=text.strip()[:LONGEST_NOTE])


def write_undone(folder: Path, file: str, *, donned_cuff: str | None = None) -> None:
    """The last decision on a recording is undone, and with it the donning of donned_cuff that followed it."""
    _append(folder, "undone", file=file, donned_cuff=donned_cuff)


def write_assigned(folder: Path, file: str, assignment: Assignment) -> None:
    """The recording is of another trial than it was recorded as; the file itself is unchanged."""
    _append(folder, "assigned", file=file, **vars(assignment))


def utc_now() -> str:
    """The time as in a journal."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")


def _place(spec: TrialSpec) -> dict[str, Any]:
    place = {"cuff": spec.cuff, "test": spec.test, "repeat": spec.repeat, "donning": spec.donning}
    return {**place, "condition": spec.condition}


class _JournalState:
    """Applies the lines of a journal in order, at a constant cost per line."""

    def __init__(self) -> None:
        self._setup: Setup | None = None
        self._begun = ""
        self._recorded: list[Recorded] = []
        self._places: dict[str, int] = {}  # in _recorded, by file
        self._verdicts: dict[str, Decision] = {}
        self._marks: dict[str, dict[int, str]] = {}
        self._donnings: dict[str, int] = {}
        self._skipped: set[TrialSpec] = set()
        self._chosen: dict[TrialSpec, None] = {}  # in the order of the choices
        self._notes: dict[str, str] = {}
        self._entered: dict[str, str] = {}
        self._assignments: dict[str, Assignment] = {}

    def add(self, entry: JournalEntry) -> None:
        """Raises ValueError for a donning that is undone before it was made."""
        match entry:
            case SetupEntry():
                self._setup, self._begun = Setup(**entry.values()), self._begun or entry.at
            case RecordedEntry():
                self._add_recorded(entry.file, Recorded(**entry.values()))
                self._entered[entry.file] = entry.at
            case VerdictEntry():
                self._verdicts.pop(entry.file, None)  # they are in the order of the decisions
                self._verdicts[entry.file] = Decision(entry.choice, entry.reason)
            case MarkEntry():
                self._marks.setdefault(entry.file, {})[entry.number] = entry.name
            case SessionNoteEntry():
                self._notes[entry.file] = entry.text
            case _:
                self._change_plan(entry)

    def journal(self) -> Journal:
        return Journal(
            self._setup,
            tuple(self._recorded),
            self._verdicts,
            self._marks,
            self._donnings,
            frozenset(self._skipped),
            self._assignments,
            self._begun,
            tuple(reversed(self._chosen)),
            self._notes,
            self._entered,
        )

    def _add_recorded(self, file: str, trial: Recorded) -> None:
        """A console that resumes a session may have entered a recording just before its recorder did."""
        if file in self._assignments:
            trial = _as_assigned(trial, self._assignments[file])
        place = self._places.setdefault(file, len(self._recorded))
        self._recorded[place : place + 1] = [trial]

    def _change_plan(self, entry: JournalEntry) -> None:
        match entry:
            case SkippedEntry():
                spec = TrialSpec(**entry.values())
                self._skipped.add(spec)
                self._chosen.pop(spec, None)
            case NextEntry():
                spec = TrialSpec(**entry.values())
                self._skipped.discard(spec)
                self._chosen.pop(spec, None)
                self._chosen[spec] = None
            case DonnedEntry():
                self._donnings[entry.cuff] = self._donnings.get(entry.cuff, 0) + 1
            case UndoneEntry():
                self._verdicts.pop(entry.file, None)
                if entry.donned_cuff is not None:
                    if entry.donned_cuff not in self._donnings:
                        raise ValueError(f"{entry.donned_cuff} was not donned anew")
                    self._donnings[entry.donned_cuff] -= 1
            case AssignedEntry():
                assignment = Assignment(entry.cuff, entry.test, entry.repeat, entry.donning)
                self._assignments[entry.file] = assignment
                if entry.file in self._places:
                    self._add_recorded(entry.file, self._recorded[self._places[entry.file]])


def _as_assigned(trial: Recorded, assignment: Assignment) -> Recorded:
    place = {"test": assignment.test, "repeat": assignment.repeat, "donning": assignment.donning}
    return replace(trial, cuff=assignment.cuff.name, **place)  # type: ignore[arg-type]


def _append(folder: Path, kind: str, **values: Any) -> None:
    readable = {name: _readable(value) if isinstance(value, str) else value for name, value in values.items()}
    entry = JournalLine.model_validate({"at": utc_now(), "format": FORMAT, "kind": kind, **readable})
    _append_line(folder / JOURNAL_FILE, entry.model_dump(mode="json"))


def _readable(text: str) -> str:
    """Typed or pasted text without NUL and halves of surrogate pairs: a reader refuses a journal with one."""
    return text.replace("\0", "").encode(errors="replace").decode()


def append_line(path: Path, kind: str, **values: Any) -> None:
    """Append a line with the time, its kind and the values to a file of JSON lines. Raises JournalError."""
    _make(path.parent)
    _append_line(path, {"at": utc_now(), "kind": kind, **values})


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise journal_error(JournalCode.NOT_WRITTEN, folder, **because(error)) from error


def _append_line(path: Path, entry: dict[str, Any]) -> None:
    """The line is on the disk before this returns. An incomplete last line is removed first.

    Console and terminal may write at the same time; without the lock, one would remove an unfinished line of the other.
    """
    try:
        with locked(path.with_name(f".{path.name}.lock"), LOCK_WAIT_S), append_to_regular(path) as file:
            file.seek(0)
            above = file.read()
            above = above[: above.rfind(b"\n") + 1]
            file.truncate(len(above))
            line = json.dumps(entry | {"previous": hashlib.sha256(above).hexdigest()}).encode()
            parse_json(line)  # a line that no reader accepts would hide all others
            file.write(line + b"\n")
            file.flush()
            sync_file(file.fileno())
            with suppress(OSError):  # the line itself contains the hash of those above
                write_checksums(path)
    except (OSError, PlainDataError) as error:
        raise journal_error(JournalCode.NOT_WRITTEN, path, **because(error)) from error


def journal_error(code: JournalCode, path: Path, **figures: float | str) -> JournalError:
    """The error of this code about a file or folder of the session."""
    return JournalError(Message(code, {"path": str(path), **figures}))

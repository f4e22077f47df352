"""session.jsonl: what was decided in a session, one line each, only ever appended to.

The recordings hold what was measured; the journal holds what people said of it: who was measured, to which plan, which
trial counts, which is redone and why, what a mark in a trial was. Nothing in it is ever changed: a later line
overrules an earlier one, and a line that a power cut tore in two is passed over.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, TypeAdapter

from documents.plain_data import parse_json
from documents.regular_file import append_to_regular, read_regular
from recordings.manifest import CuffSite, DataOrigin, is_file_name
from station.errors import StationError
from station.file_lock import locked
from station.protocol import TrialSpec

JOURNAL_FILE = "session.jsonl"
FORMAT = 1
"""Of a line. It rises where a key changes its meaning, not where one is added."""
LOCK_WAIT_S = 10.0
"""A line takes a millisecond, or what the disk takes for an fsync."""

LARGEST_JOURNAL = 16 * 2**20
"""Bytes; that of a long day has a hundred thousand."""
MOST_REPEATS = 1000

Choice = Literal["accept", "redo"]


class JournalError(StationError):
    """The journal cannot be read or written; one sentence."""


@dataclass(frozen=True)
class Setup:
    """Who is measured by whom, with which cuffs, each test so many times over. subject is a code, never a name.

    step_masses_kg are the weights of a static test in the order they are hung on; empty: as the configuration says.
    """

    subject: str
    operator: str
    cuffs: tuple[str, ...]
    repeats: Annotated[int, Field(ge=1, le=MOST_REPEATS)]
    has_bounce: bool = True
    number: str = "1"
    step_masses_kg: tuple[float, ...] = ()


@dataclass(frozen=True)
class Decision:
    """What the operator said of one recording, and why."""

    choice: Choice
    reason: str


@dataclass(frozen=True)
class Recorded:
    """What became of one trial, by the recorder's own account; file is its name in the session's folder.

    origin is measured or simulated, as its devices said; unknown in the journals of older stations.
    """

    file: str
    cuff: str | None
    test: str
    repeat: int
    donning: str
    accepted: bool
    lost_samples: int
    sentence: str
    origin: str = DataOrigin.UNKNOWN


@dataclass(frozen=True)
class Assignment:
    """The trial that a recording really is of, where it was recorded as another one."""

    cuff: CuffSite
    test: Literal["static", "dynamic"]
    repeat: int
    donning: str


@dataclass(frozen=True)
class Journal:
    """All that the lines say so far; verdicts and the names of marks go by the recording's file name.

    recorded    as assigned by the operator, where it was recorded as another trial;  assignments  by file name
    verdicts    in the order in which they were given;  a decision that was undone is not among them
    begun       UTC of the setup, as in the file; empty without one
    """

    setup: Setup | None = None
    recorded: tuple[Recorded, ...] = ()
    verdicts: Mapping[str, Decision] = field(default_factory=dict)
    marks: Mapping[str, Mapping[int, str]] = field(default_factory=dict)
    donnings: Mapping[str, int] = field(default_factory=dict)  # cuff → how often it was donned anew
    skipped: frozenset[TrialSpec] = frozenset()  # trials of the plan that are not recorded
    assignments: Mapping[str, Assignment] = field(default_factory=dict)
    begun: str = ""

    @property
    def redone(self) -> dict[str, str]:
        """File name → reason of every recording that the operator does not let count."""
        return {name: each.reason for name, each in self.verdicts.items() if each.choice == "redo"}


def read_journal(folder: Path) -> Journal:
    """The journal of a session's folder; empty where there is none. Raises JournalError naming the line that is wrong.

    The last line may be torn: it was being written when the power went, and its decision is asked for again.
    """
    path = folder / JOURNAL_FILE
    try:
        text = read_regular(path, LARGEST_JOURNAL).decode("utf-8")
    except FileNotFoundError:
        return Journal()
    except OSError as error:
        raise JournalError(f"{path} cannot be read: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise JournalError(f"{path} cannot be read: {error}") from error
    lines = _Lines()
    for number, line in enumerate(text[: text.rfind("\n") + 1].split("\n")[:-1], 1):
        try:
            lines.take(dict(parse_json(line)))
        except (ValueError, TypeError, KeyError) as error:
            found = f"expected an entry of the journal, found {line[:60]!r}"
            raise JournalError(f"{path}, line {number}: {found}") from error
    return lines.journal()


def write_setup(folder: Path, setup: Setup) -> None:
    _append(folder, "setup", **asdict(setup))


def write_recorded(folder: Path, recorded: Recorded) -> None:
    _append(folder, "recorded", **asdict(recorded))


def write_verdict(folder: Path, file: str, choice: Choice, reason: str) -> None:
    """Raises JournalError where a trial is to be redone and nobody says why."""
    if choice == "redo" and not reason.strip():
        raise JournalError(f"{file} is to be redone and no reason is given; say in a few words what was wrong with it")
    _append(folder, "verdict", file=file, choice=choice, reason=reason.strip())


def write_mark(folder: Path, file: str, number: int, name: str) -> None:
    """Names the n-th mark (from 1) of a recording."""
    _append(folder, "mark", file=file, number=number, name=name.strip())


def write_donned(folder: Path, cuff: str) -> None:
    """The cuff was taken off and donned anew: what was measured before belongs to another donning."""
    _append(folder, "donned", cuff=cuff)


def write_skipped(folder: Path, spec: TrialSpec) -> None:
    """A trial of the plan is not recorded in this session, unless somebody records it by itself."""
    _append(folder, "skipped", cuff=spec.cuff, test=spec.test, repeat=spec.repeat, donning=spec.donning)


def write_undone(folder: Path, file: str, *, donned_cuff: str | None = None) -> None:
    """The last decision on a recording is taken back, and with it the donning of donned_cuff that followed it."""
    _append(folder, "undone", file=file, donned_cuff=donned_cuff)


def write_assigned(folder: Path, file: str, assignment: Assignment) -> None:
    """The recording is of another trial than the one that it was recorded as; the file itself stays as it is."""
    _append(folder, "assigned", file=file, **asdict(assignment))


class _Lines:
    """Takes the lines of a journal one after the other, each at the same cost."""

    def __init__(self) -> None:
        self._setup: Setup | None = None
        self._begun = ""
        self._recorded: list[Recorded] = []
        self._places: dict[str, list[int]] = {}  # in _recorded, by file
        self._verdicts: dict[str, Decision] = {}
        self._marks: dict[str, dict[int, str]] = {}
        self._donnings: dict[str, int] = {}
        self._skipped: set[TrialSpec] = set()
        self._assignments: dict[str, Assignment] = {}

    def take(self, entry: dict[str, Any]) -> None:
        """Raises ValueError, TypeError or KeyError for what is no entry of a journal."""
        kind, at = entry.pop("kind"), str(entry.pop("at"))
        if entry.pop("format", FORMAT) != FORMAT:  # lines of an older station have none, and mean the same
            raise ValueError("a line of a later format")
        if not is_file_name(entry.get("file", "-"), may_be_empty=True):  # what it names stays in the folder
            raise ValueError(entry["file"])
        match kind:
            case "setup":
                self._setup, self._begun = _SETUP.validate_python(entry), self._begun or at
            case "recorded":
                recorded = _RECORDED.validate_python(entry)
                self._places.setdefault(recorded.file, []).append(len(self._recorded))
                self._recorded.append(recorded)
            case "verdict":
                self._verdicts.pop(entry["file"], None)  # they stand in the order in which they were given
                self._verdicts[entry["file"]] = _VERDICT.validate_python(entry)
            case "mark":
                self._marks.setdefault(entry["file"], {})[int(entry["number"])] = str(entry["name"])
            case _:
                self._change_plan(kind, entry)

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
        )

    def _change_plan(self, kind: str, entry: dict[str, Any]) -> None:
        match kind:
            case "skipped":
                entry.pop("name", None)  # a template of files' names comes from the configuration
                self._skipped.add(_SPEC.validate_python(entry))
            case "donned":
                cuff = str(entry["cuff"])
                self._donnings[cuff] = self._donnings.get(cuff, 0) + 1
            case "undone":
                if entry["donned_cuff"] is not None:
                    self._donnings[entry["donned_cuff"]] -= 1
                self._verdicts.pop(entry["file"], None)
            case "assigned":
                given = self._assignments[entry["file"]] = _ASSIGNMENT.validate_python(entry)
                if not is_file_name(given.cuff.name):
                    raise ValueError(given.cuff.name)
                for place in self._places.get(entry["file"], ()):
                    self._recorded[place] = _as_assigned(self._recorded[place], given)
            case _:
                raise ValueError(kind)


_SETUP, _RECORDED, _VERDICT = TypeAdapter(Setup), TypeAdapter(Recorded), TypeAdapter(Decision)
_SPEC, _ASSIGNMENT = TypeAdapter(TrialSpec), TypeAdapter(Assignment)


def _as_assigned(trial: Recorded, given: Assignment) -> Recorded:
    return replace(trial, cuff=given.cuff.name, test=given.test, repeat=given.repeat, donning=given.donning)


def _append(folder: Path, kind: str, **said: Any) -> None:
    append_line(folder / JOURNAL_FILE, kind, format=FORMAT, **said)


def append_line(path: Path, kind: str, **said: Any) -> None:
    """One line, on the disk before this returns. A torn line that is there already is taken away first.

    Console and terminal may write at once: one waits for the other, or it would take a line half written for torn.
    """
    line = json.dumps({"at": datetime.now(UTC).isoformat(timespec="milliseconds"), "kind": kind, **said})
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with locked(path.with_name(f".{path.name}.lock"), LOCK_WAIT_S), append_to_regular(path) as file:
            file.seek(0)
            file.truncate(file.read().rfind(b"\n") + 1)
            file.write(line.encode() + b"\n")
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise JournalError(f"{path} cannot be written: {error.strerror}; the decision is not stored") from error

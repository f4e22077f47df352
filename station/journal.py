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
from pathlib import Path, PureWindowsPath
from typing import Any, Literal, get_args

from recordings.manifest import CuffSite, DataOrigin
from station.file_lock import locked
from station.protocol import TrialSpec

JOURNAL_FILE = "session.jsonl"
LOCK_WAIT_S = 10.0
"""A line takes a millisecond, or what the disk takes for an fsync."""

Choice = Literal["accept", "redo"]


class JournalError(Exception):
    """The journal cannot be read or written; one sentence."""


@dataclass(frozen=True)
class Setup:
    """Who is measured by whom, with which cuffs, each test so many times over. subject is a code, never a name.

    step_masses_kg are the weights of a static test in the order they are hung on; empty: as the configuration says.
    """

    subject: str
    operator: str
    cuffs: tuple[str, ...]
    repeats: int
    has_bounce: bool = True
    number: str = "1"
    step_masses_kg: tuple[float, ...] = ()


@dataclass(frozen=True)
class Verdict:
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
    verdicts: Mapping[str, Verdict] = field(default_factory=dict)
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
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        return Journal()
    except (OSError, UnicodeDecodeError) as error:
        raise JournalError(f"{path} cannot be read: {error}") from error
    journal = Journal()
    for number, line in enumerate(text[: text.rfind("\n") + 1].splitlines(), 1):
        try:
            journal = _with(journal, dict(json.loads(line)))
        except (ValueError, TypeError, KeyError) as error:
            found = f"expected an entry of the journal, found {line[:60]!r}"
            raise JournalError(f"{path}, line {number}: {found}") from error
    return journal


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


def _with(journal: Journal, entry: dict[str, Any]) -> Journal:
    """The journal and one line more."""
    kind = entry.pop("kind")
    at = str(entry.pop("at"))
    name = str(entry.get("file", "-"))
    if PureWindowsPath(name).name != name:  # both separators and the drive: what it names stays in the folder
        raise ValueError(name)
    if kind == "setup":
        masses = tuple(entry.pop("step_masses_kg", ()))
        setup = Setup(**{**entry, "cuffs": tuple(entry["cuffs"])}, step_masses_kg=masses)
        return replace(journal, setup=setup, begun=journal.begun or at)
    if kind == "recorded":
        return replace(journal, recorded=(*journal.recorded, Recorded(**entry)))
    if kind == "verdict" and entry["choice"] in get_args(Choice):
        verdict = Verdict(entry["choice"], entry["reason"])
        return replace(journal, verdicts=_without(journal.verdicts, entry["file"]) | {entry["file"]: verdict})
    if kind == "mark":
        named = {**journal.marks.get(entry["file"], {}), int(entry["number"]): str(entry["name"])}
        return replace(journal, marks={**journal.marks, entry["file"]: named})
    return _with_change_of_plan(journal, kind, entry)


def _with_change_of_plan(journal: Journal, kind: str, entry: dict[str, Any]) -> Journal:
    if kind == "skipped":
        return replace(journal, skipped=journal.skipped | {TrialSpec(**entry)})
    if kind == "donned":
        cuff = str(entry["cuff"])
        return replace(journal, donnings={**journal.donnings, cuff: journal.donnings.get(cuff, 0) + 1})
    file = entry["file"]
    if kind == "undone":
        donnings, cuff = dict(journal.donnings), entry["donned_cuff"]
        if cuff is not None:
            donnings[cuff] -= 1
        return replace(journal, verdicts=_without(journal.verdicts, file), donnings=donnings)
    if kind == "assigned":
        given = _assignment_from(entry)
        recorded = tuple(_as_assigned(trial, given) if trial.file == file else trial for trial in journal.recorded)
        return replace(journal, recorded=recorded, assignments={**journal.assignments, file: given})
    raise ValueError(kind)


def _assignment_from(entry: dict[str, Any]) -> Assignment:
    cuff, test = entry["cuff"], entry["test"]
    name, site = str(cuff["name"]), cuff["site"]
    if PureWindowsPath(name).name != name or site not in ("arm", "waist") or test not in ("static", "dynamic"):
        raise ValueError(name)
    markers = (tuple(map(str, cuff[f"{part}_markers"])) for part in ("anchor", "cuff", "rope"))
    return Assignment(CuffSite(name, site, *markers), test, int(entry["repeat"]), str(entry["donning"]))


def _without(verdicts: Mapping[str, Verdict], file: str) -> dict[str, Verdict]:
    return {name: verdict for name, verdict in verdicts.items() if name != file}


def _as_assigned(trial: Recorded, given: Assignment) -> Recorded:
    return replace(trial, cuff=given.cuff.name, test=given.test, repeat=given.repeat, donning=given.donning)


def _append(folder: Path, kind: str, **said: Any) -> None:
    append_line(folder / JOURNAL_FILE, kind, **said)


def append_line(path: Path, kind: str, **said: Any) -> None:
    """One line, on the disk before this returns. A torn line that is there already is taken away first.

    Console and terminal may write at once: one waits for the other, or it would take a line half written for torn.
    """
    line = json.dumps({"at": datetime.now(UTC).isoformat(timespec="milliseconds"), "kind": kind, **said})
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with locked(path.with_name(f".{path.name}.lock"), LOCK_WAIT_S), path.open("a+b") as file:
            file.seek(0)
            file.truncate(file.read().rfind(b"\n") + 1)
            file.write(line.encode() + b"\n")
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise JournalError(f"{path} cannot be written: {error.strerror}; the decision is not stored") from error

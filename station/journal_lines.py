"""Lines of session.jsonl, and what they record: setup, trials, decisions.

They write and read the file; their schema is published in docs/schemas/session.schema.json.

Keys that are not named here are ignored, so that a later station may add some.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, RootModel

from recordings.manifest import CuffSite, DataOrigin, TrialCondition, is_file_name
from station.messages.codes import TrialCode
from station.messages.message import Message
from station.protocol import TrialKey

FORMAT: Literal[1] = 1
"""Format of a line. It increases if a key changes its meaning, not if one is added."""
MOST_REPEATS = 1000
JOURNAL_FILE = "session.jsonl"
LONGEST_NOTE = 10_000
LARGEST_JOURNAL = 16 * 2**20
"""Bytes; the journal of a long day has a hundred thousand."""

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
    """What all lines share: time of writing (UTC, ISO 8601), format, and the SHA-256 of all lines above, in hex.

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


class JournalLine(
    RootModel[
        Annotated[
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
    ]
):
    """One line of session.jsonl. A later line overrules an earlier one; no line is ever changed."""

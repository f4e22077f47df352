"""The schema of session.jsonl: it writes every line, reads it, and is published in docs/schemas/session.schema.json.

Keys that are not named here are ignored, so that a later station may add some.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, RootModel

from recordings.manifest import CuffSite, TestKind, TrialCondition, is_file_name
from station.messages.codes import TrialCode
from station.messages.message import Message

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


_SHARED = ("at", "format", "previous", "kind")


class JournalEntry(BaseModel):
    """What all lines share: time of writing (UTC, ISO 8601), format, and the SHA-256 of all lines above, in hex.

    The journal adds previous when it writes the line; lines of older stations have none.
    """

    model_config = ConfigDict(frozen=True)

    at: str
    format: Literal[1]
    previous: str | None = None

    def values(self) -> dict[str, Any]:
        """The keys of this kind of line."""
        return {name: getattr(self, name) for name in type(self).model_fields if name not in _SHARED}


class SetupEntry(JournalEntry):
    """Plan of the session. An empty step_masses_kg stands for the masses of the configuration.

    conditions are those of the wearer's motions; empty: neither a pose nor a motion is planned.
    """

    kind: Literal["setup"] = "setup"
    subject: str
    operator: str
    cuffs: tuple[str, ...]
    repeats: Repeats
    has_bounce: bool = True
    number: str = "1"
    step_masses_kg: tuple[float, ...] = ()
    conditions: tuple[TrialCondition, ...] = ()


class RecordedEntry(JournalEntry):
    """A trial was recorded. codes, the reason of its end, are rendered in sentence."""

    kind: Literal["recorded"] = "recorded"
    file: FileName
    cuff: str | None
    test: str
    repeat: int
    donning: str
    accepted: bool
    lost_samples: int
    sentence: str
    codes: tuple[Message[TrialCode], ...] = ()
    origin: str = "unknown"
    condition: TrialCondition | None = None


class VerdictEntry(JournalEntry):
    """The operator's decision on a recording."""

    kind: Literal["verdict"] = "verdict"
    file: FileName
    choice: Choice
    reason: str


class MarkEntry(JournalEntry):
    """Name of a mark of a recording; marks are numbered from 1."""

    kind: Literal["mark"] = "mark"
    file: FileName
    number: Annotated[int, Field(ge=0)]
    name: str


class DonnedEntry(JournalEntry):
    """A cuff was donned anew."""

    kind: Literal["donned"] = "donned"
    cuff: str


class _PlannedTrial(JournalEntry):
    cuff: str | None
    test: TestKind
    repeat: int
    donning: str = "1"
    condition: TrialCondition | None = None


class SkippedEntry(_PlannedTrial):
    """A trial of the plan is skipped."""

    kind: Literal["skipped"] = "skipped"


class NextEntry(_PlannedTrial):
    """A trial of the plan is the next one, also if it was skipped before."""

    kind: Literal["next"] = "next"


class SessionNoteEntry(JournalEntry):
    """A note on a recording, or on the session if file is empty; it replaces the previous one."""

    kind: Literal["note"] = "note"
    file: FileName
    text: Annotated[str, Field(max_length=LONGEST_NOTE)]


class UndoneEntry(JournalEntry):
    """The decision on a recording is undone, and with it the donning of donned_cuff that followed it."""

    kind: Literal["undone"] = "undone"
    file: FileName
    donned_cuff: str | None


class AssignedEntry(JournalEntry):
    """The recording is of another trial than recorded; the file itself is unchanged."""

    kind: Literal["assigned"] = "assigned"
    file: FileName
    cuff: Annotated[CuffSite, AfterValidator(_ensure_cuff_name)]
    test: Literal["static", "dynamic"]
    repeat: int
    donning: str


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

"""The verdict on one recording: its figures, those of the donning so far, and whether to keep it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Literal

from documents.message import Message
from fitting.results.codes import EXPLAINED_BY, NoteCode, Verdict
from fitting.results.sentences import Note, verdict_sentences
from fitting.results.trial_codes import TrialNoteCode
from station.journal import Choice
from station.messages.session_messages import ReasonCode

Grade = Literal["good", "doubtful", "bad"]
Reason = Message[ReasonCode]
MISSING = "-"
"""Text of a missing figure."""
FOR_THE_REPORT = {
    TrialNoteCode.ASSIGNED,
    TrialNoteCode.SYNC_CERTIFICATE,
    TrialNoteCode.SYNC_NO_STOP,
    TrialNoteCode.SYNC_CONTRADICTION,
    TrialNoteCode.CLOCKS_OR_FRAMES,
    TrialNoteCode.CLOCKS_OPEN,
    TrialNoteCode.ANOTHER_LINE,
    TrialNoteCode.START_LEFT_OUT,
    TrialNoteCode.DISAGREES,
    TrialNoteCode.CHECK_NOT_CONVERGED,
    TrialNoteCode.BOUNCES_NOT_CONVERGED,
    NoteCode.FRICTION_OR_CREEP,
    NoteCode.ONLY_ROSE,
    NoteCode.STATIC_STIFFNESS_USED,
    NoteCode.STIFFNESS_RATIO,
    NoteCode.MIGRATED_BEFORE,
    NoteCode.MIXED_ORIGIN,
    NoteCode.NOT_CALIBRATED,
    NoteCode.CREEPS,
    NoteCode.YIELDS,
    NoteCode.STIFFENS,
    NoteCode.SOFTENS,
    NoteCode.NO_ROPE,
    NoteCode.PUBLISHED_DAMPING,
    NoteCode.KNOWN_MASS,
    NoteCode.KNOWN_MASS_ZERO_DRIFT,
    NoteCode.KNOWN_MASS_GAIN_DRIFT,
    NoteCode.NO_SHIFT,
}
"""Notes for the analyst: the operator can do nothing about them between two trials."""

OF_TEST: Mapping[StrEnum, str] = {
    NoteCode.SHORT_HOLDS: "static",
    NoteCode.SLIP_OR_FRICTION: "static",
    NoteCode.MIGRATION_INTERVAL: "static",
    NoteCode.DAMPING_INTERVAL: "dynamic",
}
"""Notes on a donning → the test in which the operator can act on them."""


@dataclass(frozen=True)
class Row:
    """One quantity as text: of this trial, of the earlier repeats, and of the donning including this trial."""

    quantity: str
    this: str
    earlier: str
    so_far: str


@dataclass(frozen=True)
class TrialQuantity:
    """One quantity of this trial with its 95 % interval [SI]; the unit is the end of its name."""

    quantity: str
    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Judgement:
    """advice follows from the reasons; the operator decides.

    verdicts: the results of the donning that are not identified so far, without those of tests still to come; causes:
    its trials that ended early, which explain some of them.
    path is (displacement mm, force N) to draw, drawing the figure of a motion as HTML; marks is the number of marks.
    """

    file: str
    title: str
    advice: Choice
    reasons: tuple[Reason, ...]
    rows: tuple[Row, ...] = ()
    notes: tuple[str, ...] = ()
    path: tuple[tuple[float, float], ...] = ()
    drawing: str = ""
    marks: int = 0
    figures: tuple[TrialQuantity, ...] = ()
    verdicts: tuple[Verdict, ...] = ()
    causes: tuple[Note, ...] = ()

    @property
    def grade(self) -> Grade:
        """good only if everything was checked and no problem was found."""
        if self.advice == "redo":
            return "bad"
        return "doubtful" if self.reasons or self.verdicts or not self.rows else "good"

    @property
    def doubts(self) -> tuple[str, ...]:
        return verdict_sentences(self.verdicts, self.causes)


def judgement_without_fit(file: str) -> Judgement:
    """The judgement of a recording whose fit was killed twice: the operator decides without figures."""
    return Judgement(file, file, "accept", (Message(ReasonCode.FIT_KILLED),))


def notes_at_the_bench(notes: Iterable[Note], test: str = "") -> tuple[str, ...]:
    """Sentences of the notes on which the operator can act, of a donning those on this test; what explains a verdict
    leads it.
    """
    hidden = {*FOR_THE_REPORT, *EXPLAINED_BY}
    return tuple(str(note) for note in notes if note.code not in hidden and OF_TEST.get(note.code, test) == test)

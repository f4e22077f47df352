"""Messages of a fit: notes with their figures in SI, names of causes and findings, and verdicts as text."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from enum import StrEnum

from documents.message import Code, Message, join_sentences
from fitting.results.codes import EXPLAINED_BY, CauseCode, FindingCode, FitErrorCode, NoteCode, Verdict
from fitting.results.trial_codes import RejectionCode, TensorCode, TrialNoteCode

Note = Message[NoteCode | TrialNoteCode | RejectionCode | TensorCode | FitErrorCode]
"""Remarks on figures, or the reason for missing ones."""
NAMES: Mapping[StrEnum, str] = {
    CauseCode.TARE: "tare with the weight on",
    CauseCode.ZERO_DRIFT: "zero drift of the load cell",
    CauseCode.DISPLACEMENT_ZERO: "zero of the displacement",
    CauseCode.PULL_DIRECTION: "direction of the pull",
    CauseCode.LOOSE_MARKER: "loose anchor marker",
    CauseCode.SKIN: "skin under an anchor marker",
    CauseCode.GAIN: "gain of the load cell",
    CauseCode.LOADS: "loads of the static test",
    CauseCode.PULLEY: "friction of the pulley",
    CauseCode.STIFFENING: "stiffening",
    CauseCode.SOFTENING: "softening",
    CauseCode.FRICTION: "friction",
    CauseCode.STANDARD_LINEAR_SOLID: "standard linear solid",
    CauseCode.CREEP: "creep",
    CauseCode.SLIP: "slip",
    FindingCode.START: "start from the static zero",
    FindingCode.STIFFNESS_RATIO: "dynamic over static stiffness",
    FindingCode.CURVATURE: "curvature",
    FindingCode.HARMONICS: "harmonics",
    FindingCode.DAMPING_POWER: "damping over frequency",
    FindingCode.ANGLE: "angle of the pulls",
    FindingCode.UNLOADED_FORCE: "unloaded force between records",
    FindingCode.UNLOADED_POSITION: "unloaded position between records",
    FindingCode.FORCE_NOISE: "force noise, swing over rest",
    FindingCode.MARKER_CORRELATION: "correlation of the marker noise",
}


def verdict_messages(verdicts: Iterable[Verdict], notes: Iterable[Note] = ()) -> tuple[Message[Code], ...]:
    """The verdicts as messages. A note on a trial that ended early leads and replaces those that it explains."""
    verdicts = tuple(verdicts)
    causes = [note for note in notes if set(EXPLAINED_BY.get(note.code, ())) & set(verdicts)]
    explained = {verdict for note in causes for verdict in EXPLAINED_BY[note.code]}
    return (*causes, *(Message(verdict) for verdict in verdicts if verdict not in explained))


def verdict_sentences(verdicts: Iterable[Verdict], notes: Iterable[Note] = ()) -> tuple[str, ...]:
    """The same as sentences."""
    return tuple(map(str, verdict_messages(verdicts, notes)))


def verdict_text(verdicts: Iterable[Verdict], notes: Iterable[Note] = ()) -> str:
    """All verdicts as one text."""
    return join_sentences(verdict_messages(verdicts, notes))

"""What a session without a page tells, one dataclass an event: as JSON for programs, as text for people.

Fields carry their unit in the name; sentences are for people, everything a program needs has a field of its own.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar, Literal

from station.journal import Choice
from station.session.judgement import Figure, Row


@dataclass(frozen=True)
class SessionOpened:
    """done and skipped of trials are decided already."""

    event: ClassVar[str] = "session_opened"
    subject: str
    session: str
    folder: str
    trials: int
    done: int
    skipped: int
    is_simulated: bool


@dataclass(frozen=True)
class NextTrial:
    """number counts from 1 in the plan; order is what to do at the bench before."""

    event: ClassVar[str] = "next_trial"
    cuff: str | None
    test: str
    repeat: int
    donning: str
    number: int
    trials: int
    order: str


@dataclass(frozen=True)
class StateChanged:
    """state as in the recorder: idle (opening the devices), armed, recording, closing, closed, failed."""

    event: ClassVar[str] = "state_changed"
    state: str
    sentence: str


@dataclass(frozen=True)
class Cued:
    """What the hands do now; step of steps are done."""

    event: ClassVar[str] = "cue"
    sentence: str
    rest: str
    step: int
    steps: int


@dataclass(frozen=True)
class Status:
    """Once a second while a trial runs."""

    event: ClassVar[str] = "status"
    state: str
    recorded_s: float
    waited_s: float
    left_s: float
    force_n: float | None
    displacement_mm: float | None
    sync_v: float | None
    lost_samples: int
    disk_left_s: float | None


Warning_ = Literal["alarm", "capture_running", "not_ready", "not_recorded", "not_armed", "not_summed_up"]


@dataclass(frozen=True)
class Warned:
    """Something is wrong, and the session goes on.

    alarm            the force broke a ceiling: unload the rope
    capture_running  the sync line is high before the trial: a capture that began too early or is one too many
    not_ready        a device or the disk is not ready; tried again in retry_s
    not_recorded     a trial ended before its sync edge; armed again
    not_armed        the recorder could not be started
    not_summed_up    fit, assessment or report of the session failed
    """

    event: ClassVar[str] = "warning"
    code: Warning_
    sentence: str
    retry_s: float | None = None


@dataclass(frozen=True)
class TrialEnded:
    event: ClassVar[str] = "trial_ended"
    file: str
    accepted: bool
    lost_samples: int
    sentence: str


@dataclass(frozen=True)
class VerdictGiven:
    """The figures of one recording with their 95 % intervals, and what they advise."""

    event: ClassVar[str] = "verdict"
    file: str
    title: str
    advice: Choice
    reasons: tuple[str, ...]
    figures: tuple[Figure, ...]
    rows: tuple[Row, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Decided:
    """by: the station itself, if there is no reason to redo the recording; the operator here, or somewhere else."""

    event: ClassVar[str] = "decided"
    file: str
    choice: Choice
    reason: str
    by: Literal["station", "operator", "elsewhere"]
    is_donned_anew: bool = False


@dataclass(frozen=True)
class Skipped:
    event: ClassVar[str] = "skipped"
    cuff: str | None
    test: str
    repeat: int


@dataclass(frozen=True)
class Waiting:
    """Nothing goes on until one of these commands comes."""

    event: ClassVar[str] = "waiting"
    what: Literal["decision", "pause", "start"]
    sentence: str
    commands: tuple[str, ...]


@dataclass(frozen=True)
class Answered:
    """To a command: what comes of it, or why it cannot be."""

    event: ClassVar[str] = "answer"
    is_refused: bool = field(kw_only=True)
    sentence: str


@dataclass(frozen=True)
class SummingUp:
    event: ClassVar[str] = "summing_up"
    sentence: str


@dataclass(frozen=True)
class SummedUp:
    """cuffs: one row each, heading → text; findings of the assessment in sentences."""

    event: ClassVar[str] = "summed_up"
    cuffs: tuple[dict[str, str], ...]
    findings: tuple[str, ...]
    report: str


@dataclass(frozen=True)
class SessionClosed:
    event: ClassVar[str] = "session_closed"
    trials: int
    done: int
    skipped: int
    is_complete: bool
    sentence: str


Event = (
    SessionOpened
    | NextTrial
    | StateChanged
    | Cued
    | Status
    | Warned
    | TrialEnded
    | VerdictGiven
    | Decided
    | Skipped
    | Waiting
    | Answered
    | SummingUp
    | SummedUp
    | SessionClosed
)

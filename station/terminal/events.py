"""Events of a session without a page, one dataclass a kind: as JSON for programs, as text for people.

Fields carry their unit in the name. Sentences are for people; a program uses the codes and figures beside them.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import ClassVar, Literal

from documents.message import Message
from fitting.results.codes import Verdict
from recordings.manifest import TrialCondition
from station.bench.view import TrialTelemetry
from station.journal import Choice
from station.messages.bench_messages import CueCode, TrialCode
from station.messages.session_messages import TerminalCode
from station.session.judgement import Grade, Judgement, Reason, Row, TrialQuantity
from station.session.plan_status import PlanState, PlanStatus
from station.session.trial_runner import LiveTrial

WarningCode = Literal[
    "alarm", "capture_running", "not_ready", "not_recorded", "not_armed", "telemetry_unread", "not_summed_up"
]
STATUS_INTERVAL_S = 1.0
"""Wall seconds."""


@dataclass(frozen=True)
class SessionEvent:
    """An event of a session; event is its kind for programs."""

    event: ClassVar[str]


@dataclass(frozen=True)
class SessionOpened(SessionEvent):
    """Of all trials of the plan, done are accepted and skipped are not recorded."""

    event: ClassVar[str] = "session_opened"
    subject: str
    session: str
    folder: str
    trials: int
    done: int
    skipped: int
    is_simulated: bool


@dataclass(frozen=True)
class NextTrial(SessionEvent):
    """number counts from 1 in the plan; order is the preparation at the bench; minutes_left is of the session."""

    event: ClassVar[str] = "next_trial"
    cuff: str | None
    test: str
    repeat: int
    donning: str
    number: int
    trials: int
    order: str
    condition: TrialCondition | None = None
    minutes_left: int = 0


@dataclass(frozen=True)
class StateChanged(SessionEvent):
    """state as in the recorder: idle (opening the devices), armed, recording, closing, closed, failed.

    problems: reasons why a trial that is being recorded will not be accepted; "" if there are none.
    """

    event: ClassVar[str] = "state_changed"
    state: str
    sentence: str
    codes: tuple[str, ...] = ()
    problems: str = ""


@dataclass(frozen=True)
class CueChanged(SessionEvent):
    """The instruction to the operator; step of steps are done."""

    event: ClassVar[str] = "cue"
    sentence: str
    rest: str
    step: int
    steps: int
    code: str = ""


@dataclass(frozen=True)
class Status(SessionEvent):
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


@dataclass(frozen=True)
class WarningRaised(SessionEvent):
    """A problem; the session continues.

    alarm            the force exceeded a limit: unload the rope
    capture_running  the sync line is high before the trial: a capture began too early or was not planned
    not_ready        a device or the disk is not ready; tried again in retry_s, None if that is of no use
    not_recorded     a trial ended before its sync edge; armed again
    not_armed        the recorder could not be started
    telemetry_unread  values or the result of a trial cannot be read, and are not shown; it is recorded to its end
    not_summed_up    fit, assessment or report of the session failed

    cause is the code of the alarm, the refusal or the end of the trial, "" if there is none.
    """

    event: ClassVar[str] = "warning"
    code: WarningCode
    sentence: str
    retry_s: float | None = None
    cause: str = ""


@dataclass(frozen=True)
class TrialEnded(SessionEvent):
    event: ClassVar[str] = "trial_ended"
    file: str
    accepted: bool
    lost_samples: int
    sentence: str
    codes: tuple[str, ...] = ()


@dataclass(frozen=True)
class VerdictGiven(SessionEvent):
    """The figures of one recording with their 95 % intervals, and the advice that follows from the reasons.

    doubts: results of the donning that are not identified; grade is good, doubtful or bad.
    """

    event: ClassVar[str] = "verdict"
    file: str
    title: str
    advice: Choice
    reasons: tuple[str, ...]
    figures: tuple[TrialQuantity, ...]
    rows: tuple[Row, ...]
    notes: tuple[str, ...]
    grade: Grade
    reason_codes: tuple[Reason, ...]
    doubts: tuple[str, ...]
    verdict_codes: tuple[Verdict, ...]

    @classmethod
    def of(cls, judgement: Judgement) -> VerdictGiven:
        return cls(
            judgement.file,
            judgement.title,
            judgement.advice,
            tuple(map(str, judgement.reasons)),
            judgement.figures,
            judgement.rows,
            judgement.notes,
            judgement.grade,
            judgement.reasons,
            judgement.doubts,
            judgement.verdicts,
        )


@dataclass(frozen=True)
class Decided(SessionEvent):
    """by: station if there is no reason to redo the recording; operator here, or elsewhere."""

    event: ClassVar[str] = "decided"
    file: str
    choice: Choice
    reason: str
    by: Literal["station", "operator", "elsewhere"]
    is_donned_anew: bool = False


@dataclass(frozen=True)
class TrialSkipped(SessionEvent):
    event: ClassVar[str] = "skipped"
    cuff: str | None
    test: str
    repeat: int
    condition: TrialCondition | None = None


@dataclass(frozen=True)
class PlannedTrial:
    """number counts from 1 in the plan, and is that of the commands."""

    number: int
    title: str
    state: PlanState


@dataclass(frozen=True)
class PlanListed(SessionEvent):
    """Every trial of the plan, in its order."""

    event: ClassVar[str] = "plan"
    trials: tuple[PlannedTrial, ...]

    @classmethod
    def of(cls, plan: PlanStatus) -> PlanListed:
        return cls(
            tuple(
                PlannedTrial(number, spec.title, plan.trial_state(spec)) for number, spec in enumerate(plan.trials, 1)
            )
        )


@dataclass(frozen=True)
class Waiting(SessionEvent):
    """The session waits for one of these commands."""

    event: ClassVar[str] = "waiting"
    what: Literal["decision", "pause", "start"]
    sentence: str
    commands: tuple[str, ...]


@dataclass(frozen=True)
class CommandAnswered(SessionEvent):
    """Answer to a command: its effect, or the reason of the refusal with its code."""

    event: ClassVar[str] = "answer"
    is_refused: bool = field(kw_only=True)
    sentence: str
    code: str = ""


@dataclass(frozen=True)
class SummaryStarted(SessionEvent):
    event: ClassVar[str] = "summing_up"
    sentence: str


@dataclass(frozen=True)
class SummaryProgressed(SessionEvent):
    """A stage of the summary has begun, of so many steps."""

    event: ClassVar[str] = "summing_up_stage"
    stage: str
    steps: int


@dataclass(frozen=True)
class SummaryFinished(SessionEvent):
    """cuffs: one row per cuff, heading → text; findings of the assessment in sentences."""

    event: ClassVar[str] = "summed_up"
    cuffs: tuple[dict[str, str], ...]
    findings: tuple[str, ...]
    report: str


@dataclass(frozen=True)
class SessionClosed(SessionEvent):
    event: ClassVar[str] = "session_closed"
    trials: int
    done: int
    skipped: int
    is_complete: bool
    sentence: str


class TrialMonitor:
    """Events of one trial. A cue is an event when its code or step changes; its figures change continuously."""

    def __init__(self, show_event: Callable[[SessionEvent], None]) -> None:
        self._show_event = show_event
        self._state: tuple[str, tuple[str, ...]] = ("", ())
        self._cue: tuple[int, CueCode] | None = None
        self._alarm: str | None = None
        self._status_s = 0.0
        self._is_capture_reported = self._is_unread_reported = False

    def update(self, live: LiveTrial) -> None:
        latest = live.latest
        self._update_state(latest)
        self._report_running_capture(latest)
        if latest.state == "recording":
            self._update_cue(live)
        if live.unread is not None and not self._is_unread_reported:
            self._is_unread_reported = True
            self._show_event(WarningRaised("telemetry_unread", str(live.unread), cause=live.unread.code.value))
        alarm = live.unseen_alarm
        if alarm is not None and str(alarm) != self._alarm:
            self._show_event(WarningRaised("alarm", str(alarm), cause=alarm.code.value))
        self._alarm = None if alarm is None else str(alarm)
        if time.perf_counter() - self._status_s >= STATUS_INTERVAL_S and latest.at is not None:
            self._status_s = time.perf_counter()
            self._show_event(_status(live))

    def _update_state(self, latest: TrialTelemetry) -> None:
        state, codes = latest.state, latest.codes
        if state != self._state[0] or (state == "recording" and codes != self._state[1]):
            self._state = state, codes
            self._show_event(StateChanged(state, latest.sentence, codes, latest.problems))

    def _report_running_capture(self, latest: TrialTelemetry) -> None:
        """A trial begins at a rising edge, so a line that is high while armed belongs to an earlier capture."""
        was_reported, self._is_capture_reported = (self._is_capture_reported, TrialCode.CAPTURE_RUNNING in latest.codes)
        if self._is_capture_reported and not was_reported:
            self._show_event(WarningRaised("capture_running", str(Message(TerminalCode.CAPTURE_NOT_RECORDED))))

    def _update_cue(self, live: LiveTrial) -> None:
        cue = live.cue
        if (cue.step, cue.message.code) != self._cue:
            self._cue = cue.step, cue.message.code
            self._show_event(CueChanged(cue.sentence, cue.rest.value, cue.step, cue.steps, cue.message.code.value))


def _status(live: LiveTrial) -> Status:
    latest = live.latest
    return Status(
        state=latest.state,
        recorded_s=latest.recorded_s,
        waited_s=latest.waited_s,
        left_s=latest.left_s,
        force_n=live.force[-1][1] if live.force else None,
        displacement_mm=live.displacement[-1][1] if live.displacement else None,
        sync_v=latest.sync_v,
        lost_samples=latest.lost_samples,
        disk_left_s=latest.disk_left_s,
    )

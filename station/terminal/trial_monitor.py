"""Events of a running trial: changes of state and cue, alarms, a capture that is not recorded, the status."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from station.messages.codes import CueCode, TerminalCode, TrialCode
from station.messages.message import Message
from station.session.live_trial import LiveTrial
from station.terminal.events import CueChanged, Event, StateChanged, Status, WarningRaised

STATUS_INTERVAL_S = 1.0
"""Wall seconds."""


class TrialMonitor:
    """Events of one trial. A cue is an event when its code or step changes; its figures change continuously."""

    def __init__(self, show_event: Callable[[Event], None]) -> None:
        self._show_event = show_event
        self._state: tuple[str, list[str]] = ("", [])
        self._cue: tuple[int, CueCode] | None = None
        self._alarm: str | None = None
        self._status_s = 0.0
        self._is_capture_reported = False

    def update(self, live: LiveTrial) -> None:
        latest = live.latest
        self._update_state(latest)
        self._report_running_capture(latest)
        if latest["state"] == "recording":
            self._update_cue(live)
        alarm = live.unseen_alarm
        if alarm is not None and str(alarm) != self._alarm:
            self._show_event(WarningRaised("alarm", str(alarm), cause=alarm.code.value))
        self._alarm = None if alarm is None else str(alarm)
        if time.perf_counter() - self._status_s >= STATUS_INTERVAL_S and "recorded_s" in latest:
            self._status_s = time.perf_counter()
            self._show_event(_status(live))

    def _update_state(self, latest: dict[str, Any]) -> None:
        state, codes = latest["state"], latest["codes"]
        if state != self._state[0] or (state == "recording" and codes != self._state[1]):
            self._state = state, codes
            self._show_event(StateChanged(state, latest["sentence"], tuple(codes), latest["problems"]))

    def _report_running_capture(self, latest: dict[str, Any]) -> None:
        """A trial begins at a rising edge, so a line that is high while armed belongs to an earlier capture."""
        was_reported, self._is_capture_reported = (
            self._is_capture_reported,
            TrialCode.CAPTURE_RUNNING in latest["codes"],
        )
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
        state=latest["state"],
        recorded_s=latest["recorded_s"],
        waited_s=latest["waited_s"],
        left_s=latest["left_s"],
        force_n=live.force[-1][1] if live.force else None,
        displacement_mm=live.displacement[-1][1] if live.displacement else None,
        sync_v=latest["sync_v"],
        lost_samples=latest["lost_samples"],
        disk_left_s=latest["disk_left_s"],
    )

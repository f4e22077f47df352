"""What is worth telling of a running trial: its states, its cues, an alarm, a capture that it is not."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from typing import Any

from station.bench.falls import ALREADY_CAPTURING
from station.session.live import Live
from station.terminal.events import Cued, Event, StateChanged, Status, Warned

STATUS_S = 1.0
"""Wall seconds."""
DIGITS = re.compile(r"[\d.+-]+")


class TrialWatch:
    """Of one trial. Counts and figures in a cue change all the time; it is told again only where its text changes."""

    def __init__(self, tell: Callable[[Event], None]) -> None:
        self._tell = tell
        self._state = ""
        self._sentence = ""
        self._cue: tuple[int, str] | None = None
        self._alarm: str | None = None
        self._status_s = 0.0
        self._is_capture_told = False

    def look(self, live: Live) -> None:
        told = live.latest
        self._look_at_state(told)
        self._look_for_another_capture(told)
        if told["state"] == "recording":
            self._look_at_cue(live)
        if live.unseen_alarm is not None and live.unseen_alarm != self._alarm:
            self._tell(Warned("alarm", live.unseen_alarm))
        self._alarm = live.unseen_alarm
        if time.monotonic() - self._status_s >= STATUS_S and "recorded_s" in told:
            self._status_s = time.monotonic()
            self._tell(_status(live))

    def _look_at_state(self, told: dict[str, Any]) -> None:
        if told["state"] != self._state or (told["state"] == "recording" and told["sentence"] != self._sentence):
            self._state, self._sentence = told["state"], told["sentence"]
            self._tell(StateChanged(self._state, self._sentence))

    def _look_for_another_capture(self, told: dict[str, Any]) -> None:
        """Only a rising edge begins a trial, so a line that is high while armed belongs to a capture before it."""
        is_told, self._is_capture_told = self._is_capture_told, told["sentence"] == ALREADY_CAPTURING
        if self._is_capture_told and not is_told:
            self._tell(
                Warned(
                    "capture_running",
                    "the sync line is high: a capture runs that began before this trial was armed, and it is not "
                    "recorded; stop that capture, then start the one of this trial",
                )
            )

    def _look_at_cue(self, live: Live) -> None:
        cue = live.cue
        key = cue.step, DIGITS.sub("#", cue.sentence)
        if key != self._cue:
            self._cue = key
            self._tell(Cued(cue.sentence, cue.rest.value, cue.step, cue.steps))


def _status(live: Live) -> Status:
    told = live.latest
    return Status(
        state=told["state"],
        recorded_s=told["recorded_s"],
        waited_s=told["waited_s"],
        left_s=told["left_s"],
        force_n=live.force[-1][1] if live.force else None,
        displacement_mm=live.displacement[-1][1] if live.displacement else None,
        sync_v=told["sync_v"],
        lost_samples=told["lost_samples"],
        disk_left_s=told["disk_left_s"],
    )

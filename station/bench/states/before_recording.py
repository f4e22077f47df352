"""What ends a trial before its recording: nothing is stored yet, so it ends at once."""

from __future__ import annotations

from station.bench.states.context import DeviceFailure
from station.bench.states.state import Ended, State
from station.messages.codes import TrialCode
from station.messages.message import Message

CANCELLED = Message(TrialCode.CANCELLED)


class BeforeRecording(State):
    def stop(self, *, at_once: bool) -> State:  # noqa: ARG002
        return Ended(CANCELLED)

    def fail(self, failure: DeviceFailure) -> State:
        return Ended(failure.message)

    def cut_short(self, message: Message[TrialCode]) -> State:
        return Ended(message)

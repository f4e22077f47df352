"""A trial whose devices are opening."""

from __future__ import annotations

from station.bench.snapshot import TrialState
from station.bench.states.context import DeviceFailure
from station.bench.states.state import Over, State

CANCELLED = "cancelled by the operator before the sync edge; nothing was recorded"


class Idle(State):
    name, sentence = TrialState.IDLE, "idle"

    def stop(self, *, at_once: bool) -> State:  # noqa: ARG002
        return Over(CANCELLED)

    def fail(self, failure: DeviceFailure) -> State:
        return Over(failure.sentence)

    def cut_short(self, kind: str, sentence: str) -> State:  # noqa: ARG002
        return Over(sentence)

"""A trial whose devices are opening."""

from __future__ import annotations

from station.bench.snapshot import OPENING, TrialState
from station.bench.states.before_recording import BeforeRecording


class Idle(BeforeRecording):
    name, messages = TrialState.IDLE, OPENING

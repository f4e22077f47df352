"""State of one trial at one moment, for views."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from recordings.manifest import DataOrigin
from recordings.samples import Stream
from station.messages.codes import TrialCode
from station.messages.message import Message, join_sentences


class TrialState(Enum):
    IDLE = "idle"
    ARMED = "armed"
    RECORDING = "recording"
    CLOSING = "closing"
    CLOSED = "closed"
    FAILED = "failed"


OPENING = (Message(TrialCode.OPENING),)


@dataclass(frozen=True)
class Snapshot:
    """left_s: station seconds until the time-out of an armed trial; 0 in other states.

    messages are the state, and what will keep the trial from being accepted. edge_device_ns is the time of the sync
    edge on the clock of /sync, None before it; recording is the file, None where the recorder has not named it;
    origin is what its devices report.
    """

    state: TrialState
    messages: tuple[Message[TrialCode], ...] = OPENING
    sync_level_v: float | None = None
    waited_s: float = 0.0
    recorded_s: float = 0.0
    lost_samples: int = 0
    marks: int = 0
    streams: tuple[Stream, ...] = ()
    left_s: float = 0.0
    edge_device_ns: int | None = None
    recording: Path | None = None
    origin: DataOrigin = DataOrigin.UNKNOWN

    @property
    def sentence(self) -> str:
        return join_sentences(self.messages)

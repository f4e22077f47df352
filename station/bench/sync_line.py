"""The 5 V sync line, block by block: its level, its edges and its glitches."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from recordings.samples import Samples
from station.messages.codes import TrialCode
from station.messages.message import Message

GLITCH_NS = 5_000_000
"""A level that lasts less is a glitch: it neither starts nor ends a trial."""


@dataclass(frozen=True)
class Edge:
    """A crossing of the threshold at the first sample beyond it; is_glitch: the line returned within GLITCH_NS."""

    rising: bool
    sample_number: int
    device_time_ns: int
    from_v: float
    to_v: float
    is_glitch: bool = False


def wrong_polarity(fall: Edge) -> Message[TrialCode]:
    """The message for a falling edge where a rising one was expected."""
    return Message(TrialCode.WRONG_POLARITY, {"from_v": fall.from_v, "to_v": fall.to_v})


class SyncLine:
    """Level and edges of /sync. level_v is the voltage of the last sample, None before the first."""

    def __init__(self, threshold_v: float) -> None:
        self.threshold_v = threshold_v
        self.level_v: float | None = None
        self._unsettled: Edge | None = None  # the line may still return, in this block or the next

    @property
    def is_high(self) -> bool:
        return self.level_v is not None and self.level_v >= self.threshold_v

    @property
    def has_settled(self) -> bool:
        """Whether the level has lasted longer than a glitch."""
        return self._unsettled is None

    def missing_edge(self, timeout_s: float, fall: Edge | None) -> Message[TrialCode]:
        """The message for a time-out without a rising edge; fall is the latest unexplained falling edge."""
        if fall is not None:
            figures = {"timeout_s": timeout_s, "from_v": fall.from_v, "to_v": fall.to_v}
            return Message(TrialCode.NO_SYNC_EDGE_FELL, figures)
        if self.level_v is None:
            return Message(TrialCode.NO_SYNC_EDGE_NO_SAMPLES, {"timeout_s": timeout_s})
        code = TrialCode.NO_SYNC_EDGE_HIGH if self.is_high else TrialCode.NO_SYNC_EDGE_LOW
        return Message(code, {"timeout_s": timeout_s, "level_v": self.level_v, "threshold_v": self.threshold_v})

    def update(self, samples: Samples) -> list[Edge]:
        """Take a block; return the edges and glitches that it settles, in order. A glitch is two crossings.

        An edge within GLITCH_NS of the end of a block is returned with the next block.
        """
        if not len(samples.device_time_ns):
            return []
        settled: list[Edge] = []
        for edge in self._crossings(samples):
            before, self._unsettled = self._unsettled, edge
            if before is not None and edge.device_time_ns - before.device_time_ns < GLITCH_NS:
                settled.append(replace(before, is_glitch=True))
                self._unsettled = None
            elif before is not None:
                settled.append(before)
        if self._unsettled is not None and samples.device_time_ns[-1] - self._unsettled.device_time_ns >= GLITCH_NS:
            settled.append(self._unsettled)
            self._unsettled = None
        return settled

    def _crossings(self, samples: Samples) -> list[Edge]:
        """Crossings of the threshold in this block, also one between the previous block and this one."""
        volts = samples.values[:, 0].astype(np.float64)
        before = np.concatenate(([volts[0] if self.level_v is None else self.level_v], volts[:-1]))
        crossings = np.flatnonzero((before >= self.threshold_v) != (volts >= self.threshold_v))
        self.level_v = float(volts[-1])
        return [
            Edge(
                rising=bool(volts[i] >= self.threshold_v),
                sample_number=int(samples.sample_numbers[i]),
                device_time_ns=int(samples.device_time_ns[i]),
                from_v=float(before[i]),
                to_v=float(volts[i]),
            )
            for i in crossings
        ]

"""The 5 V sync line as it comes in: its level now, every edge, and every glitch that is none."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from recordings.samples import Samples

GLITCH_NS = 5_000_000
"""A level that is left again sooner was never reached: nothing starts with it, and nothing ends."""


@dataclass(frozen=True)
class Edge:
    """A crossing of the threshold, named by the first sample on its far side; is_glitch: the line was back at once."""

    rising: bool
    sample_number: int
    device_time_ns: int
    from_v: float
    to_v: float
    is_glitch: bool = False


def wrong_polarity(fell: Edge) -> str:
    """What a fall says that came where a rise was expected."""
    return (
        f"the sync line fell from {fell.from_v:.2f} V to {fell.to_v:.2f} V where a rise was expected; "
        "set the sync output of the mocap system to active high (or swap the two wires)"
    )


class SyncLine:
    """Follows /sync block by block. level_v is the last sample's voltage, None before the first."""

    def __init__(self, threshold_v: float) -> None:
        self.threshold_v = threshold_v
        self.level_v: float | None = None
        self._unsettled: Edge | None = None  # the line may yet come back, in this block or the next

    @property
    def is_high(self) -> bool:
        return self.level_v is not None and self.level_v >= self.threshold_v

    @property
    def has_settled(self) -> bool:
        """Whether the level has lasted too long for a glitch."""
        return self._unsettled is None

    def why_no_rise(self, fell: Edge | None) -> str:
        """What may have kept a capture's start from showing; fell is the latest fall."""
        level = "unknown" if self.level_v is None else f"{self.level_v:z.2f} V"
        if fell is not None:
            return f"; {wrong_polarity(fell)}"
        if self.is_high:
            return (
                f": the sync line stands at {level} since arming, expected below {self.threshold_v:g} V until the "
                "capture starts; stop the running capture or check the line's polarity"
            )
        return (
            f": the sync line stands at {level}, expected a rise above {self.threshold_v:g} V when the capture starts; "
            "check that the capture was started and that the sync cable is plugged in"
        )

    def feed(self, samples: Samples) -> list[Edge]:
        """What this block settles, in order: edges whose level has lasted, and glitches, each of which was two edges.

        An edge shortly before the end of a block is told with the next one.
        """
        told: list[Edge] = []
        for edge in self._crossings(samples):
            before, self._unsettled = self._unsettled, edge
            if before is not None and edge.device_time_ns - before.device_time_ns < GLITCH_NS:
                told.append(replace(before, is_glitch=True))
                self._unsettled = None
            elif before is not None:
                told.append(before)
        latest_ns = int(samples.device_time_ns[-1]) if len(samples.device_time_ns) else 0
        if self._unsettled is not None and latest_ns - self._unsettled.device_time_ns >= GLITCH_NS:
            told.append(self._unsettled)
            self._unsettled = None
        return told

    def _crossings(self, samples: Samples) -> list[Edge]:
        """Of the threshold in this block, also one between the block before and this one."""
        volts = samples.values[:, 0].astype(np.float64)
        if not len(volts):
            return []
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

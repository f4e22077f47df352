"""The 5 V sync line as it comes in: its level now, and every edge."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from recordings.samples import Samples


@dataclass(frozen=True)
class Edge:
    """A crossing of the threshold, named by the first sample on its far side."""

    rising: bool
    sample_number: int
    device_time_ns: int
    from_v: float
    to_v: float


class SyncLine:
    """Follows /sync block by block. level_v is the last sample's voltage, None before the first."""

    def __init__(self, threshold_v: float) -> None:
        self.threshold_v = threshold_v
        self.level_v: float | None = None

    @property
    def is_high(self) -> bool:
        return self.level_v is not None and self.level_v >= self.threshold_v

    def feed(self, samples: Samples) -> list[Edge]:
        """The edges in this block, also one between the block before and this one."""
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

"""Count and rate of the samples of one stream, for views of a running trial."""

from __future__ import annotations

from collections import deque

import numpy as np

from recordings.samples import Samples


class StreamTally:
    """Last value of one stream, and its rate over the last `refreshes` refreshes of the view."""

    def __init__(self, refreshes: int = 12) -> None:
        self.total = 0
        self.last = ""
        self._history: deque[tuple[float, int]] = deque(maxlen=refreshes)

    def add(self, samples: Samples) -> None:
        self.total += len(samples.values)
        if not len(samples.values):
            return
        last = samples.values[-1]
        if samples.stream == "/markers":
            seen = int(np.isfinite(last[:, 0]).sum())
            self.last = f"{seen} of {len(last)} markers seen"
        else:
            self.last = f"{float(last[0]):+.3f}"

    def rate(self, station_s: float) -> float:
        self._history.append((station_s, self.total))
        (t0, n0), (t1, n1) = self._history[0], self._history[-1]
        return (n1 - n0) / (t1 - t0) if t1 > t0 else 0.0

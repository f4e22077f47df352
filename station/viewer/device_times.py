"""Convert the device time of samples to the UTC of the host."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from recordings.samples import Samples


class DeviceTimes:
    """One clock offset per stream, from the block with the smallest delay so far.

    At the sync edge, the offset of the DAQ is fixed, and the first frame of the capture is aligned with the edge.
    """

    def __init__(self) -> None:
        self.edge_ns: int | None = None  # UTC
        self._edge_device_ns: int | None = None
        self._frame_ns = 0.0
        self._offsets: dict[str, int] = {}
        self._settled: set[str] = set()

    def set_edge(self, device_ns: int | None, frame_rate_hz: float) -> None:
        """Set the sync edge on the clock of /sync (None before it) and the nominal frame rate."""
        self._edge_device_ns = device_ns
        self._frame_ns = 1e9 / frame_rate_hz if frame_rate_hz > 0 else 0.0
        if device_ns is not None and self.edge_ns is None and "/sync" in self._offsets:
            self.edge_ns = device_ns + self._offsets["/sync"]
            self._settled |= self._offsets.keys() - {"/markers"}

    def of(self, samples: Samples) -> NDArray[np.int64]:
        """UTC [ns] (n,) of a block with at least one sample."""
        stream, last_ns = samples.stream, int(samples.device_time_ns[-1])
        if stream not in self._settled:
            offset = samples.host_time_ns - last_ns
            self._offsets[stream] = min(self._offsets.get(stream, offset), offset)
            if stream == "/markers":
                self._settle_frames(samples)
            if stream == "/sync":
                self.set_edge(self._edge_device_ns, 1e9 / self._frame_ns if self._frame_ns else 0.0)
        return np.asarray(samples.device_time_ns + self._offsets[stream], dtype=np.int64)

    def _settle_frames(self, frames: Samples) -> None:
        """Align frame 1 with the edge; a preview that has not ended has another frame number at that time."""
        first_ns = frames.device_time_ns[0] - round((int(frames.sample_numbers[0]) - 1) * self._frame_ns)
        if self.edge_ns is None or not self._frame_ns:
            return
        at_edge_ns = int(self.edge_ns - first_ns)
        if abs(at_edge_ns - self._offsets["/markers"]) < LATEST_NS:
            self._offsets["/markers"] = at_edge_ns
            self._settled.add("/markers")


LATEST_NS = 1_000_000_000
"""Largest delay of a frame; frame numbers with a larger one are not those of this capture."""

"""Where samples lie in time: by their device's clock, laid onto the host's UTC."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from recordings.samples import Samples


class DeviceTimes:
    """One offset a stream, from the block that was least delayed so far.

    With the sync edge the DAQ's offset stays as it is, and the first frame of the capture is laid onto the edge.
    """

    def __init__(self) -> None:
        self.edge_ns: int | None = None  # UTC
        self._edge_device_ns: int | None = None
        self._frame_ns = 0.0
        self._offsets: dict[str, int] = {}
        self._settled: set[str] = set()

    def set_edge(self, device_ns: int | None, frame_rate_hz: float) -> None:
        """The edge by the clock of /sync, None before it, and the nominal rate of the frames."""
        self._edge_device_ns = device_ns
        self._frame_ns = 1e9 / frame_rate_hz if frame_rate_hz > 0 else 0.0
        if device_ns is not None and self.edge_ns is None and "/sync" in self._offsets:
            self.edge_ns = device_ns + self._offsets["/sync"]
            self._settled |= self._offsets.keys() - {"/markers"}

    def of(self, samples: Samples) -> NDArray[np.int64]:
        """(n,) UTC [ns] of a block with at least one sample."""
        stream, last_ns = samples.stream, int(samples.device_time_ns[-1])
        if stream not in self._settled:
            delayed = samples.host_time_ns - last_ns
            self._offsets[stream] = min(self._offsets.get(stream, delayed), delayed)
            if stream == "/markers":
                self._settle_frames(samples)
            if stream == "/sync":
                self.set_edge(self._edge_device_ns, 1e9 / self._frame_ns if self._frame_ns else 0.0)
        return np.asarray(samples.device_time_ns + self._offsets[stream], dtype=np.int64)

    def _settle_frames(self, frames: Samples) -> None:
        """Frame 1 is exposed at the edge; frames that run on from a preview have another number there."""
        first_ns = frames.device_time_ns[0] - round((int(frames.sample_numbers[0]) - 1) * self._frame_ns)
        if self.edge_ns is None or not self._frame_ns:
            return
        at_edge_ns = int(self.edge_ns - first_ns)
        if abs(at_edge_ns - self._offsets["/markers"]) < LATEST_NS:
            self._offsets["/markers"] = at_edge_ns
            self._settled.add("/markers")


LATEST_NS = 1_000_000_000
"""By which frames may arrive after their exposure; numbers that disagree by more are not those of this capture."""

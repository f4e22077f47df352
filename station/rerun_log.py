"""A trial as a Rerun recording (.rrd): force, sync line and markers on one timeline, to look at and to share.

Rerun's viewer is not started: it would bind every interface and its page phones home. Open the file with `rerun FILE`.
"""

from __future__ import annotations

from pathlib import Path
from types import TracebackType

import numpy as np
import rerun as rr

from recordings.samples import Event, Item, Samples
from station.background_view import BackgroundView
from station.session import Snapshot

REFRESH_S = 0.2
BACKLOG = 5000
MARKER_RATE_HZ = 25.0
"""A hundred point clouds a second cost a tenth of a core and look no smoother."""


class RerunLog(BackgroundView):
    """A view that writes an .rrd file.

    The timeline is the host's UTC: the last sample of a block lies at its arrival, those before by the device's clock.
    """

    def __init__(self, path: Path) -> None:
        super().__init__("rerun log", REFRESH_S, BACKLOG)
        self._stream = rr.RecordingStream("cuffstation")
        self._stream.save(path)
        self._last_points_ns = 0

    def show(self, snapshot: Snapshot) -> None:
        """The state is told by the events already."""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        super().__exit__(kind, error, trace)
        self._stream.disconnect()

    def _take(self, item: Item) -> None:
        if isinstance(item, Event):
            self._stream.set_time("host", timestamp=np.datetime64(item.host_time_ns, "ns"))
            self._stream.log("events", rr.TextLog(item.text))
        elif isinstance(item, Samples) and len(item.values):
            self._log_samples(item)

    def _log_samples(self, samples: Samples) -> None:
        times_ns = samples.host_time_ns - samples.device_time_ns[-1] + samples.device_time_ns
        if samples.stream != "/markers":
            times = rr.TimeColumn("host", timestamp=times_ns.astype("datetime64[ns]"))
            columns = rr.Scalars.columns(scalars=samples.values[:, 0])
            self._stream.send_columns(samples.stream, indexes=[times], columns=columns)
            return
        for time_ns, frame in zip(times_ns, samples.values, strict=True):
            if time_ns - self._last_points_ns >= 1e9 / MARKER_RATE_HZ:
                self._last_points_ns = int(time_ns)
                self._stream.set_time("host", timestamp=np.datetime64(int(time_ns), "ns"))
                self._stream.log("markers", rr.Points3D(frame[np.isfinite(frame[:, 0]), :3], radii=6.0))

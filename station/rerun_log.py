"""A trial for Rerun: force, sync line, markers and rope on one timeline, in a viewer or as an .rrd to share.

The viewer is Rerun's own window. It is bound to this machine alone and its analytics are turned off for it: left to
itself it binds every interface and reports its use. A slow or closed viewer costs the recording nothing.
"""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from types import TracebackType

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from recordings.samples import Event, Item, Samples
from station.background_view import BackgroundView
from station.rerun_viewer import start_viewer
from station.session import Snapshot

REFRESH_S = 0.2
BACKLOG = 5000
MARKER_RATE_HZ = 25.0
"""A hundred point clouds a second cost a tenth of a core and look no smoother."""


def open_rerun(stack: ExitStack, path: Path | None, has_viewer: bool, rope: tuple[str, ...]) -> list[RerunLog]:
    """The views that were asked for: file, viewer, both or none. Raises ViewerError if the viewer does not start."""
    sinks: list[Path | str] = [] if path is None else [path]
    if has_viewer:
        sinks.append(start_viewer())
    return [stack.enter_context(RerunLog(sink, rope)) for sink in sinks]


class RerunLog(BackgroundView):
    """A view that writes into an .rrd file, or into a viewer at an address; rope are the labels of its markers.

    The timeline is the host's UTC: the last sample of a block lies at its arrival, those before by the device's clock.
    """

    def __init__(self, sink: Path | str, rope: tuple[str, ...] = ()) -> None:
        super().__init__("rerun log", REFRESH_S, BACKLOG)
        self.stream = rr.RecordingStream("cuffstation")
        if isinstance(sink, Path):
            self.stream.save(sink)
        else:
            self.stream.connect_grpc(sink)
        self._rope = rope
        self._labels: tuple[str, ...] = ()
        self._last_points_ns = 0

    def show(self, snapshot: Snapshot) -> None:
        """The state is told by the events already; the markers' names come with it."""
        self._labels = {stream.name: stream.labels for stream in snapshot.streams}.get("/markers", ())

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        super().__exit__(kind, error, trace)
        self.stream.disconnect()

    def _take(self, item: Item) -> None:
        if isinstance(item, Event):
            self.stream.set_time("host", timestamp=np.datetime64(item.host_time_ns, "ns"))
            self.stream.log("events", rr.TextLog(item.text))
        elif isinstance(item, Samples) and len(item.values):
            self._log_samples(item)

    def _log_samples(self, samples: Samples) -> None:
        times_ns = samples.host_time_ns - samples.device_time_ns[-1] + samples.device_time_ns
        if samples.stream != "/markers":
            times = rr.TimeColumn("host", timestamp=times_ns.astype("datetime64[ns]"))
            columns = rr.Scalars.columns(scalars=samples.values[:, 0])
            self.stream.send_columns(samples.stream, indexes=[times], columns=columns)
            return
        for time_ns, frame in zip(times_ns, samples.values, strict=True):
            if time_ns - self._last_points_ns >= 1e9 / MARKER_RATE_HZ:
                self._last_points_ns = int(time_ns)
                self.stream.set_time("host", timestamp=np.datetime64(int(time_ns), "ns"))
                self._log_frame(frame)

    def _log_frame(self, frame: NDArray[np.floating]) -> None:
        seen = np.isfinite(frame[:, 0])
        self.stream.log("markers", rr.Points3D(frame[seen, :3], radii=6.0))
        rope = frame[[number for number, label in enumerate(self._labels) if label in self._rope], :3]
        if len(rope) > 1 and np.isfinite(rope).all():
            self.stream.log("rope", rr.LineStrips3D([rope], radii=2.0))

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
from station.bench.background_view import BackgroundView
from station.bench.snapshot import Snapshot
from station.viewer.device_times import DeviceTimes
from station.viewer.layout import TIMELINE, Framed, layout
from station.viewer.viewer import start_viewer

REFRESH_S = 0.5
BACKLOG = 5000
CURVE_RATE_HZ, MARKER_RATE_HZ = 100.0, 25.0
"""As dense as an eye wants it. What Rerun's calls cost goes by their number: one a refresh for each thing that is shown
(`python -m benchmarks.rerun` measures it)."""

METRES_A_MM = 1e-3
"""The body that a replay draws beside the markers is in metres."""

Columns = list[tuple[NDArray[np.int64], NDArray[np.floating]]]
"""Host times [ns], and values at them."""


def open_rerun(stack: ExitStack, path: Path | None, rope: tuple[str, ...], *, has_viewer: bool) -> list[RerunLog]:
    """The views that were asked for: file, viewer, both or none. Raises ViewerError if the viewer does not start."""
    sinks: list[Path | str] = [] if path is None else [path]
    if has_viewer:
        sinks.append(start_viewer())
    return [stack.enter_context(RerunLog(sink, rope)) for sink in sinks]


class RerunLog(BackgroundView):
    """A view that writes into an .rrd file, or into a viewer at an address; rope are the labels of its markers.

    There is one timeline, TIMELINE: every sample lies where its device's clock puts it, not where it arrived. The clock
    of a stream is laid onto UTC by the block that was least delayed so far; from the sync edge on it stays, and frame 1
    of the capture lies at the edge. edge_ns is then the edge on that timeline.
    """

    def __init__(self, sink: Path | str, rope: tuple[str, ...] = ()) -> None:
        super().__init__("rerun log", REFRESH_S, BACKLOG)
        self.stream = rr.RecordingStream("cuffstation")
        self.stream.set_log_time_enabled(False)
        self.stream.set_log_tick_enabled(False)
        if isinstance(sink, Path):
            self.stream.save(sink)
        else:
            self.stream.connect_grpc(sink)
        self._rope = rope
        self._labels: tuple[str, ...] = ()
        self._pending: dict[str, Columns] = {}
        self._last_ns: dict[str, int] = {}
        self._times = DeviceTimes()
        self.framed: Framed | None = None  # what the view of the markers shows, once they were seen
        self.stream.send_blueprint(layout())
        self.stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)  # as QTM has it, unless told otherwise
        self.stream.log("markers", rr.Points3D.from_fields(radii=0.006), static=True)
        self.stream.log("rope", rr.LineStrips3D.from_fields(radii=0.002), static=True)

    def show(self, snapshot: Snapshot) -> None:
        """The state is told by the events already; the markers' names come with it."""
        streams = {stream.name: stream for stream in snapshot.streams}
        self._labels = streams["/markers"].labels if "/markers" in streams else ()
        self._times.set_edge(snapshot.edge_device_ns, streams["/markers"].rate_hz if self._labels else 0.0)

    @property
    def edge_ns(self) -> int | None:
        """The sync edge on the timeline [UTC, ns]; None before it."""
        return self._times.edge_ns

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        super().__exit__(kind, error, trace)
        self.stream.disconnect()

    def _refresh(self) -> None:
        super()._refresh()
        pending, self._pending = self._pending, {}
        for name, columns in pending.items():
            times_ns, values = (np.concatenate(parts) for parts in zip(*columns, strict=True))
            if name == "/markers":
                self._send_markers(times_ns, METRES_A_MM * values[:, :, :3])
            else:
                self._send(name, times_ns, rr.Scalars.columns(scalars=values[:, 0]))

    def _take(self, item: Item) -> None:
        if isinstance(item, Event):
            at_ns = self._times.edge_ns if item.kind == "sync_edge" else None
            self.stream.set_time(TIMELINE, timestamp=np.datetime64(at_ns or item.host_time_ns, "ns"))
            self.stream.log("events", rr.TextLog(item.text))
        elif isinstance(item, Samples) and len(item.values):
            times_ns = self._times.of(item)
            kept = self._thinned(item.stream, times_ns)
            if len(kept):
                self._pending.setdefault(item.stream, []).append((times_ns[kept], item.values[kept]))

    def _thinned(self, name: str, times_ns: NDArray[np.int64]) -> NDArray[np.intp]:
        """Which samples are shown: in every stretch of time the first."""
        stretch_ns = round(1e9 / (MARKER_RATE_HZ if name == "/markers" else CURVE_RATE_HZ))
        stretches = np.concatenate([[self._last_ns.get(name, -1)], times_ns // stretch_ns])
        self._last_ns[name] = int(stretches[-1])
        return np.flatnonzero(np.diff(stretches))

    def _send_markers(self, times_ns: NDArray[np.int64], frames: NDArray[np.floating]) -> None:
        seen = np.isfinite(frames[:, :, 0])
        names = self._labels if len(self._labels) == frames.shape[1] else tuple(map(str, range(frames.shape[1])))
        labels = np.broadcast_to(np.array(names), seen.shape)[seen].tolist()
        points = rr.Points3D.columns(positions=frames[seen], labels=labels).partition(lengths=seen.sum(axis=1))
        self._send("markers", times_ns, points)
        if self.framed is None and seen.any():
            self.framed = Framed.around(frames[seen])
            self.stream.send_blueprint(layout(framed=self.framed))
        rope = frames[:, [number for number, label in enumerate(self._labels) if label in self._rope]]
        taut = np.isfinite(rope).all(axis=(1, 2))
        if rope.shape[1] > 1 and taut.any():
            self._send("rope", times_ns[taut], rr.LineStrips3D.columns(strips=rope[taut]))

    def _send(self, name: str, times_ns: NDArray[np.int64], columns: rr.ComponentColumnList) -> None:
        times = rr.TimeColumn(TIMELINE, timestamp=times_ns.astype("datetime64[ns]"))
        self.stream.send_columns(name, indexes=[times], columns=columns)

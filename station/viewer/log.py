"""Show a trial in Rerun: force, sync line, markers and rope on one timeline, in a viewer or in an .rrd file.

The viewer is Rerun's own window. It listens on 127.0.0.1 only and its analytics are disabled; by default it listens on
every interface and reports its use. A slow or closed viewer does not affect the recording.

Device times of samples are converted to the UTC of the host.
"""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from types import TracebackType

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from recordings.samples import Event, Item, Samples
from station.bench.view import BackgroundView, Snapshot
from station.viewer.viewer import TIMELINE, SceneExtent, layout, open_stream, start_viewer

REFRESH_S = 0.5
BACKLOG = 5000
CURVE_RATE_HZ, MARKER_RATE_HZ = 100.0, 25.0
"""Rates of the display. The cost of Rerun depends on the number of calls: one per refresh and stream
(docs/reliability.md)."""

STREAMS = ("/force", "/sync", "/markers")
METRES_PER_MM = 1e-3
"""The body that a replay draws is in metres."""

Columns = list[tuple[NDArray[np.int64], NDArray[np.floating]]]
"""Host times [ns], and values at them."""


def open_rerun(
    stack: ExitStack, path: Path | None, rope: tuple[str, ...], *, has_viewer: bool, is_complete: bool = False
) -> list[RerunLog]:
    """Open the requested views: file, viewer, both or none. Raises ViewerError if the viewer does not start.

    is_complete: nothing is dropped, however fast the items come; the end waits for the last one.
    """
    sinks: list[Path | str] = [] if path is None else [path]
    if has_viewer:
        sinks.append(start_viewer())
    return [stack.enter_context(RerunLog(sink, rope, None if is_complete else BACKLOG)) for sink in sinks]


class RerunLog(BackgroundView):
    """A view that writes to an .rrd file, or to a viewer at an address. rope: labels of the markers on the rope.

    TIMELINE is the only timeline. Samples are at the time of their device clock, not at their time of arrival; see
    DeviceTimes. edge_ns is the sync edge on this timeline.
    """

    def __init__(self, sink: Path | str, rope: tuple[str, ...] = (), backlog: int | None = BACKLOG) -> None:
        super().__init__("rerun log", REFRESH_S, backlog)
        self.stream = open_stream("cuffstation", sink)
        self._rope = rope
        self._labels: tuple[str, ...] = ()
        self._pending: dict[str, Columns] = {}
        self._last_interval: dict[str, int] = {}
        self._times = DeviceTimes()
        self.extent: SceneExtent | None = None  # of the markers, once they are visible
        self.stream.send_blueprint(layout())
        self.stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)  # default of QTM
        self.stream.log("markers", rr.Points3D.from_fields(radii=0.006), static=True)
        self.stream.log("rope", rr.LineStrips3D.from_fields(radii=0.002), static=True)

    def show(self, snapshot: Snapshot) -> None:
        """Take the labels of the markers and the sync edge; events show the state."""
        streams = {stream.name: stream for stream in snapshot.streams}
        self._labels = streams["/markers"].labels if "/markers" in streams else ()
        self._times.set_edge(snapshot.edge_device_ns, streams["/markers"].rate_hz if self._labels else 0.0)

    @property
    def edge_ns(self) -> int | None:
        """The sync edge on the timeline [UTC, ns]; None before the edge."""
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
                self._send_markers(times_ns, METRES_PER_MM * values[:, :, :3])
            else:
                self._send(name, times_ns, rr.Scalars.columns(scalars=values[:, 0]))

    def _handle(self, item: Item) -> None:
        if isinstance(item, Event):
            at_ns = self._times.edge_ns if item.kind == "sync_edge" else None
            self.stream.set_time(TIMELINE, timestamp=np.datetime64(at_ns or item.host_time_ns, "ns"))
            self.stream.log("events", rr.TextLog(item.text))
        elif isinstance(item, Samples) and len(item.values) and item.stream in STREAMS:
            times_ns = self._times.of(item)
            kept = self._decimated(item.stream, times_ns)
            if len(kept):
                self._pending.setdefault(item.stream, []).append((times_ns[kept], item.values[kept]))

    def _decimated(self, name: str, times_ns: NDArray[np.int64]) -> NDArray[np.intp]:
        """Indices of the samples that are shown: the first one of every display interval."""
        interval_ns = round(1e9 / (MARKER_RATE_HZ if name == "/markers" else CURVE_RATE_HZ))
        intervals = np.concatenate([[self._last_interval.get(name, -1)], times_ns // interval_ns])
        self._last_interval[name] = int(intervals[-1])
        return np.flatnonzero(np.diff(intervals))

    def _send_markers(self, times_ns: NDArray[np.int64], frames: NDArray[np.floating]) -> None:
        seen = np.isfinite(frames[:, :, 0])
        names = self._labels if len(self._labels) == frames.shape[1] else tuple(map(str, range(frames.shape[1])))
        labels = np.broadcast_to(np.array(names), seen.shape)[seen].tolist()
        points = rr.Points3D.columns(positions=frames[seen], labels=labels).partition(lengths=seen.sum(axis=1))
        self._send("markers", times_ns, points)
        if self.extent is None and seen.any():
            self.extent = SceneExtent.around(frames[seen])
            self.stream.send_blueprint(layout(markers=self.extent))
        rope = frames[:, [number for number, label in enumerate(self._labels) if label in self._rope]]
        visible = np.isfinite(rope).all(axis=(1, 2))
        if rope.shape[1] > 1 and visible.any():
            self._send("rope", times_ns[visible], rr.LineStrips3D.columns(strips=rope[visible]))

    def _send(self, name: str, times_ns: NDArray[np.int64], columns: rr.ComponentColumnList) -> None:
        times = rr.TimeColumn(TIMELINE, timestamp=times_ns.astype("datetime64[ns]"))
        self.stream.send_columns(name, indexes=[times], columns=columns)


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

"""Rerun's viewer: its process, its layout and curves, the signals of a trial, and a body for all scenes.

The viewer is Rerun's own window. It listens on 127.0.0.1 only and its analytics are disabled; by default it listens on
every interface and reports its use. Without a blueprint, it opens a panel for every curve. A view is written to an .rrd
file, or to the viewer at an address; a slow or closed viewer does not affect the recording.

The signals are force, sync line, markers and rope on one timeline; device times are converted to the UTC of the host.
A body has bones, muscles coloured by activation, cord and cuffs, for replays and live values alike.
"""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from collections import defaultdict
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from documents.message import Message
from recordings.samples import Event, Item, Samples
from solver.drawing import bone_lines, path_lines, skeleton
from solver.model import Model
from solver.multibody.postures import points_in_ground, postures
from solver.suit.suit import Suit
from station.bench.view import BackgroundView, Snapshot
from station.clock import ArrivalClock
from station.errors import StationError
from station.messages.study_messages import SweepCode

WAIT_S = 20.0
TIMELINE = "time"
DISTANCE = 1.6
"""Distance of the eye from the scene in diameters of the scene, which shows all of it with a margin."""
ELEVATION, EMG = "wearer/elevation_deg", "wearer/emg_uv"
BODY_NAME = "Muscles from idle (blue) to full activation (red); suit (green)"
Array = NDArray[np.float64]
DISPLAY_HZ = 25
LineStyle = tuple[tuple[int, int, int], float]
"""Colour and width of a curve."""
IDLE, ACTIVE = np.array([60, 90, 160]), np.array([215, 40, 30])
"""Colours (RGB) of a muscle at rest and at full activation."""
THIN, THICK = 0.002, 0.006
"""Radii [m] of a muscle at rest and at full activation, for users who cannot distinguish the colours."""
BONE, CORD = (200, 200, 190), (30, 140, 60)
BONE_RADII = {"shaft": 0.006, "plate": 0.002, "cage": 0.0007}
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
LATEST_NS = 1_000_000_000
"""Largest delay of a frame; frame numbers with a larger one are not those of this capture."""


class ViewerError(StationError):
    """The viewer did not start."""


def start_viewer() -> str:
    """Start a viewer in a separate process, which outlives this one. Returns its address."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    child = subprocess.Popen(  # noqa: S603  (constant arguments)
        [sys.executable, "-m", "rerun", "--bind", "127.0.0.1", "--port", str(port), "--memory-limit", "1GB"],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "RERUN_ANALYTICS_ENABLED": "false", "DO_NOT_TRACK": "1"},
    )
    until = time.perf_counter() + WAIT_S
    while time.perf_counter() < until and child.poll() is None:
        with socket.socket() as tried:
            tried.settimeout(1.0)
            if tried.connect_ex(("127.0.0.1", port)) == 0:
                return f"rerun+http://127.0.0.1:{port}/proxy"
        time.sleep(0.1)
    raise ViewerError(Message(SweepCode.NO_VIEWER))


@dataclass(frozen=True)
class SceneExtent:
    """Extent of the points in a view: centre (3,) and diameter [m], in the frame of the view."""

    centre: tuple[float, float, float]
    diameter: float

    @staticmethod
    def around(points: NDArray[np.floating]) -> SceneExtent:
        """Extent of points (n, 3), all finite."""
        low, high = points.min(axis=0), points.max(axis=0)
        x, y, z = ((low + high) / 2).tolist()
        return SceneExtent((x, y, z), max(0.1, float(np.linalg.norm(high - low))))

    def eye(self, up: tuple[float, float, float]) -> rrb.EyeControls3D:
        """An eye that looks from the front, from the side and from slightly above."""
        horizontal = np.roll(np.array(up), 1), np.roll(np.array(up), 2)
        direction = 0.6 * np.array(up) + horizontal[0] + 0.6 * horizontal[1]
        position = np.array(self.centre) + DISTANCE * self.diameter * direction / np.linalg.norm(direction)
        return rrb.EyeControls3D(position=position, look_target=self.centre, eye_up=up)


def layout(
    *,
    markers: SceneExtent | None = None,
    body: SceneExtent | None = None,
    has_fit: bool = False,
    is_of_wearer: bool = False,
) -> rrb.Blueprint:
    """Bench (top) and body with the suit (bottom) on the left; curves and the list of events on the right.

    markers (z up) and body (y up): extents of the two scenes; None: Rerun's default view, and no body.
    """
    eye = markers.eye((0.0, 0.0, 1.0)) if markers else None
    contents = ["+ /markers", "+ /rope"]
    spaces = [rrb.Spatial3DView(origin="/", contents=contents, name="Markers and rope", eye_controls=eye)]
    if body:
        spaces.append(rrb.Spatial3DView(origin="/body", name=BODY_NAME, eye_controls=body.eye((0.0, 1.0, 0.0))))
    curves = [_curves("Load cell and sync line [V]", "force", "sync")]
    if has_fit:
        fitted = _curves("Force [N]", "fit/force_n", "fit/plateaus_n", "fit/predicted_n")
        curves = [fitted, _curves("Displacement along the rope [mm]", "fit/displacement_mm"), *curves]
    if is_of_wearer:
        elevation, emg = _curves("Elevation of the arm [deg]", ELEVATION), _curves("EMG RMS [\u00b5V]", f"{EMG}/**")
        curves = [elevation, emg, *curves]
    events = rrb.TextLogView(origin="/events", name="Events")
    return rrb.Blueprint(
        rrb.Horizontal(rrb.Vertical(*spaces), rrb.Vertical(*curves, events, row_shares=[3.0] * len(curves) + [1.0])),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE),
    )


def _curves(name: str, *paths: str) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(origin="/", contents=[f"+ /{path}" for path in paths], name=name)


def log_curve(
    stream: rr.RecordingStream, path: str, name: str, style: LineStyle, edge_ns: int, time: Array, values: Array
) -> None:
    """Log a scalar curve, decimated to the rate of the display; NaN interrupts the line.

    values (n,) at time (n,) [s] from the sync edge, which is at edge_ns [UTC, ns].
    """
    step = max(1, len(time) // max(2, int(4 * DISPLAY_HZ * (time[-1] - time[0]))))
    at = (edge_ns + (time[::step] * 1e9).astype(np.int64)).astype("datetime64[ns]")
    stream.log(path, rr.SeriesLines(names=name, colors=style[0], widths=style[1]), static=True)
    stream.send_columns(
        path, indexes=[rr.TimeColumn(TIMELINE, timestamp=at)], columns=rr.Scalars.columns(scalars=values[::step])
    )


def open_stream(name: str, sink: Path | str) -> rr.RecordingStream:
    """A stream of the application `name` to the sink, without Rerun's own timelines."""
    stream = rr.RecordingStream(name)
    stream.set_log_time_enabled(False)
    stream.set_log_tick_enabled(False)
    if isinstance(sink, Path):
        stream.save(sink)
    else:
        stream.connect_grpc(sink)
    return stream


class BodyScene:
    """Logs a model below `body` in a stream; suit is None without one."""

    def __init__(self, stream: rr.RecordingStream, model: Model, suit: Suit | None) -> None:
        self._stream, self._model, self._suit = stream, model, suit
        self._bones = skeleton(model)
        self._radii = [BONE_RADII[bone.kind] for bone in self._bones]
        stream.log("body", rr.ViewCoordinates.RIGHT_HAND_Y_UP, static=True)  # axes of OpenSim models

    def log(self, times_ns: NDArray[np.int64], coordinates: Array, activations: Array) -> SceneExtent:
        """Log frames at times_ns (frames,) on the timeline; returns their extent.

        coordinates (frames, coordinates) [rad or m], finite; activations (frames, muscles), NaN where unknown.
        """
        state = postures(self._model, coordinates, np.zeros_like(coordinates))
        bones, muscles = bone_lines(self._bones, state), path_lines(self._model, state)
        suit = self._suit
        parts = () if suit is None else suit.line
        places = [points_in_ground(state, self._model.body_index(part.body), part.location) for part in parts]
        cord = np.stack(places, axis=1) if places else None
        for frame, time_ns in enumerate(times_ns):
            self._stream.set_time(TIMELINE, timestamp=np.datetime64(int(time_ns), "ns"))
            self._log_muscles(muscles[frame], np.nan_to_num(activations[frame]))
            strips = [line[frame] for line in bones]
            self._stream.log("body/bones", rr.LineStrips3D(strips, colors=BONE, radii=self._radii))
            if suit is not None and cord is not None:
                self._log_cord(cord[frame], suit)
        return SceneExtent.around(np.concatenate([line.reshape(-1, 3) for line in bones]))

    def _log_muscles(self, lines: list[Array], activations: Array) -> None:
        share = np.clip(activations, 0.0, 1.0)[:, None]
        colours = (IDLE + share * (ACTIVE - IDLE)).astype(np.uint8)
        radii = THIN + share[:, 0] * (THICK - THIN)
        self._stream.log("body/muscles", rr.LineStrips3D(lines, colors=colours, radii=radii))

    def _log_cord(self, points: Array, suit: Suit) -> None:
        self._stream.log("body/cord", rr.LineStrips3D([points], colors=CORD, radii=0.004))
        ends = [suit.names[part] for part in ("waist", "arm")]
        cuffs = rr.Points3D(points[[0, -1]], colors=CORD, radii=0.02, labels=ends)
        self._stream.log("body/cuffs", cuffs)


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
    """Clock offset of each stream from arrival times; the sync edge fixes that of the DAQ, and the first frame of the
    capture is aligned with the edge.
    """

    def __init__(self) -> None:
        self.edge_ns: int | None = None  # UTC
        self._edge_device_ns: int | None = None
        self._frame_ns = 0.0
        self._clocks: defaultdict[str, ArrivalClock] = defaultdict(ArrivalClock)
        self._settled: set[str] = set()

    def set_edge(self, device_ns: int | None, frame_rate_hz: float) -> None:
        """Set the sync edge on the clock of /sync (None before it) and the nominal frame rate."""
        self._edge_device_ns = device_ns
        self._frame_ns = 1e9 / frame_rate_hz if frame_rate_hz > 0 else 0.0
        if device_ns is not None and self.edge_ns is None and "/sync" in self._clocks:
            self.edge_ns = device_ns + self._clocks["/sync"].offset_ns
            self._settled |= self._clocks.keys() - {"/markers"}

    def of(self, samples: Samples) -> NDArray[np.int64]:
        """UTC [ns] (n,) of a block with at least one sample."""
        stream = samples.stream
        if stream not in self._settled:
            self._clocks[stream].update(samples)
            if stream == "/markers":
                self._settle_frames(samples)
            if stream == "/sync":
                self.set_edge(self._edge_device_ns, 1e9 / self._frame_ns if self._frame_ns else 0.0)
        return samples.device_time_ns + self._clocks[stream].offset_ns

    def _settle_frames(self, frames: Samples) -> None:
        """Align frame 1 with the edge; a preview that has not ended has another frame number at that time."""
        first_ns = frames.device_time_ns[0] - round((int(frames.sample_numbers[0]) - 1) * self._frame_ns)
        if self.edge_ns is None or not self._frame_ns:
            return
        at_edge_ns = int(self.edge_ns - first_ns)
        if abs(at_edge_ns - self._clocks["/markers"].offset_ns) < LATEST_NS:
            self._clocks["/markers"].offset_ns = at_edge_ns
            self._settled.add("/markers")

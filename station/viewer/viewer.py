"""Rerun's viewer on 127.0.0.1 only, without analytics: its window's layout, its curves, and a body for all scenes.

Without a blueprint, the viewer opens a panel for every curve. A view is written to an .rrd file, or to the viewer at an
address. A body has bones, muscles coloured by activation, cord and cuffs, for replays and live values alike.
"""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from solver.drawing import bone_lines, path_lines, skeleton
from solver.model import Model
from solver.multibody.postures import points_in_ground, postures
from solver.suit.suit import Suit
from station.errors import StationError
from station.messages.message import Message
from station.messages.study_messages import SweepCode

WAIT_S = 20.0


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


TIMELINE = "time"
DISTANCE = 1.6
"""Distance of the eye from the scene in diameters of the scene, which shows all of it with a margin."""
ELEVATION, EMG = "wearer/elevation_deg", "wearer/emg_uv"
BODY_NAME = "Muscles from idle (blue) to full activation (red); suit (green)"
Array = NDArray[np.float64]
DISPLAY_HZ = 25
LineStyle = tuple[tuple[int, int, int], float]
"""Colour and width of a curve."""


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
        rrb.Horizontal(
            rrb.Vertical(*spaces),
            rrb.Vertical(*curves, events, row_shares=[3.0] * len(curves) + [1.0]),
        ),
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


IDLE, ACTIVE = np.array([60, 90, 160]), np.array([215, 40, 30])
"""Colours (RGB) of a muscle at rest and at full activation."""
THIN, THICK = 0.002, 0.006
"""Radii [m] of a muscle at rest and at full activation, for users who cannot distinguish the colours."""
BONE, CORD = (200, 200, 190), (30, 140, 60)
BONE_RADII = {"shaft": 0.006, "plate": 0.002, "cage": 0.0007}


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
            if cord is not None:
                self._log_cord(cord[frame])
        return SceneExtent.around(np.concatenate([line.reshape(-1, 3) for line in bones]))

    def _log_muscles(self, lines: list[Array], activations: Array) -> None:
        share = np.clip(activations, 0.0, 1.0)[:, None]
        colours = (IDLE + share * (ACTIVE - IDLE)).astype(np.uint8)
        radii = THIN + share[:, 0] * (THICK - THIN)
        self._stream.log("body/muscles", rr.LineStrips3D(lines, colors=colours, radii=radii))

    def _log_cord(self, points: Array) -> None:
        self._stream.log("body/cord", rr.LineStrips3D([points], colors=CORD, radii=0.004))
        cuffs = rr.Points3D(points[[0, 2]], colors=CORD, radii=0.02, labels=["waist", "arm"])
        self._stream.log("body/cuffs", cuffs)

"""Layout of Rerun's window, its curves over time, and where a view is written to.

Without a blueprint, the viewer opens a panel for every curve. A view is written to an .rrd file, or to the viewer at an
address.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

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

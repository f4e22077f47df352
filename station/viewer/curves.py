"""Curves over time in Rerun."""

from __future__ import annotations

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from station.viewer.layout import TIMELINE

Array = NDArray[np.float64]
DISPLAY_HZ = 25
LineStyle = tuple[tuple[int, int, int], float]
"""Colour and width of a curve."""


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

"""Where each thing stands in Rerun's window; left to itself the viewer opens a window for every curve."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import rerun.blueprint as rrb
from numpy.typing import NDArray

TIMELINE = "time"
DISTANCE = 1.6
"""Of the eye from what it looks at, in diameters of that: the whole of it is in sight, with some room."""
BODY_NAME = "Muscles from idle (blue) to full activation (red); suit (green)"


@dataclass(frozen=True)
class Framed:
    """What a view is to show: centre (3,) and diameter [m], in the view's frame."""

    centre: tuple[float, float, float]
    diameter: float

    @staticmethod
    def around(points: NDArray[np.floating]) -> Framed:
        """Around points (n, 3), all finite."""
        low, high = points.min(axis=0), points.max(axis=0)
        x, y, z = ((low + high) / 2).tolist()
        return Framed((x, y, z), max(0.1, float(np.linalg.norm(high - low))))

    def eye(self, up: tuple[float, float, float]) -> rrb.EyeControls3D:
        """An eye that looks at it from the front, the side and a little above."""
        aside = np.roll(np.array(up), 1), np.roll(np.array(up), 2)
        direction = 0.6 * np.array(up) + aside[0] + 0.6 * aside[1]
        position = np.array(self.centre) + DISTANCE * self.diameter * direction / np.linalg.norm(direction)
        return rrb.EyeControls3D(position=position, look_target=self.centre, eye_up=up)


def layout(*, framed: Framed | None = None, body: Framed | None = None, has_fit: bool = False) -> rrb.Blueprint:
    """The bench on the left, above the body that wears the suit; on the right the curves, above what happened.

    framed and body are what the two spaces show, markers (z up) and body (y up); None: Rerun's own view, and no body.
    """
    eye = framed.eye((0.0, 0.0, 1.0)) if framed else None
    contents = ["+ /markers", "+ /rope"]
    spaces = [rrb.Spatial3DView(origin="/", contents=contents, name="Markers and rope", eye_controls=eye)]
    if body:
        spaces.append(rrb.Spatial3DView(origin="/body", name=BODY_NAME, eye_controls=body.eye((0.0, 1.0, 0.0))))
    curves = [_curves("Load cell and sync line [V]", "force", "sync")]
    if has_fit:
        fitted = _curves("Force [N]", "fit/force_n", "fit/plateaus_n", "fit/predicted_n")
        curves = [fitted, _curves("Displacement along the rope [mm]", "fit/displacement_mm"), *curves]
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

"""Where each thing stands in Rerun's window; left to itself the viewer opens a window for every curve."""

from __future__ import annotations

import rerun.blueprint as rrb


def layout(*, has_fit: bool = False, has_body: bool = False) -> rrb.Blueprint:
    """The bench on the left, above the body that wears the suit; on the right the curves, above what happened."""
    spaces = [rrb.Spatial3DView(origin="/", contents=["+ /markers", "+ /rope"], name="Markers and rope")]
    if has_body:
        spaces.append(
            rrb.Spatial3DView(origin="/body", name="Muscles from idle (blue) to full activation (red); suit (green)")
        )
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
        rrb.TimePanel(state="collapsed", timeline="host"),
    )


def _curves(name: str, *paths: str) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(origin="/", contents=[f"+ /{path}" for path in paths], name=name)

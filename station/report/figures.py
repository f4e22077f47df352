"""Charts of a cuff's trials together: held loads, tangent stiffness, damper force."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from fitting.cuffs.cuff_fit import CuffFit
from fitting.diagnosis.fitted_pull import FittedPull
from fitting.uncertainty import Estimate
from station.charts.marks import (
    COLOURS,
    THIRD,
    Array,
    Band,
    Chart,
    Cloud,
    Colour,
    Line,
    Mark,
    Panel,
    Points,
    Rule,
    chart,
    values,
)

FORCE: Colour = "c1"
MOTION: Colour = "c2"
MM = 1e3
HEIGHT = 190.0
"""Of a panel [px]."""
DOT, RING = 3.0, 2.4
"""Radius [px] of a dot, and distance [px] between the rings around it."""


def fit_figure(fit: CuffFit, static: Sequence[FittedPull], dynamic: Sequence[FittedPull]) -> Chart:
    """Held loads of all static trials with the lines of the common stiffness; the tangent stiffness k(F) where the held
    loads determine one; F − k x over ẋ of all dynamic trials with the line of the common damping.
    """
    panels = []
    if static:
        marks: list[Mark] = []
        for later, (curves, colour) in enumerate(zip(static, COLOURS * 8, strict=False), 1 - len(static)):
            marks += _held_loads(curves, fit, colour, RING * -later)
        panels.append(_third(marks, "displacement along the rope [mm]", "force [N]"))
    tangents = fit.held.tangents if fit.held and static else ()
    if tangents:
        panels.append(_tangents(fit, tangents))
    if dynamic:
        panels.append(_damper(fit, dynamic))
    return chart(*panels)


def _third(marks: Sequence[Mark], x_label: str, y_label: str) -> Panel:
    return Panel(tuple(marks), x_label, y_label, width=THIRD, height=HEIGHT)


def _damper(fit: CuffFit, dynamic: Sequence[FittedPull]) -> Panel:
    """F − k x, less inertia, offset and drift."""
    marks: list[Mark] = []
    reach = 0.0
    for curves, colour in zip(dynamic, COLOURS * 8, strict=False):
        if curves.dynamic is not None:
            label = f"repeat {curves.pull.trial.repeat}"
            marks.append(Cloud(MM * curves.dynamic.velocity, curves.dynamic.damper_force, colour, label))
            reach = max(reach, float(np.abs(curves.dynamic.velocity).max()))
    if fit.damping is not None and reach:
        line = values([-reach, reach])
        marks.append(Line(MM * line, fit.damping.value * line, "ink", f"c = {fit.damping.value:.0f} N s/m"))
    return _third(marks, "velocity of the cuff [mm/s]", "F − k x [N]")


def _tangents(fit: CuffFit, tangents: Sequence[tuple[float, Estimate]]) -> Panel:
    """k(F) of the exponential law beside the straight line's k."""
    force = values([load for load, _ in tangents])
    low, high = values([stiffness.ci95 for _, stiffness in tangents]).T
    marks: list[Mark] = [
        Band(force, low, high, FORCE, "its 95 % interval"),
        Line(force, values([stiffness.value for _, stiffness in tangents]), FORCE, "exponential law, tangent"),
    ]
    if fit.stiffness is not None:
        marks.append(Rule(fit.stiffness.value, label=f"k = {fit.stiffness.value:.0f} N/m"))
    return _third(marks, "load above the bare hook [N]", "tangent stiffness k(F) [N/m]")


def _held_loads(curves: FittedPull, fit: CuffFit, colour: Colour, wider: float) -> Iterator[Mark]:
    """Dots of the last repeat, and rings around them of the others, which would be hidden; wider [px] than a dot."""
    if curves.static is None:
        return
    x = values([plateau.displacement for plateau in curves.static.plateaus])
    force = values([plateau.force for plateau in curves.static.plateaus])
    label = f"repeat {curves.pull.trial.repeat}"
    yield Points(MM * x, force, colour, label, is_hollow=wider > 0, radius=DOT + wider)
    if fit.stiffness is None:
        return
    for segment in np.unique(curves.static.segment):
        inside = curves.static.segment == segment
        if inside.sum() > 1:
            yield stiffness_line(fit.stiffness.value, x[inside], curves.static.offset[inside][0])


def stiffness_line(stiffness: float, x: Array, offset: float, label: str = "") -> Line:
    """F = k x + offset over the displacements x (n,) [m]."""
    ends = values([x.min(), x.max()])
    return Line(MM * ends, stiffness * ends + offset, "ink", label)

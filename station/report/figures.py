"""Charts of a cuff's trials together: force and displacement over time, held loads, damper force."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from fitting.cuffs.cuff_fit import CuffFit
from fitting.diagnosis.fitted_pull import FittedPull
from fitting.uncertainty import Estimate
from station.charts.marks import (
    COLOURS,
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
    Strip,
    chart,
    values,
)

FORCE: Colour = "c1"
MOTION: Colour = "c2"
MM = 1e3
DOT, RING = 3.0, 2.4
"""Radius [px] of a dot, and distance [px] between the rings around it."""


def trial_figure(static: FittedPull | None, dynamic: FittedPull | None) -> Chart:
    """Force and displacement over session time with the sync edge and the trial's start and end marked."""
    return Chart(tuple(_trial(curves) for curves in (static, dynamic) if curves is not None))


def static_figure(fit: CuffFit, static: Sequence[FittedPull]) -> Chart:
    """Force over displacement of all static trials, the held loads, and the lines of the common stiffness.

    Beside it the tangent stiffness k(F) with its 95 % intervals, where the held loads determine one.
    """
    marks: list[Mark] = []
    for later, (curves, colour) in enumerate(zip(static, COLOURS * 8, strict=False), 1 - len(static)):
        marks += _held_loads(curves, fit, colour, RING * -later)
    panels = [Panel(tuple(marks), "displacement of the cuff along the rope [mm]", "force [N]")]
    tangents = fit.held.tangents if fit.held else ()
    if tangents:
        panels.append(_tangents(fit, tangents))
    return chart(*panels)


def dynamic_figure(fit: CuffFit, dynamic: Sequence[FittedPull]) -> Chart:
    """F − k x (less inertia, offset and drift) over ẋ of all dynamic trials, and the line of the common damping."""
    marks: list[Mark] = []
    reach = 0.0
    for curves, colour in zip(dynamic, COLOURS * 8, strict=False):
        if curves.dynamic is not None:
            label = f"repeat {curves.pull.trial.repeat}"
            marks.append(Cloud(MM * curves.dynamic.velocity, curves.dynamic.damper_force, colour, label))
            reach = max(reach, float(np.abs(curves.dynamic.velocity).max()))
    if fit.damping is not None and reach:
        ends = values([-reach, reach])
        marks.append(Line(MM * ends, fit.damping.value * ends, "ink", f"c = {fit.damping.value:.0f} N s/m"))
    return chart(Panel(tuple(marks), "velocity of the cuff [mm/s]", "F − k x [N]"))


def _trial(curves: FittedPull) -> tuple[Panel, Panel]:
    """Force above displacement."""
    trial = curves.pull.trial
    around = list(_events(curves))
    unnamed = (replace(event, label="") for event in around)  # the legend stands above the force
    force = Line(curves.pull.force_time, curves.pull.force, FORCE, width=1.0)
    displacement = Line(curves.pull.marker_time, MM * curves.pull.displacement, MOTION, width=1.0)
    return (
        Panel(
            (*around, force),
            y_label="force [N]",
            title=f"{trial.test}, repeat {trial.repeat}",
            height=150.0,
            has_x_numbers=False,
        ),
        Panel((*unnamed, displacement), "session time [s]", "displacement [mm]", height=170.0),
    )


def _events(curves: FittedPull) -> Iterator[Rule | Strip]:
    trial = curves.pull.trial
    if curves.dynamic is not None:
        fitted = curves.dynamic.time
        yield Strip(float(fitted[0]), float(fitted[-1]), label="fitted interval", is_upright=True)
    yield Rule(0.0, label="sync edge = start", is_upright=True)
    yield Rule(trial.end, label="end", dash="dashed", is_upright=True)
    if trial.sync_fall is not None:
        yield Rule(trial.sync_fall, label="sync falls", dash="dotted", is_upright=True)


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
    return Panel(tuple(marks), "load above the bare hook [N]", "tangent stiffness k(F) [N/m]")


def _held_loads(curves: FittedPull, fit: CuffFit, colour: Colour, wider: float) -> Iterator[Mark]:
    """Dots of the last repeat, and rings around them of the others, which would be hidden; wider [px] than a dot."""
    if curves.static is None:
        return
    x = values([plateau.displacement for plateau in curves.static.plateaus])
    force = values([plateau.force for plateau in curves.static.plateaus])
    label = f"held loads, repeat {curves.pull.trial.repeat}"
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

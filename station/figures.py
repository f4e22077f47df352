"""The report's figures, drawn by matplotlib and returned as PNG bytes."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fitting.curves import TrialCurves
from fitting.result import CuffFit

FORCE, MOTION, LINE, MARK = "#1f5f8b", "#c2571a", "#1b1b1b", "#8a8a8a"
SHADES = ("#1f5f8b", "#3f9c6b", "#b8860b", "#8b3a62", "#5a5a9a")
STYLE: dict[Any, Any] = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e4e4e4",
    "legend.frameon": False,
}
MOST_POINTS = 4000
"""Of a curve that is drawn; more only makes the page heavy."""


def new_page(columns: int, rows: int = 1, height: float = 3.4, width: float = 5.2) -> tuple[Figure, list[Axes]]:
    """A page and its axes, row by row; height and width [in] are those of one of them."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(width * columns, height * rows), layout="constrained")
        axes = figure.subplots(rows, columns, squeeze=False)
    return figure, list(axes.flat)


def as_png(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    with mpl.rc_context(STYLE):
        figure.savefig(buffer, format="png", dpi=120)
    return buffer.getvalue()


def thinned(count: int, most: int) -> slice:
    """Every so many of `count` that at most `most` are left."""
    return slice(None, None, max(1, -(-count // most)))


def trial_figure(static: TrialCurves | None, dynamic: TrialCurves | None) -> bytes:
    """Force and displacement over session time with the sync edge and the trial's start and end marked."""
    shown = [curves for curves in (static, dynamic) if curves is not None]
    figure, axes = new_page(len(shown), height=2.6)
    for axis, curves in zip(axes, shown, strict=True):
        _draw_trial(axis, curves)
    return as_png(figure)


def static_figure(fit: CuffFit, static: Sequence[TrialCurves]) -> bytes:
    """Force over displacement of all static trials, the held loads, and the lines of the common stiffness."""
    figure, (axis,) = new_page(1)
    for curves, shade in zip(static, SHADES * 8, strict=False):
        force = np.interp(curves.marker_time, curves.force_time, curves.force)
        axis.plot(1e3 * curves.displacement, force, color=shade, alpha=0.18, linewidth=0.7)
        _draw_held_loads(axis, curves, fit, shade)
    axis.set_xlabel("displacement of the cuff along the rope [mm]")
    axis.set_ylabel("force [N]")
    axis.legend(loc="upper left")
    return as_png(figure)


def dynamic_figure(fit: CuffFit, dynamic: Sequence[TrialCurves]) -> bytes:
    """F − k x (less inertia, offset and drift) over ẋ of all dynamic trials, and the line of the common damping."""
    figure, (axis,) = new_page(1)
    reach = 0.0
    for curves, shade in zip(dynamic, SHADES * 8, strict=False):
        if curves.dynamic is not None:
            thin = thinned(len(curves.dynamic.velocity), 1500)
            velocity = 1e3 * curves.dynamic.velocity[thin]
            label = f"repeat {curves.trial.repeat}"
            axis.plot(velocity, curves.dynamic.damper_force[thin], ".", color=shade, ms=1.6, alpha=0.5, label=label)
            reach = max(reach, float(np.abs(curves.dynamic.velocity).max()))
    if fit.damping is not None and reach:
        ends = np.array([-reach, reach])
        words = f"c = {fit.damping.value:.0f} N s/m"
        axis.plot(1e3 * ends, fit.damping.value * ends, color=LINE, linewidth=1.4, label=words)
    axis.set_xlabel("velocity of the cuff [mm/s]")
    axis.set_ylabel("F − k x [N]")
    axis.legend(loc="upper left", markerscale=4)
    return as_png(figure)


def _draw_trial(axis: Axes, curves: TrialCurves) -> None:
    trial = curves.trial
    axis.set_title(f"{trial.test}, repeat {trial.repeat}", loc="left")
    thin = thinned(len(curves.force), MOST_POINTS)
    axis.plot(curves.force_time[thin], curves.force[thin], color=FORCE, linewidth=0.8)
    axis.set_ylabel("force [N]", color=FORCE)
    axis.set_xlabel("session time [s]")
    right = axis.twinx()
    right.spines["right"].set_visible(True)
    right.grid(visible=False)
    right.plot(curves.marker_time, 1e3 * curves.displacement, color=MOTION, linewidth=0.8)
    right.set_ylabel("displacement [mm]", color=MOTION)
    _mark(axis, 0.0, "sync edge = start", "-", "left")
    _mark(axis, trial.end, "end", "--", "right")
    if trial.sync_fall is not None:
        _mark(axis, trial.sync_fall, "sync falls", ":", "right", height=0.88)
    if curves.dynamic is not None:
        fitted = curves.dynamic.time
        axis.axvspan(float(fitted[0]), float(fitted[-1]), color="#f1efe4", zorder=0, label="fitted")


def _mark(axis: Axes, time: float, words: str, line: str, side: str, height: float = 0.98) -> None:
    """A line at a moment of the session, and what it is."""
    axis.axvline(time, color=LINE, linewidth=1.0, linestyle=line)
    axis.annotate(words, (time, height), xycoords=("data", "axes fraction"), va="top", ha=side, fontsize=7.5)


def _draw_held_loads(axis: Axes, curves: TrialCurves, fit: CuffFit, shade: str) -> None:
    if curves.static is None:
        return
    x = np.array([plateau.displacement for plateau in curves.static.plateaus])
    force = np.array([plateau.force for plateau in curves.static.plateaus])
    axis.plot(1e3 * x, force, "o", color=shade, markersize=4, label=f"held loads, repeat {curves.trial.repeat}")
    if fit.stiffness is None:
        return
    for segment in np.unique(curves.static.segment):
        inside = curves.static.segment == segment
        if inside.sum() > 1:
            ends = np.array([x[inside].min(), x[inside].max()])
            line = fit.stiffness.value * ends + curves.static.offset[inside][0]
            axis.plot(1e3 * ends, line, color=LINE, linewidth=1.1)

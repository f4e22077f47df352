"""The report's figures, drawn by matplotlib and returned as PNG bytes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes

from fitting.curves import TrialCurves
from fitting.result import CuffFit
from station.report.canvas import FORCE, LINE, MOTION, SHADES, STYLE, TITLED, as_png, new_page

MOST_POINTS = 4000
"""Of a curve that is drawn; more only makes the page heavy."""


def thinned(count: int, most: int) -> slice:
    """Every so many of `count` that at most `most` are left."""
    return slice(None, None, max(1, -(-count // most)))


@mpl.rc_context(STYLE)
def trial_figure(static: TrialCurves | None, dynamic: TrialCurves | None) -> bytes:
    """Force and displacement over session time with the sync edge and the trial's start and end marked."""
    shown = [curves for curves in (static, dynamic) if curves is not None]
    figure, axes = new_page(len(shown), rows=2, height=1.9, margins=TITLED)
    for i, curves in enumerate(shown):
        _draw_trial(axes[i], axes[i + len(shown)], curves)
    return as_png(figure)


@mpl.rc_context(STYLE)
def static_figure(fit: CuffFit, static: Sequence[TrialCurves]) -> bytes:
    """Force over displacement of all static trials, the held loads, and the lines of the common stiffness.

    Beside it the tangent stiffness k(F) with its 95 % intervals, where the held loads tell one.
    """
    law = fit.held.get("exponential_law")
    figure, (axis, *beside) = new_page(2 if law else 1)
    for curves, shade in zip(static, SHADES * 8, strict=False):
        force = np.interp(curves.marker_time, curves.force_time, curves.force)
        axis.plot(1e3 * curves.displacement, force, color=shade, alpha=0.18, linewidth=0.7)
        _draw_held_loads(axis, curves, fit, shade)
    axis.set_xlabel("displacement of the cuff along the rope [mm]")
    axis.set_ylabel("force [N]")
    axis.legend(loc="upper left")
    if law:
        _draw_tangents(beside[0], fit, law["tangents"])
    return as_png(figure)


@mpl.rc_context(STYLE)
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


def _draw_trial(over: Axes, under: Axes, curves: TrialCurves) -> None:
    """Force above, displacement below, with room for what the marks say."""
    trial = curves.trial
    thin = thinned(len(curves.force), MOST_POINTS)
    over.plot(curves.force_time[thin], curves.force[thin], color=FORCE, linewidth=0.8)
    under.plot(curves.marker_time, 1e3 * curves.displacement, color=MOTION, linewidth=0.8)
    over.set_title(f"{trial.test}, repeat {trial.repeat}", loc="left")
    over.set_ylabel("force [N]")
    under.set_ylabel("displacement [mm]")
    under.set_xlabel("session time [s]")
    under.sharex(over)
    over.tick_params(labelbottom=False)
    low, high = over.get_ylim()
    over.set_ylim(low, high + 0.25 * (high - low))
    marks = [(0.0, "sync edge = start", "-", "left", 1.0), (trial.end, "end", "--", "right", 1.0)]
    if trial.sync_fall is not None:
        marks.append((trial.sync_fall, "sync falls", ":", "right", 0.88))
    for time, words, line, side, height in marks:
        for axis in (over, under):
            axis.axvline(time, color=LINE, linewidth=1.0, linestyle=line)
        over.annotate(
            words,
            (time, height),
            (3 if side == "left" else -3, -2),
            ("data", "axes fraction"),
            "offset points",
            va="top",
            ha=side,
            fontsize=7.5,
        )
    if curves.dynamic is not None:
        fitted = curves.dynamic.time
        for axis in (over, under):
            axis.axvspan(float(fitted[0]), float(fitted[-1]), color="#f1efe4", zorder=0)


def _draw_tangents(axis: Axes, fit: CuffFit, tangents: Sequence[Mapping[str, Any]]) -> None:
    """k(F) of the exponential law beside the straight line's k."""
    force = np.array([each["force_n"] for each in tangents])
    k = np.array([each["stiffness_n_per_m"]["value"] for each in tangents])
    ends = np.array([each["stiffness_n_per_m"]["ci95"] for each in tangents])
    axis.plot(force, k, color=FORCE, linewidth=1.4, label="exponential law, tangent")
    axis.fill_between(force, *ends.T, color=FORCE, alpha=0.2, linewidth=0, label="its 95 % interval")
    if fit.stiffness is not None:
        axis.axhline(fit.stiffness.value, color=LINE, linewidth=1.1, label=f"k = {fit.stiffness.value:.0f} N/m")
    axis.margins(y=0.6)
    axis.set_xlabel("force [N]")
    axis.set_ylabel("tangent stiffness k(F) [N/m]")
    axis.legend(loc="upper left")


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

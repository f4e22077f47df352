"""The fit, trial by trial: the published study's figures of every repeat, and what tells whether the law holds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray
from scipy.stats import norm

from fitting.curves import TrialCurves
from fitting.dynamic.damping import DampingFit
from fitting.result import CuffFit, TrialFit
from fitting.static.stiffness import StaticFit
from fitting.uncertainty import NORMAL_95, Estimate
from station.report.canvas import (
    FORCE,
    LINE,
    MARK,
    MOTION,
    SHADES,
    STYLE,
    TITLED,
    WIDE,
    as_png,
    new_mosaic,
    new_page,
)
from station.report.figures import thinned

SHOWN = 8.0
"""Seconds of a swing that are drawn: more, and measurement and fit cannot be told apart."""
REPEAT_PLAN: list[Any] = [["held", "force", "damper"], ["held", "way", "damper"], ["left", "way", "damper"]]
MOST_LAG = 1.0
"""Seconds up to which residuals are held against themselves."""


@mpl.rc_context(STYLE)
def repeat_figure(fit: CuffFit, static: TrialCurves | None, dynamic: TrialCurves | None) -> bytes:
    """One repeat: held loads, line and residuals; force and displacement of the swing; damper force over velocity."""
    figure, axes = new_mosaic(REPEAT_PLAN, height_ratios=[2, 1, 1], height=4.4)
    if static is not None and static.static is not None:
        _draw_held(axes["held"], axes["left"], fit, static, static.static)
    else:
        _say(axes["held"], "no static trial")
        _say(axes["left"], "")
    if dynamic is not None and dynamic.dynamic is not None:
        _draw_swing(axes["force"], axes["way"], dynamic, dynamic.dynamic)
        _draw_damper(axes["damper"], dynamic.dynamic)
    else:
        for name, words in (("force", "no dynamic trial"), ("way", ""), ("damper", "")):
            _say(axes[name], words)
    return as_png(figure)


@mpl.rc_context(STYLE)
def complex_stiffness_figure(fit: CuffFit) -> bytes:
    """Stiffness and damping in bands of frequency with 95 % intervals, and those of the fit."""
    figure, (left, right) = new_page(2, height=3.0)
    bands = fit.complex_stiffness
    frequency = np.array([band.frequency for band in bands])
    swung = [trial.swing.stiffness.value for trial in fit.trials if trial.swing]
    for axis, each, colour, words in (
        (left, [band.stiffness for band in bands], FORCE, "Re K*, k [N/m]"),
        (right, [band.damping for band in bands], MOTION, "Im K* / 2πf, c [N s/m]"),
    ):
        _draw_intervals(axis, frequency, each, colour, "bands of frequency")
        axis.set_xlabel("frequency [Hz]")
        axis.set_ylabel(words)
    if swung:
        left.axhline(float(np.mean(swung)), color=LINE, linewidth=1.2, label="fit of the swings")
    if fit.stiffness is not None:
        left.axhline(fit.stiffness.value, color=MARK, linewidth=1.2, linestyle="--", label="held loads")
    if fit.damping is not None:
        _draw_band(right, fit.damping, "fit, 95 %")
    for axis in (left, right):
        axis.legend(loc="best")
    return as_png(figure)


@mpl.rc_context(STYLE)
def residual_figure(dynamic: Sequence[TrialCurves]) -> bytes:
    """What the law leaves of the swings' force: over time, against itself later, and against a normal distribution."""
    figure, (over_time, later, normal) = new_page(3, height=3.0, width=WIDE / 3)
    swings = [(each.trial.repeat, each.dynamic) for each in dynamic if each.dynamic is not None]
    for (repeat, swing), shade in zip(swings, SHADES * 8, strict=False):
        residual = _force_residual(swing)
        thin = thinned(len(residual), 1200)
        over_time.plot(swing.time[thin], residual[thin], ".", color=shade, ms=1.5, alpha=0.6, label=f"repeat {repeat}")
        step = float(np.median(np.diff(swing.time)))
        correlation = _autocorrelation(residual, max(2, round(MOST_LAG / step)))
        later.plot(step * np.arange(1, len(correlation) + 1), correlation, color=shade, linewidth=1.0)
        sorted_ = np.sort(residual)[thin] / float(np.std(residual))
        expected = norm.ppf((np.arange(len(residual)) + 0.5) / len(residual))[thin]
        normal.plot(expected, sorted_, color=shade, linewidth=1.2)
    limit = NORMAL_95 / np.sqrt(min(len(swing.time) for _, swing in swings))
    later.axhspan(-limit, limit, color=MARK, alpha=0.25, linewidth=0, label="95 % of white noise")
    normal.plot([-4, 4], [-4, 4], color=LINE, linewidth=0.8, linestyle="--", label="normal")
    for axis, across, up in (
        (over_time, "session time [s]", "residual force [N]"),
        (later, "later by [s]", "correlation"),
        (normal, "normal quantile", "residual / its standard deviation"),
    ):
        axis.set_xlabel(across)
        axis.set_ylabel(up)
        low, high = axis.get_ylim()
        axis.set_ylim(low, high + 0.3 * (high - low))  # the legend stands above what it explains
        axis.legend(loc="upper left", ncols=3, markerscale=4, columnspacing=1.0, handletextpad=0.4)
    return as_png(figure)


@mpl.rc_context(STYLE)
def repeats_figure(fit: CuffFit) -> bytes:
    """k, c and migration of every repeat with 95 % intervals, and the donning's as a band."""
    figure, axes = new_page(3, height=2.8, width=WIDE / 3, margins=TITLED)
    used = [trial for trial in fit.trials if trial.state == "used"]
    for axis, pooled, name, scale, words in (
        (axes[0], fit.stiffness, "stiffness", 1.0, "k [N/m]"),
        (axes[1], fit.damping, "damping", 1.0, "c [N s/m]"),
        (axes[2], fit.migration, "migration", 1e3, "migration [mm]"),
    ):
        found = [(trial.repeat, value.scaled(scale)) for trial in used if (value := _of_trial(trial, name)) is not None]
        numbers = np.array([repeat for repeat, _ in found], dtype=np.float64)
        _draw_intervals(axis, numbers, [value for _, value in found], FORCE, "repeat alone")
        if pooled is not None:
            _draw_band(axis, pooled.scaled(scale), "donning as a whole" if name == "migration" else "mean, 95 %")
        axis.set_xticks(sorted({int(number) for number in numbers}))
        axis.set_xlabel("repeat")
        axis.set_ylabel(words)
        axis.margins(x=0.25)
        axis.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, columnspacing=1.0, borderpad=0.0)
    return as_png(figure)


def _draw_held(axis: Axes, below: Axes, fit: CuffFit, curves: TrialCurves, held: StaticFit) -> None:
    """Force over displacement with the held loads, and below what they lie beside the line, in displacement."""
    force = np.interp(curves.marker_time, curves.force_time, curves.force)
    thin = thinned(len(force), 3000)
    axis.plot(1e3 * curves.displacement[thin], force[thin], color=FORCE, alpha=0.25, linewidth=0.7)
    loads = np.array([plateau.force for plateau in held.plateaus])
    axis.plot(1e3 * held.x, loads, "o", color=FORCE, markersize=4.5, label="held loads")
    axis.set_title(f"static, repeat {curves.trial.repeat}", loc="left")
    axis.set_ylabel("force [N]")
    axis.sharex(below)
    axis.tick_params(labelbottom=False)
    below.set_xlabel("displacement along the rope [mm]")
    below.set_ylabel("off [mm]")
    below.axhline(0.0, color=LINE, linewidth=0.9)
    if fit.stiffness is None:
        return
    for segment in np.unique(held.segment):
        inside = held.segment == segment
        weight = held.x_sd[inside] ** -2.0
        x, load = (np.average(values[inside], weights=weight) for values in (held.x, loads))
        off = held.x[inside] - x - (loads[inside] - load) / fit.stiffness.value
        if inside.sum() < 2:  # it slipped before and after: no line goes through it, and nothing is off
            continue
        below.errorbar(
            1e3 * held.x[inside], 1e3 * off, 1e3 * NORMAL_95 * held.x_sd[inside], fmt="o", color=FORCE, ms=3.5, lw=1
        )
        ends = np.array([held.x[inside].min(), held.x[inside].max()])
        words = f"k = {fit.stiffness.value:.0f} N/m, all repeats" if segment == held.segment[-1] else None
        axis.plot(1e3 * ends, load + fit.stiffness.value * (ends - x), color=LINE, linewidth=1.2, label=words)
    axis.legend(loc="upper left")


def _draw_swing(over: Axes, under: Axes, curves: TrialCurves, swing: DampingFit) -> None:
    """Force and displacement as measured and as fitted, for the first seconds of what was fitted."""
    start, end = float(swing.time[0]), min(float(swing.time[-1]), float(swing.time[0]) + SHOWN)
    force = (curves.force_time >= start) & (curves.force_time <= end)
    seen = (curves.marker_time >= start) & (curves.marker_time <= end)
    fitted = swing.time <= end
    law = swing.offset + swing.stiffness.value * swing.displacement + swing.damping.value * swing.velocity
    for axis, time, values, curve, colour, words in (
        (over, curves.force_time[force], curves.force[force], law[fitted], FORCE, "k x + c ẋ + F0"),
        (
            under,
            curves.marker_time[seen],
            1e3 * curves.displacement[seen],
            1e3 * swing.displacement[fitted],
            MOTION,
            "fitted x",
        ),
    ):
        thin = thinned(len(time), 900)
        axis.plot(time[thin], values[thin], ".", color=colour, ms=2.2, alpha=0.45, label="measured")
        axis.plot(swing.time[fitted], curve, color=LINE, linewidth=0.9, label=words)
        axis.legend(loc="upper right", ncols=2, markerscale=3)
        low, high = axis.get_ylim()
        axis.set_ylim(low, high + 0.22 * (high - low))
    whole = float(swing.time[-1] - swing.time[0])
    over.set_title(f"dynamic, repeat {curves.trial.repeat}: {end - start:.0f} s of {whole:.0f} s", loc="left")
    over.tick_params(labelbottom=False)
    over.set_ylabel("force [N]")
    under.set_ylabel("displacement [mm]")
    under.set_xlabel("session time [s]")


def _draw_damper(axis: Axes, swing: DampingFit) -> None:
    thin = thinned(len(swing.velocity), 2500)
    axis.plot(1e3 * swing.velocity[thin], swing.damper_force[thin], ".", color=FORCE, ms=1.8, alpha=0.4)
    ends = np.array([swing.velocity.min(), swing.velocity.max()])
    low, high = swing.damping.estimate.ci95
    axis.fill_between(1e3 * ends, low * ends, high * ends, color=MARK, alpha=0.4, linewidth=0, label="95 %")
    words = f"c = {swing.damping.value:.0f} N s/m"
    axis.plot(1e3 * ends, swing.damping.value * ends, color=LINE, linewidth=1.3, label=words)
    axis.set_title("damper", loc="left")
    axis.set_xlabel("velocity [mm/s]")
    axis.set_ylabel("F − k x [N]")
    axis.legend(loc="upper left")


def _draw_intervals(
    axis: Axes, across: NDArray[np.float64], found: Sequence[Estimate], colour: str, words: str
) -> None:
    values = np.array([each.value for each in found])
    ends = np.array([each.ci95 for each in found]).reshape(-1, 2)
    spread = np.abs(ends.T - values)
    axis.errorbar(across, values, spread, fmt="o", color=colour, ms=4.5, lw=1.2, capsize=3, label=words)


def _draw_band(axis: Axes, pooled: Estimate, words: str) -> None:
    axis.axhline(pooled.value, color=LINE, linewidth=1.2)
    axis.axhspan(*pooled.ci95, color=MARK, alpha=0.25, linewidth=0, label=words)


def _of_trial(trial: TrialFit, name: str) -> Estimate | None:
    value: Estimate | None = getattr(trial, name)
    return value if value is not None and np.isfinite(value.ci95).all() else None


def _force_residual(swing: DampingFit) -> NDArray[np.float64]:
    """F − k x − c ẋ − m ẍ − F0 − F1 u (n,) [N]."""
    return np.asarray(swing.damper_force - swing.damping.value * swing.velocity)


def _autocorrelation(values: NDArray[np.float64], most: int) -> NDArray[np.float64]:
    """At 1 … most samples' distance."""
    centred = values - values.mean()
    power = np.abs(np.fft.rfft(centred, 2 * len(values))) ** 2
    correlation = np.fft.irfft(power)[: most + 1]
    return np.asarray(correlation[1:] / correlation[0])


def _say(axis: Axes, words: str) -> None:
    axis.set_axis_off()
    axis.text(0.5, 0.5, words, ha="center", va="center", color=MARK, transform=axis.transAxes)

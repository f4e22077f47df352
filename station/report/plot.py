"""One picture of a result, for a notebook; the report's own figures are in the files beside."""

from __future__ import annotations

from collections.abc import Mapping
from functools import singledispatch

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fitting.cuffs.cuff_fit import CuffFit, SessionFit
from fitting.cuffs.wearable_cuff import QUANTITIES, UNITS
from recordings.reader import Recording
from solver.redundancy.motion_solution import MotionSolution
from solver.suit.assessment import Assessment
from station.report.canvas import LINE, SHADES, STYLE
from station.report.conditions import CONDITIONS

BUSIEST = 8
"""Muscles that a picture of a motion names."""


@singledispatch
def plot(result: object) -> Figure:
    """Draw a Recording, CuffFit, SessionFit, MotionSolution or Assessment; `.savefig(path)` keeps the figure.

    A mapping from names to CuffFit is drawn as a SessionFit is. Raises TypeError for anything else.
    """
    raise TypeError(
        f"plot draws a Recording, CuffFit, SessionFit, MotionSolution or Assessment, and got a {type(result).__name__}"
    )


def _page(rows: int, columns: int, width: float, height: float) -> tuple[Figure, list[Axes]]:
    """A figure of width and height [in], and its axes, which share the one below in a column."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(width, height), layout="constrained")
        axes = figure.subplots(rows, columns, squeeze=False, sharex=rows > 1)
    return figure, list(axes.flat)


@plot.register
def _(result: Recording) -> Figure:
    """Every scalar stream over device time, and the height of every marker, in the units of the recording."""
    figure, axes = _page(len(result.streams), 1, 9.0, 1.9 * len(result.streams))
    for axis, stream in zip(axes, result.streams, strict=True):
        track = result.load(stream.name)
        time = 1e-9 * (track.device_time_ns - track.device_time_ns[:1])
        values = track.values[:, :, 2] if track.values.ndim == 3 else track.values
        axis.plot(time, values, linewidth=0.8)
        axis.set_ylabel(f"{stream.name.strip('/')} [{stream.unit}]")
    axes[-1].set_xlabel("device time of each stream [s]")
    return figure


@plot.register
def _(result: CuffFit) -> Figure:
    """Each quantity of every trial with its 95 % interval, and the donning's own as a band."""
    figure, axes = _page(1, len(QUANTITIES), 10.0, 3.0)
    for axis, name in zip(axes, QUANTITIES, strict=True):
        scale, unit = (1e3, "mm") if UNITS[name] == "m" else (1.0, UNITS[name])
        trials = [trial for trial in result.trials if getattr(trial, name) is not None]
        for place, trial in enumerate(trials):
            estimate = getattr(trial, name)
            axis.plot(scale * np.array(estimate.ci95), [place, place], color=LINE)
            axis.plot(scale * estimate.value, place, "o", color=SHADES[0])
        axis.set_yticks(range(len(trials)), [f"{trial.test} {trial.repeat}" for trial in trials])
        axis.set_ylim(-1, len(trials))
        pooled = getattr(result, name)
        if pooled is not None:
            axis.axvspan(*(scale * end for end in pooled.ci95), color=SHADES[0], alpha=0.15)
            axis.axvline(scale * pooled.value, color=SHADES[0])
        axis.set_xlabel(f"{name} [{unit}]")
    figure.suptitle(f"cuff {result.name}, donning {result.donning}: its trials, and the donning as a band")
    return figure


@plot.register
def _(result: SessionFit) -> Figure:
    return plot(result.cuffs)


@plot.register(Mapping)
def _(result: Mapping[str, CuffFit]) -> Figure:
    """Force over displacement of every trial that was used, a panel per cuff, and its stiffness as a line."""
    if not result or not all(isinstance(fit, CuffFit) for fit in result.values()):
        raise TypeError("plot draws a mapping from names to CuffFit, as fit_session(…).cuffs is, and got another one")
    figure, axes = _page(1, len(result), 4.4 * len(result), 3.6)
    for axis, (name, fit) in zip(axes, result.items(), strict=True):
        for curves in fit.pulls.values():
            force = np.interp(curves.pull.marker_time, curves.pull.force_time, curves.pull.force)
            axis.plot(1e3 * curves.pull.displacement, force, color=LINE, linewidth=0.5, alpha=0.5)
        if fit.stiffness is not None and fit.migration is not None:
            through = (1e3 * fit.migration.value, 0.0)
            axis.axline(through, slope=1e-3 * fit.stiffness.value, color=SHADES[0], label="stiffness, after migration")
            axis.legend(fontsize="x-small", loc="upper left")
        axis.set_title(f"{name}, donning {fit.donning}", loc="left")
        axis.set_xlabel("displacement [mm]")
    axes[0].set_ylabel("force [N]")
    return figure


@plot.register
def _(result: MotionSolution) -> Figure:
    """Activations of the busiest muscles, and the size of the joint reaction, over time."""
    figure, (above, below) = _page(2, 1, 9.0, 5.2)
    for muscle in np.argsort(np.nanmax(result.activations, axis=0))[::-1][:BUSIEST]:
        above.plot(result.time, result.activations[:, muscle], label=result.muscles[muscle], linewidth=1.0)
    above.set_ylabel("activation")
    above.legend(fontsize="x-small", loc="upper left", bbox_to_anchor=(1.0, 1.0))
    below.plot(result.time, np.linalg.norm(result.reaction[:, 3:], axis=1), color=LINE)
    below.set_ylabel("joint reaction [N]")
    below.set_xlabel("time [s]")
    return figure


@plot.register
def _(result: Assessment) -> Figure:
    """Muscle effort over the cord's rest length in every condition; 1 is the suit with a slack cord."""
    figure, (axis,) = _page(1, 1, 7.0, 3.6)
    for curve in result.curves:
        label = " ".join(filter(None, (curve.cuff, CONDITIONS[curve.condition])))
        axis.plot(result.rest_lengths, curve.cost, label=label, linewidth=1.2)
    axis.axhline(1.0, color=LINE, linewidth=0.8)
    axis.set_xlabel("rest length of the cord [m]")
    axis.set_ylabel("muscle effort over that with a slack cord")
    axis.legend(fontsize="x-small")
    return figure

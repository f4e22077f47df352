"""Figures that matplotlib draws outside the report (notebooks, `station rmr --plot`, docs), one per result."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import singledispatch
from typing import Any, TypeVar, overload

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from fitting.cuffs.cuff_fit import CuffFit, SessionFit
from fitting.cuffs.wearable_cuff import QUANTITIES, UNITS
from recordings.reader import Recording
from solver.redundancy.motion_solution import MotionSolution
from solver.suit.assessment import Assessment
from station.report.muscle_figures import CONDITIONS

FORCE, MOTION, LINE, MARK = "#1f5f8b", "#c2571a", "#1b1b1b", "#8a8a8a"
SHADES = ("#1f5f8b", "#3f9c6b", "#b8860b", "#8b3a62", "#5a5a9a")
STYLE: dict[Any, Any] = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.titley": 1.0,  # else matplotlib measures every axis to find where a title is free of it
    "grid.color": "#e4e4e4",
    "legend.fontsize": 8,
    "legend.edgecolor": "none",
}
DPI = 120
COMPRESSION = 3
"""Level of zlib: 6, the usual one, takes almost twice the time for 2 % fewer bytes."""
BUSIEST = 8
"""Muscles that a picture of a motion names."""
Place = TypeVar("Place", bound=Axes | Sequence[Axes] | NDArray[Any])


def as_png(figure: Figure) -> bytes:
    """The same figure gives the same bytes: neither a date nor a version is in them."""
    pixels, png = io.BytesIO(), io.BytesIO()
    figure.set_dpi(DPI)
    with mpl.rc_context(STYLE):
        figure.savefig(pixels, format="rgba", dpi=DPI)
    opaque = Image.frombytes("RGBA", figure.canvas.get_width_height(), pixels.getvalue()).convert("RGB")
    opaque.save(png, "png", compress_level=COMPRESSION, dpi=(DPI, DPI))
    return png.getvalue()


class NotebookFigure(Figure):
    """A figure that a notebook shows as the last line of a cell, without pyplot."""

    def _repr_png_(self) -> bytes:
        return as_png(self)


@overload
def plot(result: object) -> NotebookFigure: ...
@overload
def plot(result: object, *, ax: None) -> NotebookFigure: ...
@overload
def plot(result: object, *, ax: Place) -> Place: ...
def plot(result: object, *, ax: Any = None) -> Any:
    """Draw a Recording, CuffFit, SessionFit, MotionSolution, Assessment or a mapping from names to CuffFit.

    A notebook shows the returned figure, and `.savefig(path)` keeps it. ax: axes to draw into, which are then returned:
    one, which is divided where the picture has several panels, or as many as there are panels. Raises TypeError for
    anything else, and ValueError for another number of axes.
    """
    panels = _panels(result)
    if ax is None:
        with mpl.rc_context(STYLE):
            figure = NotebookFigure(figsize=panels.size, layout="constrained")
            grid = figure.subplots(panels.rows, panels.columns, squeeze=False, sharex=panels.rows > 1)
        panels.draw(list(grid.flat))
        return figure
    axes = [ax] if isinstance(ax, Axes) else list(np.ravel(np.asarray(ax, dtype=object)))
    for one in axes:
        if not isinstance(one, Axes):
            raise TypeError(f"ax should be Axes of matplotlib, and got a {type(one).__name__}")
    count = panels.rows * panels.columns
    if len(axes) == 1 and count > 1:
        axes = _divided(axes[0], panels.rows, panels.columns)
    if len(axes) != count:
        several = f" or {count}, one for each panel" if count > 1 else ""
        raise ValueError(f"ax has {len(axes)} axes, expected one{several}")
    panels.draw(axes)
    return ax


@dataclass(frozen=True)
class _Panels:
    """Rows and columns of a picture, its size [in], and the function that draws into its axes."""

    rows: int
    columns: int
    size: tuple[float, float]
    draw: Callable[[list[Axes]], None]


def _divided(axes: Axes, rows: int, columns: int) -> list[Axes]:
    """Axes in a grid within the given ones, whose frame is removed."""
    axes.set_axis_off()
    width, height = 1 / (columns + 0.25 * (columns - 1)), 1 / (rows + 0.15 * (rows - 1))
    corners = [
        (1.25 * column * width, 1.15 * (rows - 1 - row) * height) for row in range(rows) for column in range(columns)
    ]
    return [axes.inset_axes((left, bottom, width, height)) for left, bottom in corners]


@singledispatch
def _panels(result: object) -> _Panels:
    raise TypeError(
        f"plot draws a Recording, CuffFit, SessionFit, MotionSolution or Assessment, and got a {type(result).__name__}"
    )


@_panels.register
def _(result: Recording) -> _Panels:
    """Every scalar stream over device time, and the height of every marker, in the units of the recording."""

    def draw(axes: list[Axes]) -> None:
        for axis, stream in zip(axes, result.streams, strict=True):
            track = result.load(stream.name)
            time = 1e-9 * (track.device_time_ns - track.device_time_ns[:1])
            values = track.values[:, :, 2] if track.values.ndim == 3 else track.values
            axis.plot(time, values, linewidth=0.8)
            axis.set_ylabel(f"{stream.name.strip('/')} [{stream.unit}]")
        axes[-1].set_xlabel("device time of each stream [s]")

    return _Panels(len(result.streams), 1, (9.0, 1.9 * len(result.streams)), draw)


@_panels.register
def _(result: CuffFit) -> _Panels:
    """Each quantity of every trial with its 95 % interval, and the donning's own as a band."""

    def draw(axes: list[Axes]) -> None:
        for axis, name in zip(axes, QUANTITIES, strict=True):
            _draw_trials(axis, result, name)
        axes[0].set_title(
            f"cuff {result.name}, donning {result.donning}: its trials, and the donning as a band", loc="left"
        )

    return _Panels(1, len(QUANTITIES), (10.0, 3.0), draw)


def _draw_trials(axis: Axes, result: CuffFit, name: str) -> None:
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
        low, high = (scale * end for end in pooled.ci95)
        axis.axvspan(low, high, color=SHADES[0], alpha=0.15)
        axis.axvline(scale * pooled.value, color=SHADES[0])
    axis.set_xlabel(f"{name} [{unit}]")


@_panels.register
def _(result: SessionFit) -> _Panels:
    return _panels(result.cuffs)


@_panels.register(Mapping)
def _(result: Mapping[str, CuffFit]) -> _Panels:
    """Force over displacement of every trial that was used, a panel per cuff, and its stiffness as a line."""
    if not result or not all(isinstance(fit, CuffFit) for fit in result.values()):
        raise TypeError("plot draws a mapping from names to CuffFit, as fit_session(…).cuffs is, and got another one")

    def draw(axes: list[Axes]) -> None:
        for axis, fit in zip(axes, result.values(), strict=True):
            _draw_pulls(axis, fit)
        axes[0].set_ylabel("force [N]")

    return _Panels(1, len(result), (4.4 * len(result), 3.6), draw)


def _draw_pulls(axis: Axes, fit: CuffFit) -> None:
    for curves in fit.pulls.values():
        force = np.interp(curves.pull.marker_time, curves.pull.force_time, curves.pull.force)
        axis.plot(1e3 * curves.pull.displacement, force, color=LINE, linewidth=0.5, alpha=0.5)
    if fit.stiffness is not None and fit.migration is not None:
        through = (1e3 * fit.migration.value, 0.0)
        axis.axline(through, slope=1e-3 * fit.stiffness.value, color=SHADES[0], label="stiffness, after migration")
        axis.legend(fontsize="x-small", loc="upper left")
    axis.set_title(f"{fit.name}, donning {fit.donning}", loc="left")
    axis.set_xlabel("displacement [mm]")


@_panels.register
def _(result: MotionSolution) -> _Panels:
    """Activations of the busiest muscles, and the size of the joint reaction, over time."""

    def draw(axes: list[Axes]) -> None:
        above, below = axes
        for muscle in np.argsort(np.nanmax(result.activations, axis=0))[::-1][:BUSIEST]:
            above.plot(result.time, result.activations[:, muscle], label=result.muscles[muscle], linewidth=1.0)
        above.set_ylabel("activation")
        above.legend(fontsize="x-small", loc="upper left", bbox_to_anchor=(1.0, 1.0))
        below.plot(result.time, np.linalg.norm(result.reaction[:, 3:], axis=1), color=LINE)
        below.set_ylabel("joint reaction [N]")
        below.set_xlabel("time [s]")

    return _Panels(2, 1, (9.0, 5.2), draw)


@_panels.register
def _(result: Assessment) -> _Panels:
    """Muscle effort over the cord's rest length in every condition; 1 is the suit with a slack cord."""

    def draw(axes: list[Axes]) -> None:
        axis = axes[0]
        for curve in result.curves:
            label = " ".join(filter(None, (curve.cuff, CONDITIONS[curve.condition])))
            axis.plot(result.rest_lengths, curve.cost, label=label, linewidth=1.2)
        axis.axhline(1.0, color=LINE, linewidth=0.8)
        axis.set_xlabel("rest length of the cord [m]")
        axis.set_ylabel("muscle effort over that with a slack cord")
        axis.legend(fontsize="x-small")

    return _Panels(1, 1, (7.0, 3.6), draw)

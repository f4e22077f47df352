"""Figures of `station rmr`: activations of all muscles, reserves, and the joint reaction's path on the glenoid."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import cycle, product
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure, SubFigure
from matplotlib.patches import Ellipse

from documents.interval import counted
from solver.model import Array, ModelError
from solver.redundancy.effort import effort_weights
from solver.redundancy.mechanics import glenoid_cone, is_shoulder
from solver.redundancy.problem import FrameOutcome
from station.assessment.rmr import SolvedMotion, reserve_unit
from station.checksums import write_whole
from station.report.plot import LINE, MARK, SHADES, STYLE, as_png
from station.sources import without_hash

WARM = "#c2571a"
HEAT = ("#ffffff", "#f8dcae", "#e8743b", "#8b1e4f", "#1b0c2a")
UNKNOWN = "#dedede"  # a frame without a solution
COLOURS = (*SHADES, LINE, MARK, WARM, "#4aa3a2")
STYLES = ("-", "--", ":", "-.")
MUSCLE_ROW = 0.115  # in, for a name of 7.5 points
NAMES_IN_COLUMN = 16
MM = 1e3
MOST_RIMS = 10.0
"""Half width of the axes over that of the glenoid: a reaction nearly in the glenoid's plane meets it far away."""
Page = Figure | SubFigure


def draw_solved(path: Path, solved: SolvedMotion) -> None:
    """Draw one page if the path is a .png, else every part as a .png in this folder."""
    if path.suffix == ".png":
        write_whole(path, _page(solved))
        return
    for name, (draw, size) in _PARTS.items():
        with mpl.rc_context(STYLE):
            figure = Figure(figsize=size, layout="constrained")
            draw(figure, solved)
        write_whole(path / f"{name}.png", as_png(figure))


def _page(solved: SolvedMotion) -> bytes:
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(14, max(9.2, 1.2 + MUSCLE_ROW * len(solved.model.muscles))), layout="constrained")
        sides: Any = figure.subfigures(1, 2, width_ratios=[1.25, 1], wspace=0.02)
        _activations(sides[0], solved)
        if _has_reaction(solved):
            halves: Any = sides[1].subfigures(2, 1, height_ratios=[1, 1.25])
            _glenoid(halves[0], solved)
            _reserves(halves[1], solved)
        else:
            _reserves(sides[1], solved)
        figure.suptitle(
            f"{without_hash(solved.notes['motion'])}, {solved.model.name}; filter: {solved.notes['filter']}",
            x=0.01,
            ha="left",
            fontsize=10,
        )
    return as_png(figure)


def _activations(page: Page, solved: SolvedMotion) -> None:
    """A row per muscle, time to the right, the darker the more active."""
    time, values = solved.solution.time, solved.solution.activations
    axis = page.subplots()
    colours = LinearSegmentedColormap.from_list("activation", HEAT).with_extremes(bad=UNKNOWN)
    strongest = max(float(np.nanmax(values, initial=0.0)), 0.05)
    edges = _edges(time), _edges(np.arange(float(values.shape[1])))
    image = axis.pcolormesh(*edges, values.T, cmap=colours, vmin=0.0, vmax=strongest)
    names = [name.replace("_", " ") for name in solved.model.muscle_names]
    axis.set_yticks(range(len(names)), names, fontsize=7.5)
    axis.invert_yaxis()
    axis.grid(visible=False)
    axis.tick_params(left=False)
    axis.set_title("activation", loc="left")
    axis.set_xlabel("time [s]")
    page.colorbar(image, ax=axis, pad=0.01, fraction=0.03, aspect=45, label="activation")


def _edges(centres: Array) -> Array:
    """(cells + 1,) of evenly spaced cells; those of a single one are half a unit away."""
    half = 0.5 * (centres[1] - centres[0]) if len(centres) > 1 else 0.5
    return np.append(centres - half, centres[-1] + half)


def _has_reaction(solved: SolvedMotion) -> bool:
    """Whether there is a glenoid, or a joint that was asked for."""
    return is_shoulder(solved.model, solved.options.joint) or bool(solved.solution.joint_reactions.labels)


def _reserves(page: Page, solved: SolvedMotion) -> None:
    """Forces of actuators: of those that replace muscles, and by their units of those without weight."""
    groups = _reserve_groups(solved) or {("the model has no actuators", "N m"): []}
    axes = np.atleast_1d(page.subplots(len(groups), 1, sharex=True))
    for axis, ((title, unit), members) in zip(axes, groups.items(), strict=True):
        for (style, shade), index in zip(cycle(product(STYLES, COLOURS)), members, strict=False):
            values, name = solved.solution.reserves[:, index], solved.model.actuated_names[index]
            axis.plot(solved.solution.time, values, color=shade, linestyle=style, linewidth=1.0, label=name)
        axis.set_title(title, loc="left")
        axis.set_ylabel(f"[{unit}]")
        if members:
            columns = math.ceil(len(members) / NAMES_IN_COLUMN)
            axis.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=7.5, ncols=columns)
    axes[-1].set(xlabel="time [s]", xlim=_edges(solved.solution.time)[[0, -1]])


def _reserve_groups(solved: SolvedMotion) -> dict[tuple[str, str], list[int]]:
    """(title, unit) → indices of actuators."""
    groups: dict[tuple[str, str], list[int]] = {}
    is_free = effort_weights(solved.model, solved.options)[len(solved.model.muscles) :] == 0
    for index in np.argsort(is_free, kind="stable"):
        title = "reserves without weight" if is_free[index] else "reserves with weight"
        unit = reserve_unit(solved.model, solved.model.actuators[index])
        groups.setdefault((title, unit), []).append(int(index))
    return groups


def _glenoid(page: Page, solved: SolvedMotion) -> None:
    """Path of the reaction's line of action on the glenoid, coloured by time; its rim, and unsolved frames."""
    found = solved.solution
    axis = page.subplots()
    axis.set_title("joint reaction in the plane of the glenoid", loc="left")
    try:
        along, across = (
            MM * half for half in glenoid_cone(solved.model, solved.options.glenoid_aspect, solved.options.joint).rim
        )
    except ModelError:
        _joint_forces(axis, solved)
        return
    is_held = solved.options.has_glenoid_cone
    rim = Ellipse(
        (0, 0), 2 * along, 2 * across, facecolor="#f3efe6", edgecolor=LINE, linestyle="-" if is_held else "--"
    )
    axis.add_patch(rim)
    axis.plot(0, 0, "+", color=MARK, markersize=9)
    _draw_path(page, axis, solved)
    lost = [outcome is FrameOutcome.INFEASIBLE for outcome in found.outcomes]
    if any(lost):
        axis.plot(*(MM * found.contact[lost].T), "x", color=WARM, markersize=4, label="infeasible: nearest point")
        axis.legend(loc="upper right", fontsize=7.5)
    far, rim_reach = MM * np.abs(found.contact).max(axis=1), max(along, across)
    reach = float(np.clip(1.05 * np.nanmax(far, initial=0.0), 1.15 * rim_reach, MOST_RIMS * rim_reach))
    outside = far[far > reach]
    if len(outside):
        beyond = f"{len(outside)} of {counted(len(far), 'frame')} beyond the axes, up to {outside.max():.0f} mm"
        axis.text(0.02, 0.02, beyond, transform=axis.transAxes, fontsize=7.5)
    axis.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
    axis.set_xlabel("from its centre towards the edge marker [mm]")
    axis.set_ylabel("across [mm]")


def _joint_forces(axis: Axes, solved: SolvedMotion) -> None:
    """In place of the glenoid, in a model that has none: the size of the forces of the requested joints."""
    reactions = solved.solution.joint_reactions
    axis.set_title("joint reactions", loc="left")
    if not reactions.labels:
        axis.text(0.5, 0.5, "no joint was requested (--joint)", ha="center", transform=axis.transAxes)
        axis.set_axis_off()
        return
    for place, (name, shade) in enumerate(
        zip(solved.options.reactions.joints, (*SHADES, LINE, MARK, WARM) * 9, strict=False)
    ):
        axis.plot(solved.solution.time, np.linalg.norm(reactions.force[:, place], axis=1), color=shade, label=name)
    axis.legend(fontsize=7.5)
    axis.set_xlabel("time [s]")
    axis.set_ylabel("[N]")


def _draw_path(page: Page, axis: Axes, solved: SolvedMotion) -> None:
    time, points = solved.solution.time, MM * solved.solution.contact
    pieces = np.stack([points[:-1], points[1:]], axis=1)
    line = LineCollection(list(pieces), cmap="viridis", linewidths=1.8, capstyle="round")
    line.set_array(0.5 * (time[1:] + time[:-1]))
    axis.add_collection(line)
    known = np.flatnonzero(np.isfinite(points).all(axis=1))
    for text, frame, shift in zip(("start", "end"), known[[0, -1]] if len(known) else (), (5, -11), strict=False):
        axis.plot(*points[frame], "o", color=LINE, markersize=4)
        axis.annotate(text, points[frame], xytext=(6, shift), textcoords="offset points", fontsize=8)
    page.colorbar(line, ax=axis, pad=0.02, fraction=0.05, label="time [s]")


_PARTS: dict[str, tuple[Callable[[Page, SolvedMotion], Any], tuple[float, float]]] = {
    "activations": (_activations, (8.0, 8.0)),
    "reserves": (_reserves, (8.0, 6.0)),
    "glenoid": (_glenoid, (6.0, 5.0)),
}

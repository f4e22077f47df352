"""Draw markers, model and residuals of a trial: `python -m docs.pictures.markers model.osim trial.trc ik.xml`.

Front and right side in the frame with the arm raised most; below, the residual of every marker over time. markers.png
in the documentation is of trial FLX01 of Seth et al. (2019), CC BY 4.0, with the set-up of Belli et al. (2023).
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from docs.pictures.body import VIEWS, View, draw_bones, flattened, save_picture
from solver.multibody.postures import points_in_ground, postures
from station.kinematics.ik import IkInputs, SolvedPostures, solve_postures
from station.report.plot import FORCE, MOTION, STYLE

MM = 1e3
MARGIN = 4.0  # cm


@mpl.rc_context(STYLE)
def draw_markers(solved: SolvedPostures) -> None:
    """markers.png."""
    figure = Figure(figsize=(9.0, 7.6), layout="constrained")
    above, below = figure.subfigures(2, 1, height_ratios=[1.7, 1])
    for axes, (title, view) in zip(above.subplots(1, 2), VIEWS.items(), strict=True):
        _draw_frame(axes, solved, view)
        axes.set_aspect("equal")
        axes.set(title=title, xlabel="cm", ylabel="cm")
    above.axes[0].legend(loc="center right", bbox_to_anchor=(-0.35, 0.5))
    axes = below.subplots()
    for index, (marker, residual) in enumerate(zip(solved.tasks.markers, solved.solution.residuals.T, strict=True)):
        colour = mpl.colormaps["tab10"](index % 10)
        axes.plot(solved.time, MM * residual, color=colour, linewidth=1.0, label=marker.name)
    rms = np.sqrt(np.nanmean(solved.solution.residuals**2, axis=1))
    axes.plot(solved.time, MM * rms, color="black", linewidth=2.0, label="RMS")
    axes.set(xlabel="time [s]", ylabel="residual [mm]", xlim=solved.time[[0, -1]], ylim=(0, None))
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    save_picture(figure, "markers.png")


def _draw_frame(axes: Axes, solved: SolvedPostures, view: View) -> None:
    elevation = solved.solution.coordinates[:, solved.model.coordinate_index("shoulder_elv")]
    frame = int(np.nanargmax(elevation))
    at = solved.solution.coordinates[[frame]]
    state = postures(solved.model, at, np.zeros_like(at))
    draw_bones(axes, solved.model, state, view, MOTION, "model")
    flat = flattened(solved.model, state, view)
    found = np.concatenate([points_in_ground(state, m.body, m.location) for m in solved.tasks.markers])
    seen = solved.observed[frame]
    for marker, ends in zip(solved.tasks.markers, zip(flat(found), flat(seen), strict=True), strict=True):
        axes.plot(*np.array(ends).T, color=FORCE, linewidth=1.2)
        axes.annotate(marker.name, ends[1], xytext=(3, 3), textcoords="offset points", fontsize=7)
    lowest, highest = flat(seen).min(axis=0) - MARGIN, flat(seen).max(axis=0) + MARGIN
    axes.set(xlim=(lowest[0], highest[0]), ylim=(lowest[1], highest[1]))
    axes.scatter(*flat(found).T, s=18, facecolors="none", edgecolors=MOTION, label="marker of the model")
    axes.scatter(*flat(seen).T, s=14, color=FORCE, label="observed marker")


if __name__ == "__main__":
    draw_markers(solve_postures(IkInputs(sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3]))))

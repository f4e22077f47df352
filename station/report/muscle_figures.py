"""The report's figures of what a suit does for the muscles, drawn by matplotlib and returned as PNG bytes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pandas as pd

from station.report.canvas import LINE, MARK, SHADES, TITLE, WIDE, Margins, as_png, new_page

LEGEND_COLUMNS = 3
LEGEND_ROW = 0.22
"""Inches of a row of a figure's legend."""
LEAST_SHOWN = 0.01
"""Of an activation, up to where each of its axes goes at least."""
COSTLIEST = 1.3
"""Where cost curves leave the figure: far too short a cord costs double, and would hide what matters."""

NAMED_MUSCLES = (
    "DeltoideusClavicle_A",
    "DeltoideusScapula_M",
    "DeltoideusScapula_P",
    "TrapeziusScapula_S",
    "TrapeziusClavicle_S",
    "SerratusAnterior_S",
    "SerratusAnterior_M",
    "SerratusAnterior_I",
)
"""Those that the published study shows."""
OF_MUSCLES = Margins(top=TITLE, bottom=0.48 + TITLE, between_rows=0.5)
"""Each panel has a title and tick labels, only the first of a row the axis's name; the legend is below."""


def cost_figure(assessment: Mapping[str, Any], cuff: str) -> bytes:
    """Normalised muscle cost over the cord's rest length, in every condition with one arm cuff; 1 is a slack cord."""
    places = {"rigid": ("rigid",), **{each.replace("_", "-"): (cuff, each) for each in assessment["cost"][cuff]}}
    return _cost_curves(assessment, places)


def cuffs_figure(assessment: Mapping[str, Any]) -> bytes:
    """The same with every arm cuff, shifted and yielding, beside rigid ones."""
    arms = [cuff for cuff in assessment["cost"] if cuff != "rigid"]
    return _cost_curves(assessment, {"rigid": ("rigid",), **{cuff: (cuff, "both") for cuff in arms}})


def activation_figure(activations: pd.DataFrame, cuff: str) -> bytes:
    """Activations over time, one panel per named muscle, in every condition with one arm cuff."""
    muscles = [name for name in NAMED_MUSCLES if name in activations] or list(activations.columns[3:11])
    figure, axes = new_page(4, rows=-(-len(muscles) // 4), height=1.9, width=WIDE / 4, margins=OF_MUSCLES)
    for axis, muscle in zip(axes, muscles, strict=False):
        for condition, part, shade in _conditions(activations, cuff):
            axis.plot(part["time_s"], part[muscle], color=shade, linewidth=0.9, label=condition.replace("_", "-"))
        axis.set_title(muscle, fontsize=8, loc="left")
        axis.set_ylim(0.0, max(1.05 * axis.dataLim.y1, LEAST_SHOWN))  # a muscle at rest is a line at 0, not noise
    for axis in axes[len(muscles) :]:
        axis.set_visible(False)
    for i, axis in enumerate(axes[: len(muscles)]):
        axis.set_ylabel("activation" if i % 4 == 0 else "")
        axis.set_xlabel("time [s]" if i + 4 >= len(muscles) else "")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="lower left", ncols=5, fontsize=8, frameon=False)
    return as_png(figure)


def reduction_figure(assessment: Mapping[str, Any], cuff: str) -> bytes:
    """Reduction of mean activation at the reference rest length: rigid, both with one cuff, and as EMG measured it."""
    reductions = {
        "rigid": assessment["muscle_reduction"]["rigid"],
        f"visco-elastic + shift, {cuff}": assessment["muscle_reduction"][cuff]["both"],
    }
    emg = {row["muscle"]: row for row in assessment["emg"]}
    names = list(emg) or [name for name in NAMED_MUSCLES if name in reductions["rigid"]] or list(reductions["rigid"])
    figure, (axis,) = new_page(1, height=1.2 + 0.34 * len(names), margins=Margins(top=TITLE))
    rows, height = np.arange(len(names)), 0.8 / (len(reductions) + bool(emg))
    for i, ((label, reduction), shade) in enumerate(zip(reductions.items(), (LINE, SHADES[0]), strict=False)):
        percent = [_percent(reduction[name]) for name in names]
        reach = np.array([_reach(reduction[name]) for name in names]).T
        axis.barh(rows + i * height, percent, height, xerr=reach, color=shade, ecolor=MARK, label=label)
    if emg:
        measured = [emg[name]["reduction_percent"]["value"] for name in names]
        spread = [emg[name]["sd_percent"]["value"] for name in names]
        axis.barh(rows + 2 * height, measured, height, xerr=spread, color=SHADES[1], ecolor=MARK, label="EMG ± sd")
    axis.set_yticks(rows + height / 2, names)
    axis.invert_yaxis()
    axis.set_xlabel("reduction of mean activation [%]")
    figure.legend(loc="upper left", ncols=LEGEND_COLUMNS, fontsize=7.5, frameon=False)
    return as_png(figure)


def _cost_curves(assessment: Mapping[str, Any], places: Mapping[str, tuple[str, ...]]) -> bytes:
    """A curve for each label and where it stands in the assessment, its best rest length marked."""
    lines = len(places) + 2  # those of the slack cord and of the reference rest length
    margins = Margins(top=0.14 + LEGEND_ROW * -(-lines // LEGEND_COLUMNS))
    figure, (axis,) = new_page(1, height=3.2, margins=margins)
    lengths = assessment["rest_lengths_m"]["value"]
    axis.axhline(1.0, color=MARK, linewidth=1.0, label="slack cord")
    lowest = 1.0
    for (label, place), shade in zip(places.items(), (LINE, *SHADES), strict=False):
        cost, best = assessment["cost"], assessment["optimum"]
        for step in place:
            cost, best = cost[step], best[step]
        axis.plot(lengths, np.array(cost["value"], dtype=float), color=shade, linewidth=1.3, label=label)
        if best["rest_length_m"]["value"] is not None:
            axis.plot(
                best["rest_length_m"]["value"], best["normalised_cost"]["value"], "o", color=shade, markersize=4.5
            )
        lowest = min([lowest, *(value for value in cost["value"] if value is not None)])
    reference = assessment["reference_rest_length_m"]["value"]
    axis.axvline(reference, color=MARK, linestyle=":", linewidth=1.0, label=f"compared at {reference:.2f} m")
    axis.set_ylim(lowest - 0.03, COSTLIEST)
    axis.set_xlabel("rest length of the exotendon [m]; a dot: the best one")
    axis.set_ylabel("muscle cost / slack cord")
    figure.legend(loc="upper left", ncols=LEGEND_COLUMNS, frameon=False)
    return as_png(figure)


def _conditions(activations: pd.DataFrame, cuff: str) -> Iterator[tuple[str, pd.DataFrame, str]]:
    """Condition, its rows, and its colour: the slack cord, rigid cuffs, then those with this cuff."""
    worn = activations[activations["cuff"].isin(["", cuff])]
    for (condition, part), shade in zip(worn.groupby("condition", sort=False), (MARK, LINE, *SHADES), strict=False):
        yield str(condition), part, shade


def _percent(number: Mapping[str, Any]) -> float:
    return float("nan") if number["value"] is None else 100 * number["value"]


def _reach(number: Mapping[str, Any]) -> tuple[float, float]:
    """From the value down and up to the ends of its interval, in percent; nothing where it has none."""
    if not number["ci95"]:
        return 0.0, 0.0
    low, high = number["ci95"]
    return max(100 * (number["value"] - low), 0.0), max(100 * (high - number["value"]), 0.0)

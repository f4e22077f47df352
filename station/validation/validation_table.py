"""Results of `station validate`: a table on the terminal and as CSV, and a figure of measured and predicted force."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from rich.table import Table

from solver.redundancy.glenoid import ForceAgreement
from station.report.canvas import LINE, SHADES, STYLE, as_png
from station.validation.lifts import SolvedVariant
from station.whole_file import write_whole

COLUMNS = (
    "lift",
    "variant",
    "frames",
    "unsolved",
    "compared",
    "median_difference_from_published_n",
    "rmse_percent_of_body_weight",
    "published_rmse_percent_of_body_weight",
    "correlation",
    "published_correlation",
    "peak_ratio",
    "published_peak_ratio",
    "angle_to_measured_deg",
    "is_within_limits",
)
NOTE = (
    "ΔF: median difference from the published force. RMSE in % of body weight, in brackets that of the published "
    "force; r; peaks, predicted / measured; angle to the measured force, which is not evaluated."
)
UNKNOWN = ForceAgreement(math.nan, math.nan, math.nan)


def validation_table(solved: Sequence[SolvedVariant]) -> Table:
    """A row per lift and variant; the RMSE of the published solution in brackets."""
    table = Table(
        "lift", "variant", "ΔF [N]", "RMSE [%]", "r", "peaks", "angle", "limits", caption=NOTE, show_edge=False
    )
    for found in solved:
        ours, theirs = found.agreement, found.published_rmse_percent
        table.add_row(
            found.lift,
            found.variant,
            "" if found.median_difference is None else f"{found.median_difference:.1f}",
            f"{found.rmse_percent:.1f}" + ("" if theirs is None else f" ({theirs:.1f})"),
            f"{ours.correlation:.3f}",
            f"{ours.peak_ratio:.2f}",
            "" if math.isnan(found.angle) else f"{np.degrees(found.angle):.0f}°",
            {True: "met", False: "exceeded", None: ""}[found.is_within_limits],
        )
    return table


def write_validation(path: Path, solved: Sequence[SolvedVariant]) -> None:
    """A row per lift and variant, whose figures are of the `compared` frames; empty without a published solution."""
    rows = [",".join(_row(found)) for found in solved]
    write_whole(path, "\n".join([",".join(COLUMNS), *rows]) + "\n")


def _row(found: SolvedVariant) -> list[str]:
    ours, theirs = found.agreement, found.published or UNKNOWN
    figures = (
        found.median_difference,
        found.rmse_percent,
        found.published_rmse_percent,
        ours.correlation,
        theirs.correlation,
        ours.peak_ratio,
        theirs.peak_ratio,
        math.degrees(found.angle),
    )
    verdict = {True: "true", False: "false", None: ""}[found.is_within_limits]
    counts = map(str, (len(found.time), found.unsolved, found.compared))
    return [found.lift, found.variant, *counts, *map(_field, figures), verdict]


def _field(figure: float | None) -> str:
    return "" if figure is None or math.isnan(figure) else f"{figure:.6g}"


DASHES = ("-", "--", "-.", ":")
LABELS = {
    "none": "published weights, no cone",
    "circle": "published weights, circular cone",
    "ellipse": "published weights, elliptic cone",
    "defaults": "defaults of the solver",
}


def draw_forces(path: Path, solved: Sequence[SolvedVariant]) -> None:
    """A panel per lift: measured force, and predicted force in every variant. As .svg or .png, by the suffix."""
    lifts = list(dict.fromkeys(found.lift for found in solved))
    with mpl.rc_context({**STYLE, "svg.hashsalt": "forces", "svg.fonttype": "none"}):
        figure = Figure(figsize=(1.0 + 4.2 * len(lifts), 3.4), layout="constrained")
        panels = figure.subplots(1, len(lifts), sharey=True, squeeze=False)[0]
        for panel, lift in zip(panels, lifts, strict=True):
            variants = [found for found in solved if found.lift == lift]
            measured = 100.0 * variants[0].measured_force / variants[0].body_weight
            panel.plot(variants[0].time, measured, color=LINE, linewidth=2.2, label="measured")
            for place, found in enumerate(variants):
                label = LABELS.get(found.variant, found.variant)
                style = {"color": SHADES[place % len(SHADES)], "linestyle": DASHES[place % len(DASHES)]}
                panel.plot(found.time, 100.0 * found.force / found.body_weight, label=label, **style)
            panel.set(title=lift, xlabel="time [s]")
        panels[0].set(ylabel="joint force [% of body weight]", ylim=(0, None))
        panels[0].legend(fontsize="x-small")
        write_whole(path, as_png(figure) if path.suffix == ".png" else _as_svg(figure))


def _as_svg(figure: Figure) -> bytes:
    """Without a date: the same figure gives the same bytes."""
    drawn = io.BytesIO()
    figure.savefig(drawn, format="svg", metadata={"Date": None, "Creator": None})
    return drawn.getvalue()

"""Figure of measured and predicted joint force over the lifts."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

from station.report.canvas import LINE, SHADES, STYLE, as_png
from station.validation.lifts import SolvedVariant
from station.whole_file import write_whole

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

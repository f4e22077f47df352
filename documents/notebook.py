"""Results as HTML for a notebook: a title, a table of figures, remarks, and a small drawing of curves."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

Curve = tuple[NDArray[np.float64], NDArray[np.float64]]
WIDTH, HEIGHT, MOST_POINTS = 260, 150, 200
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9")
"""Of Okabe and Ito (2008), as in the report."""


def result_html(
    title: str, header: Sequence[str], rows: Iterable[Sequence[str]], remark: str, drawing: str = ""
) -> str:
    """A fragment of a page; every text is escaped. drawing is that of curves_svg."""
    cells = ["<tr>" + "".join(f"<th>{escape(name)}</th>" for name in header) + "</tr>"]
    cells += ["<tr>" + "".join(f"<td>{escape(text)}</td>" for text in row) + "</tr>" for row in rows]
    table = f"<table>{''.join(cells)}</table>"
    return f"<div><b>{escape(title)}</b>{table}<p>{escape(remark)}</p>{drawing}</div>"


def curves_svg(curves: Sequence[Curve], horizontal: str, vertical: str) -> str:
    """Curves (x, y) in one frame with its limits; samples that are not finite are left out."""
    thinned = [(x[:: 1 + len(x) // MOST_POINTS], y[:: 1 + len(x) // MOST_POINTS]) for x, y in curves]
    finite = [np.column_stack(curve)[np.isfinite(curve).all(axis=0)] for curve in thinned]
    points = np.concatenate(finite) if finite else np.zeros((0, 2))
    if not len(points):
        return ""
    low, size = points.min(axis=0), np.ptp(points, axis=0)
    scale = np.array([WIDTH, -HEIGHT]) / np.where(size > 0, size, 1.0)
    lines = "".join(
        f'<polyline fill="none" stroke="{COLOURS[number % len(COLOURS)]}" points="'
        + " ".join(f"{x:.1f},{y:.1f}" for x, y in (curve - low) * scale + [0, HEIGHT])
        + '"/>'
        for number, curve in enumerate(finite)
    )
    high = low + size
    texts = (
        f'<text x="0" y="{HEIGHT + 14}">{low[0]:.3g}</text>'
        f'<text x="{WIDTH}" y="{HEIGHT + 14}" text-anchor="end">{high[0]:.3g} {escape(horizontal)}</text>'
        f'<text x="{WIDTH + 4}" y="{HEIGHT}">{low[1]:.3g}</text>'
        f'<text x="{WIDTH + 4}" y="10">{high[1]:.3g} {escape(vertical)}</text>'
    )
    box = f"-2 -2 {WIDTH + 90} {HEIGHT + 22}"
    return (
        f'<svg viewBox="{box}" width="{WIDTH + 90}" font-size="11" fill="currentColor">'
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="none" stroke="#999"/>{lines}{texts}</svg>'
    )

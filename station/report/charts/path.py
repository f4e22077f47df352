"""Curves and clouds as short SVG paths: no more points than a screen can show, in tenths of a pixel."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from station.report.charts.marks import Array

PIECES = 220
"""Of a curve; the first, least, greatest and last value of every piece are kept, so that no peak is lost."""
MOST_DOTS = 450


def curve(x: Array, y: Array) -> str:
    """`d` of a path through the points (n,) [px]; NaN interrupts it."""
    return "".join(_piece(points) for points in _runs(np.column_stack([x, y])) if len(points))


def outline(x: Array, low: Array, high: Array) -> str:
    """`d` of the closed path around a band."""
    return "".join(
        _piece(np.concatenate([points[:, :2], points[::-1, ::2]])) + "Z"
        for points in _runs(np.column_stack([x, low, high]))
        if len(points)
    )


def dots(x: Array, y: Array) -> str:
    """`d` of dots: lines of no length, which a round line cap makes visible. Dots on the same pixel are one."""
    points = np.column_stack([x, y])[:: max(1, -(-len(x) // MOST_DOTS))]
    pixels = np.unique(np.round(points[np.isfinite(points).all(axis=1)], 0), axis=0)
    return "".join(f"M{across:.0f} {up:.0f}h0" for across, up in pixels)


def _runs(points: Array) -> Iterator[Array]:
    """The stretches without NaN."""
    known = np.asarray(np.isfinite(points).all(axis=1))
    edges = np.flatnonzero(np.diff(known)) + 1
    for run in np.split(np.arange(len(points)), edges):
        if len(run) and known[run[0]]:
            yield points[run]


def _piece(points: Array) -> str:
    points = _decimated(points)
    tenths = np.rint(10.0 * points).astype(np.int64)
    steps = np.diff(tenths, axis=0)
    moves = steps[np.any(steps != 0, axis=1)] / 10
    start = f"M{tenths[0, 0] / 10:g} {tenths[0, 1] / 10:g}"
    return start + ("l" + " ".join(f"{across:g} {up:g}" for across, up in moves) if len(moves) else "h0")


def _decimated(points: Array) -> Array:
    """First, least, greatest (of y) and last point of every piece of a long curve, in their order."""
    if len(points) <= 4 * PIECES:
        return points
    kept: set[int] = set()
    for piece in np.array_split(np.arange(len(points)), PIECES):
        up = points[piece, 1]
        kept.update(map(int, piece[[0, -1, up.argmin(), up.argmax()]]))
    return np.asarray(points[sorted(kept)])

"""Curves and clouds as short SVG paths: no more points than a screen can show, in tenths of a pixel."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np

from station.charts.marks import Array

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
    return "".join(f"M{across} {up}h0" for across, up in pixels.astype(np.int64).tolist())


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
    moves = steps[np.any(steps != 0, axis=1)]
    start = f"M{_tenths(int(tenths[0, 0]))} {_tenths(int(tenths[0, 1]))}"
    return start + ("l" + " ".join(map(_tenths, moves.ravel().tolist())) if len(moves) else "h0")


@cache
def _tenths(count: int) -> str:
    """A number of tenths; steps of curves are few numbers many times."""
    return f"{count / 10:g}"


def _decimated(points: Array) -> Array:
    """First, least, greatest (of y) and last point of every piece of a long curve, in their order."""
    count = len(points)
    if count <= 4 * PIECES:
        return points
    edges = np.arange(PIECES + 1) * count // PIECES
    up, kept = points[:, 1], np.zeros(count, bool)
    kept[edges[:-1]] = kept[edges[1:] - 1] = True
    piece = np.repeat(np.arange(PIECES), np.diff(edges))
    order = np.lexsort((up, piece))  # of every piece the least and the greatest at its ends
    kept[order[edges[:-1]]] = kept[order[edges[1:] - 1]] = True
    return np.asarray(points[kept])

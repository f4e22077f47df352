"""Paths as records for the compiled code; bodies are those of multibody/body_tables.py."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache
from itertools import accumulate, count
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from documents.interval import counted
from solver.errors import SolverCode
from solver.model import AnyPathPoint, Array, Model, ModelError, Path, PathPoint, PathWrap, WrapSurface

Indices = NDArray[np.int64]
Record = np.void
Records = NDArray[np.void]
Codes = NDArray[np.int8]

KINDS = ("ellipsoid", "sphere", "cylinder", "torus")
ELLIPSOID, SPHERE, CYLINDER, TORUS = 0, 1, 2, 3
METHODS = ("hybrid", "midpoint", "axial")
HYBRID, MIDPOINT, AXIAL = 0, 1, 2
CONVERGED, NOT_CONVERGED = 0, 1
"""Outcome of a path in a posture: whether an iteration reached its limit of rounds."""
NO_SURFACE = -1
FIXED = -1

# A point of a path: fixed in its body, or the one in column `changes` of the posture's CHANGE; that is −1 if fixed.
POINT = np.dtype([("body", np.int64), ("changes", np.int64), ("location", np.float64, (3,))])

# A moving or conditional path point in a posture: its location in its body, the derivative of that by a coordinate (−1:
# none), and whether it belongs to the path.
CHANGE = np.dtype(
    [("location", np.float64, (3,)), ("slope", np.float64, (3,)), ("coordinate", np.int64), ("is_there", np.int64)]
)

# A surface of a path, as in WrapSurface. The path stays where coordinate `axis` of the surface's frame has the sign
# `allowed`, or anywhere if that is 0. Two wraps with the same `surface` are on the same one. Only the pieces between
# the path's points `first` and `last` may wrap.
WRAP = np.dtype(
    [
        ("surface", np.int64),
        ("kind", np.int64),
        ("method", np.int64),
        ("body", np.int64),
        ("rotation", np.float64, (3, 3)),
        ("translation", np.float64, (3,)),
        ("dimensions", np.float64, (3,)),
        ("axis", np.int64),
        ("allowed", np.int64),
        ("first", np.int64),
        ("last", np.int64),
    ]
)

# Points of a path: its path points, then two tangent points for each of its wraps. `location` is the latest place in
# the body, `ground` the place in ground at the first use in this posture, if it is_placed; `on_surface`, at the second
# tangent point, is the length of the path over the surface. `slope` is the derivative of a location by its coordinate.
NODE = np.dtype(
    [
        ("body", np.int64),
        ("surface", np.int64),
        ("location", np.float64, (3,)),
        ("ground", np.float64, (3,)),
        ("is_placed", np.int64),
        ("coordinate", np.int64),
        ("slope", np.float64, (3,)),
        ("on_surface", np.float64),
    ]
)


class PathTables(NamedTuple):
    """Several paths: path i has the points (POINT) first_point[i] to first_point[i + 1] − 1; wraps (WRAP) alike, and
    the bodies that it touches.
    """

    points: Records
    wraps: Records
    bodies: Indices
    first_point: Indices
    first_wrap: Indices
    first_body: Indices


class PathResults(NamedTuple):
    """Results of all paths, as in paths.PathState: lengths, speeds and outcome codes (frames, paths); wrenches (frames,
    touched bodies of all paths, 6); and mobilities (frames, paths, coordinates), zero before, or no coordinates where
    none moves a point.
    """

    lengths: Array
    speeds: Array
    wrenches: Array
    mobilities: Array
    codes: Codes


@lru_cache(maxsize=32)
def pack_paths(model: Model, paths: tuple[Path, ...]) -> PathTables:
    """Raises ModelError for an index outside the model: compiled code would read beyond its arrays."""
    for k, path in enumerate(paths):
        _check(model, k, path)
    changes = count()
    points = [_point(point, changes) for path in paths for point in path.points]
    wraps = [_wrap(wrap, model.surfaces[wrap.surface], path) for path in paths for wrap in path.wraps]
    bodies = [_touched(model, path) for path in paths]
    return PathTables(
        np.array(points, POINT),
        np.array(wraps, WRAP),
        np.array([body for touched in bodies for body in touched], dtype=np.int64),
        _starts([len(path.points) for path in paths]),
        _starts([len(path.wraps) for path in paths]),
        _starts([len(touched) for touched in bodies]),
    )


def _check(model: Model, k: int, path: Path) -> None:
    if len(path.points) < 2:
        sentence = f"path {k} has {counted(len(path.points), 'point')}, expected at least 2: its beginning and its end"
        raise ModelError(sentence, SolverCode.WRONG_PATH)
    for point in path.points:
        if not 0 <= point.body < len(model.bodies):
            known = f"{model.name} has the bodies 0 to {len(model.bodies) - 1}"
            sentence = f"path {k} has a point on body {point.body}, but {known}; use Model.body_index"
            raise ModelError(sentence, SolverCode.WRONG_PATH)
        if not isinstance(point, PathPoint) and not 0 <= point.coordinate < len(model.coordinates):
            known = f"{model.name} has the coordinates 0 to {len(model.coordinates) - 1}"
            sentence = f"path {k} moves with coordinate {point.coordinate}, but {known}; use Model.coordinate_index"
            raise ModelError(sentence, SolverCode.WRONG_PATH)
    for wrap in path.wraps:
        if not 0 <= wrap.surface < len(model.surfaces):
            known = f"{model.name} has {len(model.surfaces)} surfaces"
            sentence = f"path {k} wraps over surface {wrap.surface}, but {known}, counted from 0"
            raise ModelError(sentence, SolverCode.WRONG_PATH)


def _touched(model: Model, path: Path) -> list[int]:
    """Bodies with a point or a surface of the path."""
    return sorted({point.body for point in path.points} | {model.surfaces[wrap.surface].body for wrap in path.wraps})


def _starts(counts: Sequence[int]) -> Indices:
    return np.array([0, *accumulate(counts)], dtype=np.int64)


def _point(point: AnyPathPoint, changes: Iterator[int]) -> tuple[object, ...]:
    if isinstance(point, PathPoint):
        return point.body, FIXED, point.location
    return point.body, next(changes), np.zeros(3)


def _wrap(wrap: PathWrap, surface: WrapSurface, path: Path) -> tuple[object, ...]:
    placement = surface.placement
    return (
        wrap.surface,
        KINDS.index(surface.kind),
        METHODS.index(wrap.method),
        surface.body,
        placement.rotation,
        placement.translation,
        surface.dimensions,
        *_side(surface.quadrant),
        wrap.first if surface.is_active else len(path.points),
        len(path.points) - 1 if wrap.last is None else wrap.last,
    )


def _side(quadrant: str) -> tuple[int, int]:
    """Axis and sign: "-y" is (1, −1), "x" or "+x" is (0, 1), "all" is (0, 0)."""
    if quadrant == "all":
        return 0, 0
    return "xyz".index(quadrant[-1]), -1 if quadrant[0] == "-" else 1

"""Path points that move in their bodies, or exist only in a range, with a coordinate; compiled."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from solver.compiled import compiled_for_python
from solver.model import NO_COORDINATE, ConditionalPathPoint, MovingPathPoint, Path, PathPoint
from solver.multibody.functions import derivatives
from solver.multibody.postures import Postures
from solver.multibody.tables import Functions, pack_functions
from solver.vectors import ORIGIN, Array, add, read, turn, write
from solver.wrapping.path_tables import CHANGE, Records

RANGE_TOLERANCE = 1e-5  # OpenSim keeps a conditional point this far beyond its range
NO_FUNCTION = -1

# As in model.MovingPathPoint and ConditionalPathPoint; the latter stays at its translation and has no function.
MOVER = np.dtype(
    [
        ("rotation", np.float64, (3, 3)),
        ("translation", np.float64, (3,)),
        ("coordinate", np.int64),
        ("lowest", np.float64),
        ("highest", np.float64),
        ("first_function", np.int64),
    ]
)


class MovingPoints(NamedTuple):
    """The points (MOVER) and their functions.

    stops_at_ends  whether a point that is held at an end of its range does not move either; OpenSim's does
    """

    points: Records
    functions: Functions
    stops_at_ends: bool


def pack_moving_points(paths: Sequence[Path], postures: Postures, *, stops_at_ends: bool = False) -> Records:
    """(frames, points) of CHANGE, for the points of the paths that are not fixed; stops_at_ends as in MovingPoints."""
    movers = MovingPoints(*_movers(tuple(paths)), stops_at_ends)
    changes = np.zeros((len(postures.coordinates), len(movers.points)), CHANGE)
    place_points(movers, postures.coordinates, changes)
    return changes


def has_moving_points(paths: tuple[Path, ...]) -> bool:
    """Whether a coordinate moves any point of the paths in its body; a conditional point stays."""
    _, functions = _movers(paths)
    return len(functions.functions) > 1  # the last row only ends them


@compiled_for_python
def place_points(movers: MovingPoints, coordinates: Array, changes: Records) -> None:
    """Fill changes (frames, points) at coordinates (frames, coordinates)."""
    points, functions, stops_at_ends = movers
    for frame in range(len(changes)):
        for k in range(len(points)):
            mover, change = points[k], changes[frame, k]
            rotation, translation = mover["rotation"], read(mover["translation"])
            q, first = coordinates[frame, mover["coordinate"]], mover["first_function"]
            if first == NO_FUNCTION:
                write(change["location"], translation)
                change["coordinate"] = NO_COORDINATE
                change["is_there"] = mover["lowest"] - RANGE_TOLERANCE <= q <= mover["highest"] + RANGE_TOLERANCE
                continue
            held = min(max(q, mover["lowest"]), mover["highest"])
            for i in range(3):
                change["location"][i], _, _ = derivatives(functions, first + i, held)
                _, change["slope"][i], _ = derivatives(functions, first + i, q)
            write(change["location"], add(translation, turn(rotation, read(change["location"]))))
            write(change["slope"], turn(rotation, read(change["slope"])))
            if stops_at_ends and held != q:
                write(change["slope"], ORIGIN)
            change["coordinate"], change["is_there"] = mover["coordinate"], 1


@lru_cache(maxsize=32)
def _movers(paths: tuple[Path, ...]) -> tuple[Records, Functions]:
    changing = [point for path in paths for point in path.points if not isinstance(point, PathPoint)]
    moving = [function for point in changing if isinstance(point, MovingPathPoint) for function in point.functions]
    movers, first = np.zeros(len(changing), MOVER), 0
    for row, point in zip(movers, changing, strict=True):
        row["coordinate"], (row["lowest"], row["highest"]) = point.coordinate, point.range
        if isinstance(point, ConditionalPathPoint):
            row["translation"], row["first_function"] = point.location, NO_FUNCTION
        else:
            row["rotation"], row["translation"] = point.placement.rotation, point.placement.translation
            row["first_function"] = first
            first += len(point.functions)
    return movers, pack_functions(moving)

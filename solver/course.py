"""Paths and poses as the compiled code reads them: flat arrays, and the room it works in."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import accumulate
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from solver.model import Path, WrapSurface

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

KINDS = ("ellipsoid", "sphere", "cylinder")
ELLIPSOID, SPHERE, CYLINDER = 0, 1, 2
METHODS = ("hybrid", "midpoint", "axial")
HYBRID, MIDPOINT, AXIAL = 0, 1, 2
NO_SURFACE = -1


class Course(NamedTuple):
    """The points and the surfaces of one path, or of several behind one another; bodies are rows of the Pose.

    point_body (points,), point_location and point_slope (points, 3), point_coordinate (points,), -1 where it is fixed,
    point_range (points, 2): as in PathPoint.
    surface (wraps,) index in the model, kind and method (wraps,) as above, body (wraps,), rotation (wraps, 3, 3) and
    translation (wraps, 3) of the surface in its body, dimensions (wraps, 3): as in WrapSurface.
    axis, allowed (wraps,): the path stays where coordinate `axis` of the surface's frame has this sign; 0: anywhere.
    """

    point_body: Indices
    point_location: Array
    point_slope: Array
    point_coordinate: Indices
    point_range: Array
    surface: Indices
    kind: Indices
    method: Indices
    body: Indices
    rotation: Array
    translation: Array
    dimensions: Array
    axis: Indices
    allowed: Indices


class Courses(NamedTuple):
    """Several paths in one Course: path i has the points from first_point[i] to before first_point[i + 1]."""

    course: Course
    first_point: Indices
    first_wrap: Indices


class Pose(NamedTuple):
    """One frame of Postures, all in ground: rotation (bodies, 3, 3), the other body arrays (bodies, 3), q and u."""

    rotation: Array
    origin: Array
    angular_velocity: Array
    origin_velocity: Array
    coordinates: Array
    speeds: Array


class Lane(NamedTuple):
    """Room to lay one path at a time. A path is a sequence of nodes: its points are the nodes 0, 1, …; each of its
    surfaces has two more, the tangent points, which are in the sequence while the path touches it.

    sequence (nodes,)        the nodes in order along the path
    body, surface (nodes,)   of each node; surface is NO_SURFACE for the path's own points
    location (nodes, 3)      latest place in the body [m]
    ground (nodes, 3)        place in ground [m] at its first use in this posture, if it is_placed (nodes,)
    on_surface (nodes,)      at a second tangent point: length [m] of the path over the surface before it
    order, answer (nodes,)   the surfaces in the order in which they are tried, and what each answered last
    """

    sequence: Indices
    body: Indices
    surface: Indices
    location: Array
    ground: Array
    is_placed: NDArray[np.bool_]
    on_surface: Array
    order: Indices
    answer: Indices


@lru_cache(maxsize=32)
def pack_paths(paths: tuple[Path, ...], surfaces: tuple[WrapSurface, ...]) -> Courses:
    points = [point for path in paths for point in path.points]
    wraps = [wrap for path in paths for wrap in path.wraps]
    wrapped = [surfaces[wrap.surface] for wrap in wraps]
    sides = [_side(surface) for surface in wrapped]
    course = Course(
        point_body=_indices([point.body for point in points]),
        point_location=_numbers([point.location for point in points], 3),
        point_slope=_numbers([point.slope for point in points], 3),
        point_coordinate=_indices([point.coordinate for point in points]),
        point_range=_numbers([point.range for point in points], 2),
        surface=_indices([wrap.surface for wrap in wraps]),
        kind=_indices([KINDS.index(surface.kind) for surface in wrapped]),
        method=_indices([METHODS.index(wrap.method) for wrap in wraps]),
        body=_indices([surface.body for surface in wrapped]),
        rotation=_numbers([surface.placement.rotation for surface in wrapped], 3, 3),
        translation=_numbers([surface.placement.translation for surface in wrapped], 3),
        dimensions=_numbers([surface.dimensions for surface in wrapped], 3),
        axis=_indices([axis for axis, _ in sides]),
        allowed=_indices([allowed for _, allowed in sides]),
    )
    return Courses(
        course,
        first_point=_indices([0, *accumulate(len(path.points) for path in paths)]),
        first_wrap=_indices([0, *accumulate(len(path.wraps) for path in paths)]),
    )


def room_for(courses: Courses) -> Lane:
    """A Lane as long as the longest of the paths needs."""
    nodes = int(max(np.diff(courses.first_point) + 2 * np.diff(courses.first_wrap), default=0))
    return Lane(
        sequence=np.zeros(nodes, dtype=np.int64),
        body=np.zeros(nodes, dtype=np.int64),
        surface=np.zeros(nodes, dtype=np.int64),
        location=np.zeros((nodes, 3)),
        ground=np.zeros((nodes, 3)),
        is_placed=np.zeros(nodes, dtype=np.bool_),
        on_surface=np.zeros(nodes),
        order=np.zeros(nodes, dtype=np.int64),
        answer=np.zeros(nodes, dtype=np.int64),
    )


def _side(surface: WrapSurface) -> tuple[int, int]:
    """The axis and the sign of a quadrant: "-y" is (1, −1), "x" or "+x" is (0, 1), "all" is (0, 0)."""
    if surface.quadrant == "all":
        return 0, 0
    return "xyz".index(surface.quadrant[-1]), -1 if surface.quadrant[0] == "-" else 1


def _indices(values: Sequence[int]) -> Indices:
    return np.array(values, dtype=np.int64)


def _numbers(rows: Sequence[ArrayLike], *shape: int) -> Array:
    return np.array(rows, dtype=np.float64).reshape(-1, *shape)

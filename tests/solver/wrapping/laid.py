"""Paths between points of the ground over surfaces of the ground: all that a surface's geometry needs."""

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from solver.model import GROUND, Array, Body, Model, Path, PathPoint, PathWrap, Placement, WrapSurface
from solver.multibody.postures import postures
from solver.muscle import PathMode, evaluate_paths

Method = Literal["hybrid", "midpoint", "axial"]
METHODS: tuple[Method, ...] = ("hybrid", "midpoint", "axial")

RANDOM = np.random.default_rng(20)


def sphere(radius: float, quadrant: str = "all", centre: ArrayLike = (0, 0, 0)) -> WrapSurface:
    return _surface("sphere", (radius, radius, radius), quadrant, centre)


def cylinder(radius: float, length: float, quadrant: str = "all", centre: ArrayLike = (0, 0, 0)) -> WrapSurface:
    return _surface("cylinder", (radius, radius, length), quadrant, centre)


def ellipsoid(radii: ArrayLike, quadrant: str = "all", centre: ArrayLike = (0, 0, 0)) -> WrapSurface:
    return _surface("ellipsoid", radii, quadrant, centre)


def torus(tube: float, ring: float, quadrant: str = "all") -> WrapSurface:
    return _surface("torus", (tube, ring, 0), quadrant, (0, 0, 0))


def at_angle(angle: float, distance: float, height: float) -> Array:
    """Of these cylindrical coordinates."""
    return np.array([distance * np.cos(angle), distance * np.sin(angle), height])


def unrolled(radius: float, start: Array, end: Array, opening: float) -> float:
    """Over a cylinder, in the plane: tangents and arc in line, the rise across them; `opening` is the angle between
    the ends' radii.
    """
    away = np.array([np.hypot(*start[:2]), np.hypot(*end[:2])])
    around = np.sqrt(away**2 - radius**2).sum() + radius * (opening - np.arccos(radius / away).sum())
    return float(np.hypot(around, end[2] - start[2]))


def lengths_over(
    surfaces: Sequence[WrapSurface], lines: ArrayLike, method: Method = "hybrid", mode: PathMode = "opensim"
) -> Array:
    """Length (lines,) of each line (lines, points, 3) laid over the surfaces, tried in their order."""
    wraps = tuple(PathWrap(k, method) for k in range(len(surfaces)))
    paths = [Path(tuple(point(GROUND, place) for place in line), wraps) for line in np.asarray(lines, dtype=float)]
    model = bare_model(tuple(surfaces))
    still = np.zeros((1, 0))
    lengths: Array = evaluate_paths(model, postures(model, still, still), paths, mode).lengths[0]
    return lengths


def straight_lengths(lines: ArrayLike) -> Array:
    pieces: Array = np.linalg.norm(np.diff(np.asarray(lines, dtype=float), axis=1), axis=-1)
    lengths: Array = pieces.sum(axis=1)
    return lengths


def lines_through(radius: float, reach: float, count: int) -> Array:
    """Random lines (count, 2, 3) with both ends between 1.1 and `reach` radii from the origin, most of them near it."""
    directions = RANDOM.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    start = directions * radius * RANDOM.uniform(1.1, reach, (count, 1))
    beside = RANDOM.normal(size=(count, 3)) * 0.3
    opposite = -directions + beside
    opposite /= np.linalg.norm(opposite, axis=1, keepdims=True)
    end = opposite * radius * RANDOM.uniform(1.1, reach, (count, 1))
    return np.stack([start, end], axis=1)


def point(body: int, location: ArrayLike) -> PathPoint:
    return PathPoint(body, np.asarray(location, dtype=float))


def bare_model(surfaces: tuple[WrapSurface, ...]) -> Model:
    ground = Body("ground", 0.0, np.zeros(3), np.zeros((3, 3)))
    return Model("bare", np.zeros(3), (ground,), (), (), surfaces, (), (), (), ())


def _surface(
    kind: Literal["ellipsoid", "sphere", "cylinder", "torus"], dimensions: ArrayLike, quadrant: str, centre: ArrayLike
) -> WrapSurface:
    placement = Placement(np.eye(3), np.asarray(centre, dtype=float))
    return WrapSurface(kind, GROUND, placement, kind, np.asarray(dimensions, dtype=float), quadrant)

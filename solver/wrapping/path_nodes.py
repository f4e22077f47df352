"""Nodes of wrapped paths in ground: path points and tangent points, in order; compiled, for drawing."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from solver.compiled import compiled_for_python
from solver.vectors import Array, write
from solver.wrapping.opensim_path import place_in_ground, wrap_path
from solver.wrapping.path_tables import CONVERGED, Indices, PathTables, Records
from solver.wrapping.workspace import WrapWorkspace


class PathNodes(NamedTuple):
    """Nodes of all paths: places (frames, paths, nodes, 3) [m] in ground, their surfaces (NO_SURFACE at a path point),
    and how many nodes each path has (frames, paths); the rest is unused.
    """

    places: Array
    surfaces: Indices
    counts: Indices


def allocate_nodes(frames: int, paths: int, work: WrapWorkspace) -> PathNodes:
    shape = (frames, paths, len(work.nodes))
    counts: NDArray[np.int64] = np.zeros((frames, paths), np.int64)
    return PathNodes(np.zeros((*shape, 3)), np.zeros(shape, np.int64), counts)


@compiled_for_python
def place_path_nodes(
    tables: PathTables, poses: Records, changes: Records, work: WrapWorkspace, results: PathNodes
) -> None:
    """Wrap every path in every frame: poses (frames, bodies) of BODY, changes (frames, points) of CHANGE."""
    for frame in range(len(poses)):
        for path in range(results.counts.shape[1]):
            points = tables.points[tables.first_point[path] : tables.first_point[path + 1]]
            wraps = tables.wraps[tables.first_wrap[path] : tables.first_wrap[path + 1]]
            work.code[0] = CONVERGED
            count, _ = wrap_path(points, wraps, poses[frame], changes[frame], work)
            results.counts[frame, path] = count
            for k in range(count):
                node = work.sequence[k]
                write(results.places[frame, path, k], place_in_ground(poses[frame], work.nodes, node))
                results.surfaces[frame, path, k] = work.nodes[node]["surface"]

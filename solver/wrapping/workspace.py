"""Working memory for wrapping paths, allocated once for all paths and frames."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from solver.vectors import Array
from solver.wrapping.fan import Fan, allocate_fan
from solver.wrapping.path_tables import NODE, Codes, Indices, PathTables, Records


class WrapWorkspace(NamedTuple):
    """Working memory of one path at a time.

    nodes     (NODE) its path points and tangent points
    sequence  of the nodes along the path
    seen      (wraps,) how often the path had changed when it was last wrapped over a surface
    fan       of an ellipsoid
    wrench    (bodies, 6) on each body, zero between paths
    code      (1,) the path's outcome
    """

    nodes: Records
    sequence: Indices
    seen: Indices
    fan: Fan
    wrench: Array
    code: Codes


def allocate_wrap(tables: PathTables) -> WrapWorkspace:
    wraps = np.diff(tables.first_wrap)
    longest = int((np.diff(tables.first_point) + 2 * wraps).max(initial=0))
    seen = np.zeros(int(wraps.max(initial=0)), np.int64)
    return WrapWorkspace(
        np.zeros(longest, NODE),
        np.zeros(longest, np.int64),
        seen,
        allocate_fan(),
        allocate_wrench(tables),
        np.zeros(1, np.int8),
    )


def allocate_wrench(tables: PathTables) -> Array:
    return np.zeros((int(tables.bodies.max(initial=-1)) + 1, 6))

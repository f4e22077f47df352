"""Working memory for shortest paths, allocated once for all paths and frames."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from solver.geodesics.contact import CONTACT
from solver.geodesics.planes import PLANES
from solver.geodesics.series import ORDER, ROWS
from solver.vectors import Array
from solver.wrapping.path_tables import NODE, Codes, Indices, PathTables, Records
from solver.wrapping.workspace import allocate_wrench


class GeodesicWorkspace(NamedTuple):
    """nodes of a path (NODE) and their sequence along it; stops, the nodes that are its path points; its contacts
    (CONTACT), one for each of its surfaces, and their order along a segment; the matrix of shortest_path.py; the series
    of series.py; the detours of planes.py; wrench (bodies, 6), zero between paths; code (1,), the outcome of the path.
    """

    nodes: Records
    sequence: Indices
    stops: Indices
    contacts: Records
    order: Indices
    matrix: Array
    series: Array
    detours: Array
    wrench: Array
    code: Codes


def allocate_geodesic(tables: PathTables) -> GeodesicWorkspace:
    points = int(np.diff(tables.first_point).max(initial=0))
    wraps = int(np.diff(tables.first_wrap).max(initial=0))
    nodes = points + 2 * wraps * points
    return GeodesicWorkspace(
        np.zeros(nodes, NODE),
        np.zeros(nodes, np.int64),
        np.zeros(points, np.int64),
        np.zeros(wraps, CONTACT),
        np.zeros(wraps, np.int64),
        np.zeros((4 * wraps, 4 * wraps + 1)),
        np.zeros((ROWS, ORDER + 1)),
        np.zeros(PLANES),
        allocate_wrench(tables),
        np.zeros(1, np.int8),
    )

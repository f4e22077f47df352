"""Working memory for wrapping paths, allocated once for all paths and frames."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from solver.wrapping.fan import Fan, allocate_fan
from solver.wrapping.path_tables import NODE, Codes, Indices, PathTables, Records


class WrapWorkspace(NamedTuple):
    """nodes of a path (NODE) and their sequence along it; working memory of the fan; code (1,), the path's outcome."""

    nodes: Records
    sequence: Indices
    fan: Fan
    code: Codes


def allocate_wrap(tables: PathTables) -> WrapWorkspace:
    longest = int((np.diff(tables.first_point) + 2 * np.diff(tables.first_wrap)).max(initial=0))
    return WrapWorkspace(np.zeros(longest, NODE), np.zeros(longest, np.int64), allocate_fan(), np.zeros(1, np.int8))

"""The memory that laying a path takes, allocated once for all paths and frames."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from solver.vectors import Array
from solver.wrapping.course import NODE, Courses, Indices, Records
from solver.wrapping.ellipsoid import fan_room


class Room(NamedTuple):
    """nodes of a path (NODE) and their sequence along it; the fan of ellipsoid.py."""

    nodes: Records
    sequence: Indices
    fan: Array


def room_for(courses: Courses) -> Room:
    longest = int((np.diff(courses.first_point) + 2 * np.diff(courses.first_wrap)).max(initial=0))
    return Room(np.zeros(longest, NODE), np.zeros(longest, np.int64), fan_room())

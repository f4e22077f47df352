"""The memory that solving a frame takes, allocated once for all frames: what two threads allocate, both wait for."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from solver.dense import Order

Array = NDArray[np.float64]


class FrameWorkspace(NamedTuple):
    """For n muscles and m rows.

    found (m,), cost (n,) and own (m, m) of frames.py
    loose, weighted (n,), old and change (m,) of newton.py
    a, inverse, pull, da, rest (n,), z, slack, dz, aim (2, n) and dv (m,) of interior_point.py
    matrix (m, m), its order (m,) and error (m,) of both
    """

    cost: Array
    own: Array
    found: Array
    loose: Array
    weighted: Array
    old: Array
    change: Array
    a: Array
    inverse: Array
    pull: Array
    da: Array
    rest: Array
    z: Array
    slack: Array
    dz: Array
    aim: Array
    dv: Array
    matrix: Array
    order: Order
    error: Array


def allocate_frame(n: int, m: int) -> FrameWorkspace:
    sizes: dict[str, tuple[int, ...]] = {
        "own": (m, m),
        "matrix": (m, m),
        "z": (2, n),
        "slack": (2, n),
        "dz": (2, n),
        "aim": (2, n),
    }
    sizes |= dict.fromkeys(("found", "old", "change", "dv", "error"), (m,))
    arrays = {name: np.zeros(sizes.get(name, (n,))) for name in FrameWorkspace._fields if name != "order"}
    return FrameWorkspace(order=np.zeros(m, np.int64), **arrays)

"""Working memory of the compiled solver, allocated once for all frames: threads wait for each other's allocations."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from solver.dense import Order

Array = NDArray[np.float64]


class RowSystem(NamedTuple):
    """The linear system of a step: matrix (m, m) and its pivot order (m,)."""

    matrix: Array
    order: Order


class NewtonWorkspace(NamedTuple):
    """free_inverse (n,), error, previous and change (m,) of newton.py."""

    system: RowSystem
    free_inverse: Array
    error: Array
    previous: Array
    change: Array


class Iterate(NamedTuple):
    """A point of the interior-point method: a (n,), multipliers z (2, n) and v (m,), slack (2, n) of the bounds."""

    a: Array
    z: Array
    v: Array
    slack: Array


class SearchDirection(NamedTuple):
    """Changes of a, z and v along a full step from an Iterate."""

    a: Array
    z: Array
    v: Array


class InteriorWorkspace(NamedTuple):
    """error (m,), inverse and gradient (n,), and aim (2, n) of interior_point.py."""

    system: RowSystem
    point: Iterate
    step: SearchDirection
    error: Array
    inverse: Array
    gradient: Array
    aim: Array


class FrameWorkspace(NamedTuple):
    """For n muscles and m rows: cost (n,), relaxed (m, m), rows (m, n) and target (m,) of frames.py, and what the two
    methods need.
    """

    cost: Array
    relaxed: Array
    rows: Array
    target: Array
    newton: NewtonWorkspace
    interior: InteriorWorkspace


def allocate_frame(n: int, m: int) -> FrameWorkspace:
    """Working memory for n muscles and m rows."""
    system = RowSystem(matrix=np.zeros((m, m)), order=np.zeros(m, np.int64))
    return FrameWorkspace(
        cost=np.zeros(n),
        relaxed=np.zeros((m, m)),
        rows=np.zeros((m, n)),
        target=np.zeros(m),
        newton=NewtonWorkspace(system, np.zeros(n), np.zeros(m), np.zeros(m), np.zeros(m)),
        interior=InteriorWorkspace(
            system=system,
            point=Iterate(np.zeros(n), np.zeros((2, n)), np.zeros(m), np.zeros((2, n))),
            step=SearchDirection(np.zeros(n), np.zeros((2, n)), np.zeros(m)),
            error=np.zeros(m),
            inverse=np.zeros(n),
            gradient=np.zeros(n),
            aim=np.zeros((2, n)),
        ),
    )

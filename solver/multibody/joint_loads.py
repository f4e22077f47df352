"""Generalised forces of loads on bodies; compiled.

A load's wrench on a body acts on every joint between that body and the ground, so wrenches are summed from the
outermost bodies inwards, and a coordinate's force is the power of its screw with the sum of the wrenches beyond it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from solver.compiled import compiled, compiled_for_python
from solver.multibody.tables import Records

Array = NDArray[np.float64]


@compiled_for_python
def add_joint_loads(joints: Records, screws: Array, body: int, wrenches: Array, forces: Array, beyond: Array) -> None:
    """Add to forces (frames, loads, coordinates) those of wrenches (frames, loads, bodies, 6), and fill beyond (frames,
    loads, 6) with the sum of the wrenches on `body` and the bodies beyond it; screws as in postures.Postures.
    """
    total = np.empty(wrenches.shape[2:])
    for frame in range(len(wrenches)):
        for load in range(wrenches.shape[1]):
            _sum_inwards(joints, screws[frame], wrenches[frame, load], forces[frame, load], total)
            for i in range(6):
                beyond[frame, load, i] = total[body, i]


@compiled
def _sum_inwards(joints: Records, screws: Array, wrenches: Array, forces: Array, total: Array) -> None:
    """Of one load; fills total (bodies, 6) with the sum of the wrenches on a body and all bodies beyond it."""
    for body in range(len(total)):
        for i in range(6):
            total[body, i] = wrenches[body, i]
    for k in range(len(joints) - 1, -1, -1):
        joint = joints[k]
        parent, child = total[joint["parent"]], total[joint["child"]]
        for j in range(joint["count"]):
            coordinate, power = joint["coordinates"][j], 0.0
            for i in range(6):
                power += screws[coordinate, i] * child[i]
            forces[coordinate] += power
        for i in range(6):
            parent[i] += child[i]

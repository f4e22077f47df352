"""What loads do, from the equations of motion of dynamics.py; compiled.

A load's wrench on a body acts on every joint between that body and the ground, so wrenches are summed from the
outermost bodies inwards: f = screw · sum of the wrenches beyond. Then u̇ = P f and R = wrench beyond the joint − R_a u̇.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from solver.compiled import compiled, compiled_for_python
from solver.moving.tables import Records
from solver.sharing.linear import dot
from solver.wrapping.vectors import cross, read

Array = NDArray[np.float64]


@compiled_for_python
def respond(
    joints: Records,
    reaction_body: int,
    screws: Array,
    mobility: Array,
    reaction_point: Array,
    per_acceleration: Array,
    wrenches: Array,
    forces: Array,
    acceleration: Array,
    reaction: Array,
) -> None:
    """Fill acceleration (frames, loads, coordinates) and reaction (frames, loads, 6) for wrenches on bodies (frames,
    loads, bodies, 6) and forces on coordinates (frames, loads, coordinates).
    """
    total, force = np.empty(wrenches.shape[2:]), np.empty(screws.shape[1])
    for frame in range(len(wrenches)):
        P, R = mobility[frame], per_acceleration[frame]
        for load in range(wrenches.shape[1]):
            _gather(joints, screws[frame], wrenches[frame, load], forces[frame, load], total, force)
            u, r = acceleration[frame, load], reaction[frame, load]
            for j in range(len(u)):
                u[j] = dot(P[j], force)
            beyond = total[reaction_body]
            moment = cross(read(reaction_point[frame]), read(beyond[3:]))
            for i in range(6):
                r[i] = beyond[i] - dot(R[i], u)
            for i in range(3):
                r[i] -= moment[i]


@compiled
def _gather(joints: Records, screws: Array, wrenches: Array, forces: Array, total: Array, force: Array) -> None:
    """Fill total (bodies, 6), each body's wrench with those of all beyond it, and force (coordinates,) with theirs."""
    for body in range(len(total)):
        for i in range(6):
            total[body, i] = wrenches[body, i]
    for j in range(len(force)):
        force[j] = forces[j]
    for k in range(len(joints) - 1, -1, -1):
        joint = joints[k]
        wrench = total[joint["child"]]
        for j in range(joint["count"]):
            coordinate = joint["coordinates"][j]
            force[coordinate] += dot(screws[coordinate], wrench)
        parent = total[joint["parent"]]
        for i in range(6):
            parent[i] += wrench[i]

"""Accelerations and joint reaction that loads cause; compiled.

A load's wrench on a body acts on every joint between that body and the ground, so wrenches are summed from the
outermost bodies inwards, and a coordinate's force is the power of its screw with the sum of the wrenches beyond it.
With these forces f, u̇ = P f and R = wrench − R_a u̇, as in dynamics.EquationsOfMotion.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from solver.compiled import compiled, compiled_for_python
from solver.dense import inner_product, matrix_times
from solver.multibody.tables import Indices, Records

Array = NDArray[np.float64]


class Mobility(NamedTuple):
    """What the response depends on besides the loads, all as in dynamics.EquationsOfMotion: screws (frames,
    coordinates, 6), mobility P, reaction_per_acceleration R_a, and the reaction's body and point (frames, 3).
    """

    joints: Records
    screws: Array
    mobility: Array
    per_acceleration: Array
    body: int
    point: Array


class Loads(NamedTuple):
    """Loads, whose responses are multiplied by factors (frames, loads), and added up with shares (frames, loads).

    wrenches  (frames, wrenches, 6), load and body (wrenches,), and the number of bodies, as in LoadWrenches
    forces    (frames, loads, coordinates), or no frames without such forces
    driven    (actuators,) coordinates on which further loads of this strength (actuators,) act
    """

    wrenches: Array
    load: Indices
    body: Indices
    bodies: int
    forces: Array
    factors: Array
    shares: Array
    driven: Indices
    strength: Array


class Responses(NamedTuple):
    """acceleration (frames, coordinates, loads and actuators), reaction (frames, 6, loads and actuators), and those of
    the sum of the loads, total_acceleration (frames, coordinates) and total_reaction (frames, 6).
    """

    acceleration: Array
    reaction: Array
    total_acceleration: Array
    total_reaction: Array


@compiled_for_python
def fill_responses(mobility: Mobility, loads: Loads, responses: Responses) -> None:
    """Fill the responses in all frames."""
    count, coordinates = loads.factors.shape[1], mobility.screws.shape[1]
    beyond, forces, total = np.empty((loads.bodies, 6, count)), np.empty((coordinates, count)), np.empty(coordinates)
    for frame in range(len(loads.wrenches)):
        _place(loads, frame, beyond)
        _sum_inwards(mobility.joints, mobility.screws[frame], beyond, forces)
        if len(loads.forces):
            for load in range(count):
                for i in range(coordinates):
                    forces[i, load] += loads.forces[frame, load, i]
        direct = beyond[mobility.body]
        _refer_to(mobility.point[frame], direct)
        _respond(mobility, loads, frame, forces, total, direct, responses)


@compiled
def _place(loads: Loads, frame: int, beyond: Array) -> None:
    """Fill (bodies, 6, loads) with the wrenches on each body."""
    beyond[:] = 0.0
    wrenches = loads.wrenches[frame]
    for k in range(len(wrenches)):
        body, load = loads.body[k], loads.load[k]
        for i in range(6):
            beyond[body, i, load] = wrenches[k, i]


@compiled
def _sum_inwards(joints: Records, screws: Array, beyond: Array, forces: Array) -> None:
    """Fill forces; beyond (bodies, 6, loads) becomes the sum of the wrenches on a body and all bodies beyond it."""
    forces[:] = 0.0
    for k in range(len(joints) - 1, -1, -1):
        joint = joints[k]
        parent, child = beyond[joint["parent"]], beyond[joint["child"]]
        for j in range(joint["count"]):
            coordinate = joint["coordinates"][j]
            _add_row_times(screws[coordinate], child, forces[coordinate])
        for i in range(6):
            for load in range(parent.shape[1]):
                parent[i, load] += child[i, load]


@compiled
def _add_row_times(screw: Array, wrenches: Array, forces: Array) -> None:
    a, b, c, d, e, f = screw[0], screw[1], screw[2], screw[3], screw[4], screw[5]
    for load in range(len(forces)):
        turning = a * wrenches[0, load] + b * wrenches[1, load] + c * wrenches[2, load]
        forces[load] += turning + (d * wrenches[3, load] + e * wrenches[4, load] + f * wrenches[5, load])


@compiled
def _refer_to(point: Array, wrenches: Array) -> None:
    """Moments about the point in place of those about the origin."""
    x, y, z = point[0], point[1], point[2]
    for load in range(wrenches.shape[1]):
        wrenches[0, load] -= y * wrenches[5, load] - z * wrenches[4, load]
        wrenches[1, load] -= z * wrenches[3, load] - x * wrenches[5, load]
        wrenches[2, load] -= x * wrenches[4, load] - y * wrenches[3, load]


@compiled
def _respond(
    mobility: Mobility, loads: Loads, frame: int, forces: Array, total: Array, direct: Array, responses: Responses
) -> None:
    P, R_a = mobility.mobility[frame], mobility.per_acceleration[frame]
    acceleration, reaction = responses.acceleration[frame], responses.reaction[frame]
    total_acceleration, factors, shares = responses.total_acceleration[frame], loads.factors[frame], loads.shares[frame]
    for i in range(len(P)):
        total[i] = inner_product(forces[i], shares)
        _multiply(forces[i], factors)
    for i in range(len(P)):
        total_acceleration[i] = inner_product(P[i], total)
    matrix_times(P, forces, acceleration)
    for i in range(len(P)):
        for k in range(len(loads.driven)):
            acceleration[i, len(factors) + k] = P[i, loads.driven[k]] * loads.strength[k]
    matrix_times(R_a, acceleration, reaction)
    for i in range(6):
        responses.total_reaction[frame, i] = inner_product(direct[i], shares) - inner_product(
            R_a[i], total_acceleration
        )
        row, own = reaction[i], direct[i]
        for j in range(len(row)):
            row[j] = -row[j]
        for j in range(len(factors)):
            row[j] += own[j] * factors[j]


@compiled
def _multiply(row: Array, factors: Array) -> None:
    for j in range(len(row)):
        row[j] *= factors[j]

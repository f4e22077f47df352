"""OpenSim's fan: the mean direction from points inside an ellipsoid to their closest points on it.

OpenSim 4.6 takes 298 such directions, its blades, along the segment that pierces the ellipsoid, and ends the search for
each closest point early. After k steps of that search the direction is a smooth function of the place on the segment.
It is therefore computed at 64 Chebyshev nodes, and the sum over the blades that end after k steps is a sum over the
nodes with weights (Trefethen, Approximation Theory and Approximation Practice, chapter 3). Where the last coefficients
of the Chebyshev series do not vanish, all blades are computed.
"""

from __future__ import annotations

from functools import lru_cache
from math import floor, log, sqrt
from typing import NamedTuple

import numpy as np

from solver.compiled import compiled
from solver.vectors import ORIGIN, Array, Vector, add, along, norm, read, subtract, unit
from solver.wrapping.closest import MOST_ITERATIONS, STOP, closest_to_each
from solver.wrapping.path_tables import Codes
from solver.wrapping.segment import ROUND_OFF

SPACINGS = 300
BLADES = SPACINGS - 2
NODES = 64
SMALLEST_TERM = 1e-12
"""Of a coefficient of the series, relative to the mean of the blades."""
SMALLEST = 1e-300
SHALLOW = 1e-4
"""Of f in the middle of the segment: below, round-off in OpenSim's blades is seen in its results."""
NEAR_STOP = 0.8 * STOP
UNCERTAIN = 0.02, 1e-3
"""Of ln f, in all and per 2ᵏ after k steps: how near to STOP a blade is computed by itself."""


class Fan(NamedTuple):
    """Chebyshev nodes on a segment from 0 to 1, and working memory for one segment.

    positions     (nodes,)
    weights       (blades + 1, nodes) row i gives the sum over the first i blades of a function known at the nodes
    last_terms    (nodes,) gives the sum of the last two coefficients of the Chebyshev series
    logits        (nodes,) ln(s / (1 − s)), to which ln f is nearly linear
    blade_logits  (blades + 1,) the same at multiples of 1/300
    at_nodes      (10, nodes) working memory
    at_blades     (7, blades) working memory
    """

    positions: Array
    weights: Array
    last_terms: Array
    logits: Array
    blade_logits: Array
    at_nodes: Array
    at_blades: Array


def allocate_fan() -> Fan:
    return Fan(*_node_tables(), np.empty((10, NODES)), np.empty((7, BLADES)))


@compiled
def fan_direction(r1: Vector, inner: Vector, a: Vector, fan: Fan, code: Codes) -> Vector:
    """Unit vector of the sum of the blades from r1 + i/300 · inner, i = 1 … 298, to the ellipsoid with semi-axes a."""
    is_smooth, total = _sum_by_nodes(r1, inner, a, fan)
    return unit(total if is_smooth else _sum_of_blades(r1, inner, a, fan, code))


@compiled
def _sum_by_nodes(r1: Vector, inner: Vector, a: Vector, fan: Fan) -> tuple[bool, Vector]:
    """Whether the series converges, and the sum of the unit vectors along the blades."""
    total = ORIGIN
    if _has_blade_in_plane(r1, inner):
        return False, total
    nodes = fan.at_nodes
    for i in range(NODES):
        s = fan.positions[i]
        nodes[0, i], nodes[1, i], nodes[2, i] = r1[0] + s * inner[0], r1[1] + s * inner[1], r1[2] + s * inner[2]
        nodes[3, i] = 0.0
    left, right = 0, 0  # blades that have ended, from either end of the segment
    for steps in range(MOST_ITERATIONS):
        if not _find_steps(a, fan) or (steps == 0 and nodes[4, NODES // 2] < SHALLOW):
            break
        next_left = _ended_blades(left, BLADES - right, steps, 1, r1, inner, a, fan)
        next_right = _ended_blades(right, BLADES - next_left, steps, -1, r1, inner, a, fan)
        if steps > 0 and next_left + next_right > left + right:
            low, high = fan.weights[next_left], fan.weights[BLADES - next_right]
            for i in range(NODES):
                nodes[6, i] = fan.weights[BLADES - right, i] - high[i] + low[i] - fan.weights[left, i]
            total = add(total, _sum_at_nodes(a, fan))
        left, right = next_left, next_right
        if left + right == BLADES:
            for i in range(NODES):
                nodes[6, i] = fan.last_terms[i]
            return BLADES * norm(_sum_at_nodes(a, fan)) < SMALLEST_TERM * norm(total), total
        for i in range(NODES):
            nodes[3, i] -= nodes[5, i]
    return False, total


@compiled
def _has_blade_in_plane(r1: Vector, inner: Vector) -> bool:
    """Whether a blade starts in a coordinate plane: OpenSim looks for its closest point in that plane."""
    for i in range(3):
        blade = floor(0.5 - SPACINGS * r1[i] / inner[i]) if inner[i] != 0.0 else 0.0
        if abs(r1[i] + blade / SPACINGS * inner[i]) <= ROUND_OFF:
            return True
    return False


@compiled
def _find_steps(a: Vector, fan: Fan) -> bool:
    """Row 4: the condition f at the multipliers in row 3; row 5: the Newton step. Whether f shows where blades end.

    It does not if f is clearly negative, or if it may exceed STOP between two nodes only.
    """
    nodes = fan.at_nodes
    negative, unfinished, near_stop = 0, 0, 0
    for i in range(NODES):
        nodes[4, i], nodes[5, i] = _newton_step(nodes[3, i], nodes[0, i], nodes[1, i], nodes[2, i], a)
        negative += 0 if nodes[4, i] > -STOP else 1
        unfinished += 1 if nodes[4, i] >= STOP else 0
        near_stop += 1 if nodes[4, i] >= NEAR_STOP else 0
    return negative == 0 and (unfinished > 0 or near_stop == 0)


@compiled
def _newton_step(t: float, x: float, y: float, z: float, a: Vector) -> tuple[float, float]:
    """The condition of closest.py and the Newton step, from fewer products."""
    aa, bb, cc = a[0] * a[0], a[1] * a[1], a[2] * a[2]
    P, Q, R = t + aa, t + bb, t + cc
    PQ, PR, QR = P * Q, P * R, Q * R
    PQR = PQ * R
    gx, gy, gz = aa * (x * x) * QR, bb * (y * y) * PR, cc * (z * z) * PQ
    f = PQR * PQR - gx * QR - gy * PR - gz * PQ
    half_slope = PQR * (QR + PR + PQ) - gx * (Q + R) - gy * (P + R) - gz * (P + Q)
    return f, 0.5 * f / half_slope


@compiled
def _ended_blades(ended: int, most: int, steps: int, sense: int, r1: Vector, inner: Vector, a: Vector, fan: Fan) -> int:
    """How many blades from one end of the segment (sense 1: r1; −1: the other one) end after these steps."""
    f, origin, skipped = fan.at_nodes[4], 0 if sense > 0 else NODES - 1, 0 if sense > 0 else 1
    node = 0
    while node < NODES and f[origin + sense * node] < STOP:
        node += 1
    if node == 0:
        return ended
    if node == NODES:
        return most
    lowest, next_lowest = log(max(f[origin + sense * (node - 1)], SMALLEST)), log(f[origin + sense * node])
    spacing = fan.logits[node] - fan.logits[node - 1]
    bound = fan.logits[node - 1] + (log(STOP) - lowest) / (next_lowest - lowest) * spacing
    count = max(ended, int(SPACINGS * fan.positions[node - 1]) - skipped)
    while count < most and fan.blade_logits[count + skipped] < bound:
        count += 1
    margin = (UNCERTAIN[0] + UNCERTAIN[1] * (1 << steps)) * spacing / (next_lowest - lowest)
    while (
        count < most and fan.blade_logits[count + skipped] - bound < margin and _ends(count, steps, sense, r1, inner, a)
    ):
        count += 1
    while count > ended and bound - fan.blade_logits[count - 1 + skipped] < margin:
        if _ends(count - 1, steps, sense, r1, inner, a):
            break
        count -= 1
    return count


@compiled
def _ends(blade: int, steps: int, sense: int, r1: Vector, inner: Vector, a: Vector) -> bool:
    """Whether a blade, counted from one end, ends after these steps."""
    s = (blade + 1) / SPACINGS if sense > 0 else (BLADES - blade) / SPACINGS
    x, y, z = along(r1, s, inner)
    t, f, step = 0.0, 0.0, 0.0
    for _ in range(steps + 1):
        t -= step
        f, step = _newton_step(t, x, y, z, a)
    return f < STOP


@compiled
def _sum_at_nodes(a: Vector, fan: Fan) -> Vector:
    """The weighted sum of the directions of blades from the nodes, with the weights in row 6.

    Inside the ellipsoid the blade from x to a² x / (t + a²) has the direction of x / (t + a²).
    """
    nodes = fan.at_nodes
    aa, bb, cc = a[0] * a[0], a[1] * a[1], a[2] * a[2]
    for i in range(NODES):
        x, y, z, t = nodes[0, i], nodes[1, i], nodes[2, i], nodes[3, i]
        P, Q, R = t + aa, t + bb, t + cc
        x, y, z = x * (Q * R), y * (P * R), z * (P * Q)
        weight = nodes[6, i] / sqrt(x * x + y * y + z * z)
        nodes[7, i], nodes[8, i], nodes[9, i] = weight * x, weight * y, weight * z
    rest = NODES
    while rest > 8:  # by halves, so that the compiler can add several at once
        rest //= 2
        for i in range(rest):
            nodes[7, i] += nodes[7, i + rest]
            nodes[8, i] += nodes[8, i + rest]
            nodes[9, i] += nodes[9, i + rest]
    total = ORIGIN
    for i in range(rest):
        total = add(total, (nodes[7, i], nodes[8, i], nodes[9, i]))
    return total


@compiled
def _sum_of_blades(r1: Vector, inner: Vector, a: Vector, fan: Fan, code: Codes) -> Vector:
    starts, ends = fan.at_blades[:3], fan.at_blades[3:6]
    for axis in range(3):
        for i in range(BLADES):
            starts[axis, i] = r1[axis] + (i + 1) / SPACINGS * inner[axis]
    closest_to_each(a, starts, fan.at_blades[6], ends, code)
    total = ORIGIN
    for i in range(BLADES):
        total = add(total, unit(subtract(read(ends[:, i]), read(starts[:, i]))))
    return total


@lru_cache(maxsize=1)
def _node_tables() -> tuple[Array, Array, Array, Array, Array]:
    """The constant fields of Fan."""
    angles = (np.arange(NODES) + 0.5) * np.pi / NODES
    degrees = np.arange(NODES)
    terms = np.cos(np.outer(degrees, np.pi - angles)) * np.where(degrees == 0, 1.0, 2.0)[:, None] / NODES
    positions, blades = 0.5 - 0.5 * np.cos(angles), np.arange(1, BLADES + 1) / SPACINGS
    at_blades = np.cos(np.outer(np.arccos(2.0 * blades - 1.0), degrees)) @ terms
    weights = np.vstack([np.zeros(NODES), at_blades.cumsum(axis=0)])
    logits, multiples = np.log(positions / (1 - positions)), np.arange(1, SPACINGS) / SPACINGS
    return positions, weights, terms[-2:].sum(axis=0), logits, np.log(multiples / (1 - multiples))

"""OpenSim's fan: the mean direction from points inside an ellipsoid to their closest points on it.

OpenSim 4.6 takes 298 such directions, its blades, along the segment that pierces the ellipsoid, and ends the search for
each closest point early. After k steps of that search the direction is a smooth function of the place on the segment.
It is therefore computed at 64 Chebyshev nodes, and the sum over the blades that end after k steps is a sum over the
nodes with weights (Trefethen, Approximation Theory and Approximation Practice, chapter 3). Where the last coefficients
of the Chebyshev series do not vanish, all blades are computed.

The closest point of an ellipsoid or an ellipse is found as by Eberly (Graphics Gems IV, p. 113). Newton's method stops
where OpenSim 4.6 stops, before round-off, because the wrapping plane depends on the iterate.
"""

from __future__ import annotations

from functools import lru_cache
from math import floor, log, sqrt
from typing import NamedTuple

import numpy as np

from solver.compiled import compiled
from solver.vectors import ORIGIN, Array, Vector, add, along, norm, read, subtract, unit, write
from solver.wrapping.path_tables import NOT_CONVERGED, Codes
from solver.wrapping.segment import ROUND_OFF

SPACINGS = 300
BLADES = SPACINGS - 2
NODES = 64
SMALLEST_TERM = 1e-12
"""Of a coefficient of the series, relative to the mean of the blades."""
SMALLEST = 1e-300
SHALLOW = 1e-4
"""Of f in the middle of the segment: below, round-off in OpenSim's blades is seen in its results."""
STOP = 1e-9
NEAR_STOP = 0.8 * STOP
UNCERTAIN = 0.02, 1e-3
"""Of ln f, in all and per 2ᵏ after k steps: how near to STOP a blade is computed by itself."""
MOST_ITERATIONS = 64
ANY_AXIS = -1


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
    """The stopping condition and the Newton step, from fewer products."""
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


@compiled
def closest_on_ellipsoid(a: Vector, point: Vector, flat_axis: int, code: Codes) -> Vector:
    """The point of the ellipsoid with semi-axes a closest to `point`; all of order 1.

    flat_axis  stay in the plane where this coordinate keeps its value (0 in practice); ANY_AXIS: in no plane
    code       (1,) set to NOT_CONVERGED where Newton's method does not end
    """
    axis = _flat_axis(a, point) if flat_axis == ANY_AXIS else flat_axis
    if axis == 0:
        y, z = closest_on_ellipse(a[1], a[2], point[1], point[2], code)
        return point[0], y, z
    if axis == 1:
        z, x = closest_on_ellipse(a[2], a[0], point[2], point[0], code)
        return x, point[1], z
    if axis == 2:
        x, y = closest_on_ellipse(a[0], a[1], point[0], point[1], code)
        return x, y, point[2]
    return _closest_in_space(a, point, code)


@compiled
def closest_to_each(a: Vector, points: Array, t: Array, feet: Array, code: Codes) -> None:
    """closest_on_ellipsoid for points (3, n), bit for bit, several times as fast. Fills feet (3, n), with t (n,)."""
    aa, bb, cc = a[0] * a[0], a[1] * a[1], a[2] * a[2]
    _find_multipliers(a, points, t, code)
    for i in range(t.size):
        feet[0, i] = aa * points[0, i] / (t[i] + aa)
        feet[1, i] = bb * points[1, i] / (t[i] + bb)
        feet[2, i] = cc * points[2, i] / (t[i] + cc)
    for i in range(t.size):
        if min(abs(points[0, i]), abs(points[1, i]), abs(points[2, i])) <= ROUND_OFF:
            write(feet[:, i], closest_on_ellipsoid(a, read(points[:, i]), ANY_AXIS, code))


@compiled
def closest_on_ellipse(a: float, b: float, u: float, v: float, code: Codes) -> tuple[float, float]:
    """The point of the ellipse with semi-axes a, b closest to (u, v)."""
    near_minor, near_major = abs(u) <= ROUND_OFF, abs(v) <= ROUND_OFF
    if near_minor and near_major:
        return ((-a if u < 0.0 else a), 0.0) if a < b else (0.0, (-b if v < 0.0 else b))
    if near_minor:
        return _closest_from_an_axis(a, b, v)
    if near_major:
        y, x = _closest_from_an_axis(b, a, u)
        return x, y
    aa, bb = a * a, b * b
    aauu, bbvv = aa * (u * u), bb * (v * v)
    is_inside = (u / a) * (u / a) + (v / b) * (v / b) < 1.0
    t = 0.0 if is_inside else max(a, b) * sqrt(u * u + v * v)
    P, Q = t + aa, t + bb
    for _ in range(MOST_ITERATIONS):
        P, Q = t + aa, t + bb
        PP, QQ = P * P, Q * Q
        f = PP * QQ - aauu * QQ - bbvv * PP
        if abs(f) < STOP:
            break
        t -= f / (2.0 * (P * Q * (P + Q) - aauu * Q - bbvv * P))
    else:
        code[0] = NOT_CONVERGED
    return aa * u / P, bb * v / Q


@compiled
def _closest_from_an_axis(across: float, along: float, v: float) -> tuple[float, float]:
    """From (0, v) on an axis of the ellipse: (coordinate across that axis, coordinate along it)."""
    if across >= along or abs(v) >= along - across * across / along:
        return 0.0, (along if v >= 0.0 else -along)
    y = along * along * v / (along * along - across * across)
    return across * sqrt(abs(1.0 - (y / along) * (y / along))), y


@compiled
def _flat_axis(a: Vector, point: Vector) -> int:
    """The axis along which the point is zero, else ANY_AXIS; of several, the one whose ellipse is the narrowest."""
    axis, narrowest = ANY_AXIS, 0.0
    for i in range(3):
        radii = a[(i + 1) % 3] + a[(i + 2) % 3]
        if abs(point[i]) <= ROUND_OFF and (axis == ANY_AXIS or radii < narrowest):
            axis, narrowest = i, radii
    return axis


@compiled
def _closest_in_space(a: Vector, point: Vector, code: Codes) -> Vector:
    u, v, w = point
    aa, bb, cc = a[0] * a[0], a[1] * a[1], a[2] * a[2]
    t = _first_multiplier(a, u, v, w)
    for _ in range(MOST_ITERATIONS):
        f, slope = _condition(t, aa, bb, cc, aa * (u * u), bb * (v * v), cc * (w * w))
        if abs(f) < STOP:
            break
        t -= f / slope
    else:
        code[0] = NOT_CONVERGED
    return aa * u / (t + aa), bb * v / (t + bb), cc * w / (t + cc)


@compiled
def _find_multipliers(a: Vector, points: Array, t: Array, code: Codes) -> None:
    """For points x (3, n) away from the coordinate planes, the t (n,) for which a² x / (t + a²) is closest.

    Newton steps are taken for all points at once, so that the compiler can vectorise them.
    """
    aa, bb, cc = a[0] * a[0], a[1] * a[1], a[2] * a[2]
    for i in range(t.size):
        t[i] = _first_multiplier(a, points[0, i], points[1, i], points[2, i])
    for _ in range(MOST_ITERATIONS):
        unfinished = 0
        for i in range(t.size):
            u, v, w = points[0, i], points[1, i], points[2, i]
            f, slope = _condition(t[i], aa, bb, cc, aa * (u * u), bb * (v * v), cc * (w * w))
            is_close = abs(f) < STOP
            unfinished += 0 if is_close else 1
            t[i] -= 0.0 if is_close else f / slope
        if unfinished == 0:
            break
    else:
        code[0] = NOT_CONVERGED


@compiled
def _first_multiplier(a: Vector, u: float, v: float, w: float) -> float:
    is_inside = (u / a[0]) * (u / a[0]) + (v / a[1]) * (v / a[1]) + (w / a[2]) * (w / a[2]) < 1.0
    return 0.0 if is_inside else max(a[0], a[1], a[2]) * sqrt(u * u + v * v + w * w)


@compiled
def _condition(t: float, aa: float, bb: float, cc: float, aauu: float, bbvv: float, ccww: float) -> tuple[float, float]:
    """Zero where a² x / (t + a²) is on the ellipsoid, and its derivative; the terms in OpenSim's order."""
    P, Q, R = t + aa, t + bb, t + cc
    PP, QQ, RR = P * P, Q * Q, R * R
    PQ, PR, QR = P * Q, P * R, Q * R
    f = PP * QQ * RR - aauu * QQ * RR - bbvv * PP * RR - ccww * PP * QQ
    slope = PQ * R * (QR + PR + PQ) - aauu * QR * (Q + R) - bbvv * PR * (P + R) - ccww * PQ * (P + Q)
    return f, 2.0 * slope

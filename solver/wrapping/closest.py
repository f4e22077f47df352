"""The point of an ellipsoid or an ellipse closest to a given one (Eberly, in Graphics Gems IV, p. 113).

Newton's method stops where OpenSim 4.6 stops, before round-off, because the wrapping plane depends on the iterate.
"""

from __future__ import annotations

from math import sqrt

from solver.compiled import compiled
from solver.vectors import Array, Vector, read, write
from solver.wrapping.path_tables import NOT_CONVERGED, Codes
from solver.wrapping.segment import ROUND_OFF

STOP = 1e-9
MOST_ITERATIONS = 64
ANY_AXIS = -1


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

"""Functions of one coordinate, as solver/functions/coordinate.py defines them; compiled."""

from __future__ import annotations

from math import cos, inf, sin

from solver.compiled import compiled
from solver.multibody.tables import Functions


@compiled
def derivatives(functions: Functions, k: int, x: float) -> tuple[float, float, float]:
    """Value, slope and curvature of function k, as functions.Function."""
    function = functions.functions[k]
    piece = function["first_piece"]
    while x >= functions.ends[piece] and functions.ends[piece] < inf:
        piece += 1
    local, powers = x - functions.origins[piece], functions.coefficients[piece]
    value, slope, curvature = 0.0, 0.0, 0.0
    for degree in range(len(powers) - 1, -1, -1):
        curvature = curvature * local + 2.0 * slope
        slope = slope * local + value
        value = value * local + powers[degree]
    amplitude, omega = function["amplitude"], function["omega"]
    if amplitude != 0.0:
        swing = amplitude * sin(omega * x + function["phase"])
        value, curvature = swing + value, curvature - omega * omega * swing
        slope += amplitude * omega * cos(omega * x + function["phase"])
    return value, slope, curvature

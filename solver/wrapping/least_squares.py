"""Minimise the square of a function of one unknown as OpenSim's Lmdif does; compiled.

Moré, "The Levenberg–Marquardt algorithm", Lecture Notes in Mathematics 630 (1978), MINPACK's LMDIF. OpenSim stops it
early, so that its result depends on every step; the rules and their constants are kept.
"""

from __future__ import annotations

from math import sqrt

from solver.compiled import compiled

TOLERANCE = 1e-4  # of the sum of squares, and of the unknown
FIRST_STEP = 0.2  # greatest first step, in the scaled unknown
DIFFERENCE = 1e-5  # for the slope
MOST_EVALUATIONS = 500
ACCEPTED, POOR, GOOD = 1e-4, 0.25, 0.75  # ratios of the actual to the predicted reduction
MOST_PARAMETERS = 10  # tried for one step


@compiled
def limited_step(slope: float, value: float, scale: float, bound: float, parameter: float) -> tuple[float, float]:
    """Step p of the linearised problem with |scale · p| about `bound` at most, and its damping parameter (LMPAR)."""
    step = value / slope if slope != 0.0 else 0.0
    size = abs(scale * step)
    excess = size - bound
    if excess <= 0.1 * bound:
        return -step, 0.0
    lowest = 0.0
    if slope != 0.0:
        change = abs(scale * (scale * step / size) / slope)
        lowest = excess / bound / change / change
    gradient = abs(slope * value / scale)
    highest = gradient / bound
    parameter = min(max(parameter, lowest), highest)
    if parameter == 0.0:
        parameter = gradient / size
    for attempt in range(MOST_PARAMETERS):
        if parameter == 0.0:
            parameter = 0.001 * highest
        damping = sqrt(parameter) * scale
        stiffness = sqrt(slope * slope + damping * damping)
        step = slope * value / (stiffness * stiffness)
        size = abs(scale * step)
        before, excess = excess, size - bound
        if abs(excess) <= 0.1 * bound or (lowest == 0.0 and excess <= before < 0.0) or attempt == MOST_PARAMETERS - 1:
            break
        change = abs(scale * (scale * step / size) / stiffness)
        correction = excess / bound / change / change
        if excess > 0.0:
            lowest = max(lowest, parameter)
        else:
            highest = min(highest, parameter)
        parameter = max(lowest, parameter + correction)
    return -step, parameter

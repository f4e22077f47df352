"""Speeds and accelerations of a motion by splines, with the low-pass filter of OpenSim's tools.

InverseDynamicsTool and AnalyzeTool extend the motion at both ends by odd reflection over half its length, filter it
forwards and backwards, and fit a natural spline of degree 5 through the samples of every coordinate. The speeds are the
slopes of these splines. The accelerations are their curvatures in inverse dynamics; static optimisation takes the
slopes of further splines through the speeds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
import scipy

from solver.constraint import CoordinateCoupler, CoordinateLock, CoordinatePrescription
from solver.errors import MotionError, SolverCode
from solver.functions.coordinate_functions import natural_interpolation
from solver.model import Array, Model
from solver.motion import Kinematics, Motion, ensure_cutoff, ensure_steps, frames_between

Accelerations = Literal["curvatures", "slopes_of_speeds"]
HALF_ORDER = 3
LEAST_FRAMES = 2 * HALF_ORDER
FILTER_ORDER = 3


def differentiate_by_splines(
    motion: Motion,
    cutoff: float | None = None,
    start: float | None = None,
    end: float | None = None,
    accelerations: Accelerations = "curvatures",
) -> Kinematics:
    """Filter a motion at `cutoff` [Hz], take speeds and accelerations from splines, keep the frames from start to end.

    Raises MotionError for a motion of fewer than LEAST_FRAMES frames, a cutoff above half the frame rate, or no frame.
    """
    frames = len(motion.time)
    if frames < LEAST_FRAMES:
        sentence = f"splines need at least {LEAST_FRAMES} frames and the motion has {frames}; give a longer motion"
        raise MotionError(sentence, SolverCode.NO_FRAMES)
    ensure_steps(motion, cutoff)
    interval = float(motion.time[-1] - motion.time[0]) / (frames - 1)
    at, time, positions = motion.time, motion.time, motion.coordinates
    if cutoff is not None:  # it takes samples as even; so times that were rounded must not make its result uneven
        at = np.linspace(motion.time[0], motion.time[-1], frames)
        time, positions = _padded(at, positions, frames // 2)
        positions = _low_pass(positions, cutoff, interval)
    spline = natural_interpolation(time, positions, HALF_ORDER)
    speeds, curvatures = spline(at, nu=1), spline(at, nu=2)
    if accelerations == "slopes_of_speeds":
        curvatures = natural_interpolation(time, spline(time, nu=1), HALF_ORDER)(at, nu=1)
    kept = frames_between(motion.time, start, end)
    return Kinematics(
        time=motion.time[kept],
        interval=interval,
        positions=spline(at)[kept],
        speeds=speeds[kept],
        accelerations=curvatures[kept],
        cutoff=cutoff,
        derivatives="splines",
        steps=motion.steps,
        missing=motion.missing,
        largest_degrees=motion.largest_degrees,
        row_counts=motion.row_counts,
        repeated_rows=motion.repeated_rows,
        unused=motion.unused,
    )


def held_by_constraints(model: Model, kinematics: Kinematics, names: Sequence[str] | None = None) -> Kinematics:
    """With locked and prescribed coordinates at their values, and coupled ones at those that their leaders determine.

    names are the coordinates that may change; by default all. The leaders of a coupled coordinate keep their motion.
    """
    moved = tuple(part.copy() for part in (kinematics.positions, kinematics.speeds, kinematics.accelerations))
    for constraint in model.constraints:
        if not isinstance(constraint, CoordinateLock | CoordinatePrescription | CoordinateCoupler):
            continue
        held = constraint.dependent if isinstance(constraint, CoordinateCoupler) else constraint.coordinate
        if names is None or model.coordinate_names[held] in names:
            for part, values in zip(moved, _required(constraint, kinematics.time, moved), strict=True):
                part[:, held] = values
    return replace(kinematics, positions=moved[0], speeds=moved[1], accelerations=moved[2])


def _required(
    constraint: CoordinateLock | CoordinatePrescription | CoordinateCoupler, time: Array, motion: tuple[Array, ...]
) -> Sequence[Array | float]:
    """Value, speed and acceleration of the coordinate that it determines; motion as those of all."""
    if isinstance(constraint, CoordinatePrescription):
        return constraint.function.derivatives(time)
    if isinstance(constraint, CoordinateLock):
        return constraint.value, 0.0, 0.0
    total = np.zeros((3, len(time)))
    for leader, function in zip(constraint.independents, constraint.functions, strict=True):
        position, speed, acceleration = (part[:, leader] for part in motion)
        value, slope, curvature = function.derivatives(position)
        total += value, slope * speed, slope * acceleration + curvature * speed**2
    return tuple(total)


def _padded(time: Array, coordinates: Array, count: int) -> tuple[Array, Array]:
    """Both extended by `count` frames at both ends by odd reflection."""
    extended = [
        np.concatenate([2 * part[:1] - part[count:0:-1], part, 2 * part[-1:] - part[-2 : -count - 2 : -1]])
        for part in (time, coordinates)
    ]
    return extended[0], extended[1]


def _low_pass(positions: Array, cutoff: float, interval: float) -> Array:
    """Butterworth of order 3, forwards and backwards; each pass leaves its first three samples as they are."""
    ensure_cutoff(cutoff, 1 / interval)
    b, a = scipy.signal.butter(FILTER_ORDER, 2 * cutoff * interval)
    for _ in range(2):
        before, rest = positions[:FILTER_ORDER], positions[FILTER_ORDER:]
        states = [scipy.signal.lfiltic(b, a, first[::-1], first[::-1]) for first in before.T]
        filtered, _ = scipy.signal.lfilter(b, a, rest, axis=0, zi=np.column_stack(states))
        positions = np.concatenate([before, filtered])[::-1]
    return positions

"""The held loads of a static trial against the weights that were to be hung on: mistakes of a setting show at once."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fitting.calibration import STANDARD_GRAVITY, blame
from fitting.plateaus import MIN_STEP, Plateau

MAX_SCALE_ERROR = 0.04
"""Relative: so much may weights and their hook be off."""
MAX_FRICTION = 0.03
"""Part of the load that a pulley may hold back, and give back, without being said to rub."""
MAX_STEP_ERROR = 0.25
"""Of a weight: how far one load may be off where the others are right."""
SIGNIFICANCE = 3.0


def check_steps(plateaus: Sequence[Plateau], masses: Sequence[float]) -> tuple[str, ...]:
    """Notes on loads that are not those of the weights [kg], which are hung on in this order and taken off again."""
    if len(plateaus) < 2 or not masses:
        return ()
    force = np.array([plateau.force for plateau in plateaus]) - plateaus[0].force
    sd = np.array([math.hypot(plateau.force_sd, plateaus[0].force_sd) for plateau in plateaus])
    levels = STANDARD_GRAVITY * np.concatenate(([0.0], np.cumsum(masses)))
    if force.max() < MIN_STEP:
        return (f"no load of protocol.step_masses_kg was hung on, the first being {levels[1]:.1f} N",)
    ratio = _first_guess(force, levels)
    for _ in range(3):
        on = np.argmin(np.abs(force[:, None] - ratio * levels), axis=1)
        ratio = float(force @ levels[on] / (levels[on] @ levels[on]))
    error = float(np.median(sd)) / float(levels[on].max())
    notes = _scale_note(ratio, error, levels, masses)
    notes += _friction_note(force, on, ratio * levels, error)
    if not notes:
        notes += _step_notes(plateaus, force, on, levels)
    if on.max() < len(masses):
        notes += (f"{on.max()} of {len(masses)} weights of protocol.step_masses_kg were hung on",)
    return notes


def _first_guess(force: NDArray[np.float64], levels: NDArray[np.float64]) -> float:
    """Newtons read for one hung on: the middle step up over the middle weight."""
    steps = np.diff(force)
    rises = steps[steps > 0.3 * steps.max()]  # all weights may come off at once
    return float(np.median(rises) / np.median(np.diff(levels))) if len(rises) else 1.0


def _scale_note(ratio: float, error: float, levels: NDArray[np.float64], masses: Sequence[float]) -> tuple[str, ...]:
    if abs(ratio - 1) <= max(MAX_SCALE_ERROR, SIGNIFICANCE * error):
        return ()
    return (
        f"the load rises by {ratio * levels[1]:.1f} N where {masses[0]:g} kg ({levels[1]:.1f} N) are hung on, "
        f"{blame(ratio)}; correct the configuration or protocol.step_masses_kg",
    )


def _friction_note(
    force: NDArray[np.float64], on: NDArray[np.intp], loads: NDArray[np.float64], error: float
) -> tuple[str, ...]:
    """A pulley holds back a part μ of the load that comes on and as much of the load that goes off."""
    top = int(np.argmax(on))
    pairs = [(k, np.flatnonzero(on[:top] == k), top + np.flatnonzero(on[top:] == k)) for k in range(1, int(on[top]))]
    split = [(loads[k], force[down].mean() - force[up].mean()) for k, up, down in pairs if len(up) and len(down)]
    if not split:
        return ()
    load, difference = np.array(split).T
    friction = float(load @ difference / (load @ load)) / 2
    least = float(np.min(np.abs(difference / load))) / 2  # one load that is off is no friction
    if least <= max(MAX_FRICTION, SIGNIFICANCE * error) or np.ptp(np.sign(difference)) > 0:
        return ()
    return (
        f"the same weights read {200 * friction:+.0f} % more when they come off than when they go on: the pulley holds "
        f"{100 * abs(friction):.0f} % of the load; oil it (the cell reads what the cuff feels, so the fit goes on)",
    )


def _step_notes(
    plateaus: Sequence[Plateau], force: NDArray[np.float64], on: NDArray[np.intp], levels: NDArray[np.float64]
) -> tuple[str, ...]:
    """Single loads that are off."""
    weight = float(np.median(np.diff(levels)))
    return tuple(
        f"the load held from {plateau.start:.1f} s on is {read:.1f} N above the hook, expected {levels[k]:.1f} N "
        f"({k} weights); correct the weights or the step's time in protocol.toml"
        for plateau, read, k in zip(plateaus, force, on, strict=True)
        if abs(read - levels[k]) > MAX_STEP_ERROR * weight
    )

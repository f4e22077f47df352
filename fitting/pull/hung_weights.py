"""Compare the held loads of a static trial with the weights of the protocol; this detects wrong settings.

    force above the bare hook = r (1 − μ d) w + b t      w: weights on the hook; d = 1 after adding, −1 after removing

r is the gain of the cell, μ the friction of a pulley as part of the load, b the drift of the zero.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fitting.pull.plateaus import Plateau
from fitting.results.codes import TrialNoteCode
from fitting.results.rendering import Figures, Note
from fitting.trial.calibration import find_mistake
from fitting.uncertainty import Estimate, normal_estimate
from recordings.standard_gravity import g

MAX_SCALE_ERROR = 0.03
"""Relative error of weights and hook that is tolerated."""
MAX_FRICTION = 0.03
"""Friction of a pulley, as part of the load, from which it is reported."""
MAX_STEP_ERROR = 0.25
"""Tolerated error of a single load if the others are right, as part of a weight."""
SIGNIFICANCE = 3.0
LEAST_SCALE = 0.03
"""Smallest gain of the cell; below it, no weight was added."""
BACK = 0.3
"""Part of a weight: the hook is bare again if its load is as near as this to the first load."""
SKIPPED = 0.15
"""Part of a weight, rms, by which the loads must fit better if two weights are assumed to change at once."""


@dataclass(frozen=True)
class LoadScale:
    """Scale of the load cell from the weights of the protocol.

    gain      newtons read per newton of weight
    friction  of the pulley, part of the load; None if unknown
    on        (plateaus,) number of weights on the hook
    expected  (plateaus,) N above the bare hook, with gain, friction and drift
    """

    gain: Estimate
    friction: Estimate | None
    on: NDArray[np.intp]
    expected: NDArray[np.float64]

    @property
    def is_off(self) -> bool:
        """Whether the gain differs from 1 by more than the errors of the weights explain."""
        return abs(self.gain.value - 1) > max(MAX_SCALE_ERROR, SIGNIFICANCE * self.gain.standard_error)

    @property
    def has_friction(self) -> bool:
        """Whether the friction of the pulley exceeds that of a good one."""
        mu = self.friction
        return mu is not None and abs(mu.value) > max(MAX_FRICTION, SIGNIFICANCE * mu.standard_error)


def load_scale(plateaus: Sequence[Plateau], masses: Sequence[float]) -> LoadScale | None:
    """Scale for weights [kg] that are added in this order and removed again; None if no weight was added."""
    if len(plateaus) < 2 or not masses:
        return None
    force = np.array([plateau.force for plateau in plateaus]) - plateaus[0].force
    levels = g * np.concatenate(([0.0], np.cumsum(masses)))
    if force.max() < max(LEAST_SCALE * levels[1], SIGNIFICANCE * _noise(plateaus)):
        return None
    scales = [_fitted(plateaus, force, levels, on) for on in _orders(force, levels)]
    return min(scales, key=lambda scale: _disorder(scale, force, levels))


def last_step(plateaus: Sequence[Plateau], masses: Sequence[float]) -> tuple[int, int] | None:
    """Weights that were added, and those of them that were removed again; None if the loads do not show it."""
    if len(plateaus) < 2:
        return 0, 0
    scale = load_scale(plateaus, masses)
    return (int(scale.on.max()), int(scale.on.max() - scale.on[-1])) if scale is not None else None


def check_steps(plateaus: Sequence[Plateau], masses: Sequence[float]) -> tuple[Note, ...]:
    """Notes on loads that differ from those of the weights [kg], which are added in this order and removed again."""
    if len(plateaus) < 2 or not masses:
        return ()
    weight = g * masses[0]
    fall = plateaus[0].force - min(plateau.force for plateau in plateaus)
    rise = max(plateau.force for plateau in plateaus) - plateaus[0].force
    if fall > max(2 * rise, LEAST_SCALE * weight, SIGNIFICANCE * _noise(plateaus)):
        figures = {"fall_n": fall, "mass_kg": masses[0], "weight_n": weight}
        return (Note(TrialNoteCode.LOAD_FALLS, figures),)
    scale = load_scale(plateaus, masses)
    if scale is None:
        return (Note(TrialNoteCode.NO_WEIGHT, {"weight_n": weight}),)
    notes = tuple(_setting_notes(scale, masses))
    notes += tuple(_step_notes(plateaus, scale, masses)) if not notes else ()
    if scale.on.max() < len(masses):
        notes += (Note(TrialNoteCode.FEW_WEIGHTS, {"count": int(scale.on.max()), "total": len(masses)}),)
    return notes


def _setting_notes(scale: LoadScale, masses: Sequence[float]) -> Iterator[Note]:
    gain, mu, weight = scale.gain, scale.friction, g * masses[0]
    if scale.is_off:
        figures: Figures = {
            "rise_n": gain.value * weight,
            "mass_kg": masses[0],
            "weight_n": weight,
            "gain": gain.value,
            "standard_error": gain.standard_error,
            "mistake": find_mistake(gain.value),
        }
        yield Note(TrialNoteCode.WEIGHT_GAIN, figures)
    if scale.has_friction and mu is not None:
        figures = {"hysteresis": 2 * mu.value, "friction": abs(mu.value), "standard_error": mu.standard_error}
        yield Note(TrialNoteCode.PULLEY, figures)


def _step_notes(plateaus: Sequence[Plateau], scale: LoadScale, masses: Sequence[float]) -> Iterator[Note]:
    """Notes on single wrong loads."""
    levels = g * np.concatenate(([0.0], np.cumsum(masses)))
    limit = MAX_STEP_ERROR * g * float(np.median(masses))
    for plateau, k, expected in zip(plateaus, scale.on, scale.expected, strict=True):
        read = plateau.force - plateaus[0].force
        if abs(read - levels[k]) > limit and abs(read - expected) > limit / 2:  # not a drift
            figures = {"start_s": plateau.start, "found_n": read, "expected_n": float(levels[k]), "count": int(k)}
            yield Note(TrialNoteCode.WRONG_LOAD, figures)


def _noise(plateaus: Sequence[Plateau]) -> float:
    """Standard error [N] of a load above the hook."""
    return math.sqrt(2) * float(np.median([plateau.force_sd for plateau in plateaus]))


def _orders(force: NDArray[np.float64], levels: NDArray[np.float64]) -> Iterator[NDArray[np.intp]]:
    """Candidates for the number of weights at every load: as in the protocol, one per step, or from the load."""
    most, top = len(levels) - 1, float(force.max())
    up, down = np.arange(most + 1), np.arange(most)[::-1]
    # With friction of the pulley, the load may stay or rise when the first weight is removed.
    yield from (order for order in (np.append(up, down), np.append(up, down[1:])) if len(order) == len(force))
    on = [0]
    for before, now in pairwise(force.tolist()):
        is_back = now < BACK * top / max(on[-1], 1)
        on.append(min(on[-1] + 1, most) if now > before else 0 if is_back else max(on[-1] - 1, 0))
    yield np.array(on)
    for count in range(1, most + 1):
        yield np.argmin(np.abs(force[:, None] - top / levels[count] * levels), axis=1)


def _fitted(
    plateaus: Sequence[Plateau], force: NDArray[np.float64], levels: NDArray[np.float64], on: NDArray[np.intp]
) -> LoadScale:
    """Gain, friction and drift by least squares, as far as the order of the weights distinguishes them."""
    weight = levels[on]
    is_removed = np.concatenate(([False], np.diff(on) < 0)) & (on > 0)
    middle = np.array([plateau.start + plateau.end for plateau in plateaus]) / 2
    columns = [weight]
    if is_removed.any():
        columns.append(np.where(is_removed, weight, -weight))
    if on[-1] == 0 and len(force) > len(columns) + 2:
        columns.append(middle - middle[0])
    design = np.column_stack(columns)
    solved, _, rank, _ = np.linalg.lstsq(design, force, rcond=None)
    residual = force - design @ solved
    dof = max(1, len(force) - 1 - int(rank))
    variance = max(float(residual @ residual) / dof, _noise(plateaus) ** 2)
    covariance = variance * np.linalg.pinv(design.T @ design)
    gain = normal_estimate(float(solved[0]), math.sqrt(covariance[0, 0]))
    friction = None
    if is_removed.any() and gain.value > 0:
        friction = normal_estimate(float(solved[1]) / gain.value, math.sqrt(covariance[1, 1]) / gain.value)
    return LoadScale(gain, friction, on, design @ solved)


def _disorder(scale: LoadScale, force: NDArray[np.float64], levels: NDArray[np.float64]) -> float:
    """RMS error of the loads for this order, in weights; an order that skips weights is penalised."""
    if scale.gain.value <= 0:
        return math.inf
    steps, top = np.diff(scale.on), int(scale.on.max())
    from_top = (scale.on[:-1] == top) & ((scale.on[1:] == 0) | (scale.on[1:] == top - 2))
    skips = np.count_nonzero((np.abs(steps) != 1) & ~from_top)
    off = float(np.std(force - scale.expected)) / (scale.gain.value * float(np.min(np.diff(levels))))
    return off + SKIPPED * skips

"""The held loads of a static trial against the weights that were to be hung on: mistakes of a setting show at once.

    force above the bare hook = r (1 − μ d) w + b t      w the weights on, d = 1 reached by hanging on, −1 by taking off

r is what the cell reads for one newton, μ what a pulley holds back and gives back, b the drift of the zero.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.constants import g

from fitting.calibration import blame
from fitting.static.plateaus import Plateau
from fitting.uncertainty import Estimate, normal_estimate

MAX_SCALE_ERROR = 0.03
"""Relative: so much may weights and their hook be off."""
MAX_FRICTION = 0.03
"""Part of the load that a pulley may hold back, and give back, without being said to rub."""
MAX_STEP_ERROR = 0.25
"""Of a weight: how far one load may be off where the others are right."""
SIGNIFICANCE = 3.0
LEAST_SCALE = 0.03
"""Newtons read for one: below, nothing was hung on."""
BACK = 0.3
"""Of a weight: so near to the first load is the hook bare again."""
SKIPPED = 0.15
"""Of a weight, rms: by so much better must the loads fit an order in which two weights came at once."""


@dataclass(frozen=True)
class LoadScale:
    """gain: newtons read for one hung on; friction: part of the load that the pulley holds back, None if unknown.

    on (plateaus,) is how many weights hang on; expected (plateaus,) [N] what they and the pulley make the cell read.
    """

    gain: Estimate
    friction: Estimate | None
    on: NDArray[np.intp]
    expected: NDArray[np.float64]

    @property
    def is_off(self) -> bool:
        """Whether the cell reads what the weights' own errors do not explain."""
        return abs(self.gain.value - 1) > max(MAX_SCALE_ERROR, SIGNIFICANCE * self.gain.standard_error)

    @property
    def rubs(self) -> bool:
        """Whether the pulley holds back more than a good one does."""
        mu = self.friction
        return mu is not None and abs(mu.value) > max(MAX_FRICTION, SIGNIFICANCE * mu.standard_error)


def load_scale(plateaus: Sequence[Plateau], masses: Sequence[float]) -> LoadScale | None:
    """What the cell reads for the weights [kg], hung on in this order and taken off again; None if none was hung on."""
    if len(plateaus) < 2 or not masses:
        return None
    force = np.array([plateau.force for plateau in plateaus]) - plateaus[0].force
    levels = g * np.concatenate(([0.0], np.cumsum(masses)))
    if force.max() < max(LEAST_SCALE * levels[1], SIGNIFICANCE * _noise(plateaus)):
        return None
    scales = [_fitted(plateaus, force, levels, on) for on in _orders(force, levels)]
    return min(scales, key=lambda scale: _disorder(scale, force, levels))


def check_steps(plateaus: Sequence[Plateau], masses: Sequence[float]) -> tuple[str, ...]:
    """Notes on loads that are not those of the weights [kg], which are hung on in this order and taken off again."""
    if len(plateaus) < 2 or not masses:
        return ()
    weight = g * masses[0]
    fall = plateaus[0].force - min(plateau.force for plateau in plateaus)
    rise = max(plateau.force for plateau in plateaus) - plateaus[0].force
    if fall > max(2 * rise, LEAST_SCALE * weight, SIGNIFICANCE * _noise(plateaus)):
        return (
            f"the load falls by {fall:.1f} N where {masses[0]:g} kg ({weight:.1f} N) and more are to be hung on; set "
            "load_cell.polarity to the other sign, or begin with the bare hook",
        )
    scale = load_scale(plateaus, masses)
    if scale is None:
        return (f"no load of protocol.step_masses_kg was hung on, the first being {weight:.1f} N",)
    notes = tuple(_setting_notes(scale, masses))
    notes += tuple(_step_notes(plateaus, scale, masses)) if not notes else ()
    if scale.on.max() < len(masses):
        notes += (f"{scale.on.max()} of {len(masses)} weights of protocol.step_masses_kg were hung on",)
    return notes


def _setting_notes(scale: LoadScale, masses: Sequence[float]) -> Iterator[str]:
    gain, mu, weight = scale.gain, scale.friction, g * masses[0]
    if scale.is_off:
        yield (
            f"the load rises by {gain.value * weight:.1f} N where {masses[0]:g} kg ({weight:.1f} N) are hung on, "
            f"{gain.value:.4f} ± {gain.standard_error:.4f} times as much, {blame(gain.value)}; correct the "
            "configuration or protocol.step_masses_kg"
        )
    if scale.rubs and mu is not None:
        yield (
            f"the same weights read {200 * mu.value:+.0f} % more when they come off than when they go on: the pulley "
            f"holds {100 * abs(mu.value):.0f} % of the load (± {100 * mu.standard_error:.1f} %); oil it (the cell "
            "reads what the cuff feels, so the fit goes on)"
        )


def _step_notes(plateaus: Sequence[Plateau], scale: LoadScale, masses: Sequence[float]) -> Iterator[str]:
    """Single loads that are off."""
    levels = g * np.concatenate(([0.0], np.cumsum(masses)))
    limit = MAX_STEP_ERROR * g * float(np.median(masses))
    for plateau, k, expected in zip(plateaus, scale.on, scale.expected, strict=True):
        read = plateau.force - plateaus[0].force
        if abs(read - levels[k]) > limit and abs(read - expected) > limit / 2:  # a drift is no wrong load
            yield (
                f"the load held from {plateau.start:.1f} s on is {read:.1f} N above the hook, expected {levels[k]:.1f} "
                f"N ({k} weights); correct the weights or the step's time in protocol.toml"
            )


def _noise(plateaus: Sequence[Plateau]) -> float:
    """Standard error [N] of a load above the hook."""
    return math.sqrt(2) * float(np.median([plateau.force_sd for plateau in plateaus]))


def _orders(force: NDArray[np.float64], levels: NDArray[np.float64]) -> Iterator[NDArray[np.intp]]:
    """How many weights may be on at each load: as the protocol says, one more or less a step, or by the load."""
    most, top = len(levels) - 1, float(force.max())
    up, down = np.arange(most + 1), np.arange(most)[::-1]
    # A pulley that rubs may swallow the first weight that comes off, or make the load rise by it.
    yield from (each for each in (np.append(up, down), np.append(up, down[1:])) if len(each) == len(force))
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
    """Gain, friction and drift by least squares, as far as the order of the weights tells them apart."""
    weight = levels[on]
    came_off = np.concatenate(([False], np.diff(on) < 0)) & (on > 0)
    middle = np.array([plateau.start + plateau.end for plateau in plateaus]) / 2
    columns = [weight]
    if came_off.any():
        columns.append(np.where(came_off, weight, -weight))
    if on[-1] == 0 and len(force) > len(columns) + 2:
        columns.append(middle - middle[0])
    design = np.column_stack(columns)
    solved, _, rank, _ = np.linalg.lstsq(design, force, rcond=None)
    left = force - design @ solved
    dof = max(1, len(force) - 1 - int(rank))
    variance = max(float(left @ left) / dof, _noise(plateaus) ** 2)
    covariance = variance * np.linalg.pinv(design.T @ design)
    gain = normal_estimate(float(solved[0]), math.sqrt(covariance[0, 0]))
    friction = None
    if came_off.any() and gain.value > 0:
        friction = normal_estimate(float(solved[1]) / gain.value, math.sqrt(covariance[1, 1]) / gain.value)
    return LoadScale(gain, friction, on, design @ solved)


def _disorder(scale: LoadScale, force: NDArray[np.float64], levels: NDArray[np.float64]) -> float:
    """How far the loads are from those of this order, in weights; an order that skips weights must fit far better."""
    if scale.gain.value <= 0:
        return math.inf
    steps, top = np.diff(scale.on), int(scale.on.max())
    from_top = (scale.on[:-1] == top) & ((scale.on[1:] == 0) | (scale.on[1:] == top - 2))
    skips = np.count_nonzero((np.abs(steps) != 1) & ~from_top)
    off = float(np.std(force - scale.expected)) / (scale.gain.value * float(np.min(np.diff(levels))))
    return off + SKIPPED * skips

"""Tendon slack lengths with which a person's own motions stay in the active range of the muscles.

A scaled generic muscle can be too short or too long for a motion that the person made by his own force: below half of
its optimal length a fibre gives no active force, and far above it is pulled passively (Zajac 1989, Crit. Rev. Biomed.
Eng. 17:359). Tendon slack length is the least known of the parameters (Garner and Pandy 2003, Ann. Biomed. Eng. 31:207,
fit it so that fibres work in their range). Here it changes as little as brings the fibre into a range, FIBRE_RANGE
by default, and only in muscles that leave it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from solver.model import Model, Muscle
from solver.scaling_findings import FIBRE_RANGE, LARGEST_JUMP, muscle_ranges

Array = NDArray[np.float64]


@dataclass(frozen=True)
class TendonChange:
    """A tendon whose slack length changed by `change` [m]; before: shortest and longest normalised fibre length."""

    muscle: str
    change: float
    before: tuple[float, float]


def fit_tendons(
    model: Model, motions: Sequence[Array], fibres: tuple[float, float] = FIBRE_RANGE
) -> tuple[Model, tuple[TendonChange, ...]]:
    """The model with such tendons. motions: postures (frames, coordinates) of the person's own lifts.

    A fibre that goes through more than the whole range is centred in it. A muscle whose path jumps is left as it is,
    because the length on one side of the jump is wrong.
    """
    ranges = [muscle_ranges(model, coordinates) for coordinates in motions]
    shortest = np.min([found.shortest for found in ranges], axis=0)
    longest = np.max([found.longest for found in ranges], axis=0)
    jumps = np.max([found.jump for found in ranges], axis=0) > LARGEST_JUMP
    muscles, changes = [], []
    for muscle, low, high, is_torn in zip(model.muscles, shortest, longest, jumps, strict=True):
        wanted = 0.0 if is_torn else _slack_change(muscle, (float(low), float(high)), fibres)
        change = max(wanted, -muscle.tendon_slack_length)
        if change:
            muscles.append(replace(muscle, tendon_slack_length=muscle.tendon_slack_length + change))
            changes.append(TendonChange(muscle.name, change, (float(low), float(high))))
        else:
            muscles.append(muscle)
    return replace(model, muscles=tuple(muscles)), tuple(changes)


def _slack_change(muscle: Muscle, found: tuple[float, float], wanted: tuple[float, float]) -> float:
    """That brings a fibre which goes from low to high into the wanted range [m]; 0 where it is in it."""
    (low, high), (lowest, highest) = found, wanted
    if low >= lowest and high <= highest:
        return 0.0
    if high - low > highest - lowest:
        middle = 0.5 * (lowest + highest - low - high)
        return _along(muscle, low) - _along(muscle, low + middle)
    if low < lowest:
        return _along(muscle, low) - _along(muscle, lowest)
    return _along(muscle, high) - _along(muscle, highest)


def _along(muscle: Muscle, fibre: float) -> float:
    """Part of the path that a fibre of this normalised length takes, along the tendon [m]."""
    height = np.sin(muscle.pennation_at_optimal)
    return muscle.optimal_fiber_length * float(np.sqrt(max(fibre**2 - height**2, 0.0)))

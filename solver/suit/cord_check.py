"""Tension of a suit's cord as measured, beside the one that the suit predicts in the postures of the same trial."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.cuff import CuffParameters
from solver.model import Model
from solver.motion import Kinematics
from solver.multibody.postures import postures
from solver.suit.cord import cord_line, suit_forces
from solver.suit.suit import Suit

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CordCheck:
    """Measured and predicted tension (frames,) [N] at time (frames,) [s].

    offset       measured less predicted, mean over the frames [N]: the load cell's zero is part of it
    rms          of what differs besides the offset [N]
    correlation  of the two, NaN where one of them is constant
    """

    time: Array
    measured: Array
    predicted: Array
    offset: float
    rms: float
    correlation: float


def check_cord(
    suit: Suit,
    model: Model,
    kinematics: Kinematics,
    measured: Array,
    cuffs: Sequence[CuffParameters | None] = (None, None),
) -> CordCheck:
    """Compare the tension (frames,) [N] measured in the frames of a motion with that of the suit at its reference rest
    length; cuffs are those at waist and arm, None a rigid one, already migrated as far as they do.
    """
    state = postures(model, kinematics.positions, kinematics.speeds)
    forces = suit_forces(
        suit,
        cord_line(suit, model, state, kinematics.interval),
        np.array([suit.reference_rest_length]),
        cuffs,
        yields=any(cuff is not None for cuff in cuffs),
    )
    predicted = forces.tension[0]
    differing = measured - predicted
    offset = float(differing.mean())
    is_constant = np.ptp(measured) == 0.0 or np.ptp(predicted) == 0.0
    return CordCheck(
        kinematics.time,
        measured,
        predicted,
        offset,
        float(np.sqrt(np.mean((differing - offset) ** 2))),
        np.nan if is_constant else float(np.corrcoef(measured, predicted)[0, 1]),
    )

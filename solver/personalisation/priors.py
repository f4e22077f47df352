"""What is known of a body before its markers are seen: sizes, marker errors, posture of the shoulder girdle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.model import Marker, Model, ScapulothoracicMotion
from solver.personalisation.anthropometry import SizeFactor, size_factors
from solver.personalisation.marker_errors import CLAVICLE, MarkerErrors, marker_errors

Array = NDArray[np.float64]

POSTURE_OF_PERSON = np.radians(7.0)
"""Standard deviation, between persons, of the mean of a coordinate of clavicle or scapula, about the model's default.
Without it, offsets of markers and posture of the girdle are exchangeable.
"""
POSTURE_IN_MOTION = np.radians(7.0)
"""Standard deviation of such a coordinate about the person's mean while an arm moves."""
UPWARD_ROTATION = np.radians(12.0)
"""In motion, of the scapula's upward rotation. It follows glenohumeral elevation by 0.43 (Braman et al. 2009, J.
Shoulder Elbow Surg. 18:960): 43 degrees over 100, which has this standard deviation where elevations are uniform.
"""


@dataclass(frozen=True, eq=False)
class BodyPriors:
    """Normal distributions, independent between size, markers and posture.

    factors     which scale factors are estimated;  covariance (factors, factors) of their logarithms, whose mean is 0
    errors      of the markers
    girdle      standard deviation [rad] of a coordinate about the person's mean, by name
    person      standard deviation [rad] of that mean about the model's default, of every coordinate of girdle
    """

    factors: tuple[SizeFactor, ...]
    covariance: Array
    errors: MarkerErrors
    girdle: Mapping[str, float]
    person: float = POSTURE_OF_PERSON


def population_priors(model: Model, markers: Sequence[Marker]) -> BodyPriors:
    """Those of the population, for a person of whom nothing else is known. ModelError as size_factors raises it."""
    factors, covariance = size_factors(model)
    return BodyPriors(factors, covariance, marker_errors(model, markers), _girdle(model))


def _girdle(model: Model) -> dict[str, float]:
    """Coordinates of the clavicle's joint and of scapulothoracic joints."""
    deviations = {}
    for joint in model.joints:
        is_scapulothoracic = isinstance(joint.motion, ScapulothoracicMotion)
        if not (is_scapulothoracic or model.bodies[joint.child].name == CLAVICLE):
            continue
        for place, index in enumerate(joint.motion.coordinates):
            turns_upward = is_scapulothoracic and place == 2
            deviations[model.coordinate_names[index]] = float(UPWARD_ROTATION if turns_upward else POSTURE_IN_MOTION)
    return deviations

"""How far markers lie from where a model has them: palpation, the shape of the bone, and the skin that moves over it.

A marker is off by a constant offset and by a scatter that follows the posture, each about a centimetre along each axis.
Skin over the scapula slides farther the farther it is from the acromion: from rest to an elevated arm by a median of
30.4 mm at the acromial angle, 53.1 mm at the root of the scapular spine and 70.0 mm at the inferior angle (upright CT
of 20 shoulders, 2022, Sensors 22:6502). At their distances from the acromioclavicular joint in the thoracoscapular
model, 45, 120 and 173 mm, this is the straight line SLIDE_AT_JOINT + SLIDE_PER_DISTANCE · distance within 1 mm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.model import Marker, Model, PointConstraint

Array = NDArray[np.float64]

OFFSET = 0.010  # m along each axis
SCATTER = 0.010  # m along each axis
SLIDE_AT_JOINT = 0.016  # m
SLIDE_PER_DISTANCE = 0.31
SCAPULA, CLAVICLE = "scapula", "clavicle"


@dataclass(frozen=True, eq=False)
class MarkerErrors:
    """Standard deviations along each axis [m], (markers,): of the constant offset, and of the scatter about it."""

    offset: Array
    scatter: Array


def marker_errors(model: Model, markers: Sequence[Marker]) -> MarkerErrors:
    """Of markers on a model. A slide that is uniform between 0 and s has mean s/2 and standard deviation s/√12; its
    direction is not known, so each axis has a third of the square.
    """
    slide = np.array([_slide(model, marker) for marker in markers])
    return MarkerErrors(np.hypot(OFFSET, slide / np.sqrt(12.0)), np.hypot(SCATTER, slide / 6.0))


def _slide(model: Model, marker: Marker) -> float:
    """Of the skin under a marker, from rest to an elevated arm [m]."""
    joint = _acromioclavicular_point(model)
    if joint is None or model.bodies[marker.body].name != SCAPULA:
        return 0.0
    return SLIDE_AT_JOINT + SLIDE_PER_DISTANCE * float(np.linalg.norm(marker.location - joint))


def _acromioclavicular_point(model: Model) -> Array | None:
    """In the scapula, where it is joined to the clavicle."""
    for constraint in model.constraints:
        if isinstance(constraint, PointConstraint):
            sides = {
                model.bodies[constraint.body_1].name: constraint.location_1,
                model.bodies[constraint.body_2].name: constraint.location_2,
            }
            if sides.keys() == {SCAPULA, CLAVICLE}:
                return sides[SCAPULA]
    return None

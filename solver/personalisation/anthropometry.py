"""What is known of a body before its markers are seen: sizes, marker errors, posture of the shoulder girdle.

Sizes: covariance of the logarithms of body dimensions in ANSUR II (Gordon et al. 2014, Anthropometric Survey of U.S.
Army Personnel, NATICK/TR-15/007; public data), 4,082 men and 1,986 women, both sexes with equal weight (computed by
`benchmarks/anthropometry.py` of commit eb3242d from the survey's two tables). The owner of a generic model is a member
of the population like the person, so the ratio of their dimensions has twice this covariance.

Masses: segment masses as parts of the body's mass, means of men and women of de Leva (1996), J. Biomech. 29:1223-1230,
table 4.

Marker errors: palpation, the shape of the bone, and the skin that moves over it. A marker is off by a constant offset
and by a scatter that follows the posture, each about a centimetre along each axis. Skin over the scapula slides farther
the farther it is from the acromion: from rest to an elevated arm by a median of 30.4 mm at the acromial angle, 53.1 mm
at the root of the scapular spine and 70.0 mm at the inferior angle (upright CT of 20 shoulders, 2022, Sensors 22:6502).
At their distances from the acromioclavicular joint in the thoracoscapular model, 45, 120 and 173 mm, this is the
straight line SLIDE_AT_JOINT + SLIDE_PER_DISTANCE · distance within 1 mm.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from solver.errors import SolverCode
from solver.model import Marker, Model, ModelError, PointConstraint, ScapulothoracicMotion

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
OFFSET = 0.010  # m along each axis
SCATTER = 0.010  # m along each axis
SLIDE_AT_JOINT = 0.016  # m
SLIDE_PER_DISTANCE = 0.31
SCAPULA, CLAVICLE = "scapula", "clavicle"


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


@dataclass(frozen=True)
class SizeFactor:
    """One scale factor of a person: the bodies it scales, along which of their axes (0, 1, 2), and the dimension of
    ANSUR II whose variation it has. Axes are those of OpenSim's models: x forward, y up, z to the right.
    """

    name: str
    bodies: tuple[str, ...]
    axes: tuple[int, ...]
    dimension: str


ALL_AXES = (0, 1, 2)
SIZE_FACTORS: Final = (
    SizeFactor("thorax depth", ("thorax",), (0,), "chest depth"),
    SizeFactor("thorax height", ("thorax",), (1,), "suprasternal height less tenth rib height"),
    SizeFactor("thorax width", ("thorax",), (2,), "chest breadth"),
    SizeFactor("clavicle", ("clavicle",), ALL_AXES, "biacromial breadth"),
    SizeFactor("scapula", ("scapula",), ALL_AXES, "shoulder length"),
    SizeFactor("upper arm", ("humerus",), ALL_AXES, "acromion-radiale length"),
    SizeFactor("forearm and hand", ("ulna", "radius", "hand"), ALL_AXES, "radiale-stylion length"),
)
LOG_COVARIANCE: Final = 1e-4 * np.array(
    [
        [116.4, 26.6, 48.2, 24.0, 12.5, 20.0, 18.6],
        [26.6, 100.3, 41.0, 57.6, 49.0, 39.2, 45.6],
        [48.2, 41.0, 56.6, 39.2, 28.3, 24.4, 26.2],
        [24.0, 57.6, 39.2, 65.1, 56.8, 36.3, 47.6],
        [12.5, 49.0, 28.3, 56.8, 79.1, 31.0, 43.4],
        [20.0, 39.2, 24.4, 36.3, 31.0, 42.8, 42.3],
        [18.6, 45.6, 26.2, 47.6, 43.4, 42.3, 63.8],
    ]
)
"""Of ln(dimension) in the population, in the order of SIZE_FACTORS."""


@dataclass(frozen=True)
class ArmSegment:
    """Bodies of a segment, and its part of the body's mass."""

    bodies: tuple[str, ...]
    mass_fraction: float


ARM_SEGMENTS: Final[Mapping[str, ArmSegment]] = {
    "upper arm": ArmSegment(("humerus",), 0.0263),
    "forearm": ArmSegment(("ulna", "radius"), 0.0150),
    "hand": ArmSegment(("hand",), 0.00585),
}


def has_arm_segments(model: Model) -> bool:
    """Whether the model has a body of an arm segment, whose mass is known as a share of a person's."""
    names = {body.name for body in model.bodies}
    return any(not names.isdisjoint(segment.bodies) for segment in ARM_SEGMENTS.values())


def size_factors(model: Model) -> tuple[tuple[SizeFactor, ...], Array]:
    """The size factors whose bodies a model has, and the prior covariance (factors, factors) of their logarithms.

    A body without a factor keeps its size. Raises ModelError for a model that has none of the bodies.
    """
    names = {body.name for body in model.bodies}
    kept = [k for k, factor in enumerate(SIZE_FACTORS) if names.issuperset(factor.bodies)]
    if not kept:
        known = ", ".join(sorted({body for factor in SIZE_FACTORS for body in factor.bodies}))
        raise ModelError(
            f"the model {model.name} has no body of a known size ({known}); rename its bodies", SolverCode.UNKNOWN_NAME
        )
    return tuple(SIZE_FACTORS[k] for k in kept), 2.0 * LOG_COVARIANCE[np.ix_(kept, kept)]


def body_factors(factors: Sequence[SizeFactor], values: Array) -> dict[str, Array]:
    """Name of a body → scale factors (3,) along its axes, from one value per size factor."""
    by_body: dict[str, Array] = {}
    for factor, value in zip(factors, values, strict=True):
        for body in factor.bodies:
            by_body.setdefault(body, np.ones(3))[list(factor.axes)] = value
    return by_body


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

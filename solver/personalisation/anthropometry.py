"""Priors of a body before its markers are seen: sizes, marker errors, posture of the shoulder girdle.

Sizes: covariance of the logarithms of body dimensions in ANSUR II (Gordon et al. 2014, Anthropometric Survey of U.S.
Army Personnel, NATICK/TR-15/007; public data), 4,082 men and 1,986 women, both sexes with equal weight (computed by
`benchmarks/anthropometry.py` of commit eb3242d from the survey's two tables). The owner of a generic model is a member
of the population like the person, so the ratio of their dimensions has twice this covariance.

Masses: segment masses as parts of the body's mass, means of men and women of de Leva (1996), J. Biomech. 29:1223-1230,
table 4.

Marker errors: palpation, the shape of the bone, and the skin that moves over it. A marker is off by a constant offset
and by a scatter that follows the posture, each about a centimetre along each axis, less on an epicondyle. Skin over the
scapula slides farther the farther it is from the acromion: from rest to an elevated arm by a median of 30.4 mm at the
acromial angle, 53.1 mm at the root of the scapular spine and 70.0 mm at the inferior angle (upright CT of 20 shoulders,
2022, Sensors 22:6502). At their distances from the acromioclavicular joint in the thoracoscapular model, 45, 120 and
173 mm, this is the straight line SLIDE_AT_JOINT + SLIDE_PER_DISTANCE · distance within 1 mm.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from solver.errors import SolverCode
from solver.model import Array, Marker, Model, ModelError, PointConstraint, ScapulothoracicMotion

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
ELEVATION: Final = "shoulder_elv"
UPWARD_SLOPE: Final = 0.43
"""Upward rotation of the scapula per glenohumeral elevation: Braman et al. (2009), bone pins, raising the arm."""
UPWARD_DEVIATION = np.radians(10.1)
"""Standard deviation about that on a raised arm, where the person's hanging arm is known: upward rotation between 25
and 125 degrees of elevation differs between adults by as much (Dayanidhi et al. 2005, Clin. Biomech. 20:600).
"""
TILT_DEVIATION = np.radians(13.0)
"""The same, of the other coordinates of the scapula, without a slope; assumed."""
CLAVICLE_SLOPES: Final = (-0.26, 0.15)
"""Protraction and elevation of the clavicle per glenohumeral elevation: it retracts by 15 to 29 and rises by 11 to 15
degrees in a full raise (Ludewig et al. 2004, J. Orthop. Sports Phys. Ther. 34:140), of about 85 degrees in this joint.
"""
OFFSET = 0.010  # m along each axis
SCATTER = 0.010  # m along each axis
EPICONDYLE_OFFSET = 0.006
"""m along each axis, of a marker on an epicondyle of the humerus: 4 mm of palpation (Langenderfer et al. 2009, Comput.
Methods Biomech. Biomed. Eng. 12:211) and the mean slide of the skin.
"""
EPICONDYLE_SCATTER = 0.005
"""m along each axis. With 69 mm between the epicondyles this is 5.9 degrees of axial rotation. Against bone pins it was
wrong by 5 degrees on average while the arm was raised, which is a standard deviation of 6.3 degrees (Hamming et al.
2012, J. Electromyogr. Kinesiol. 22:437).
"""
EPICONDYLE_PLACEMENT, EPICONDYLE_SLIDE = 0.004, 0.0093
"""The same, of where such a marker is put and of its slide on a raised arm: an error that grows in proportion to the
elevation is 1.7 times its root mean square over a motion at the end."""
SKIN_SLIDE = 0.015
"""m along each axis, of another marker on a raised arm: a centimetre over a motion, likewise."""
MEDIAN_NORM = 1.538  # of a vector of three standard normal components
EPICONDYLE_REACH = 0.05  # m from the elbow's centre
SLIDE_AT_JOINT = 0.016  # m
SLIDE_PER_DISTANCE = 0.31
SCAPULA, CLAVICLE, HUMERUS = "scapula", "clavicle", "humerus"


@dataclass(frozen=True, eq=False)
class BodyPriors:
    """Normal distributions, independent between size, markers and posture.

    factors     which scale factors are estimated;  covariance (factors, factors) of their logarithms, whose mean is 0
    errors      of the markers
    girdle      standard deviation [rad] of a coordinate about the person's mean, by name
    rhythm      of every coordinate of girdle, by name: how it follows the elevation of the arm
    person      standard deviation [rad] of that mean about the model's default, of every coordinate of girdle
    """

    factors: tuple[SizeFactor, ...]
    covariance: Array
    errors: MarkerErrors
    girdle: Mapping[str, float]
    rhythm: Mapping[str, Rhythm]
    person: float = POSTURE_OF_PERSON


@dataclass(frozen=True)
class Rhythm:
    """A coordinate grows by slope with ELEVATION, with a standard deviation [rad] about that on a raised arm."""

    slope: float
    deviation: float


def population_priors(model: Model, markers: Sequence[Marker]) -> BodyPriors:
    """Those of the population, for a person of whom nothing else is known. ModelError as size_factors raises it."""
    factors, covariance = size_factors(model)
    return BodyPriors(factors, covariance, marker_errors(model, markers), _girdle(model), _rhythm(model))


def _rhythm(model: Model) -> dict[str, Rhythm]:
    """Of the coordinates of _girdle; slopes are 0 in a model without an elevation of the arm."""
    follows = float(ELEVATION in model.coordinate_names)
    rhythms: dict[str, Rhythm] = {}
    for joint in model.joints:
        names = [model.coordinate_names[index] for index in joint.motion.coordinates]
        if isinstance(joint.motion, ScapulothoracicMotion):
            rhythms |= {name: Rhythm(0.0, float(TILT_DEVIATION)) for name in names}
            rhythms[names[2]] = Rhythm(follows * UPWARD_SLOPE, float(UPWARD_DEVIATION))
        elif model.bodies[joint.child].name == CLAVICLE:
            known = CLAVICLE_SLOPES if len(names) == len(CLAVICLE_SLOPES) else np.zeros(len(names))
            for name, slope in zip(names, known, strict=True):
                rhythms[name] = Rhythm(follows * slope, float(POSTURE_IN_MOTION))
    return rhythms


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
    """One scale factor of a person: the bodies it scales, along which of their axes (0, 1, 2).

    Axes are those of OpenSim's models: x forward, y up, z to the right.
    """

    name: str
    bodies: tuple[str, ...]
    axes: tuple[int, ...]


ALL_AXES = (0, 1, 2)
SIZE_FACTORS: Final = (
    SizeFactor("thorax depth", ("thorax",), (0,)),  # chest depth
    SizeFactor("thorax height", ("thorax",), (1,)),  # suprasternal height less tenth rib height
    SizeFactor("thorax width", ("thorax",), (2,)),  # chest breadth
    SizeFactor("clavicle", ("clavicle",), ALL_AXES),  # biacromial breadth
    SizeFactor("scapula", ("scapula",), ALL_AXES),  # shoulder length
    SizeFactor("upper arm", ("humerus",), ALL_AXES),  # acromion-radiale length
    SizeFactor("forearm and hand", ("ulna", "radius", "hand"), ALL_AXES),  # radiale-stylion length
)
"""A comment names the dimension of ANSUR II that gives the variation."""
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
SHARED_CORRELATION = 0.7
"""Correlation of two bones per correlation of their dimensions, some of which overlap: shoulder length is a part of
biacromial breadth, r = 0.79. Clavicle and scapula correlate with stature with r = 0.56 (Pongpon et al. 2021, Med.
Health 16:177) and 0.6 (Vukotic et al. 2021, Int. J. Morphol. 39:902), so with each other between 0.56 · 0.6 = 0.34,
where they have stature alone in common, and 0.79. The middle is 0.7 of the latter.
"""


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
    covariance = 2.0 * LOG_COVARIANCE[np.ix_(kept, kept)]
    return tuple(SIZE_FACTORS[k] for k in kept), np.where(np.eye(len(kept)) > 0.0, 1.0, SHARED_CORRELATION) * covariance


def body_factors(factors: Sequence[SizeFactor], values: Array) -> dict[str, Array]:
    """Name of a body → scale factors (3,) along its axes, from one value per size factor."""
    by_body: dict[str, Array] = {}
    for factor, value in zip(factors, values, strict=True):
        for body in factor.bodies:
            by_body.setdefault(body, np.ones(3))[list(factor.axes)] = value
    return by_body


@dataclass(frozen=True, eq=False)
class MarkerErrors:
    """Standard deviations along each axis [m], (markers,).

    offset, scatter   of the mean over a motion, and about it
    placement, slide  of where the marker was put, and of the slide of the skin from there when the arm is raised
    """

    offset: Array
    scatter: Array
    placement: Array
    slide: Array


def marker_errors(model: Model, markers: Sequence[Marker]) -> MarkerErrors:
    """Of markers on a model. A slide that is uniform between 0 and s has mean s/2 and standard deviation s/√12; its
    direction is not known, so each axis has a third of the square.
    """
    slide = np.array([_slide(model, marker) for marker in markers])
    on_bone = np.array([_is_on_epicondyle(model, marker) for marker in markers], dtype=np.bool_)
    offset = np.where(on_bone, EPICONDYLE_OFFSET, OFFSET)
    scatter = np.where(on_bone, EPICONDYLE_SCATTER, SCATTER)
    return MarkerErrors(
        offset=np.hypot(offset, slide / np.sqrt(12.0)),
        scatter=np.hypot(scatter, slide / 6.0),
        placement=np.where(on_bone, EPICONDYLE_PLACEMENT, OFFSET),
        slide=np.where(slide > 0.0, slide / MEDIAN_NORM, np.where(on_bone, EPICONDYLE_SLIDE, SKIN_SLIDE)),
    )


def _is_on_epicondyle(model: Model, marker: Marker) -> bool:
    """Whether a marker on the humerus is near its joint with the forearm."""
    if model.bodies[marker.body].name != HUMERUS:
        return False
    elbows = [joint.frame_in_parent.translation for joint in model.joints if joint.parent == marker.body]
    return any(float(np.linalg.norm(marker.location - elbow)) < EPICONDYLE_REACH for elbow in elbows)


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

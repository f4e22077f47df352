"""Size and mass of body segments in the population: what is known of a person before any marker is seen.

Sizes: covariance of the logarithms of body dimensions in ANSUR II (Gordon et al. 2014, Anthropometric Survey of U.S.
Army Personnel, NATICK/TR-15/007; public data), 4,082 men and 1,986 women, both sexes with equal weight
(computed by `benchmarks/anthropometry.py` of commit eb3242d from the survey's two tables). The owner of a generic model
is a member of the population like the person, so the ratio of their dimensions has twice this covariance.

Masses: segment masses as parts of the body's mass, means of men and women of de Leva (1996), J. Biomech. 29:1223-1230,
table 4.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from solver.errors import SolverCode
from solver.model import Model, ModelError

Array = NDArray[np.float64]


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

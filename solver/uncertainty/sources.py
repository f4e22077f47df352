"""Sources of the uncertainty of an assessment, in five groups, with their spreads.

A spread is a standard deviation; a relative one is that of the logarithm of a factor whose median is 1. A spread of 0
leaves the source out. The defaults and where they come from are in station/assessment/uncertainty.toml.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf
from typing import Annotated, Literal, get_args

from pydantic import Field

from documents.validation import NonNegative

Group = Literal["fit", "donning", "body", "muscles", "motion"]
GROUPS: tuple[Group, ...] = get_args(Group)
Spread = Annotated[NonNegative, Field(le=1.0)]
"""A relative spread; above 1 a factor would cover orders of magnitude."""
Metres = Annotated[NonNegative, Field(le=0.1)]


@dataclass(frozen=True)
class FitSpread:
    """Uncertainty of the cuffs' fit: factor on the standard errors of cuffs.json; 0 leaves the fit out."""

    factor: Annotated[NonNegative, Field(le=100.0)] = 1.0


@dataclass(frozen=True)
class DonningSpread:
    """From one donning of a cuff to the next, waist cuff included: relative, of its three parameters.

    freedom  degrees of freedom of the three, where they are estimated; infinite for a declared spread
    """

    stiffness: float = 0.15
    damping: float = 0.30
    migration: float = 0.20
    freedom: tuple[float, float, float] = (inf, inf, inf)

    @property
    def spreads(self) -> tuple[float, float, float]:
        return self.stiffness, self.damping, self.migration


@dataclass(frozen=True)
class BodySpread:
    """Of the wearer's body and of the suit on it.

    size              of the whole body, relative;  segment_mass of upper arm, forearm, hand, relative
    attachment_point  of waist, shoulder and arm point of the cord, along each axis [m]
    cord_stiffness    relative
    """

    size: Spread = 0.02
    segment_mass: Spread = 0.13
    attachment_point: Annotated[Metres, Field(alias="attachment_point_m")] = 0.01
    cord_stiffness: Spread = 0.05


@dataclass(frozen=True)
class MuscleSpread:
    """Of the muscle model and of the effort that it minimises. All but path_point are relative.

    strength             of all muscles together;  max_isometric_force of a muscle about that
    optimal_fiber_length, tendon_slack_length  of a muscle
    path_point           of a muscle's origin and insertion, along each axis [m]
    glenoid_radius       of the rim that the joint reaction must stay within
    reserve_weight       weight of the reserve actuators in the effort
    """

    strength: Spread = 0.20
    max_isometric_force: Spread = 0.15
    optimal_fiber_length: Spread = 0.05
    tendon_slack_length: Spread = 0.03
    path_point: Annotated[Metres, Field(alias="path_point_m")] = 0.003
    glenoid_radius: Spread = 0.08
    reserve_weight: Spread = 0.7


@dataclass(frozen=True)
class MotionSpread:
    """Of postures and of repeated cycles of the motion.

    posture    lasting error of each angle [rad];  noise: varying error of each angle [rad], below NOISE_CUTOFF
    amplitude  of the excursion of each coordinate from the first posture, relative, from cycle to cycle
    duration   of a cycle, relative
    """

    posture: float = 0.0436
    noise: float = 0.0035
    amplitude: float = 0.05
    duration: float = 0.10


@dataclass(frozen=True)
class UncertaintySources:
    """All sources of uncertainty."""

    fit: FitSpread = field(default_factory=FitSpread)
    donning: DonningSpread = field(default_factory=DonningSpread)
    body: BodySpread = field(default_factory=BodySpread)
    muscles: MuscleSpread = field(default_factory=MuscleSpread)
    motion: MotionSpread = field(default_factory=MotionSpread)

    @property
    def fit_only(self) -> UncertaintySources:
        """The noise of the fit alone."""
        return UncertaintySources(
            self.fit,
            DonningSpread(0.0, 0.0, 0.0),
            BodySpread(0.0, 0.0, 0.0, 0.0),
            MuscleSpread(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
            MotionSpread(0.0, 0.0, 0.0, 0.0),
        )

"""A model with a suit at one rest length, as a file holds it, and the suit's forces in a motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from solver.cuff import CuffParameters
from solver.model import GROUND, Model
from solver.motion import Kinematics
from solver.multibody.loads import ExternalForce
from solver.multibody.postures import postures
from solver.suit.cord import cord_line, suit_forces
from solver.suit.suit import PARTS, Suit, with_suit_masses

CORD = "exotendon"
CUFF_NAMES = tuple(f"{part}_cuff" for part in PARTS)
CUFFS_AT_ENDS = (CUFF_NAMES[0], CUFF_NAMES[2])
"""Names in a file; the cuff between is not there where the cord is straight."""


@dataclass(frozen=True, eq=False)
class SuitedModel:
    """The bare model and its suit at the reference rest length; a cuff at waist or arm that is None is rigid."""

    bare: Model
    suit: Suit
    waist: CuffParameters | None
    arm: CuffParameters | None

    @property
    def model(self) -> Model:
        """With the suit's masses on its bodies."""
        return with_suit_masses(self.bare, self.suit)

    def loads(self, kinematics: Kinematics, every: int = 1) -> tuple[ExternalForce, ...]:
        """Forces on the bodies of the suit's parts in every N-th frame; the cuffs follow all frames.

        Raises SuitError where a cuff has no equilibrium.
        """
        suit, bodies = self.suit, [body.name for body in self.bare.bodies]
        state = postures(self.bare, kinematics.positions, kinematics.speeds)
        forces = suit_forces(
            suit,
            cord_line(suit, self.bare, state, kinematics.interval),
            np.array([suit.reference_rest_length]),
            (self.waist, self.arm),
            yields=self.waist is not None or self.arm is not None,
            every=every,
        )
        return tuple(
            ExternalForce(
                name=f"{part}_cuff",
                body=bodies.index(getattr(suit, part).body),
                axes=GROUND,
                force=forces.forces[0, :, place],
                torque=np.zeros_like(forces.forces[0, :, place]),
                origin=GROUND,
                point=forces.points[0, :, place],
            )
            for place, part in enumerate(("waist", "arm", "shoulder"))
            if part in suit.parts
        )

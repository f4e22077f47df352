"""What the wearer wears in a scenario of the stream solver."""

from __future__ import annotations

from dataclasses import dataclass

from solver.cuff import CuffParameters
from solver.suit.scenarios import Condition

SLACK = float("inf")
"""Rest length of a cord that never pulls: the suit is worn, with its masses, and does nothing."""


@dataclass(frozen=True)
class StreamScenario:
    """The suit at one rest length [m], with these cuffs (None is a rigid one) in this condition.

    All scenarios of a solver share its Suit, so its cord and masses. The condition is as in SuitScenario: "rigid",
    "shift" (with migration), "visco_elastic" (with compliance) or "both".
    """

    rest_length: float = SLACK
    condition: Condition = "rigid"
    waist: CuffParameters | None = None
    arm: CuffParameters | None = None

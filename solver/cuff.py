"""The cuff: its fitted parameters and the one force law, F = k x + c ẋ (Kelvin-Voigt)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

PARAMETER_ORDER = ("stiffness", "damping", "migration")


@dataclass(frozen=True)
class CuffParameters:
    """A fitted cuff.

    name        of the cuff: "hand", "tube", "elbow", "waist", …
    site        "arm" or "waist"
    stiffness   k [N/m]
    damping     c [N s/m]
    migration   displacement along the pull that remains after unloading [m]
    covariance  (3, 3) of (stiffness, damping, migration) in those units; zero where a parameter is given, not fitted
    source      SHA-256 of the recordings that it was fitted from, or a sentence on the origin of the figures
    """

    name: str
    site: Literal["arm", "waist"]
    stiffness: float
    damping: float
    migration: float
    covariance: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3, 3)))
    source: str = ""


def by_site(cuffs: Iterable[CuffParameters]) -> tuple[list[CuffParameters], list[CuffParameters]]:
    """Those at the arm, and those at the waist."""
    cuffs = list(cuffs)
    return [cuff for cuff in cuffs if cuff.site == "arm"], [cuff for cuff in cuffs if cuff.site == "waist"]


def cuff_force(
    stiffness: float, damping: float, displacement: NDArray[np.float64], velocity: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Force [N] of a cuff displaced by x [m] at ẋ [m/s], any shape: F = k x + c ẋ, (1) and (7) of the source
    study (docs/architecture.md).
    """
    return stiffness * displacement + damping * velocity

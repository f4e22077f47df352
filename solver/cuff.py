"""The law of a cuff, in one place: force, equilibrium and stiffness; and a fitted cuff with its covariance by name.

Forces of the suit, exported bushings, draws and fits use these objects. Another law is another class
(docs/how-to/law.md).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Literal, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from documents.results import EqualByFields
from solver.checks import freeze_arrays
from solver.errors import SolverCode, SolverError

Array = NDArray[np.float64]
Number = TypeVar("Number", float, Array)
MOST_STEPS = 60  # of Newton's method, which approaches the root of a convex or concave spring from one side
CLOSE = 1e-13  # relative


class CuffLaw(ABC):
    """Force of a cuff, the same in all directions: F = K(|x|) x + c ẋ, with the secant stiffness K of its spring.

    A law states K and dF/dx; the spring's force must rise with the displacement. damping  c [N s/m]
    """

    damping: float

    @abstractmethod
    def secant(self, distance: Number) -> float | Number:
        """Secant stiffness K [N/m] at distances [m] from rest, any shape; for a linear spring a number."""

    @abstractmethod
    def tangent(self, distance: Number) -> float | Number:
        """Tangent stiffness dF/dx [N/m] there."""

    def force(self, displacement: Array, velocity: Array, *, axis: int | None = None) -> Array:
        """Force [N] at displacements [m] and velocities [m/s], any shape; axis is that of the components of vectors.

        (1) and (7) of the source study (docs/architecture.md).
        """
        is_vector = axis is not None
        distance = np.linalg.norm(displacement, axis=axis, keepdims=True) if is_vector else np.abs(displacement)
        return np.asarray(self.secant(distance) * displacement + self.damping * velocity)

    def equilibrium(self, force: Number) -> Number:
        """Displacement [m] at rest under a constant force [N]; k q = T, (8). Raises SolverError if none is found."""
        load: Any = np.abs(force)
        with np.errstate(all="ignore"):  # steps of a law without an equilibrium grow without limit
            distance = load / self.secant(0.0 * load)
            for _ in range(MOST_STEPS):
                step = (self.secant(distance) * distance - load) / self.tangent(distance)
                distance = distance - step
                if np.all(np.isfinite(distance) & (np.abs(step) <= CLOSE * distance)):
                    found: Number = np.copysign(distance, force)
                    return found
        raise SolverError(
            f"the law of the cuff, {type(self).__name__}, should have an equilibrium under {np.max(load):g} N, and "
            f"none is found in {MOST_STEPS} steps; check that its force rises with the displacement",
            SolverCode.CUFFS_NOT_AT_REST,
        )

    def bushing(self) -> tuple[float, float]:
        """Stiffness [N/m] and damping [N s/m] of a linear bushing in a file. Raises SolverError for another law."""
        raise SolverError(
            f"OpenSim's BushingForce is linear, and the law of the cuff, {type(self).__name__}, is not; export the "
            "cuff rigid, or with the linear law",
            SolverCode.SUIT_NOT_WRITABLE,
        )

    def secant_under(self, force: Array) -> float | Array:
        """Secant stiffness [N/m] in equilibrium with a force [N]."""
        return self.secant(np.abs(self.equilibrium(force)))

    def tangent_under(self, force: Array) -> float | Array:
        """Tangent stiffness [N/m] in equilibrium with a force [N]."""
        return self.tangent(np.abs(self.equilibrium(force)))


@dataclass(frozen=True)
class KelvinVoigt(CuffLaw):
    """F = k x + c ẋ with stiffness k [N/m] and damping c [N s/m]."""

    NAME: ClassVar[str] = "kelvin_voigt"
    stiffness: float
    damping: float = 0.0

    def secant(self, distance: Number) -> float | Number:  # noqa: ARG002 (the same at any distance)
        return self.stiffness

    tangent = secant

    def force(self, displacement: Array, velocity: Array, *, axis: int | None = None) -> Array:  # noqa: ARG002
        """As CuffLaw.force; linear in each component."""
        return self.stiffness * displacement + self.damping * velocity

    def equilibrium(self, force: Number) -> Number:
        return force / self.stiffness

    def bushing(self) -> tuple[float, float]:
        return self.stiffness, self.damping


@dataclass(frozen=True, eq=False)
class CuffParameters(EqualByFields):
    """A fitted cuff.

    name        of the cuff: "hand", "tube", "elbow", "waist", …
    site        "arm" or "waist"
    stiffness   k [N/m]
    damping     c [N s/m]
    migration   displacement along the pull that remains after unloading [m]
    covariance  of the figures in UNITS, in those units; zero where a figure is given, not fitted, and by default
    source      SHA-256 of the recordings that it was fitted from, or a sentence on the origin of the figures
    """

    UNITS: ClassVar[Mapping[str, str]] = {"stiffness": "N/m", "damping": "N s/m", "migration": "m"}
    """Names of the figures, in the order of the covariance, with their units."""

    name: str
    site: Literal["arm", "waist"]
    stiffness: float
    damping: float
    migration: float
    covariance: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 0)))
    source: str = ""

    def __post_init__(self) -> None:
        """Raises ModelError for a covariance of another size than that of the figures."""
        size = len(self.UNITS)
        if not self.covariance.size:
            object.__setattr__(self, "covariance", np.zeros((size, size)))
        freeze_arrays(self, covariance=(size, size))

    @property
    def law(self) -> CuffLaw:
        """The force of this cuff."""
        return KelvinVoigt(self.stiffness, self.damping)

    @property
    def figures(self) -> Array:
        """Values of the figures in UNITS."""
        return np.array([getattr(self, name) for name in self.UNITS])

    def with_figures(self, values: Sequence[float]) -> Self:
        """The cuff with other values of the figures in UNITS."""
        changed: dict[str, Any] = dict(zip(self.UNITS, values, strict=True))
        return replace(self, **changed)


def by_site(cuffs: Iterable[CuffParameters]) -> tuple[list[CuffParameters], list[CuffParameters]]:
    """Those at the arm, and those at the waist."""
    cuffs = list(cuffs)
    return [cuff for cuff in cuffs if cuff.site == "arm"], [cuff for cuff in cuffs if cuff.site == "waist"]

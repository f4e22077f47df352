"""Force-length curves of tendons: force over the greatest isometric force of the muscle, of length over slack length.

As in OpenSim's TendonForceLengthCurve (Millard, Uchida, Seth, Delp, J. Biomech. Eng. 135(2):021005, 2013), in its
Thelen2003Muscle (Thelen, J. Biomech. Eng. 125(1):70-77, 2003, with constants that make the slope continuous) and in its
DeGrooteFregly2016Muscle (De Groote, Kinney, Rao, Fregly, Ann. Biomed. Eng. 44(10):2922-2936, 2016).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import exp, expm1, log

import numpy as np
from numpy.typing import NDArray

from solver.functions.bezier_chain import BezierChain, chain, evaluate

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MillardTendon:
    """The figures of OpenSim's TendonForceLengthCurve, its defaults.

    strain     at a force of 1;  stiffness  slope there and beyond;  toe_force  where the toe ends
    """

    strain: float = 0.049
    stiffness: float = 1.375 / 0.049
    toe_force: float = 2.0 / 3.0
    curviness: float = 0.5

    @property
    def chain(self) -> BezierChain:
        return _millard_chain(self)

    def force(self, length: Array) -> Array:
        return evaluate(self.chain, length, None)


@dataclass(frozen=True)
class ThelenTendon:
    """An exponential up to `toe_force`, then a straight line to a force of 1 at the strain; zero if slack."""

    strain: float = 0.04
    toe_force: float = 0.33
    toe_shape: float = 3.0

    @property
    def toe_strain(self) -> float:
        """Where both parts have the same slope (0.609 of the strain, as the paper rounds it)."""
        slope = self.toe_shape * self.toe_force * exp(self.toe_shape) / expm1(self.toe_shape)
        return self.strain * slope / (slope + 1.0 - self.toe_force)

    @property
    def stiffness(self) -> float:
        return (1.0 - self.toe_force) / (self.strain - self.toe_strain)

    def force(self, length: Array) -> Array:
        stretch = length - 1.0
        toe = np.expm1(self.toe_shape * np.clip(stretch, 0.0, self.toe_strain) / self.toe_strain)
        straight = self.stiffness * np.maximum(stretch - self.toe_strain, 0.0)
        force: Array = self.toe_force * toe / expm1(self.toe_shape) + straight
        return force


@dataclass(frozen=True)
class DeGrooteFreglyTendon:
    """An exponential through 0 at slack length and 1 at the strain; a slack tendon pushes with up to 0.2."""

    strain: float = 0.049

    @property
    def shape(self) -> float:
        """k of 0.2 exp(k strain) − 0.2."""
        return log(6.0) / self.strain

    def force(self, length: Array) -> Array:
        force: Array = 0.2 * np.expm1(self.shape * (length - 1.0))
        return force


TendonCurve = MillardTendon | ThelenTendon | DeGrooteFreglyTendon


@lru_cache(maxsize=256)
def _millard_chain(tendon: MillardTendon) -> BezierChain:
    """From slack to the end of the toe, with a knot half-way up."""
    toe, stiffness = tendon.toe_force, tendon.stiffness
    end = 1.0 + tendon.strain - (1.0 - toe) / stiffness
    foot = 1.0 + (end - 1.0) / 10.0
    middle = 1.0 + tendon.strain - (1.0 - toe / 2) / stiffness
    slope = toe / 2 / (middle - foot)
    knot = (foot + middle) / 2, slope * (middle - foot) / 2, slope
    return chain((1.0, 0.0, 0.0), knot, (end, toe, stiffness), curviness=(tendon.curviness,) * 2)

"""Springs and ligaments along a path: OpenSim's PathSpring, ExpressionBasedPathForce, Ligament and
Blankevoort1991Ligament.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.functions.coordinate import Function
from solver.functions.expression import Expression
from solver.model import Model, Path
from solver.multibody.force_element import Loads
from solver.multibody.postures import Postures
from solver.paths import evaluate_paths

Array = NDArray[np.float64]


@dataclass(frozen=True)
class _AlongPath(ABC):
    """Tension [N] of a path, in relation to its resting length [m]."""

    name: str
    path: Path
    resting_length: float

    @abstractmethod
    def tension(self, length: Array, speed: Array) -> Array:
        """(frames,) [N] for a length (frames,) [m] and its rate (frames,) [m/s]."""

    def loads(self, model: Model, state: Postures) -> Loads:
        paths = evaluate_paths(model, state, [self.path])
        tension = self.tension(paths.lengths[:, 0], paths.speeds[:, 0])
        return (
            paths.wrench_per_tension[:, 0] * tension[:, None, None],
            paths.mobility_per_tension[:, 0] * tension[:, None],
        )


@dataclass(frozen=True)
class PathSpring(_AlongPath):
    """Tension stiffness · stretch · (1 + dissipation · lengthening speed) beyond the resting length.

    stiffness [N/m], dissipation [s/m]. As in OpenSim, the tension of a stretched path that shortens fast is negative.
    """

    stiffness: float
    dissipation: float

    def tension(self, length: Array, speed: Array) -> Array:
        return self.stiffness * np.maximum(length - self.resting_length, 0.0) * (1.0 + self.dissipation * speed)


@dataclass(frozen=True)
class PathExpression(_AlongPath):
    """A formula in the stretch s [m] and the lengthening speed ldot [m/s].

    is_clamped  whether the stretch of a path below its resting length is zero rather than negative
    """

    expression: Expression
    is_clamped: bool = True

    def tension(self, length: Array, speed: Array) -> Array:
        stretch = length - self.resting_length
        return self.expression.at(np.maximum(stretch, 0.0) if self.is_clamped else stretch, speed)


@dataclass(frozen=True)
class Ligament(_AlongPath):
    """Tension force · curve(length / resting length) beyond the resting length."""

    force: float
    curve: Function

    def tension(self, length: Array, speed: Array) -> Array:  # noqa: ARG002 (of every force along a path)
        tension = self.force * self.curve.derivatives(length / self.resting_length)[0]
        return np.where(length > self.resting_length, tension, 0.0)


DAMPED_FROM = 0.01
"""Strain at which the damping of a Blankevoort1991Ligament is complete."""


@dataclass(frozen=True)
class BlankevoortLigament(_AlongPath):
    """Tension over the strain: quadratic up to the transition strain, then linear; damped while it lengthens.

    Blankevoort, Huiskes, J. Biomech. Eng. 113(3):263-269 (1991). The resting length is OpenSim's slack_length.

    stiffness  [N per unit strain];  damping [N s per unit strain]
    """

    stiffness: float
    transition_strain: float
    damping: float

    def tension(self, length: Array, speed: Array) -> Array:
        strain, rate = length / self.resting_length - 1.0, speed / self.resting_length
        toe = np.clip(strain, 0.0, self.transition_strain)
        quadratic = 0.5 * self.stiffness / self.transition_strain * toe**2 if self.transition_strain > 0.0 else 0.0
        linear = self.stiffness * np.maximum(strain - self.transition_strain, 0.0)
        t = np.clip(strain / DAMPED_FROM, 0.0, 1.0)
        damped = self.damping * np.maximum(rate, 0.0) * t**3 * (10.0 + t * (6.0 * t - 15.0))
        return quadratic + linear + damped

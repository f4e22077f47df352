"""Springs along a path: OpenSim's PathSpring and Ligament."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.functions.coordinate import Function
from solver.model import Model, Path
from solver.multibody.force_element import Loads
from solver.multibody.postures import Postures
from solver.paths import evaluate_paths

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PathSpring:
    """Tension stiffness · stretch · (1 + dissipation · lengthening speed) [N] of a path beyond its resting length [m].

    stiffness [N/m], dissipation [s/m]. As in OpenSim, the tension of a stretched path that shortens fast is negative.
    """

    name: str
    path: Path
    resting_length: float
    stiffness: float
    dissipation: float

    def loads(self, model: Model, state: Postures) -> Loads:
        return _loads_along(self.path, model, state, self._tension)

    def _tension(self, length: Array, speed: Array) -> Array:
        return self.stiffness * np.maximum(length - self.resting_length, 0.0) * (1.0 + self.dissipation * speed)


@dataclass(frozen=True)
class Ligament:
    """Tension force · curve(length / resting length) [N] of a path beyond its resting length [m]."""

    name: str
    path: Path
    resting_length: float
    force: float
    curve: Function

    def loads(self, model: Model, state: Postures) -> Loads:
        return _loads_along(self.path, model, state, self._tension)

    def _tension(self, length: Array, _speed: Array) -> Array:
        tension = self.force * self.curve.derivatives(length / self.resting_length)[0]
        return np.where(length > self.resting_length, tension, 0.0)


def _loads_along(path: Path, model: Model, state: Postures, tension_of: Callable[[Array, Array], Array]) -> Loads:
    paths = evaluate_paths(model, state, [path])
    tension = tension_of(paths.lengths[:, 0], paths.speeds[:, 0])
    return (
        paths.wrench_per_tension[:, 0] * tension[:, None, None],
        paths.mobility_per_tension[:, 0] * tension[:, None],
    )

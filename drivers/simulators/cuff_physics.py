"""A cuff on its tissue, pulled over a rope: the equations of motion and their integrator.

Along the pull, with X the cuff, B the place on the body where it was donned (laboratory, m) and s the slip:

    tissue     F = k (X − B − s) + c (Ẋ − Ḃ − ṡ)               visco-elastic
    skin       ṡ = max(0, F − L(s)) / η,   L(s) = L₀ + H s     friction with a growing limit (Perzyna)
    cuff       m Ẍ = T − F
    link       T = max(0, kₗ (Y − X) + cₗ (Ẏ − Ẋ))             rope or spring; the load cell reads T
    far end    M Ÿ = M g − T                                   where a weight hangs; else a hand moves Y
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numba.core.caching import FunctionCache
from numba.core.runtime.nrt import rtsys
from numpy.typing import NDArray

from drivers.simulators.settings import CuffTruth, SlipLaw
from recordings.standard_gravity import g

STEP_S = 0.0005

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Slider:
    """The skin's law: limit L₀ [N] = first, H [N/m] = growth, η [N s/m] = viscosity."""

    first: float
    growth: float
    viscosity: float


def slider_from_migration(migration: float, peak_load: float, law: SlipLaw) -> Slider:
    """The law under which a static test up to peak_load [N] leaves the cuff slipped by migration [m].

    At rest under the peak L(s) = peak, so H = (peak − L₀) / migration; a cuff without migration never slips.
    """
    if migration == 0:
        return Slider(math.inf, 0.0, 1.0)
    growth = (peak_load - law.first_slip_n) / migration
    return Slider(law.first_slip_n, growth, growth * law.settling_s)


@dataclass(frozen=True)
class SpringDamper:
    """Rope or spring: stiffness [N/m], damping [N s/m]; a hand drives its far end, or else a weight hangs there."""

    stiffness: float
    damping: float
    is_driven: bool


@dataclass(frozen=True)
class MechanicalState:
    """Cuff and far end, position [m] and speed [m/s] along the pull in the laboratory, and the slip [m]."""

    cuff: float
    cuff_speed: float
    slip: float
    far: float
    far_speed: float


@dataclass(frozen=True)
class CuffMechanics:
    """One cuff of mass [kg] on its tissue and skin, pulled by a link."""

    tissue: CuffTruth
    mass: float
    slider: Slider
    link: SpringDamper

    def at_rest(self, load: float, slip: float, base: float, base_speed: float) -> MechanicalState:
        """The equilibrium under a constant load [N], on a body at base [m] that moves at base_speed [m/s]."""
        cuff = base + slip + load / self.tissue.stiffness_n_per_m
        return MechanicalState(cuff, base_speed, slip, cuff + load / self.link.stiffness, base_speed)

    def integrate(self, state: MechanicalState, drive: Floats) -> tuple[MechanicalState, Floats]:
        """The state n steps of STEP_S later (classical Runge-Kutta), and the trajectory.

        drive (2n + 1, 3), at every half step from now on: B [m], Ḃ [m/s], and the mass at the far end [kg] or its
        driven place Y [m]. The trajectory is (n, 3), after every step: displacement X − B [m], slip s [m], load T [N].
        """
        vector = np.array([state.cuff, state.cuff_speed, state.slip, state.far, state.far_speed])
        tissue, slider, link = self.tissue, self.slider, self.link
        cuff_law = (tissue.stiffness_n_per_m, tissue.damping_n_s_per_m, self.mass)
        law = np.array([*cuff_law, slider.first, slider.growth, slider.viscosity, link.stiffness, link.damping])
        trajectory = np.empty((len(drive) // 2, 3))
        _run(vector, law, link.is_driven, drive, trajectory)
        return MechanicalState(*vector.tolist()), trajectory


_Cache: Any = FunctionCache  # without types
_initialize_memory: Any = rtsys.initialize


class _KernelCache(_Cache):  # type: ignore[misc]
    """numba's cache, which loads code without first importing all that numba can compile: 0.5 s of processor."""

    def load_overload(self, signature: Any, target: Any) -> Any:
        _initialize_memory(target)  # for arrays: all that loaded code needs
        with self._guard_against_spurious_io_errors():
            return self._load_overload(signature, target)


def _cached(function: Callable[..., None]) -> Any:
    """The function as machine code, which is kept on disk."""
    kernel: Any = njit(nogil=True)(function)
    kernel._cache = _KernelCache(function)
    return kernel


@_cached
def _run(vector, law, is_driven, drive, trajectory):  # type: ignore[no-untyped-def]
    slope = np.empty((4, 5))
    stage = np.empty(5)
    for step in range(len(trajectory)):
        at = 2 * step
        _slope(vector, law, is_driven, drive[at], slope[0])
        for i, (half_steps, share) in enumerate(((1, 0.5), (1, 0.5), (2, 1.0))):
            for j in range(5):
                stage[j] = vector[j] + share * STEP_S * slope[i, j]
            _slope(stage, law, is_driven, drive[at + half_steps], slope[i + 1])
        for j in range(5):
            vector[j] += STEP_S / 6.0 * (slope[0, j] + 2.0 * slope[1, j] + 2.0 * slope[2, j] + slope[3, j])
        if is_driven:
            vector[3] = drive[at + 2, 2]
            vector[4] = 0.0
        trajectory[step, 0] = vector[0] - drive[at + 2, 0]
        trajectory[step, 1] = vector[2]
        trajectory[step, 2] = _tension(vector, law, vector[3])


@njit(nogil=True)
def _slope(vector, law, is_driven, drive, out):  # type: ignore[no-untyped-def]
    k, c, mass, first, growth, viscosity = law[0], law[1], law[2], law[3], law[4], law[5]
    x, v, slip, far_speed = vector[0], vector[1], vector[2], vector[4]
    force = k * (x - drive[0] - slip) + c * (v - drive[1])
    slip_speed = 0.0
    excess = force - first - growth * slip
    if excess > 0.0:
        slip_speed = excess / (viscosity + c)  # the force that drives the slip decreases by c ṡ
        force -= c * slip_speed
    tension = _tension(vector, law, drive[2] if is_driven else vector[3])
    out[0] = v
    out[1] = (tension - force) / mass
    out[2] = slip_speed
    out[3] = 0.0 if is_driven else far_speed
    out[4] = 0.0 if is_driven else g - tension / drive[2]


@njit(nogil=True)
def _tension(vector, law, far):  # type: ignore[no-untyped-def]
    return max(0.0, law[6] * (far - vector[0]) + law[7] * (vector[4] - vector[1]))

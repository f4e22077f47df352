"""Masses that hang from the load cell in place of the rig: a known one at rest, and one that bounces on a spring.

A known mass that a person hangs from the load cell in place of the rig, at rest, by a hook without weight. Does not
imitate: the swing of a mass that was just hung.

A weight on a steel spring that hangs from the load cell: pulled down by a hand, let go, caught again. The cell reads
the spring, T = M g + k z + c ż with z the downward displacement of the weight from rest (Hooke). While no hand holds
it, the weight swings as the damped oscillator M z̈ = −k z − c ż does. All of it is known in closed form.

Does not imitate: the spring's own mass and surge, the weight swinging sideways, the air.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.constants import g

from drivers.simulators.settings import BounceTest

Floats = NDArray[np.float64]


class HungMass:
    """Known masses on the load cell by time [world s]."""

    def __init__(self) -> None:
        self._times = [-math.inf]
        self._forces = [math.nan]  # [N]; NaN: the rig

    def hang(self, mass_kg: float, now: float) -> None:
        """The mass hangs in place of the rig; 0 is the empty cell."""
        self._change(mass_kg * g, now)

    def take_off(self, now: float) -> None:
        """The rig is back."""
        if not math.isnan(self._forces[-1]):
            self._change(math.nan, now)

    def force(self, t: Floats, rig: Floats) -> Floats:
        """(n,) [N] on the cell at t (n,), where the rig alone would pull with rig (n,)."""
        hung = np.array(self._forces)[np.searchsorted(self._times, t, side="right") - 1]
        return np.where(np.isnan(hung), rig, hung)

    def _change(self, force: float, now: float) -> None:
        self._times.append(now)
        self._forces.append(force)


class BouncingMass:
    """Times are world seconds. The weight hangs from hang() to take_off(), and bounces once after each begin()."""

    def __init__(self, test: BounceTest) -> None:
        self._test = test
        self._hangs: list[tuple[float, float]] = []
        self._starts: list[float] = []
        omega = 2 * math.pi * test.frequency_hz
        self._stiffness = test.mass_kg * omega**2
        self._damping = 2 * test.damping_ratio * test.mass_kg * omega
        self._decay, self._omega = test.damping_ratio * omega, omega * math.sqrt(1 - test.damping_ratio**2)

    def hang(self, now: float) -> None:
        """The weight hangs from the load cell in place of the rope."""
        if not self._hangs or self._hangs[-1][1] < math.inf:
            self._hangs.append((now, math.inf))

    def take_off(self, now: float) -> None:
        """The rope is back; the past does not change."""
        if self._hangs and self._hangs[-1][1] == math.inf:
            self._hangs[-1] = (self._hangs[-1][0], now)

    def begin(self, start: float) -> float:
        """The hand begins at `start`; returns when it will have caught the weight again."""
        test = self._test
        self._starts.append(start)
        return start + test.lead_in_s + 2 * test.hand_over_s + test.bounce_s

    def is_hanging(self, t: Floats) -> NDArray[np.bool_]:
        """(n,) at t (n,)."""
        hanging = np.zeros(t.shape, dtype=bool)
        for first, last in self._hangs:
            hanging |= (t >= first) & (t < last)
        return hanging

    def displacement(self, t: Floats) -> Floats:
        """(n,) [m] downward from rest at t (n,)."""
        return self._motion(t)[0]

    def tension(self, t: Floats) -> Floats:
        """(n,) [N] of the spring on the load cell at t (n,)."""
        displacement, speed = self._motion(t)
        return self._test.mass_kg * g + self._stiffness * displacement + self._damping * speed

    def _motion(self, t: Floats) -> tuple[Floats, Floats]:
        """Displacement and speed: pulled down by the hand, free, stopped by the hand; speeds are differences."""
        step = 1e-4
        displacement = self._place(t)
        return displacement, (self._place(t + step) - self._place(t - step)) / (2 * step)

    def _place(self, t: Floats) -> Floats:
        test = self._test
        starts = np.array([-math.inf, *self._starts])
        since = t - starts[np.searchsorted(starts, t, side="right") - 1]
        since = np.where(np.isfinite(since), since, 0.0)
        let_go = test.lead_in_s + test.hand_over_s
        down = _eased((since - test.lead_in_s) / test.hand_over_s)
        free = np.maximum(since - let_go, 0.0)
        swing = np.cos(self._omega * free) + self._decay / self._omega * np.sin(self._omega * free)
        caught = _eased((since - let_go - test.bounce_s) / test.hand_over_s)
        return np.asarray(1e-3 * test.amplitude_mm * down * np.exp(-self._decay * free) * swing * (1 - caught))


def _eased(progress: Floats) -> Floats:
    """0 before 0, 1 after 1, and between them the minimum-jerk motion of a hand."""
    p = np.clip(progress, 0.0, 1.0)
    return p**3 * (10 - 15 * p + 6 * p * p)

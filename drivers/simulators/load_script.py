"""Loads of a trial by time: weights added and removed step by step, or a spring driven at about 1 Hz.

Time zero is the start of the capture; before it and after its duration only the hook hangs on the rope.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.constants import g

from drivers.simulators.cuff_physics import SpringDamper
from drivers.simulators.settings import DynamicTest, Rig, Settings, StaticTest
from drivers.simulators.wander import Wander, random_wander

Floats = NDArray[np.float64]
PullKind = Literal["static", "dynamic"]


@dataclass(frozen=True)
class Gate:
    """The next movement of the hands begins at `moves`; they have been at rest since `stands` [s]."""

    stands: float
    moves: float


class LoadScript(Protocol):
    """Load of one trial, with the random times of its hand."""

    @property
    def link(self) -> SpringDamper: ...

    @property
    def duration(self) -> float:
        """Seconds from the start of the capture until all weights are removed."""
        ...

    @property
    def gates(self) -> tuple[Gate, ...]:
        """Times at which led hands wait for the console: step k opens the k-th (operator.hands, settings.py)."""
        ...

    def far_end(self, t: Floats) -> Floats:
        """State of the link's far end at t (n,) [s]: the mass on it [kg], or its position along the pull [m]."""
        ...


def script_for(test: PullKind, settings: Settings, rest: float, rng: np.random.Generator) -> LoadScript:
    """One trial's script; rest [m] is where the cuff sits along the pull under the hook alone."""
    if test == "static":
        return _static_script(settings.protocol.static, settings.rig, rng)
    return _dynamic_script(settings.protocol.dynamic, settings.rig, rest, rng)


@dataclass(frozen=True)
class StaticScript:
    """The mass on the rope: at each time one step's mass (negative: taken off) passes from hand to rope."""

    link: SpringDamper
    duration: float
    hook_mass: float
    times: tuple[float, ...]
    hand_overs: tuple[float, ...]
    masses: tuple[float, ...]

    @property
    def gates(self) -> tuple[Gate, ...]:
        """Every weight, and the end."""
        ends = (time + hand_over for time, hand_over in zip(self.times, self.hand_overs, strict=True))
        return tuple(map(Gate, (0.0, *ends), (*self.times, self.duration)))

    def far_end(self, t: Floats) -> Floats:
        mass = np.full(t.shape, self.hook_mass)
        for time, hand_over, step in zip(self.times, self.hand_overs, self.masses, strict=True):
            mass += step * _eased((t - time) / hand_over)
        return mass


@dataclass(frozen=True)
class DynamicScript:
    """The far end of the spring: force is what the hand aims at, were the cuff to stay at rest."""

    link: SpringDamper
    duration: float
    rest: float
    hook: float
    test: DynamicTest
    unsteadiness: Wander  # of amplitude and frequency, relative

    @property
    def gates(self) -> tuple[Gate, ...]:
        """The first pull; a running oscillation is not paused."""
        return (Gate(0.0, self.test.lead_in_s),)

    def far_end(self, t: Floats) -> Floats:
        test = self.test
        up = test.lead_in_s
        swing = up + test.hand_over_s
        down = swing + test.swing_s
        pull = _eased((t - up) / test.hand_over_s) - _eased((t - down) / test.hand_over_s)
        envelope = _eased((t - swing) / test.hand_over_s) - _eased((t - down + test.hand_over_s) / test.hand_over_s)
        amplitude = test.amplitude_n * (1 + self.unsteadiness.value(t)[:, 0])
        phase = 2 * np.pi * test.frequency_hz * (t - swing + self.unsteadiness.integral(t)[:, 1])
        force = self.hook + pull * (test.mean_n - self.hook) + envelope * amplitude * np.sin(phase)
        return self.rest + force / self.link.stiffness


def _static_script(test: StaticTest, rig: Rig, rng: np.random.Generator) -> StaticScript:
    masses = (*test.step_masses_kg, *(-mass for mass in reversed(test.step_masses_kg)))
    hand_overs = tuple(rng.uniform(test.shortest_hand_over_s, test.longest_hand_over_s, len(masses)).tolist())
    times = []
    time = test.lead_in_s
    for hand_over in hand_overs:
        times.append(time)
        time += hand_over + test.hold_s
    link = SpringDamper(rig.rope_stiffness_n_per_m, rig.rope_damping_n_s_per_m, is_driven=False)
    return StaticScript(link, time, rig.hook_n / g, tuple(times), hand_overs, masses)


def _dynamic_script(test: DynamicTest, rig: Rig, rest: float, rng: np.random.Generator) -> DynamicScript:
    jitter = np.array([test.amplitude_jitter, test.frequency_jitter])
    unsteadiness = random_wander(rng, jitter, 0.1 * test.frequency_hz, 0.5 * test.frequency_hz)
    duration = test.lead_in_s + 2 * test.hand_over_s + test.swing_s + test.lead_out_s
    link = SpringDamper(rig.spring_stiffness_n_per_m, 0.0, is_driven=True)
    return DynamicScript(link, duration, rest, rig.hook_n, test, unsteadiness)


def _eased(progress: Floats) -> Floats:
    """0 before 0, 1 after 1, and between them the minimum-jerk motion of a hand."""
    p = np.clip(progress, 0.0, 1.0)
    return p**3 * (10 - 15 * p + 6 * p * p)

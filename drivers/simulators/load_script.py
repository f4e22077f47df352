"""Loads of a trial: the pull on the worn cuff, computed on demand from its physics, and masses in place of the rig.

The loads over time are weights added and removed step by step, or a spring driven at about 1 Hz. Time zero is the start
of the capture; before it and after its duration only the hook hangs on the rope. The computed motion of the cuff is
kept for the last minutes, on the integrator's grid.

A known mass hangs from the load cell at rest, by a hook without weight. A weight on a steel spring hangs from the load
cell: pulled down by a hand, let go, caught again. The cell reads the spring, T = M g + k z + c ż with z the downward
displacement of the weight from rest (Hooke). While no hand holds it, the weight swings as the damped oscillator
M z̈ = −k z − c ż does. All of it is known in closed form.

Does not imitate: the swing of a mass that was just hung, the spring's own mass and surge, the weight swinging sideways,
the air.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.simulators.cuff_physics import STEP_S, CuffMechanics, SpringDamper, slider_from_migration
from drivers.simulators.markers import Wander, WanderOnGrid, random_wander
from drivers.simulators.settings import BounceTest, DynamicTest, Rig, Settings, StaticTest
from recordings.standard_gravity import g

Floats = NDArray[np.float64]

_KEPT_S = 240.0  # at speed 30 a device may lag by 8 s of wall time
_SETTLING_S = 2.0  # after a longer time without queries the integration restarts here
_CHUNK_STEPS = 1000
PullKind = Literal["static", "dynamic"]


class SimulatedPull:
    """The cuff under its load; base is how the wearer's sway moves the unpulled cuff along the rope [m]."""

    def __init__(self, settings: Settings, base: Wander, rng: np.random.Generator) -> None:
        self._settings = settings
        self._base = base
        self._base_on_grid = WanderOnGrid(base, STEP_S / 2, 2 * _CHUNK_STEPS + 1)
        self._rng = rng
        self._trajectory = Trajectory(_KEPT_S)

    @property
    def slip(self) -> float:
        """Slip of the cuff since it was donned [m]."""
        return self._state.slip

    def set_up(self, cuff: str, test: PullKind, slip: float) -> None:
        """From now on this cuff, slipped by slip [m], hangs at rest under the hook; begin() starts the load."""
        settings = self._settings
        tissue = settings.cuffs[cuff]
        slider = slider_from_migration(tissue.migration_m, settings.peak_static_n, settings.slip)
        rest = slip + settings.rig.hook_n / tissue.stiffness_n_per_m
        self._script = script_for(test, settings, rest, self._rng)
        self._script_start = math.inf
        self._gates: tuple[Gate, ...] = ()
        self._mechanics = CuffMechanics(tissue, settings.cuff_body.mass_kg, slider, self._script.link)
        self._rest(slip)

    def begin(self, start: float, *, is_led: bool = False) -> float:
        """The hands begin at the world time start [s]; returns when they will have finished.

        Hands that are led wait at every gate of the script for follow(): until then, inf.
        """
        self._script_start = start
        self._gates = self._script.gates if is_led else ()
        return math.inf if self._gates else start + self._script.duration

    def follow(self, step: int, now: float) -> float:
        """The page is at this step: its gate opens at the world time now [s]. Returns when all will be finished."""
        now = max(now, self._trajectory.end * STEP_S)
        while self._gates and len(self._script.gates) - len(self._gates) < step:
            gate, *later = self._gates
            self._gates = tuple(later)
            is_early = now - self._script_start < gate.stands  # then the movement before is finished first
            self._script_start = max(self._script_start, now - gate.moves) if is_early else now - gate.moves
        return math.inf if self._gates else self._script_start + self._script.duration

    def advance(self, until: float) -> None:
        """Computes the motion up to the world time until [s]."""
        target = math.ceil(until / STEP_S) + 1
        if math.isinf(self._script_start) and (target - self._trajectory.end) * STEP_S > _SETTLING_S:
            self._trajectory.hold_until(target - int(_SETTLING_S / STEP_S))
            self._rest(self._state.slip)
        while self._trajectory.end < target:
            self._integrate(min(target - self._trajectory.end, _CHUNK_STEPS))

    def at(self, t: Floats) -> Floats:
        """(n, 3) at world times t (n,): displacement [m], slip [m], load [N]; computed before by advance()."""
        return self._trajectory.at(t)

    def _rest(self, slip: float) -> None:
        now = np.array([(self._trajectory.end - 1) * STEP_S])
        base, base_speed = float(self._base.value(now)[0, 0]), float(self._base.rate(now)[0, 0])
        self._state = self._mechanics.at_rest(self._settings.rig.hook_n, slip, base, base_speed)

    def _integrate(self, steps: int) -> None:
        half_step = 2 * (self._trajectory.end - 1) + np.arange(2 * steps + 1)
        t = half_step.astype(np.float64) * (STEP_S / 2)
        held = self._gates[0].moves if self._gates else math.inf
        far_end = self._script.far_end(np.clip(t - self._script_start, -1.0, held))
        drive = np.column_stack([self._base_on_grid.value_and_rate(t[0], t.size), far_end])
        self._state, trajectory = self._mechanics.integrate(self._state, drive)
        self._trajectory.append(trajectory)


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


class Trajectory:
    """A ring of (displacement [m], slip [m], load [N]) per step; row n belongs to the world time n × STEP_S."""

    def __init__(self, kept_s: float) -> None:
        self._ring = np.zeros((int(kept_s / STEP_S), 3))
        self._first = self._end = 0

    @property
    def end(self) -> int:
        """The step after the last one known."""
        return self._end

    def hold_until(self, step: int) -> None:
        """The state stays constant until `step`, the step of the next row. Earlier rows are kept."""
        held = min(step - self._end, len(self._ring))
        last = self._ring[(self._end - 1) % len(self._ring)].copy()
        self._end = step - held
        self.append(np.broadcast_to(last, (held, 3)))

    def append(self, rows: Floats) -> None:
        """Continues by rows (n, 3)."""
        self._ring[np.arange(self._end, self._end + len(rows)) % len(self._ring)] = rows
        self._end += len(rows)
        self._first = max(self._first, self._end - len(self._ring))

    def at(self, t: Floats) -> Floats:
        """(n, 3) at the times t (n,) [s], linear between steps; outside the rows that are kept, the first or last."""
        place = np.clip(t / STEP_S, self._first, self._end - 1)
        step = np.floor(place).astype(np.int64)
        before = self._ring[step % len(self._ring)]
        after = self._ring[np.minimum(step + 1, self._end - 1) % len(self._ring)]
        rows: Floats = before + (place - step)[:, None] * (after - before)
        return rows


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
        return self._place(t)

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

"""The pull on the worn cuff: the load script of a trial applied to the cuff's physics, computed on demand."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from drivers.simulators.cuff_physics import STEP_S, CuffMechanics, slider_of
from drivers.simulators.load_script import Gate, PullKind, script_for
from drivers.simulators.settings import Settings
from drivers.simulators.trajectory import Trajectory
from drivers.simulators.wander import Wander

Floats = NDArray[np.float64]

_KEPT_S = 240.0  # at speed 30 a device may lag by 8 s of wall time
_SETTLING_S = 2.0  # after a longer time without queries the integration restarts here
_CHUNK_STEPS = 20_000


class SimulatedPull:
    """The cuff under its load; base is how the wearer's sway moves the unpulled cuff along the rope [m]."""

    def __init__(self, settings: Settings, base: Wander, rng: np.random.Generator) -> None:
        self._settings = settings
        self._base = base
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
        slider = slider_of(tissue.migration_m, settings.peak_static_n, settings.slip)
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
        drive = np.column_stack([self._base.value(t), self._base.rate(t), far_end])
        self._state, trajectory = self._mechanics.integrate(self._state, drive)
        self._trajectory.append(trajectory)

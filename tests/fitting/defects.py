"""Cuffs that are no spring and damper, and rigs with something wrong: the experiment of experiment.py, other cuffs.

Balance of forces at the cuff, integrated: imports nothing of solver, drivers or fitting. Does not imitate: a rope's
pulley, breathing, two defects of the rig at once.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recordings.manifest import Manifest
from recordings.reader import Track
from tests.fitting.experiment import ANCHOR, PULL, STEP, Session, Truth

ACROSS = np.array([0.8, -0.6, 0.0])
"""A unit vector at right angles to PULL."""


@dataclass(frozen=True)
class Law:
    """F = (k/b)(e^{b y} − 1) + c ẏ + friction + two Maxwell arms, y = x − slip. SI units.

    bend          b [1/m], stiffening if positive
    friction      N, reached within `presliding` m
    fast, slow    (part of k, relaxation time) of the arms
    slip_from     N beyond which the cuff slips, by 1/`hardening` m for each N
    """

    stiffness: float = 8520.0
    damping: float = 210.0
    mass: float = 0.2
    bend: float = 0.0
    friction: float = 0.0
    presliding: float = 0.1e-3
    fast: tuple[float, float] = (0.0, 0.3)
    slow: tuple[float, float] = (0.0, 15.0)
    slip_from: float = 1e9
    hardening: float = 2e4


@dataclass(frozen=True)
class Rig:
    """What is wrong with the measurement. Added to dynamic trials: newtons, metres of the cuff's marker.

    static_angle, dynamic_angle  rad between the pull and the cuff's first axis
    swing_noise  N, standard deviation of white force noise in the swing alone
    skin     m/N by which the first anchor marker follows the pull
    ratio    stiffness across the pull over that along it
    """

    dynamic_zero: float = 0.0
    dynamic_shift: float = 0.0
    static_angle: float = 0.0
    dynamic_angle: float = 0.0
    ratio: float = 0.3
    swing_noise: float = 0.0
    skin: float = 0.0


class OddSession(Session):
    """A donning of a cuff with any law on a rig with a defect. Slip and friction persist from trial to trial."""

    def __init__(self, law: Law, rig: Rig, seed: int, truth: Truth | None = None) -> None:
        super().__init__(truth or Truth(friction=1e9, migration=0.0), seed)
        self.law, self.rig = law, rig
        self.left, self.left_across = np.zeros(3), np.zeros(3)

    @property
    def migration(self) -> float:
        """Displacement [m] that remains unloaded: slip, and what friction holds."""
        friction, slip, _ = self.left
        return float(slip - self.law.friction * friction / self.law.stiffness)

    def _record(
        self, test: str, repeat: int, time: NDArray[np.float64], load: NDArray[np.float64]
    ) -> tuple[Manifest, dict[str, Track]]:
        is_dynamic = test == "dynamic"
        angle = self.rig.dynamic_angle if is_dynamic else self.rig.static_angle
        law, k, c = self.law, self.law.stiffness, self.law.damping
        along, self.left = _answer(law, k, c, load * np.cos(angle), self.left)
        across = 0 * along
        if angle:
            ratio, aside = self.rig.ratio, load * np.sin(angle)
            across, self.left_across = _answer(law, ratio * k, ratio * c, aside, self.left_across)
        seen = self.exposed(time)
        path = along[seen, None] * PULL + across[seen, None] * ACROSS + self.rig.dynamic_shift * is_dynamic * PULL
        shifts = np.zeros((len(seen), len(ANCHOR) + 1, 3))
        shifts[:, 0] = self.rig.skin * load[seen, None] * PULL
        shifts[:, -1] = path
        read = load + self.rig.dynamic_zero * is_dynamic
        if is_dynamic and self.rig.swing_noise:
            read = read + self.rig.swing_noise * (time > 2.5) * self.random.standard_normal(len(time))
        return self.assemble(test, repeat, time, read, shifts, np.cos(angle) * PULL + np.sin(angle) * ACROSS)


def _answer(
    law: Law, k: float, c: float, load: NDArray[np.float64], left: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Cuff displacement (n,) [m] under a load (n,) [N], and the state after it: friction, slip, highest load (3,)."""
    arms = (law.fast[0] * k, law.fast[1], law.slow[0] * k, law.slow[1])
    slip = (law.slip_from, law.hardening)
    return _move(load, k, c, law.mass, law.bend, law.friction, law.presliding, *arms, *slip, left)  # type: ignore[no-any-return]


@njit(cache=True)
def _move(load, k, c, mass, bend, friction, presliding, k1, t1, k2, t2, limit, hardening, left):  # type: ignore[no-untyped-def]
    """Semi-implicit Euler in twenty sub-steps; starts at rest under the first load, the arms at ease."""
    h = STEP / 20
    z, s, highest = left
    v, q1, q2 = 0.0, 0.0, 0.0
    carried = load[0] - friction * z
    x = s + (carried / k if bend == 0.0 else np.log(1 + bend * carried / k) / bend)
    places = np.empty(len(load))
    for i in range(len(load)):
        places[i] = x
        change = load[min(i + 1, len(load) - 1)] - load[i]
        for part in range(20):
            here = load[i] + (part + 0.5) / 20 * change
            highest = max(highest, here - limit)
            gives = max(0.0, highest / hardening - s) / 0.3
            y = x - s
            spring = k * y if bend == 0.0 else k / bend * (np.exp(bend * y) - 1)
            rate = v - gives
            v += h / mass * (here - spring - c * rate - friction * z - q1 - q2)
            x += h * v
            s += h * gives
            rate = v - gives
            z += h * (rate - abs(rate) * z) / presliding
            q1 += h * (k1 * rate - q1 / t1)
            q2 += h * (k2 * rate - q2 / t2)
    return places, np.array([z, s, highest])

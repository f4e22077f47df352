"""One implicit step of all fibres, and the lengths that it starts from.

By the second-order backward differentiation formula (BDF2; Curtiss and Hirschfelder, Proc. Natl. Acad. Sci. 38:235,
1952), l' = (3 l − 4 l₁ + l₂) / 2h of the two frames before, which damps the stiff modes of short tendons; by implicit
Euler, l' = (l − l₁) / h, in the second frame and after a fibre was held at its least length. The balance of forces
holds in every frame, so velocities of the path are only needed in the first one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from solver.compiled import compiled_for_python
from solver.tendons.fiber import AT_SHORTEST, balance, settle_fiber, tendon_force
from solver.tendons.tables import FiberTables

Array = NDArray[np.float64]
Codes = NDArray[np.int8]


class StepStart(NamedTuple):
    """What the step of n fibres starts from: v = rate (l − anchor) + drift cos φ, and a guess of l; all (n,)."""

    anchor: Array
    rate: Array
    drift: Array
    guess: Array


class SettledFibers(NamedTuple):
    """The fibres after a step, all (n,): normalised length, tendon force over the greatest isometric one, its
    derivative by the activation, passive force of the fibre along the tendon over the same, codes of fiber.py.
    """

    length: Array
    force: Array
    gain: Array
    passive: Array
    codes: Codes


@compiled_for_python
def fill_settled(
    tables: FiberTables, paths: Array, activations: Array, start: StepStart, settled: SettledFibers
) -> None:
    """Fibres (n,) at path lengths [m] and activations (n,)."""
    for i in range(len(tables.muscle)):
        path, rate, anchor, drift = paths[i], start.rate[i], start.anchor[i], start.drift[i]
        a = max(activations[i], tables.least_activation[i])
        length, force, gain, passive, code = settle_fiber(tables, i, path, a, rate, anchor, drift, start.guess[i])
        settled.length[i], settled.force[i], settled.passive[i], settled.codes[i] = length, force, passive, code
        settled.gain[i] = gain if activations[i] >= a else 0.0


@compiled_for_python
def fill_given(tables: FiberTables, paths: Array, settled: SettledFibers) -> None:
    """Forces (n,) of fibres whose lengths are given in settled; without derivatives."""
    for i in range(len(tables.muscle)):
        length, path = settled.length[i], paths[i]
        settled.force[i] = tendon_force(tables, i, path, length)[0]
        settled.passive[i] = balance(tables, i, path, 0.0, 0.0, length, 0.0, length)[3]


def allocate_settled(count: int) -> SettledFibers:
    length, force, gain, passive = np.zeros((4, count))
    return SettledFibers(length, force, gain, passive, np.zeros(count, np.int8))


class FiberHistory:
    """Normalised fibre lengths of the two frames before, at an interval [s]."""

    def __init__(self, tables: FiberTables, interval: float) -> None:
        optimal, fastest = tables.scales[:, 0], tables.scales[:, 4]
        self._optimal, self._per_second = optimal, 1.0 / fastest
        self._interval = interval
        self._last: Array | None = None
        self._before = np.empty(len(optimal))
        self._is_second_order = self._was_free = np.zeros(len(optimal), bool)

    def start(self, path_speeds: Array) -> StepStart:
        """Of the next frame; path_speeds (n,) [m/s] count in a first one, where tendons keep their lengths."""
        none = np.zeros(len(self._optimal))
        if self._last is None:
            drift = path_speeds * self._per_second / self._optimal
            return StepStart(none, none, drift, np.ones(len(none)))
        anchor = np.where(self._is_second_order, (4.0 * self._last - self._before) / 3.0, self._last)
        rate = np.where(self._is_second_order, 1.5, 1.0) / self._interval * self._per_second
        return StepStart(anchor, rate, none, self._last.copy())

    def keep(self, settled: SettledFibers) -> None:
        """The fibres of the frame, for the next ones."""
        is_free = settled.codes != AT_SHORTEST
        if self._last is not None:
            self._before, self._is_second_order = self._last, is_free & self._was_free
        self._last, self._was_free = settled.length.copy(), is_free

    def forget(self) -> None:
        """The next frame is a first one."""
        self._last, self._is_second_order = None, np.zeros(len(self._optimal), bool)

"""Wrenches of many loads that each act on few bodies, as muscles do: only those that are not zero."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class LoadWrenches:
    """A sparse array (frames, loads, bodies, 6) in coordinate format.

    values  (frames, wrenches, 6) moment about the ground's origin [N m] and force [N], in ground
    load    (wrenches,) the load that each of them belongs to;  body (wrenches,) the body that it acts on
    loads, bodies  how many there are
    """

    values: Array
    load: Indices
    body: Indices
    loads: int
    bodies: int

    def dense(self) -> Array:
        """(frames, loads, bodies, 6)."""
        wrenches = np.zeros((len(self.values), self.loads, self.bodies, 6))
        wrenches[:, self.load, self.body] = self.values
        return wrenches

    def total(self, factors: Array) -> Array:
        """(frames, bodies, 6) sum of the loads times their factors (frames, loads)."""
        values = self.values * factors[:, self.load, None]
        wrenches = [values[:, self.body == body].sum(axis=1) for body in range(self.bodies)]
        return np.stack(wrenches, axis=1)


def on_all_bodies(wrenches: Array) -> LoadWrenches:
    """Of a dense array (frames, loads, bodies, 6)."""
    frames, loads, bodies, _ = wrenches.shape
    load, body = np.divmod(np.arange(loads * bodies), bodies)
    return LoadWrenches(wrenches.reshape(frames, loads * bodies, 6), load, body, loads, bodies)

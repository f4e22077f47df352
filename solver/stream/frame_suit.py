"""Forces of the suit in one frame, for all scenarios.

Rates of cord and cuffs are the differences over one interval that the offline assessment takes; the neighbouring
postures are extrapolated from q, q̇ and q̈, so that they need no frame beside this one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.model import Model
from solver.multibody.postures import postures
from solver.multibody.rotations import wrench_about_origin
from solver.stream.stream_scenario import StreamScenario
from solver.suit.cord import CordLine, cord_line, suit_forces
from solver.suit.scenarios import SuitScenario
from solver.suit.suit import Suit, SuitError

Array = NDArray[np.float64]

_NEIGHBOURS = {"backward": (-1.0, 0.0), "central": (-1.0, 0.0, 1.0)}
_AT = 1  # the frame itself, among these


@dataclass(frozen=True, eq=False)
class FrameForces:
    """tension of the cord [N], shift (2,) of waist and arm cuff from where they were put on [m], wrench (18,) on the
    bodies of waist, arm and shoulder, as response_to_wrenches takes it.
    """

    tension: float
    shift: Array
    wrench: Array


def suit_forces_of_frame(
    suit: Suit, model: Model, state: Array, interval: float, scenarios: Mapping[str, StreamScenario]
) -> dict[str, FrameForces]:
    """By the name of a scenario; one whose cuffs have no equilibrium is missing. state (3, coordinates) q, q̇, q̈."""
    steps = interval * np.array(_NEIGHBOURS[suit.rate])[:, None]
    q, u, a = state
    near = postures(model, q + steps * (u + 0.5 * steps * a), u + steps * a)
    line = cord_line(suit, model, near, interval)
    found: dict[str, FrameForces] = {}
    for names in _with_the_same_cuffs(scenarios):
        try:
            found |= _forces(suit, line, scenarios, names)
        except SuitError:  # of one of them: find out which
            for name in names:
                try:
                    found |= _forces(suit, line, scenarios, [name])
                except SuitError:
                    continue
    return found


def _with_the_same_cuffs(scenarios: Mapping[str, StreamScenario]) -> list[list[str]]:
    """Names of scenarios that differ in the rest length only: they are evaluated together."""
    groups: dict[tuple[object, ...], list[str]] = {}
    for name, worn in scenarios.items():
        groups.setdefault((worn.condition, id(worn.waist), id(worn.arm)), []).append(name)
    return list(groups.values())


def _forces(
    suit: Suit, line: CordLine, scenarios: Mapping[str, StreamScenario], names: Sequence[str]
) -> dict[str, FrameForces]:
    worn = scenarios[names[0]]
    lengths = np.array([scenarios[name].rest_length for name in names])
    scenario = SuitScenario(worn.condition, worn.waist, worn.arm, lengths)
    forces = suit_forces(suit, line, lengths, scenario.cuffs, is_shifted=scenario.is_shifted, yields=scenario.yields)
    migration = np.array([cuff.migration if cuff and scenario.is_shifted else 0.0 for cuff in scenario.cuffs])
    wrenches = wrench_about_origin(forces.points[:, _AT], forces.forces[:, _AT]).reshape(len(names), -1)
    shifts = np.linalg.norm(forces.displacement[:, _AT], axis=-1) + migration
    return {
        name: FrameForces(float(forces.tension[place, _AT]), shifts[place], wrenches[place])
        for place, name in enumerate(names)
    }

"""Results of a cost curve: the numbers of the assessment's tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from solver.suit.curve_minimum import find_minimum
from solver.suit.scenarios import Condition, ScenarioEffort, SuitedMotion, SuitScenario

Array = NDArray[np.float64]
Solved = tuple[SuitScenario, ScenarioEffort]
"""A scenario and its effort; the last rest length is the reference, the others are those tried."""

IDLE = 1e-9
"""Mean activation up to which a muscle does nothing: of nothing, nothing can be saved."""

UNMIGRATED: dict[Condition, Condition] = {"shift": "rigid", "both": "visco_elastic"}
"""The same cuffs in the same suit before they have slipped."""


@dataclass(frozen=True, eq=False)
class CurveReadouts:
    """Numbers off n versions of one curve, each (n,), NaN where there is no such number.

    at_reference       normalised cost at the suit's reference rest length
    rest_length        where the cost is lowest [m];  lowest_cost there
    permissible_error  full width in which 90 % of the best saving is kept [m]
    to_slack           from the best rest length to where the cord never pulls [m]
    cord_force         largest tension at the reference rest length [N]
    cord_force_lost    share of it that migration has taken, against the same cuffs before they slipped
    cost_per_migration normalised cost added at the reference rest length per metre that the arm cuff has slipped [1/m]
    reduction          (n, measured) 1 − mean activation / that with a slack cord, at the reference; see SuitedMotion
    """

    at_reference: Array
    rest_length: Array
    lowest_cost: Array
    permissible_error: Array
    to_slack: Array
    cord_force: Array
    cord_force_lost: Array
    cost_per_migration: Array
    reduction: Array


def read_off_curves(
    worn: SuitedMotion, slack: ScenarioEffort, solved: Mapping[Condition, Solved]
) -> dict[Condition, CurveReadouts]:
    """One version of each curve, from one set of cuffs in all conditions, or from rigid ones alone."""
    return {condition: _read(worn, slack, curve, _unmigrated(solved, condition)) for condition, curve in solved.items()}


def stacked(readouts: Sequence[CurveReadouts]) -> CurveReadouts:
    """Versions of a curve, one behind the other."""
    return CurveReadouts(
        **{f.name: np.concatenate([getattr(part, f.name) for part in readouts]) for f in fields(CurveReadouts)}
    )


def _unmigrated(solved: Mapping[Condition, Solved], condition: Condition) -> Solved | None:
    return solved[UNMIGRATED[condition]] if condition in UNMIGRATED else None


def _read(worn: SuitedMotion, slack: ScenarioEffort, solved: Solved, unmigrated: Solved | None) -> CurveReadouts:
    scenario, effort = solved
    force, cost = effort.cord_force[-1], effort.muscles[-1]
    force_before = cost_before = np.nan
    if unmigrated is not None:
        _, before = unmigrated
        force_before, cost_before = before.cord_force[-1], before.muscles[-1]
    lowest = find_minimum(scenario.rest_lengths[:-1], effort.muscles[:-1])
    slipped = scenario.arm.migration if scenario.arm else 0.0
    mean, mean_slack = worn.mean_activation(effort.activations[-1]), worn.mean_activation(slack.activations[0])
    return CurveReadouts(
        at_reference=np.array([cost]),
        rest_length=np.array([lowest.rest_length]),
        lowest_cost=np.array([lowest.cost]),
        permissible_error=np.array([lowest.width]),
        to_slack=np.array([worn.slack_rest_length(scenario) - lowest.rest_length]),
        cord_force=np.array([force]),
        cord_force_lost=np.array([1 - force / force_before]),
        cost_per_migration=np.array([(cost - cost_before) / slipped if slipped else np.nan]),
        reduction=1 - np.divide(mean, mean_slack, out=np.full_like(mean, np.nan), where=mean_slack > IDLE)[None],
    )

"""Results of a cost curve: its minimum and permissible error, and the figures of the assessment's tables."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np
import scipy
from numpy.typing import NDArray

from solver.redundancy.problem import FrameOutcome
from solver.suit.scenarios import CUFF_CONDITIONS, Condition, ScenarioEffort, SuitedMotion, SuitScenario

Array = NDArray[np.float64]
Place = tuple[Condition, str | None]
"""Condition and arm cuff's name, None where all cuffs are rigid."""
Solved = tuple[SuitScenario, ScenarioEffort]
"""A scenario and its effort; the last rest length is the reference, the others are those tried."""

LARGE_RESERVES = 0.1
"""Effort of the reserves, over that of the muscles with a slack cord, above which muscles do not explain a motion."""
ROUND_OFF = 1e-9  # m
IDLE = 1e-9
"""Mean activation below which a muscle counts as inactive and has no reduction."""

UNMIGRATED: dict[Condition, Condition] = {"shift": "rigid", "both": "visco_elastic"}
"""Condition → the same cuffs without migration."""


@dataclass(frozen=True, eq=False)
class CurveReadouts:
    """Results of n versions of one curve, (n,) each, NaN where there is none.

    at_reference       normalised cost at the suit's reference rest length
    rest_length        where the cost is lowest [m];  lowest_cost there
    permissible_error  full width in which 90 % of the best saving is kept [m]
    to_slack           from the best rest length to that at which the cord is always slack [m]
    cord_force         largest tension at the reference rest length [N]
    cord_force_lost    share of it lost by migration, relative to the same cuffs before it
    cost_per_arm_migration, cost_per_waist_migration
                       derivative of the normalised cost at the reference rest length with respect to the migration of
                       this cuff alone, by central differences of the solved effort [1/m]; NaN for a rigid cuff
    bounds             (n, 4) side of the lengths tried at which the cost is lowest (−1, 1), and what rest_length,
                       lowest_cost and to_slack are there; the optimum lies there or beyond; else (0, NaN, NaN, NaN)
    reduction          (n, measured) 1 − mean activation / that with a slack cord, at the reference; see SuitedMotion
    efforts            (n, rest lengths) normalised cost at the suit's rest lengths, of drawn people with migration and
                       compliance; NaN below those that have a solution. (n, 0) otherwise
    reserves           effort of the reserve actuators at the reference rest length, over that of the muscles with a
                       slack cord
    outcome            FrameOutcome that leaves at_reference unknown, or SOLVED; the SolverCode of a drawn person who
                       cannot be evaluated
    """

    at_reference: Array
    rest_length: Array
    lowest_cost: Array
    permissible_error: Array
    to_slack: Array
    cord_force: Array
    cord_force_lost: Array
    cost_per_arm_migration: Array
    cost_per_waist_migration: Array
    bounds: Array
    reduction: Array
    efforts: Array
    reserves: Array
    outcome: NDArray[np.str_]

    def part(self, versions: NDArray[np.bool_]) -> CurveReadouts:
        """These versions alone."""
        return CurveReadouts(**{field.name: getattr(self, field.name)[versions] for field in fields(self)})


_OTHERS = {"bounds", "reduction", "efforts", "reserves", "outcome"}
FIGURES = tuple(field.name for field in fields(CurveReadouts) if field.name not in _OTHERS)
"""Fields with one number for each version."""


def read_off_curves(
    suited: SuitedMotion,
    slack: ScenarioEffort,
    solved: Mapping[Condition, Solved],
    conditions: Sequence[Condition] = CUFF_CONDITIONS,
) -> dict[Condition, CurveReadouts]:
    """One version of the curves of these conditions, from one set of cuffs in all conditions and rigid ones."""
    idle = suited.mean_activation(slack.activations[0])
    return {
        condition: _read(suited, slack, idle, solved[condition], _unmigrated(solved, condition))
        for condition in conditions
    }


def stacked(readouts: Sequence[CurveReadouts]) -> CurveReadouts:
    """The versions of several curves, concatenated."""
    return CurveReadouts(
        **{f.name: np.concatenate([getattr(part, f.name) for part in readouts]) for f in fields(CurveReadouts)}
    )


def _unmigrated(solved: Mapping[Condition, Solved], condition: Condition) -> Solved | None:
    return solved[UNMIGRATED[condition]] if condition in UNMIGRATED else None


def _read(
    suited: SuitedMotion, slack: ScenarioEffort, mean_slack: Array, solved: Solved, unmigrated: Solved | None
) -> CurveReadouts:
    """mean_slack (measured,) is the mean activation with a slack cord."""
    scenario, effort = solved
    force, cost = effort.cord_force[-1], effort.muscles[-1]
    force_before = unmigrated[1].cord_force[-1] if unmigrated is not None else np.nan
    lowest = find_minimum(scenario.rest_lengths[:-1], effort.muscles[:-1])
    slack_length = suited.slack_rest_length(scenario)
    bounds, lowest_cost = np.array([0.0, np.nan, np.nan, np.nan]), lowest.cost
    if lowest.edge:
        place = -2 if lowest.edge > 0 else 0  # the last is the reference
        length = scenario.rest_lengths[place]
        bounds = np.array([lowest.edge, length, effort.muscles[place], slack_length - length])
        if length >= slack_length - ROUND_OFF:
            lowest_cost = effort.muscles[place]  # a longer cord is as slack
    of_waist, of_arm = effort.migration_slopes
    mean = suited.mean_activation(effort.activations[-1])
    return CurveReadouts(
        at_reference=np.array([cost]),
        rest_length=np.array([lowest.rest_length]),
        lowest_cost=np.array([lowest_cost]),
        permissible_error=np.array([lowest.width]),
        to_slack=np.array([slack_length - lowest.rest_length]),
        cord_force=np.array([force]),
        cord_force_lost=np.array([1 - force / force_before if force_before > 0 else np.nan]),
        cost_per_arm_migration=np.array([of_arm]),
        cost_per_waist_migration=np.array([of_waist]),
        bounds=bounds[None],
        reduction=1 - np.divide(mean, mean_slack, out=np.full_like(mean, np.nan), where=mean_slack > IDLE)[None],
        efforts=np.empty((1, 0)),
        reserves=effort.reserves[-1:],
        outcome=np.array([str(_outcome(cost, (*effort.outcomes[-1], *slack.outcomes[0])))]),
    )


def _outcome(cost: float, of_frames: Sequence[FrameOutcome]) -> FrameOutcome:
    """SOLVED, or the most frequent outcome of frames that leaves the cost unknown: rates do not, nor frames left out,
    unless all of them are.
    """
    if np.isfinite(cost):
        return FrameOutcome.SOLVED
    known = (FrameOutcome.SOLVED, FrameOutcome.BEYOND_ACTIVATION_RATE, FrameOutcome.NOT_FINITE)
    found = Counter(outcome for outcome in of_frames if outcome not in known)
    return found.most_common(1)[0][0] if found else FrameOutcome.NOT_FINITE


def efforts_at(suited: SuitedMotion, solved: Solved) -> Array:
    """Normalised cost (rest lengths,) at those of the suit, from a curve that ends with a slack cord: monotone cubics
    (Fritsch and Carlson 1980, SIAM J. Numer. Anal. 17:238); 1 where the cord is slack throughout, NaN below the
    shortest rest length of the curve.
    """
    scenario, effort = solved
    lengths, cost, wanted = scenario.rest_lengths[:-1], effort.muscles[:-1], suited.suit.rest_lengths
    efforts = np.where(wanted < lengths[-1], np.nan, 1.0)
    if np.isfinite(cost).all():
        curve = scipy.interpolate.PchipInterpolator(lengths, cost, extrapolate=False)
        efforts[wanted < lengths[-1]] = curve(wanted[wanted < lengths[-1]])
    return efforts


KEPT_REDUCTION = 0.9  # of the best one, within the permissible error of the rest length
NOWHERE = np.nan


@dataclass(frozen=True)
class CurveMinimum:
    """The best rest length [m], the normalised cost there, and the full width [m] in which 90 % of the saving is kept.

    All NaN where the best of the lengths tried is the first or the last; the width also where it goes beyond them.
    edge is −1 where it is the first, 1 where it is the last, 0 otherwise.
    """

    rest_length: float
    cost: float
    width: float
    edge: int = 0


def find_minimum(rest_lengths: Array, cost: Array) -> CurveMinimum:
    """The lowest point of a cubic spline through the cost (rest lengths,) at the lengths tried (rest lengths,) [m]."""
    edge = edge_of_minimum(cost)
    if edge or np.isnan(cost).any():
        return CurveMinimum(NOWHERE, NOWHERE, NOWHERE, edge)
    spline = scipy.interpolate.CubicSpline(rest_lengths, cost)
    flat = spline.derivative().roots(extrapolate=False)
    length = float(flat[np.argmin(spline(flat))])
    lowest = float(spline(length))
    edges = spline.solve(1 - KEPT_REDUCTION * (1 - lowest), extrapolate=False)
    before, after = edges[edges < length], edges[edges > length]
    is_kept = before.size and after.size and lowest < 1
    return CurveMinimum(length, lowest, float(after.min() - before.max()) if is_kept else NOWHERE)


def edge_of_minimum(cost: Array) -> int:
    """−1 if the first cost (rest lengths,) is the least, 1 if the last is, 0 otherwise or if a cost is unknown."""
    best = int(np.argmin(cost))
    if np.isnan(cost[best]):
        return 0
    return -1 if best == 0 else int(best == len(cost) - 1)

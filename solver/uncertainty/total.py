"""Drawn people give an assessment its intervals, its decision between the cuffs, and the bands of its curves."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from solver.suit.assessment import Assessment, Comparison, EffortCurve, UncertaintySummary
from solver.suit.decision import BASES, DecisionRule, decide
from solver.suit.quantity import COLUMNS, content_of_intervals, edge_bounds, quantity_of_draws
from solver.suit.scenarios import LARGE_RESERVES, CurveReadouts, Place
from solver.uncertainty.indices import SobolIndices

Array = NDArray[np.float64]
Readouts = Mapping[Place, CurveReadouts]
IndexedFigure = tuple[str, tuple[str, ...]]
"""A figure, as "effort_at_reference", with its arm cuff, or with the two of which it is a difference."""
INFEASIBLE_MOTION = "infeasible_motion"
UNVARIED = 1e-12
"""Range of efforts that differ by rounding only."""
COMPARED = ("at_reference", "rest_length", "lowest_cost", "permissible_error")
"""Figures whose error of decimation is stated."""


@dataclass(frozen=True, eq=False)
class DrawnPeople:
    """Results of the drawn people beyond the summary in the assessment.

    readouts    of each curve: of the fitted cuffs on the assessed person, then of the people
    seed        of the sample;  index_blocks: blocks of the sample for Sobol indices
    indices     of each figure, None where it is unknown or does not vary; empty where none were asked for
    """

    readouts: Readouts
    seed: int
    index_blocks: int = 0
    indices: Mapping[IndexedFigure, SobolIndices | None] = field(default_factory=dict)


def with_people(
    assessment: Assessment, readouts: Readouts, every: int, sources: Sequence[str], rule: DecisionRule
) -> Assessment:
    """The assessment with the intervals of readouts (1 + people,), and the decision.

    The first reading is of the assessed person on the frames of the people: its difference from the assessment, which
    has more frames, is added to the others. People whose muscles cannot do the motion are left out (mark_infeasible).
    """
    is_feasible = np.all([reading.outcome != INFEASIBLE_MOTION for reading in readouts.values()], axis=0)
    readouts = {place: reading.part(is_feasible) for place, reading in readouts.items()}
    solved = np.all([np.isfinite(reading.at_reference[1:]) for reading in readouts.values()], axis=0)
    curves = tuple(_with_intervals(curve, readouts[curve.condition, curve.cuff]) for curve in assessment.curves)
    worn = {curve.cuff: curve for curve in curves if curve.condition == "both" and curve.cuff is not None}
    efforts = {
        basis: {cuff: _shifted(curve, name, readouts["both", cuff]) for cuff, curve in worn.items()}
        for basis, name in BASES.items()
    }
    summary = UncertaintySummary(
        people=len(is_feasible) - 1,
        solved=int(solved.sum()),
        every=every,
        unsolved=_unsolved(list(readouts.values())),
        sources=tuple(sources),
        content=content_of_intervals(int(solved.sum())),
        largest_difference={name: _largest_difference(assessment, readouts, name) for name in COMPARED},
        decisions={basis: decide(drawn, rule) for basis, drawn in efforts.items()},
        rule=rule,
        infeasible=int((~is_feasible).sum()),
    )
    comparisons = tuple(_compared(comparison, readouts) for comparison in assessment.comparisons)
    return replace(assessment, curves=curves, comparisons=comparisons, uncertainty=summary)


def mark_infeasible(readouts: Readouts, *, has_assessed: bool) -> Readouts:
    """With the outcome INFEASIBLE_MOTION of people for whom reserve actuators take over, by the rule of the assessed
    motion: in any condition more than LARGE_RESERVES of the effort with a slack cord.

    has_assessed: the first is the assessed person, who is never marked; no other is where that motion is infeasible
    itself, of which a finding says so.
    """
    is_marked = np.any([reading.reserves > LARGE_RESERVES for reading in readouts.values()], axis=0)
    if has_assessed:
        is_marked &= not is_marked[0]
    return {
        place: replace(reading, outcome=np.where(is_marked, INFEASIBLE_MOTION, reading.outcome))
        for place, reading in readouts.items()
    }


def explained_figures(readouts: Readouts) -> dict[IndexedFigure, Array]:
    """(people,) of the figures that have Sobol indices: of every arm cuff the effort at the reference rest length and
    the best rest length or its bound, of two cuffs the differences of their efforts; NaN for people with an infeasible
    motion.
    """
    cuffs = {cuff: reading for (condition, cuff), reading in readouts.items() if condition == "both" and cuff}
    found: dict[IndexedFigure, Array] = {}
    for cuff, reading in cuffs.items():
        found["effort_at_reference", (cuff,)] = reading.at_reference
        found["best_rest_length", (cuff,)] = np.where(
            np.isnan(reading.rest_length), reading.bounds[:, COLUMNS["rest_length"]], reading.rest_length
        )
    for a, b in combinations(cuffs, 2):
        for basis, name in BASES.items():
            found[f"difference_{basis}", (a, b)] = getattr(cuffs[a], name) - getattr(cuffs[b], name)
    is_infeasible = np.any([reading.outcome == INFEASIBLE_MOTION for reading in readouts.values()], axis=0)
    return {figure: np.where(is_infeasible, np.nan, values) for figure, values in found.items()}


def _with_intervals(curve: EffortCurve, versions: CurveReadouts) -> EffortCurve:
    """Without intervals if nothing that is drawn changes the curve, as that of rigid cuffs by the fit alone."""
    known = versions.at_reference[np.isfinite(versions.at_reference)]
    if len(known) and np.ptp(known) < UNVARIED:
        return curve
    return replace(
        curve,
        figures={
            name: quantity_of_draws(figure.value, getattr(versions, name), edge_bounds(versions, name))
            for name, figure in curve.figures.items()
        },
        reduction={
            name: quantity_of_draws(figure.value, versions.reduction[:, i])
            for i, (name, figure) in enumerate(curve.reduction.items())
        },
        cost_ci95=_band(curve.cost, versions.efforts),
    )


def _compared(comparison: Comparison, readouts: Readouts) -> Comparison:
    first, second = (readouts["both", cuff].at_reference for cuff in comparison.cuffs)
    return replace(comparison, cost_difference=quantity_of_draws(comparison.cost_difference.value, first - second))


def _shifted(curve: EffortCurve, name: str, versions: CurveReadouts) -> Array:
    """(people,) of a figure, moved by what separates the assessed person from the assessment; NaN without a value."""
    value, drawn = curve.figures[name].value, getattr(versions, name)
    shifted: Array = drawn[1:] + ((np.nan if value is None else value) - drawn[0])
    return shifted


def _largest_difference(assessment: Assessment, readouts: Readouts, name: str) -> float:
    """NaN if one of them is NaN; the result of max() would depend on their order."""
    found = [
        getattr(readouts[curve.condition, curve.cuff], name)[0] - (np.nan if value is None else value)
        for curve in assessment.curves
        for value in [curve.figures[name].value]
    ]
    return float(np.max(np.abs(found)))


def _unsolved(readouts: Sequence[CurveReadouts]) -> dict[str, int]:
    """Number of people by the outcome of their first curve without an effort."""
    first = (
        next((reading.outcome[person] for reading in readouts if np.isnan(reading.at_reference[person])), None)
        for person in range(1, len(readouts[0].at_reference))
    )
    return dict(Counter(str(outcome) for outcome in first if outcome is not None).most_common())


def _band(cost: Array, versions: Array) -> Array | None:
    """(rest lengths, 2) about the cost, from versions (1 + people, rest lengths); None where people have no efforts."""
    if not versions.shape[1]:
        return None
    quantities = [quantity_of_draws(value, drawn) for value, drawn in zip(cost.tolist(), versions.T, strict=True)]
    return np.array([quantity.ci95 or (np.nan, np.nan) for quantity in quantities])

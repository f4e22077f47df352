"""Intervals of total uncertainty, and the decision between the cuffs, from drawn people."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import combinations
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from solver.suit.assessment import Assessment
from solver.suit.decision import MOST_UNKNOWN, CuffDecision, DecisionRule, decide
from solver.suit.quantity import Quantity
from solver.suit.readouts import FIGURES, CurveReadouts
from solver.suit.uncertainty import Place
from solver.uncertainty.indices import SobolIndices

if TYPE_CHECKING:
    from solver.uncertainty.cubes import CubesComparison

Array = NDArray[np.float64]
Basis = Literal["at_reference", "at_best"]
"""Every cuff at the suit's reference rest length, or each at its own best rest length."""
BASES: Mapping[Basis, str] = {"at_reference": "at_reference", "at_best": "lowest_cost"}
"""Basis → field of CurveReadouts with the effort."""
IndexedFigure = tuple[str, tuple[str, ...]]
"""A figure, as "effort_at_reference", with its arm cuff, or with the two of which it is a difference."""


@dataclass(frozen=True, eq=False)
class CostBand:
    """Cost of the assessment and ends of its 95 % interval, (rest lengths,) each; NaN where too many are unknown."""

    cost: Array
    low: Array
    high: Array


@dataclass(frozen=True, eq=False)
class TotalUncertainty:
    """Results for the drawn people.

    people      number drawn;  solved: with an effort at the reference rest length of every curve;  every: N-th frame
    figures     of each curve: name of a field of CurveReadouts → its figure with the interval of total uncertainty
    reduction   of each curve: muscle or group of muscles → its figure
    decisions   between the arm cuffs that yield and have migrated;  rule: as decided
    readouts    of each curve: of the fitted cuffs on the assessed person, then of the people
    bands       of the normalised cost with every arm cuff that yields and has migrated
    indices     of each figure, None where it is unknown or does not vary; empty where none were asked for
    cubes       the people who were solved again with an effort of cubes, None for none
    seed        of the sample of people, None if it is not known
    """

    people: int
    solved: int
    every: int
    figures: Mapping[Place, Mapping[str, Quantity]]
    reduction: Mapping[Place, Mapping[str, Quantity]]
    decisions: Mapping[Basis, CuffDecision]
    rule: DecisionRule
    readouts: Mapping[Place, CurveReadouts]
    bands: Mapping[Place, CostBand]
    indices: Mapping[IndexedFigure, SobolIndices | None] = field(default_factory=dict)
    cubes: CubesComparison | None = None
    seed: int | None = None


def total_uncertainty(
    assessment: Assessment, readouts: Mapping[Place, CurveReadouts], every: int, rule: DecisionRule
) -> TotalUncertainty:
    """Compare the people with the assessed person on the same frames; the difference is added to the assessment's
    figures, which are computed from more frames.
    """
    curves = {(curve.condition, curve.cuff): curve for curve in assessment.curves}
    solved = np.all([np.isfinite(reading.at_reference[1:]) for reading in readouts.values()], axis=0)
    efforts: dict[Basis, dict[str, Array]] = {basis: {} for basis in BASES}
    for (condition, cuff), reading in readouts.items():
        if condition == "both" and cuff is not None:
            for basis, name in BASES.items():
                efforts[basis][cuff] = _shifted(curves["both", cuff].figures[name].value, getattr(reading, name))
    return TotalUncertainty(
        people=len(solved),
        solved=int(solved.sum()),
        every=every,
        figures={
            place: {
                name: quantity_of_people(curves[place].figures[name].value, getattr(reading, name)) for name in FIGURES
            }
            for place, reading in readouts.items()
        },
        reduction={
            place: {
                muscle: quantity_of_people(figure.value, reading.reduction[:, index])
                for index, (muscle, figure) in enumerate(curves[place].reduction.items())
            }
            for place, reading in readouts.items()
        },
        decisions={basis: decide(drawn, rule) for basis, drawn in efforts.items()},
        rule=rule,
        readouts=readouts,
        bands={
            place: _band(curves[place].cost, reading.efforts)
            for place, reading in readouts.items()
            if reading.efforts.shape[1]
        },
    )


def explained_figures(readouts: Mapping[Place, CurveReadouts]) -> dict[IndexedFigure, Array]:
    """(people,) of the figures that have Sobol indices: of every arm cuff the effort at the reference rest length and
    the best rest length, of two cuffs the differences of their efforts.
    """
    cuffs = {cuff: reading for (condition, cuff), reading in readouts.items() if condition == "both" and cuff}
    found: dict[IndexedFigure, Array] = {}
    for cuff, reading in cuffs.items():
        found["effort_at_reference", (cuff,)] = reading.at_reference
        found["best_rest_length", (cuff,)] = reading.rest_length
    for a, b in combinations(cuffs, 2):
        for basis, name in BASES.items():
            found[f"difference_{basis}", (a, b)] = getattr(cuffs[a], name) - getattr(cuffs[b], name)
    return found


def quantity_of_people(value: float | None, versions: Array) -> Quantity:
    """The value with the interval of versions (people,), the assessed person first; without an interval where too many
    have no value.
    """
    drawn = _shifted(value, versions)
    is_known = np.isfinite(drawn)
    if value is None or not is_known.any() or is_known.mean() < 1 - MOST_UNKNOWN:
        return Quantity(value)
    low, high = np.quantile(drawn[is_known], [0.025, 0.975])
    return Quantity(value, (float(min(low, value)), float(max(high, value))))


def _shifted(value: float | None, versions: Array) -> Array:
    """(people,) around the value of the assessment; NaN without one."""
    shifted: Array = versions[1:] + ((np.nan if value is None else value) - versions[0])
    return shifted


def _band(cost: Array, versions: Array) -> CostBand:
    """About the cost (rest lengths,) of the assessment, from versions (people + 1, rest lengths)."""
    drawn = versions[1:] + (cost - versions[0])
    is_known = np.isfinite(drawn).mean(axis=0) >= 1 - MOST_UNKNOWN
    low, high = np.full((2, len(cost)), np.nan)
    if is_known.any():
        ends = np.nanquantile(drawn[:, is_known], [0.025, 0.975], axis=0)
        low[is_known], high[is_known] = np.minimum(ends[0], cost[is_known]), np.maximum(ends[1], cost[is_known])
    return CostBand(cost, low, high)

"""Intervals of total uncertainty, and the decision between the cuffs, from drawn people."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from solver.suit.assessment import Assessment
from solver.suit.decision import MOST_UNKNOWN, CuffDecision, DecisionRule, decide
from solver.suit.quantity import Quantity
from solver.suit.readouts import FIGURES, CurveReadouts
from solver.suit.uncertainty import Place
from solver.uncertainty.cubes import CubesComparison
from solver.uncertainty.figures import BASES, Basis, IndexedFigure, quantity_of_people, shift_to_assessment
from solver.uncertainty.indices import SobolIndices

Array = NDArray[np.float64]


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
    unsolved    outcome of the people who are not solved → number, the most frequent first
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
    unsolved: Mapping[str, int] = field(default_factory=dict)


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
                efforts[basis][cuff] = shift_to_assessment(
                    curves["both", cuff].figures[name].value, getattr(reading, name)
                )
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
        unsolved=_unsolved(list(readouts.values())),
    )


def _unsolved(readouts: Sequence[CurveReadouts]) -> dict[str, int]:
    """Number of people by the outcome of their first curve without an effort."""
    first = (
        next((reading.outcome[person] for reading in readouts if np.isnan(reading.at_reference[person])), None)
        for person in range(1, len(readouts[0].at_reference))
    )
    return dict(Counter(str(outcome) for outcome in first if outcome is not None).most_common())


def _band(cost: Array, versions: Array) -> CostBand:
    """About the cost (rest lengths,) of the assessment, from versions (people + 1, rest lengths)."""
    drawn = versions[1:] + (cost - versions[0])
    is_known = np.isfinite(drawn).mean(axis=0) >= 1 - MOST_UNKNOWN
    low, high = np.full((2, len(cost)), np.nan)
    if is_known.any():
        ends = np.nanquantile(drawn[:, is_known], [0.025, 0.975], axis=0)
        low[is_known], high[is_known] = np.minimum(ends[0], cost[is_known]), np.maximum(ends[1], cost[is_known])
    return CostBand(cost, low, high)

"""The exponent of the effort as a source of doubt: the same people with squares and with cubes of activations.

Effort saved is relative to the effort with a slack cord, each with its own exponent. The same people are compared, so
the change by the exponent is free of the scatter between people. If both exponents are equally likely, the variance of
a figure has a part of the exponent: that of the two means (first order), and the mean of that of each person (total).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.suit.decision import CuffDecision, DecisionRule, decide
from solver.suit.quantity import Quantity
from solver.suit.readouts import FIGURES, CurveReadouts
from solver.suit.uncertainty import Place
from solver.uncertainty.figures import BASES, Basis, IndexedFigure, explained_figures, quantity_of_people

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ExponentChange:
    """Change of a figure from squares to cubes: mean over the people with its 95 % interval over people.

    first, total  share of the variance that the exponent explains alone, and with interactions; NaN without variance
    """

    change: Quantity
    first: float
    total: float


@dataclass(frozen=True, eq=False)
class CubesComparison:
    """Results of the people who were solved with both exponents.

    people     number drawn;  solved: with both exponents at the reference rest length of every curve
    figures    of each curve with cubes: of the assessed person, with the interval of the people
    decisions  with cubes;  of_squares: of the same people with squares
    changes    of each figure that has Sobol indices, None where it is unknown
    """

    people: int
    solved: int
    figures: Mapping[Place, Mapping[str, Quantity]]
    decisions: Mapping[Basis, CuffDecision]
    of_squares: Mapping[Basis, CuffDecision]
    changes: Mapping[IndexedFigure, ExponentChange | None]

    def agrees(self, basis: Basis) -> bool:
        """Whether both exponents lead to the same statement on the cuffs."""
        cubes, squares = self.decisions[basis], self.of_squares[basis]
        return (cubes.outcome, set(cubes.leading), set(cubes.worse)) == (
            squares.outcome,
            set(squares.leading),
            set(squares.worse),
        )


def compare_exponents(
    squares: Mapping[Place, CurveReadouts], cubes: Mapping[Place, CurveReadouts], rule: DecisionRule
) -> CubesComparison:
    """Compare the same people, the assessed one first, with both exponents."""
    known = [np.isfinite(reading.at_reference[1:]) for part in (squares, cubes) for reading in part.values()]
    before, after = explained_figures(squares), explained_figures(cubes)
    return CubesComparison(
        people=len(known[0]),
        solved=int(np.all(known, axis=0).sum()),
        figures={
            place: {
                name: quantity_of_people(_known(getattr(reading, name)[0]), getattr(reading, name)) for name in FIGURES
            }
            for place, reading in cubes.items()
        },
        decisions=_decisions(cubes, rule),
        of_squares=_decisions(squares, rule),
        changes={figure: _change(before[figure][1:], after[figure][1:]) for figure in after},
    )


def _decisions(readouts: Mapping[Place, CurveReadouts], rule: DecisionRule) -> dict[Basis, CuffDecision]:
    return {
        basis: decide(
            {
                cuff: getattr(reading, name)[1:]
                for (condition, cuff), reading in readouts.items()
                if condition == "both" and cuff
            },
            rule,
        )
        for basis, name in BASES.items()
    }


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _change(squares: Array, cubes: Array) -> ExponentChange | None:
    """None where fewer than two people are known with both exponents."""
    is_known = np.isfinite(squares + cubes)
    if is_known.sum() < 2:
        return None
    squares, cubes = squares[is_known], cubes[is_known]
    change = cubes - squares
    low, high = np.quantile(change, [0.025, 0.975])
    mean = float(change.mean())
    together = np.concatenate([squares, cubes])
    variance = float(np.var(together)) if np.ptp(together) > 0 else np.nan
    first, total = mean**2 / 4 / variance, float((change**2).mean()) / 4 / variance
    return ExponentChange(Quantity(mean, (float(low), float(high))), first, total)

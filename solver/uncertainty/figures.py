"""Figures of drawn people: which have an interval, and which have Sobol indices."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from solver.suit.decision import MOST_UNKNOWN
from solver.suit.quantity import Quantity
from solver.suit.readouts import CurveReadouts
from solver.suit.uncertainty import Place

Array = NDArray[np.float64]
Basis = Literal["at_reference", "at_best"]
"""Every cuff at the suit's reference rest length, or each at its own best rest length."""
BASES: Mapping[Basis, str] = {"at_reference": "at_reference", "at_best": "lowest_cost"}
"""Basis → field of CurveReadouts with the effort."""
IndexedFigure = tuple[str, tuple[str, ...]]
"""A figure, as "effort_at_reference", with its arm cuff, or with the two of which it is a difference."""


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
    drawn = shift_to_assessment(value, versions)
    is_known = np.isfinite(drawn)
    if value is None or not is_known.any() or is_known.mean() < 1 - MOST_UNKNOWN:
        return Quantity(value)
    low, high = np.quantile(drawn[is_known], [0.025, 0.975])
    return Quantity(value, (float(min(low, value)), float(max(high, value))))


def shift_to_assessment(value: float | None, versions: Array) -> Array:
    """(people,) moved by what separates the assessed person, versions[0], from the assessment; NaN without a value."""
    shifted: Array = versions[1:] + ((np.nan if value is None else value) - versions[0])
    return shifted

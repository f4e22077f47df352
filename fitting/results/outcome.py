"""Outcome of an iteration, and of the comparison of a file with its hash.

An iteration converged, stopped at its limit of rounds, or is outside the range of the law.
"""

from __future__ import annotations

from collections.abc import Iterable
from enum import StrEnum


class FitOutcome(StrEnum):
    """How an iteration ended.

    CONVERGED      its convergence criterion was met
    NOT_CONVERGED  it reached its limit of rounds while its parameters still changed
    NO_SOLUTION    it left the range in which the law describes a cuff, for example with a negative stiffness
    """

    CONVERGED = "converged"
    NOT_CONVERGED = "not_converged"
    NO_SOLUTION = "no_solution"


NEGLIGIBLE = 0.01
"""Standard errors by which a parameter may change in the last round of a converged fit."""


def worst(outcomes: Iterable[FitOutcome]) -> FitOutcome:
    """The outcome of a fit in several parts, all of which must converge."""
    found = set(outcomes)
    return next(
        (outcome for outcome in (FitOutcome.NO_SOLUTION, FitOutcome.NOT_CONVERGED) if outcome in found), CONVERGED
    )


CONVERGED = FitOutcome.CONVERGED


class Standing(StrEnum):
    """Comparison of a file with the hash recorded when it was written, or of a figure with the fit."""

    AS_RECORDED = "as recorded"
    CHANGED = "changed since"
    MISSING = "missing"
    ADDED = "added since"
    BY_HAND = "given by hand"
    UNRECORDED = "no hash recorded"

    @property
    def is_break(self) -> bool:
        """Whether this breaks the chain of hashes from the report to the recordings."""
        return self in (Standing.CHANGED, Standing.MISSING, Standing.ADDED)

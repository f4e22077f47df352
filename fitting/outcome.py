"""How an iteration of a fit ended: converged, stopped at its limit of rounds, or left the law's range."""

from __future__ import annotations

from collections.abc import Iterable
from enum import StrEnum

from fitting.quality import UnusableTrial


class FitOutcome(StrEnum):
    """How an iteration ended.

    CONVERGED      its convergence criterion was met
    NOT_CONVERGED  it was stopped at its limit of rounds while its parameters still changed
    NO_SOLUTION    it left the range in which the law describes a cuff, as with a negative stiffness
    """

    CONVERGED = "converged"
    NOT_CONVERGED = "not_converged"
    NO_SOLUTION = "no_solution"


class NotConverged(UnusableTrial):
    """A fit without which a trial is of no use did not converge; one sentence."""

    outcome = FitOutcome.NOT_CONVERGED


NEGLIGIBLE = 0.01
"""Standard errors by which a parameter may still change in the last round of a fit that is called converged."""


def worst(outcomes: Iterable[FitOutcome]) -> FitOutcome:
    """The outcome of a fit in several parts, all of which must converge."""
    found = set(outcomes)
    return next((each for each in (FitOutcome.NO_SOLUTION, FitOutcome.NOT_CONVERGED) if each in found), CONVERGED)


CONVERGED = FitOutcome.CONVERGED

"""Optimise a suit for one pair of cuffs: rest length and, optionally, stiffness and attachment points.

Two optima: for the cuffs as fitted, and the robust one, with the least mean cost over drawn cuffs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any, Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from solver.cuff import CuffParameters
from solver.errors import SolverCode
from solver.redundancy.motion_solution import LoadedMotion
from solver.suit.cord import Condition, SuitScenario
from solver.suit.scenarios import SuitedMotion, prepare_suited_motion, solve_scenarios
from solver.suit.suit import Suit, SuitError

Array = NDArray[np.float64]
Freedom = Literal["stiffness", "waist", "shoulder", "arm"]
Pair = tuple[CuffParameters | None, CuffParameters | None]

# one step of the search, and the most steps from the start
REST_LENGTH_STEP = 0.02  # m; from half the suit's shortest to its longest
STIFFNESS_STEP, MOST_STIFFNESS_STEPS = np.log(1.2), 8.0  # a factor of 4.3 either way
POINT_STEP, MOST_POINT_STEPS = 0.01, 5.0  # m
PRECISION = 0.01  # of a step
TRIES_PER_FREEDOM = 80
MOST_APART, LEAST_FRAMES = 20, 30  # of the frames in which suits are tried
STAGE = "trying suits"


class SearchOutcome(StrEnum):
    """Outcome of a search for a suit: at its precision, or at its limit of evaluations."""

    CONVERGED = "converged"
    NOT_CONVERGED = "not_converged"


@dataclass(frozen=True, eq=False)
class SuitCandidate:
    """A suit at its reference rest length, and its normalised cost.

    cost      with the fitted cuffs, muscles solved in all selected frames
    drawn     (draws,) with the drawn cuffs, in the frames in which suits are tried; empty without draws
    at_limit  parameters at the limit of the search
    outcome   of the search that found it
    """

    suit: Suit
    cost: float
    drawn: Array
    at_limit: tuple[str, ...]
    outcome: SearchOutcome = SearchOutcome.CONVERGED


@dataclass(frozen=True, eq=False)
class OptimisedSuit:
    """The suit as it was, the best with the fitted cuffs, the best on average over the draws, and suits tried."""

    start: SuitCandidate
    fitted: SuitCandidate
    robust: SuitCandidate
    tried: int


def optimise_suit(
    motion: LoadedMotion,
    suit: Suit,
    cuffs: tuple[CuffParameters | None, CuffParameters],
    condition: Condition = "both",
    free: Sequence[Freedom] = (),
    *,
    drawn: Sequence[Pair] = (),
    every: int | None = None,
    progress: Callable[[str, int, int], None] = lambda *_: None,
) -> OptimisedSuit:
    """Search by the simplex method of Nelder and Mead, from the suit's reference rest length, with a waist cuff, None a
    rigid one, and an arm cuff.

    drawn are the same cuffs drawn again, for the robust optimum. Muscles are solved in every N-th frame; None: 20, or
    less where a short motion, as a stride, would keep fewer than 30 frames. Raises as prepare_suited_motion, and if the
    cord never pulls. A candidate that cannot be solved has infinite cost.
    """
    if suit.is_straight and "shoulder" in free:
        raise SuitError("a straight cord has no shoulder point to move; free another point", SolverCode.SUIT)
    apart = every or min(MOST_APART, max(1, len(motion.kinematics.time) // LEAST_FRAMES))
    decimated = prepare_suited_motion(motion, suit, apart)
    decimated.ensure_pulls()
    search = _Search(decimated, condition, tuple(free), progress)
    pairs = [cuffs, *(drawn if condition != "rigid" else ())]
    fitted = search.best(pairs[:1])
    robust = search.best(pairs[1:]) if len(pairs) > 1 else fitted
    progress(STAGE, search.tried, search.tried)  # the total was the limit of iterations; it is now what was needed
    whole = prepare_suited_motion(motion, suit)
    start, best, safe = (
        SuitCandidate(
            suit=candidate,
            cost=float(_costs(whole, candidate, condition, pairs[:1])[0]),
            drawn=_costs(search.suited, candidate, condition, pairs[1:]),
            at_limit=at_limit,
            outcome=outcome,
        )
        for candidate, at_limit, outcome in ((suit, (), SearchOutcome.CONVERGED), fitted, robust)
    )
    return OptimisedSuit(start, best, safe, search.tried)


def _costs(suited: SuitedMotion, suit: Suit, condition: Condition, pairs: Sequence[Pair]) -> Array:
    """(pairs,) normalised cost at the suit's reference rest length; infinite where a frame cannot be solved."""
    if not pairs:
        return np.zeros(0)
    length = np.array([suit.reference_rest_length])
    scenarios = [SuitScenario(condition, *(pair if condition != "rigid" else (None, None)), length) for pair in pairs]
    _, efforts = solve_scenarios(suited.with_suit(suit), scenarios)
    costs = np.concatenate([effort.muscles for effort in efforts])
    costs[np.isnan(costs)] = np.inf
    return costs


class _Search:
    """Map the free parameters to one vector of steps from the given suit, and count the evaluations."""

    def __init__(
        self,
        suited: SuitedMotion,
        condition: Condition,
        free: tuple[Freedom, ...],
        progress: Callable[[str, int, int], None],
    ) -> None:
        self.suited, self.condition, self.free, self.progress = suited, condition, free, progress
        start = suited.suit
        lengths = (start.rest_lengths[[0, -1]] * [0.5, 1.0] - start.reference_rest_length) / REST_LENGTH_STEP
        self.bounds = [(float(lengths[0]), float(lengths[1]))]
        for freedom in free:
            most, count = (MOST_STIFFNESS_STEPS, 1) if freedom == "stiffness" else (MOST_POINT_STEPS, 3)
            self.bounds += [(-most, most)] * count
        self.tried = 0

    def best(self, pairs: Sequence[Pair]) -> tuple[Suit, tuple[str, ...], SearchOutcome]:
        """The suit of least mean cost over these pairs of cuffs, the parameters at their bounds, and the outcome."""

        def mean_cost(steps: Array) -> float:
            return self._mean_cost(steps, pairs)

        size = len(self.bounds)
        inwards = np.where(np.array(self.bounds)[:, 1] >= 1, 1.0, -1.0)
        options: Any = {
            "initial_simplex": np.vstack([np.zeros(size), np.diag(inwards)]),
            "xatol": PRECISION,
            "fatol": 1e-6,
            "maxfev": TRIES_PER_FREEDOM * size,
        }
        found = scipy.optimize.minimize(
            mean_cost, np.zeros(size), method="Nelder-Mead", bounds=self.bounds, options=options
        )
        outcome = SearchOutcome.CONVERGED if found.success else SearchOutcome.NOT_CONVERGED
        return self._suit(found.x), self._at_limit(found.x), outcome

    def _mean_cost(self, steps: Array, pairs: Sequence[Pair]) -> float:
        self.progress(STAGE, self.tried, 2 * TRIES_PER_FREEDOM * len(self.bounds))
        self.tried += 1
        try:
            return float(_costs(self.suited, self._suit(steps), self.condition, pairs).mean())
        except SuitError:
            return np.inf

    def _suit(self, steps: Array) -> Suit:
        suit, rest = self.suited.suit, iter(steps[1:])
        changed = replace(suit, reference_rest_length=suit.reference_rest_length + REST_LENGTH_STEP * float(steps[0]))
        for freedom in self.free:
            if freedom == "stiffness":
                changed = replace(changed, stiffness=suit.stiffness * float(np.exp(STIFFNESS_STEP * next(rest))))
            else:
                point = getattr(suit, freedom)
                moved = point.location + POINT_STEP * np.array([next(rest) for _ in range(3)])
                changed = replace(changed, **{freedom: replace(point, location=moved)})
        return changed

    def _at_limit(self, steps: Array) -> tuple[str, ...]:
        names = ["rest_length"]
        for freedom in self.free:
            names += [freedom] * (1 if freedom == "stiffness" else 3)
        room = np.abs(np.array(self.bounds).T - steps).min(axis=0)
        return tuple(dict.fromkeys(name for name, left in zip(names, room, strict=True) if left < 2 * PRECISION))

"""Which cuff to choose: probabilities of statements about the efforts of drawn people.

A difference matters if it reaches the smallest effect of interest. Two cuffs are equivalent if their difference is
smaller (Lakens et al. 2018, Adv. Methods Pract. Psychol. Sci. 1:259, equivalence testing). The probabilities are those
of a smoothed distribution of the drawn people: the share of 100 people for whom a statement is true has a standard
error of 2 points at 95 %, so that the largest shares would be overestimates.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import combinations
from typing import Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from solver.suit.quantity import MOST_UNKNOWN, interval_of_draws

Array = NDArray[np.float64]
Basis = Literal["at_reference", "at_best"]
"""Every cuff at the suit's reference rest length, or each at its own best rest length."""
BASES: Mapping[Basis, str] = {"at_reference": "at_reference", "at_best": "lowest_cost"}
"""Basis → field of CurveReadouts with the effort."""

NORMAL_QUARTILES = 1.349
"""Distance of the quartiles of a normal distribution in standard deviations."""


class DecisionOutcome(StrEnum):
    """CHOOSE one cuff; the leading ones are EQUIVALENT; UNDECIDED; ONLY_CUFF has no rival; UNKNOWN efforts."""

    CHOOSE = "choose"
    EQUIVALENT = "equivalent"
    UNDECIDED = "undecided"
    ONLY_CUFF = "only_cuff"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class DecisionRule:
    """relevant_difference: smallest effect of interest, relative to the effort with a slack cord; certainty: the
    probability above which a statement counts as true.
    """

    relevant_difference: float = 0.02
    certainty: float = 0.9


@dataclass(frozen=True)
class PairProbability:
    """Two cuffs: mean difference of their efforts, first less second, its 95 % interval, and three probabilities that
    add up to 1.

    first_saves_more, second_saves_more  by at least the relevant difference;  equivalent: neither does
    """

    cuffs: tuple[str, str]
    difference: float
    ci95: tuple[float, float]
    first_saves_more: float
    second_saves_more: float
    equivalent: float


@dataclass(frozen=True)
class CuffDecision:
    """The outcome for the cuffs, the one with the least mean effort first.

    leading      CHOOSE: the chosen cuff; EQUIVALENT: the equivalent ones; UNDECIDED: the one with the least mean effort
    worse        cuffs that save less than the leading one by at least the relevant difference
    undecided    cuffs that are neither equivalent nor worse with certainty
    probability  CHOOSE: that the leading cuff saves more than every other; EQUIVALENT: that all leading cuffs lie
                 within the relevant difference; otherwise None
    people       number of drawn people whose efforts are known
    """

    outcome: DecisionOutcome
    leading: tuple[str, ...]
    worse: tuple[str, ...]
    undecided: tuple[str, ...]
    probability: float | None
    pairs: tuple[PairProbability, ...]
    people: int


def decide(efforts: Mapping[str, Array], rule: DecisionRule | None = None) -> CuffDecision:
    """Decide from the efforts (people,) of every cuff, relative to a slack cord; NaN where a person has no solution.

    People without a solution for any of the cuffs are left out.
    """
    rule = rule or DecisionRule()
    names, drawn = list(efforts), np.array(list(efforts.values()))
    is_known = np.isfinite(drawn).all(axis=0)
    people = int(is_known.sum())
    if people == 0 or people < (1 - MOST_UNKNOWN) * len(is_known):
        return CuffDecision(DecisionOutcome.UNKNOWN, (), (), (), None, (), people)
    known = dict(zip(names, drawn[:, is_known], strict=True))
    lead, *others = sorted(names, key=lambda name: float(known[name].mean()))
    if not others:
        return CuffDecision(DecisionOutcome.ONLY_CUFF, (lead,), (), (), None, (), people)
    pairs = tuple(compare(known, pair, rule.relevant_difference) for pair in combinations(names, 2))
    behind = {name: compare(known, (lead, name), rule.relevant_difference) for name in others}
    worse = tuple(name for name in others if behind[name].first_saves_more > rule.certainty)
    equivalent = tuple(name for name in others if behind[name].equivalent > rule.certainty)
    undecided = tuple(name for name in others if name not in (*worse, *equivalent))
    outcome, probability = DecisionOutcome.UNDECIDED, None
    leading: tuple[str, ...] = (lead,)
    if not undecided:
        leading = (lead, *equivalent)
        outcome = DecisionOutcome.EQUIVALENT if equivalent else DecisionOutcome.CHOOSE
        probability = _joint(known, leading, worse, rule.relevant_difference)
        if probability <= rule.certainty:
            outcome, leading, undecided, probability = DecisionOutcome.UNDECIDED, (lead,), (*equivalent, *worse), None
            worse = ()
    return CuffDecision(outcome, leading, worse, undecided, probability, pairs, people)


def compare(efforts: Mapping[str, Array], cuffs: tuple[str, str], relevant_difference: float) -> PairProbability:
    """Probabilities for two cuffs from finite efforts (people,)."""
    difference = efforts[cuffs[0]] - efforts[cuffs[1]]
    first = _probability(-difference - relevant_difference)
    second = _probability(difference - relevant_difference)
    ends = interval_of_draws(difference)
    return PairProbability(cuffs, float(difference.mean()), ends, first, second, max(0.0, 1 - first - second))


def _joint(
    efforts: Mapping[str, Array], leading: Sequence[str], worse: Sequence[str], relevant_difference: float
) -> float:
    """Of several leading cuffs, that they lie within the relevant difference; of one, that all others are worse."""
    if len(leading) == 2:
        return compare(efforts, (leading[0], leading[1]), relevant_difference).equivalent
    led = np.array([efforts[name] for name in leading])
    if len(leading) > 1:
        return 1 - _probability(np.ptp(led, axis=0) - relevant_difference)
    others = np.array([efforts[name] for name in worse])
    return _probability(others.min(axis=0) - led[0] - relevant_difference)


def _probability(margin: Array) -> float:
    """That the margin of the next person is at least 0, from those of drawn people (people,).

    Normal kernels of Silverman's bandwidth around values that are shrunk to the mean, so that mean and variance remain
    those of the values (Silverman and Young 1987, Biometrika 74:469); the share itself if half of the values are equal.
    """
    mean, variance = float(margin.mean()), float(margin.var())
    spread = min(math.sqrt(variance), float(np.subtract(*np.quantile(margin, [0.75, 0.25]))) / NORMAL_QUARTILES)
    width = 0.9 * spread * len(margin) ** -0.2
    if width == 0.0:
        return float((margin >= 0).mean())
    shrunk = mean + (margin - mean) / math.sqrt(1 + width**2 / variance)
    return float(scipy.special.ndtr(shrunk / width).mean())

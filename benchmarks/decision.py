"""Calibration of the decision between two arm cuffs: simulated labs, claimed probabilities against what happens next.

    python -m benchmarks.decision [--labs 2000] [--wearers 60] [--people 100]

A lab measures one donning of two cuffs, whose true stiffness and migration are drawn from the range of plausible cuffs.
It draws people as `station assess` does: a wearer, and the next donning about the measured one. Then a new wearer dons
both cuffs, and every statement is true or false. Wearers differ in body, muscles and motion by the bundled budget; the
effort of each is solved on a grid of stiffness and migration and interpolated between. Prints for each statement how
often it was made, its mean claimed probability, and how often it was true, with 95 % intervals (Wilson).
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy
from numpy.typing import NDArray

from solver.bundled import bundled_model
from solver.cuff import CuffParameters
from solver.motion import differentiate
from solver.raise_arm import simulate_arm_raise
from solver.suit.decision import DecisionOutcome, DecisionRule, decide
from solver.suit.scenarios import LoadedMotion, SuitScenario, prepare_suited_motion, solve_scenarios
from solver.suit.suit import read_suit
from solver.uncertainty.factors import normal_scores, random_factors, scores_by_factor, unit_sample
from solver.uncertainty.sources import DonningSpread, UncertaintySources
from solver.uncertainty.varied_model import NEXT_DONNING, varied_model, varied_options, varied_suit
from solver.uncertainty.varied_motion import MotionDraws, varied_motion

Array = NDArray[np.float64]
Limits = tuple[tuple[float, float], tuple[float, float]]

STIFFNESS, MIGRATION = (600.0, 20000.0), (0.0, 0.065)  # N/m and m, of the grid
RANGES = {
    "about the published cuffs": ((2000.0, 9000.0), (0.005, 0.025)),
    "wide": ((1500.0, 12000.0), (0.002, 0.040)),
}
"""Stiffness [N/m] and migration [m] of true cuffs, uniform in their logarithms."""
NODES = 8, 12
FRAMES = 20
BINS = (0.0, 0.5, 0.8, 0.9, 0.95, 0.99, 1.0)


@dataclass(frozen=True)
class Lab:
    """What a lab claims about the next wearer, and whether it was so."""

    outcome: DecisionOutcome
    claimed: float
    is_true: bool
    pair: tuple[tuple[float, bool], ...]


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    arguments.add_argument("--labs", type=int, default=2000)
    arguments.add_argument("--wearers", type=int, default=60)
    arguments.add_argument("--people", type=int, default=100)
    chosen = arguments.parse_args()
    efforts = solved_efforts(2 * chosen.wearers)
    known, new = efforts[: chosen.wearers], efforts[chosen.wearers :]
    for name, limits in RANGES.items():
        for factor in (float(NEXT_DONNING), 1.0):
            generator = np.random.default_rng(1)
            labs = [simulate(known, new, chosen.people, factor, limits, generator) for _ in range(chosen.labs)]
            print(f"\n{name}, next donning with {factor:.3g} times the spread; {chosen.labs} labs")
            print_decisions(labs)
            print_probabilities(labs)


def simulate(
    known: Surfaces, new: Surfaces, people: int, factor: float, limits: Limits, generator: np.random.Generator
) -> Lab:
    """One lab and its next wearer. Both cuffs are measured in one donning."""
    spread = DonningSpread()
    spreads = np.array([spread.stiffness, spread.migration])
    true = np.column_stack(
        [
            np.exp(generator.uniform(*np.log(limits[0]), 2)),
            np.exp(generator.uniform(*np.log(limits[1]), 2)),
        ]
    )
    measured = true * np.exp(spreads * generator.standard_normal((2, 2)))
    drawn = measured * np.exp(factor * spreads * generator.standard_normal((people, 2, 2)))
    wearers = generator.integers(len(known), size=people)
    rule = DecisionRule()
    efforts = np.array([known[wearer](cuffs) for wearer, cuffs in zip(wearers, drawn, strict=True)])
    decision = decide({"a": efforts[:, 0], "b": efforts[:, 1]}, rule)
    a, b = new[int(generator.integers(len(new)))](true * np.exp(spreads * generator.standard_normal((2, 2))))
    ahead = {"a": b - a, "b": a - b}
    (pair,) = decision.pairs
    truths = (
        (pair.first_saves_more, bool(b - a >= rule.relevant_difference)),
        (pair.second_saves_more, bool(a - b >= rule.relevant_difference)),
        (pair.equivalent, bool(abs(a - b) < rule.relevant_difference)),
    )
    lead = decision.leading[0]
    is_true = truths[2][1] if len(decision.leading) > 1 else bool(ahead[lead] >= rule.relevant_difference)
    return Lab(decision.outcome, decision.probability or np.nan, is_true, truths)


class Surface:
    """Effort of one wearer over log stiffness and migration, by a bicubic spline."""

    def __init__(self, stiffness: Array, migration: Array, effort: Array) -> None:
        self._spline = scipy.interpolate.RectBivariateSpline(np.log(stiffness), migration, effort, kx=3, ky=3)

    def __call__(self, cuffs: Array) -> Array:
        """Effort (cuffs,) of cuffs (cuffs, 2) with stiffness [N/m] and migration [m], within the grid."""
        stiffness, migration = cuffs.T
        found: Array = self._spline.ev(np.log(stiffness.clip(*STIFFNESS)), migration.clip(*MIGRATION))
        return found


Surfaces = list[Surface]


def solved_efforts(wearers: int) -> Surfaces:
    """Of wearers drawn from body, muscles and motion of the budget, at the reference rest length of the suit."""
    model, suit = bundled_model(), read_suit()
    motion = LoadedMotion(model, differentiate(simulate_arm_raise(model)))
    sources = replace(UncertaintySources(), donning=DonningSpread(0.0, 0.0, 0.0))
    factors = random_factors(sources, model, ())
    draws = MotionDraws(model, (motion.kinematics,))
    stiffness = np.geomspace(*STIFFNESS, NODES[0])
    migration = np.linspace(*MIGRATION, NODES[1])
    waist = CuffParameters("waist", "waist", 2140.0, 124.0, 0.0121)
    length = np.array([suit.reference_rest_length])
    found = []
    for row in normal_scores(unit_sample(factors, wearers, "latin_hypercube", seed=1)):
        scores = scores_by_factor(factors, row)
        varied = replace(
            motion,
            model=replace(
                varied_model(model, sources.body, sources.muscles, scores),
                coordinates=tuple(replace(one, range=(-np.inf, np.inf)) for one in model.coordinates),
            ),
            kinematics=varied_motion(draws, sources.motion, scores),
            options=varied_options(motion.options, sources.muscles, scores),
        )
        every = max(1, len(motion.kinematics.time) // FRAMES)
        suited = prepare_suited_motion(varied, varied_suit(suit, sources.body, scores), every)
        scenarios = [
            SuitScenario("both", waist, CuffParameters("arm", "arm", k, 150.0, m), length)
            for k in stiffness.tolist()
            for m in migration.tolist()
        ]
        effort = np.array([one.muscles[0] for one in solve_scenarios(suited, scenarios)[1]]).reshape(NODES)
        if np.isfinite(effort).all():
            found.append(Surface(stiffness, migration, effort))
    return found


def print_decisions(labs: list[Lab]) -> None:
    print("| statement | labs | claimed | true | difference |\n|---|---|---|---|---|")
    for outcome in (DecisionOutcome.CHOOSE, DecisionOutcome.EQUIVALENT):
        made = [lab for lab in labs if lab.outcome is outcome]
        if made:
            print_row(outcome.value, np.array([lab.claimed for lab in made]), np.array([lab.is_true for lab in made]))
    print(f"| undecided | {sum(lab.outcome is DecisionOutcome.UNDECIDED for lab in labs)} | | | |")


def print_probabilities(labs: list[Lab]) -> None:
    """Of the three probabilities of every lab, by what is claimed."""
    claimed, is_true = (np.array([pair[i] for lab in labs for pair in lab.pair]) for i in (0, 1))
    for low, high in pairwise(BINS):
        inside = (claimed >= low) & ((claimed < high) | (high == 1.0))
        if inside.any():
            print_row(f"a probability of {low:.0%} to {high:.0%}", claimed[inside], is_true[inside])


def print_row(name: str, claimed: Array, is_true: NDArray[np.bool_]) -> None:
    interval = scipy.stats.binomtest(int(is_true.sum()), len(is_true)).proportion_ci(method="wilson")
    difference = 100 * (is_true.mean() - claimed.mean())
    true = f"{100 * is_true.mean():.1f} % ({100 * interval.low:.1f} to {100 * interval.high:.1f})"
    print(f"| {name} | {len(is_true)} | {100 * claimed.mean():.1f} % | {true} | {difference:+.1f} points |")


if __name__ == "__main__":
    main()

"""Calibration of the decision between two arm cuffs: simulated labs, claimed probabilities against what happens next.

    python -m benchmarks.decision [--labs 12000] [--people 100] [--samples 12] [--only 1,4] [--seed 0]

A lab measures one donning of two cuffs and draws people as `station assess` does, from a Latin hypercube: a wearer, and
the next donning about the measured one. Then another wearer dons both cuffs, and every statement is true or false:
which cuff saves more, at the reference rest length and each at its own best one, and in which interval the best rest
length lies. Wearers are drawn from body, muscles and motion of a budget; the effort of each is solved on a grid of
stiffness and rest length. A lab has the wearers of one sample, the next wearer is one of all samples.

True cuffs are uniform in the logarithms of stiffness and migration, wider than what a lab may have measured, so that
all that was measured is equally likely. The last table draws them from the published range alone: first as a lab that
does not know this range, then as one that does. Prints for each statement how often it was made, its mean claimed
probability, how often it was true, with 95 % intervals (Wilson), and the difference with its standard error.
--samples are Latin hypercubes of people, --only numbers of populations; another --seed draws other labs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cache
from itertools import pairwise

import numpy as np
import scipy
from numpy.typing import NDArray

from benchmarks.command_line import parse_options
from solver.bundled import bundled_model, simulate_arm_raise
from solver.cuff import CuffParameters
from solver.motion import differentiate
from solver.redundancy.motion_solution import LoadedMotion
from solver.suit.cord import SuitScenario
from solver.suit.decision import BASES, Basis, CuffDecision, DecisionOutcome, DecisionRule, decide
from solver.suit.quantity import interval_of_draws
from solver.suit.scenarios import LARGE_RESERVES, SuitedMotion, prepare_suited_motion, solve_scenarios
from solver.suit.suit import read_suit
from solver.uncertainty.factors import normal_scores, random_factors, scores_by_factor, unit_sample
from solver.uncertainty.sources import DonningSpread, UncertaintySources
from solver.uncertainty.varied_model import NEXT_DONNING, varied_model, varied_options, varied_suit
from solver.uncertainty.varied_motion import MotionDraws, varied_motion

Array = NDArray[np.float64]
Limits = tuple[tuple[float, float], tuple[float, float]]
"""Least and greatest stiffness [N/m] and migration [m]."""

TRUE_CUFFS: Limits = ((1000.0, 18000.0), (0.0012, 0.070))
PUBLISHED: Limits = ((2000.0, 9000.0), (0.005, 0.025))
WIDE: Limits = ((1500.0, 12000.0), (0.002, 0.040))
SPREADS = np.array([DonningSpread().stiffness, DonningSpread().migration])
NODES = 8, 16
FINE = 49, 129
"""Points of the grid in stiffness and shortening that is solved, and of that between which is interpolated linearly."""
LONGEST_SHORTENING = 0.32
"""m of the cord below the rest length at which it is slack."""
FRAMES = 20
WAIST = CuffParameters("waist", "waist", 2140.0, 124.0, 0.0121)
BINS = (0.0, 0.2, 0.5, 0.8, 0.9, 0.95, 0.99, 1.0)
NAMES = ("a", "b")


def is_within(limits: Limits) -> Callable[[Array], bool]:
    low, high = np.array(limits).T
    return lambda measured: bool(((measured >= low) & (measured <= high)).all())


def is_far_apart(measured: Array) -> bool:
    """Whether one cuff migrates little, and the other one much."""
    least, most = np.sort(measured[:, 1])
    return is_within(WIDE)(measured) and bool(least < 6e-3 and most > 25e-3)


POPULATIONS: tuple[tuple[str, str, Limits, Callable[[Array], bool], bool], ...] = (
    ("measured within the published range", "bundled budget", TRUE_CUFFS, is_within(PUBLISHED), False),
    ("measured within a wide range", "bundled budget", TRUE_CUFFS, is_within(WIDE), False),
    ("measured within a wide range", "half of it", TRUE_CUFFS, is_within(WIDE), False),
    ("measured far apart", "half of it", TRUE_CUFFS, is_far_apart, False),
    ("true cuffs within the published range", "bundled budget", PUBLISHED, is_within(TRUE_CUFFS), False),
    ("true cuffs within the published range, known", "bundled budget", PUBLISHED, is_within(TRUE_CUFFS), True),
)
"""Title, budget of the wearers, range of true cuffs, which measured ones are taken, whether the lab knows the range."""


def main() -> None:
    chosen = parse_options(__doc__, labs=12000, people=100, samples=12, only="", seed=0)
    budget = UncertaintySources()
    parts = {name: getattr(budget, name) for name in ("body", "muscles", "motion")}
    halves = {
        name: replace(part, **{one.name: 0.5 * getattr(part, one.name) for one in fields(part)})
        for name, part in parts.items()
    }
    titles = {"bundled budget": budget, "half of it": replace(budget, **halves)}
    solve = cache(lambda title: solve_wearers(titles[title], chosen.people, chosen.samples))
    wanted = [int(number) for number in chosen.only.split(",")] if chosen.only else range(1, len(POPULATIONS) + 1)
    for number in wanted:
        title, sources, limits, is_measured, knows_range = POPULATIONS[number - 1]
        generator = np.random.default_rng(number + 100 * chosen.seed)
        known = limits if knows_range else None
        cuffs = [draw_cuffs(limits, is_measured, generator) for _ in range(chosen.labs)]
        labs = [simulate(solve(sources), pair, known, generator) for pair in cuffs]
        print(f"\n{number}. {title}, {sources}; {chosen.labs} labs", flush=True)
        print_table(labs)


@dataclass(frozen=True)
class Lab:
    """Claim of a lab about the next wearer, and whether it was true.

    decisions  outcome, claimed probability and truth by basis
    pair       claimed probability and truth of every statement on the pair
    covers     whether the interval of the best rest length of each cuff contained that of the next wearer
    """

    decisions: dict[Basis, tuple[DecisionOutcome, float, bool]]
    pair: tuple[tuple[float, bool], ...]
    covers: tuple[bool, ...]


def draw_cuffs(
    limits: Limits, is_measured: Callable[[Array], bool], generator: np.random.Generator
) -> tuple[Array, Array]:
    """True and measured stiffness and migration (cuffs, 2) of a lab whose measurement is one of these."""
    low, high = np.log(np.array(limits)).T
    while True:
        true = np.exp(generator.uniform(low, high, (2, 2)))
        measured = true * np.exp(SPREADS * generator.standard_normal((2, 2)))
        if is_measured(measured):
            return true, measured


def simulate(wearers: Wearers, cuffs: tuple[Array, Array], known: Limits | None, generator: np.random.Generator) -> Lab:
    """One lab and its next wearer. known: the range of true cuffs, if the lab knows it."""
    true, measured = cuffs
    people = generator.permutation(wearers.samples[generator.integers(len(wearers.samples))])
    sample = scipy.stats.qmc.LatinHypercube(8, rng=generator).random(len(people)).reshape(len(people), 2, 2, 2)
    of_donning, of_mean = sample[:, 0], sample[:, 1]
    if known is None:
        drawn = measured * np.exp(NEXT_DONNING * SPREADS * normal_scores(of_donning))
    else:
        low, high = (np.log(np.array(known)).T[:, None] - np.log(measured)) / SPREADS
        means = scipy.stats.truncnorm.ppf(of_mean, low, high)
        drawn = measured * np.exp(SPREADS * (means + normal_scores(of_donning)))
    claimed = wearers.assess(people, drawn)
    one = generator.integers(len(wearers.slack), size=1)
    happened = wearers.assess(one, true * np.exp(SPREADS * generator.standard_normal((1, 2, 2))))
    rule, decisions = DecisionRule(), {}
    pair: tuple[tuple[float, bool], ...] = ()
    for basis, name in BASES.items():
        decision = decide(dict(zip(NAMES, claimed[name].T, strict=True)), rule)
        a, b = happened[name][0].tolist()
        is_true = _is_true(decision, {"a": b - a, "b": a - b}, rule.relevant_difference)
        decisions[basis] = decision.outcome, decision.probability or np.nan, is_true
        if basis == "at_reference":
            pair = _of_pair(decision, b - a, rule.relevant_difference)
    intervals = [interval_of_draws(values) for values in claimed["rest_length"].T]
    covers = tuple(
        low <= value <= high for (low, high), value in zip(intervals, happened["rest_length"][0].tolist(), strict=True)
    )
    return Lab(decisions, pair, covers)


def _is_true(decision: CuffDecision, ahead: dict[str, float], relevant: float) -> bool:
    if len(decision.leading) > 1:
        return abs(ahead["a"]) < relevant
    return ahead[decision.leading[0]] >= relevant


def _of_pair(decision: CuffDecision, ahead: float, relevant: float) -> tuple[tuple[float, bool], ...]:
    (pair,) = decision.pairs
    return (
        (pair.first_saves_more, ahead >= relevant),
        (pair.second_saves_more, -ahead >= relevant),
        (pair.equivalent, abs(ahead) < relevant),
    )


@dataclass(frozen=True, eq=False)
class Wearers:
    """Effort (wearers, stiffness, shortening) on the fine grid, where the cord is shorter than a slack one by as much.

    samples    of which a lab has one: indices of its wearers
    slack (wearers,) longest line of the cord [m];  least, best (wearers, stiffness) least effort and its shortening [m]
    reference  rest length [m]
    """

    samples: tuple[NDArray[np.int64], ...]
    effort: Array
    slack: Array
    least: Array
    best: Array
    reference: float

    def assess(self, wearers: NDArray[np.int64], cuffs: Array) -> dict[str, Array]:
        """Readouts (people, cuffs) of wearers (people,) with the stiffness and migration of cuffs (people, cuffs, 2).

        A cuff that migrates along the cord slackens it by the migration.
        """
        low, high = np.log(TRUE_CUFFS[0])
        at_stiffness = (np.log(cuffs[..., 0]) - low) / (high - low) * (FINE[0] - 1)
        migration = cuffs[..., 1] + WAIST.migration
        shortening = (self.slack[wearers, None] - self.reference - migration).clip(0, LONGEST_SHORTENING)
        who = np.broadcast_to(wearers[:, None], at_stiffness.shape)
        place = np.array([who, at_stiffness, shortening / LONGEST_SHORTENING * (FINE[1] - 1)])
        return {
            "at_reference": _interpolated(self.effort, place),
            "lowest_cost": _interpolated(self.least, place[:2]),
            "rest_length": self.slack[wearers, None] - migration - _interpolated(self.best, place[:2]),
        }


def _interpolated(table: Array, place: Array) -> Array:
    found: Array = scipy.ndimage.map_coordinates(table, place, order=1, mode="nearest")
    return found


def solve_wearers(sources: UncertaintySources, people: int, samples: int) -> Wearers:
    """Samples of people drawn from body, muscles and motion; without those whose muscles cannot do the motion."""
    model, suit = bundled_model(), read_suit()
    motion = LoadedMotion(model, differentiate(simulate_arm_raise(model)))
    sources = replace(sources, donning=DonningSpread(0.0, 0.0, 0.0))
    factors, draws = random_factors(sources, model, ()), MotionDraws(model, motion.kinematics)
    efforts, slack, sample_of = [], [], []
    rows = [unit_sample(factors, people, "latin_hypercube", seed) for seed in range(1, samples + 1)]
    for person, row in enumerate(normal_scores(np.concatenate(rows))):
        scores = scores_by_factor(factors, row)
        own = varied_model(model, sources.body, sources.muscles, scores)
        own = replace(own, coordinates=tuple(replace(one, range=(-np.inf, np.inf)) for one in own.coordinates))
        kinematics = varied_motion(draws, sources.motion, scores)
        options = varied_options(motion.options, sources.muscles, scores)
        every = max(1, len(kinematics.time) // FRAMES)
        wearer = LoadedMotion(own, kinematics, motion.loads, options)
        suited = prepare_suited_motion(wearer, varied_suit(suit, sources.body, scores), every)
        if (effort := _solve_grid(suited)) is not None:
            efforts.append(effort)
            slack.append(float(suited.line.length.max()))
            sample_of.append(person // people)
    of_samples = tuple(np.flatnonzero(np.array(sample_of) == sample) for sample in range(samples))
    effort = np.array(efforts)
    best = effort.argmin(axis=2) / (FINE[1] - 1) * LONGEST_SHORTENING
    return Wearers(of_samples, effort, np.array(slack), effort.min(axis=2), best, suit.reference_rest_length)


def _solve_grid(suited: SuitedMotion) -> Array | None:
    """Effort on the fine grid by bicubic splines; None for an infeasible motion."""
    stiffness = np.geomspace(*TRUE_CUFFS[0], NODES[0])
    shortening = np.linspace(LONGEST_SHORTENING, 0.0, NODES[1])
    lengths = float(suited.line.length.max()) - shortening
    scenarios = [
        SuitScenario("visco_elastic", WAIST, CuffParameters("arm", "arm", k, 150.0, 0.0), lengths)
        for k in stiffness.tolist()
    ]
    solved = solve_scenarios(suited, scenarios)[1]
    effort = np.array([one.muscles for one in solved])[:, ::-1]
    if not np.isfinite(effort).all() or solved[0].reserves[-1] > LARGE_RESERVES:
        return None
    (x, y), (fine_x, fine_y) = ([np.linspace(0.0, 1.0, size) for size in sizes] for sizes in (NODES, FINE))
    found: Array = scipy.interpolate.RectBivariateSpline(x, y, effort, kx=3, ky=3)(fine_x, fine_y)
    return found


def print_table(labs: Sequence[Lab]) -> None:
    print("| statement | made | claimed | true | difference |\n|---|---|---|---|---|")
    for basis in BASES:
        for outcome in (DecisionOutcome.CHOOSE, DecisionOutcome.EQUIVALENT):
            made = [lab.decisions[basis] for lab in labs if lab.decisions[basis][0] is outcome]
            if made:
                print_row(f"{outcome}, {basis}", [claimed for _, claimed, _ in made], [is_true for *_, is_true in made])
        undecided = sum(lab.decisions[basis][0] is DecisionOutcome.UNDECIDED for lab in labs)
        print(f"| undecided, {basis} | {undecided} | | | |")
    claimed, is_true = (np.array([pair[i] for lab in labs for pair in lab.pair]) for i in (0, 1))
    for low, high in pairwise(BINS):
        inside = (claimed >= low) & ((claimed < high) | (high == 1.0))
        if inside.any():
            print_row(f"a probability of {low:.0%} to {high:.0%}", claimed[inside], is_true[inside])
    covers = [one for lab in labs for one in lab.covers]
    print_row("best rest length in its interval", [0.95] * len(covers), covers)


def print_row(name: str, claimed: Sequence[float] | Array, is_true: Sequence[bool] | Array) -> None:
    interval = scipy.stats.binomtest(int(np.sum(is_true)), len(is_true)).proportion_ci(method="wilson")
    difference = 100 * (np.mean(is_true) - np.mean(claimed))
    error = 100 * np.std(np.array(is_true, dtype=float) - claimed) / np.sqrt(len(is_true))
    true = f"{100 * np.mean(is_true):.1f} % ({100 * interval.low:.1f} to {100 * interval.high:.1f})"
    off = f"{difference:+.1f} ± {error:.1f} points"
    print(f"| {name} | {len(is_true)} | {100 * np.mean(claimed):.1f} % | {true} | {off} |")


if __name__ == "__main__":
    main()

"""Uncertainty of the assessment: evaluate it again with drawn cuffs and, where there are any, drawn motions.

Cuffs are drawn from the covariance of their fit. Draws use fewer frames and rest lengths than the assessment. A drawn
result is therefore compared with the fitted cuffs on the same frames and lengths; the effect of this decimation is
reported.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from solver.checks import ensure_at_least
from solver.cuff import CuffParameters
from solver.errors import SolverCode
from solver.motion import Kinematics
from solver.suit.readouts import CurveReadouts, read_off_curves, stacked
from solver.suit.scenarios import CUFF_CONDITIONS, Condition, SuitedMotion, SuitScenario, solve_scenarios
from solver.suit.suit import SuitError

Array = NDArray[np.float64]
Place = tuple[Condition, str | None]
"""Condition and arm cuff's name, None where all cuffs are rigid."""

Pair = tuple[CuffParameters | None, CuffParameters]
"""A waist and an arm cuff of one draw."""

SEED = 1
NODES = 8  # rest lengths of a drawn curve
PAIRS_AT_ONCE = 40  # bounds the memory
MOST_TRIES = 100  # a draw
MOST_APART, LEAST_FRAMES = 20, 30


class DrawnSource(StrEnum):
    """A source of uncertainty that draws propagate."""

    CUFFS = "cuffs"
    MOTIONS = "motions"


@dataclass(frozen=True, eq=False)
class DrawSettings:
    """How uncertainty is propagated: draws of all cuffs, solved in every N-th frame.

    every    N; None: 20, or less where a short motion, as a stride, would keep fewer than 30 frames
    motions  with the frames of the assessed one, drawn from the uncertainty of its postures; the draws use them in turn
    """

    count: int = 200
    every: int | None = None
    motions: Sequence[Kinematics] = ()

    def __post_init__(self) -> None:
        """Raise ModelError for a number of draws below 0, or of frames below 1."""
        ensure_at_least("draws", self.count, 0)
        if self.every is not None:
            ensure_at_least("every", self.every, 1)

    def sources(self, cuffs: Iterable[CuffParameters]) -> tuple[DrawnSource, ...]:
        """What differs between draws with these cuffs; empty: no draw would differ from the assessment."""
        if not self.count:
            return ()
        of_cuffs = (DrawnSource.CUFFS,) if any(cuff.covariance.any() for cuff in cuffs) else ()
        return (*of_cuffs, DrawnSource.MOTIONS) if self.motions else of_cuffs

    def frames_apart(self, frames: int) -> int:
        """N for a motion with so many frames."""
        return self.every or min(MOST_APART, max(1, frames // LEAST_FRAMES))


@dataclass(frozen=True, eq=False)
class DrawnScenarios:
    """Readouts of all conditions with all cuffs: first of the fitted cuffs, then of the draws.

    One draw is one motion and one set of cuffs. Its waist cuff is combined with each of its arm cuffs, so that these
    compare pair by pair. Of rigid cuffs there is one reading per motion.
    """

    readouts: Mapping[Place, CurveReadouts]
    count: int
    every: int


def draw_cuff(cuff: CuffParameters, count: int, generator: np.random.Generator) -> list[CuffParameters]:
    """The fitted cuff, then `count` draws from its covariance; draws without positive stiffness are repeated.

    If the stiffness of the cuff is positive, so is at least every second draw. Raises SuitError where MOST_TRIES tries
    a draw are not enough, as with a stiffness that is negative or not finite.
    """
    errors = np.sqrt(np.diag(cuff.covariance))
    scale = np.where(errors > 0, errors, 1.0)
    sizes, directions = np.linalg.eigh(cuff.covariance / np.outer(scale, scale))
    root = scale[:, None] * directions * np.sqrt(sizes.clip(0))
    drawn = [cuff]
    for _ in range(MOST_TRIES * count):
        if len(drawn) > count:
            break
        stiffness, damping, migration = np.array([cuff.stiffness, cuff.damping, cuff.migration]) + (
            root @ generator.standard_normal(3)
        )
        if stiffness > 0:
            drawn.append(replace(cuff, stiffness=stiffness, damping=damping, migration=migration))
    if len(drawn) <= count:
        raise SuitError(
            f"the cuff {cuff.name} should have a positive stiffness, and {cuff.stiffness:g} N/m with its covariance "
            f"gave {len(drawn) - 1} of {count} draws in {MOST_TRIES * count} tries; fit it again",
            SolverCode.STIFFNESS_NOT_DRAWN,
        )
    return drawn


def solve_draws(
    motions: Sequence[SuitedMotion],
    waist: CuffParameters | None,
    arms: Sequence[CuffParameters],
    count: int,
    spans: Mapping[Place, tuple[float, float]],
    progress: Callable[[int, int], None] = lambda *_: None,
) -> DrawnScenarios:
    """Evaluate `count` draws of all cuffs, with every curve at a few rest lengths over its span [m] around its optimum.

    motions are the assessed one and those drawn from the uncertainty of its postures, which the draws use in turn;
    without any, every draw is of the assessed one. Spans are of the rest length and what the cuffs have slipped
    together, so that they follow drawn migrations. progress(done, total) counts pairs of a waist and an arm cuff.
    """
    generator = np.random.default_rng(SEED)
    waists = draw_cuff(waist, count, generator) if waist else [None] * (count + 1)
    draws = [list(zip(waists, draw_cuff(arm, count, generator), strict=True)) for arm in arms]
    total, done = len(arms) * (count + 1), 0
    progress(done, total)
    readouts: dict[Place, list[CurveReadouts]] = {}
    for suited, numbers in zip(motions, _share(count, len(motions)), strict=True):
        pairs = [drawn[number] for drawn in draws for number in numbers]
        for batch, found in _solve_in_batches(suited, pairs, spans):
            for place, readings in found.items():
                readouts.setdefault(place, []).extend(readings)
            done += batch
            progress(done, total)
    return DrawnScenarios({place: stacked(entries) for place, entries in readouts.items()}, count, motions[0].every)


def _share(count: int, motions: int) -> list[list[int]]:
    """Numbers of the draws that each motion is combined with; 0 are the fitted cuffs, in the assessed motion."""
    if motions == 1:
        return [list(range(count + 1))]
    return [[0], *(list(range(first, count + 1, motions - 1)) for first in range(1, motions))]


def _solve_in_batches(
    suited: SuitedMotion, pairs: Sequence[Pair], spans: Mapping[Place, tuple[float, float]]
) -> Iterator[tuple[int, dict[Place, list[CurveReadouts]]]]:
    """Number of pairs of a batch and its readouts; those of rigid cuffs come first, with a batch of no pairs."""
    reference = suited.suit.reference_rest_length
    rigid = SuitScenario("rigid", None, None, np.append(suited.suit.rest_lengths, reference))
    slack, (effort,) = solve_scenarios(suited, [rigid])
    yield 0, {("rigid", None): [read_off_curves(suited, slack, {"rigid": (rigid, effort)})["rigid"]]}
    for first in range(0, len(pairs), PAIRS_AT_ONCE):
        batch = pairs[first : first + PAIRS_AT_ONCE]
        scenarios = [scenario for pair in batch for scenario in _scenarios(*pair, spans, reference)]
        solved = zip(scenarios, solve_scenarios(suited, scenarios)[1], strict=True)
        found: dict[Place, list[CurveReadouts]] = {}
        for _, arm in batch:
            own = {scenario.condition: (scenario, result) for scenario, result in islice(solved, len(CUFF_CONDITIONS))}
            for condition, reading in read_off_curves(suited, slack, {"rigid": (rigid, effort), **own}).items():
                if condition != "rigid":
                    found.setdefault((condition, arm.name), []).append(reading)
        yield len(batch), found


def _scenarios(
    waist: CuffParameters | None, arm: CuffParameters, spans: Mapping[Place, tuple[float, float]], reference: float
) -> list[SuitScenario]:
    """A pair of cuffs in every condition, at rest lengths over its span and at the reference."""
    scenarios = []
    for condition in CUFF_CONDITIONS:
        cord = SuitScenario(condition, waist, arm, np.linspace(*spans[condition, arm.name], NODES), condition == "both")
        scenarios.append(replace(cord, rest_lengths=np.append(cord.rest_lengths - cord.migration, reference)))
    return scenarios

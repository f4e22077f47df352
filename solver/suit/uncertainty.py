"""Uncertainty of the assessment: evaluate it again with cuffs drawn from the covariance of their fit.

Draws use fewer frames and rest lengths than the assessment. A drawn result is therefore compared with the fitted cuffs
on the same frames and lengths; the effect of this decimation is reported.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from solver.cuff import CuffParameters
from solver.suit.readouts import CurveReadouts, read_off_curves, stacked
from solver.suit.scenarios import CUFF_CONDITIONS, Condition, SuitedMotion, SuitScenario, solve_scenarios

Array = NDArray[np.float64]
Place = tuple[Condition, str | None]
"""Condition and arm cuff's name, None where all cuffs are rigid."""

SEED = 1
NODES = 8  # rest lengths of a drawn curve
PAIRS_AT_ONCE = 40  # bounds the memory


@dataclass(frozen=True, eq=False)
class DrawnScenarios:
    """Readings of each condition with each cuff: first of the fitted cuffs, then of every draw.

    One draw is one set of cuffs: its waist is worn with each of its arm cuffs, so that arm cuffs compare pair by pair.
    """

    readouts: Mapping[Place, CurveReadouts]
    count: int
    every: int


def draw_cuff(cuff: CuffParameters, count: int, generator: np.random.Generator) -> list[CuffParameters]:
    """The fitted cuff, then `count` draws from its covariance; draws without positive stiffness are repeated."""
    errors = np.sqrt(np.diag(cuff.covariance))
    scale = np.where(errors > 0, errors, 1.0)
    sizes, directions = np.linalg.eigh(cuff.covariance / np.outer(scale, scale))
    root = scale[:, None] * directions * np.sqrt(sizes.clip(0))
    drawn = [cuff]
    while len(drawn) <= count:
        stiffness, damping, migration = np.array([cuff.stiffness, cuff.damping, cuff.migration]) + (
            root @ generator.standard_normal(3)
        )
        if stiffness > 0:
            drawn.append(replace(cuff, stiffness=stiffness, damping=damping, migration=migration))
    return drawn


def solve_draws(
    worn: SuitedMotion,
    waist: CuffParameters | None,
    arms: Sequence[CuffParameters],
    count: int,
    spans: Mapping[Place, tuple[float, float]],
    progress: Callable[[int, int], None] = lambda *_: None,
) -> DrawnScenarios:
    """Evaluate `count` draws of all cuffs, with every curve at a few rest lengths over its span [m] around its optimum.

    Spans are of the rest length and what the cuffs have slipped together, so that they follow drawn migrations.
    progress(done, total) counts pairs of a waist and an arm cuff.
    """
    generator = np.random.default_rng(SEED)
    waists = draw_cuff(waist, count, generator) if waist else [None] * (count + 1)
    pairs = [pair for arm in arms for pair in zip(waists, draw_cuff(arm, count, generator), strict=True)]
    progress(0, len(pairs))
    reference = worn.suit.reference_rest_length
    rigid = SuitScenario("rigid", None, None, np.append(worn.suit.rest_lengths, reference))
    slack, (effort,) = solve_scenarios(worn, [rigid])
    readouts: dict[Place, list[CurveReadouts]] = {
        ("rigid", None): [read_off_curves(worn, slack, {"rigid": (rigid, effort)})["rigid"]]
    }
    for first in range(0, len(pairs), PAIRS_AT_ONCE):
        batch = pairs[first : first + PAIRS_AT_ONCE]
        scenarios = [scenario for pair in batch for scenario in _scenarios(*pair, spans, reference)]
        solved = zip(scenarios, solve_scenarios(worn, scenarios)[1], strict=True)
        for _, arm in batch:
            own = {scenario.condition: (scenario, found) for scenario, found in islice(solved, len(CUFF_CONDITIONS))}
            for condition, reading in read_off_curves(worn, slack, {"rigid": (rigid, effort), **own}).items():
                if condition != "rigid":
                    readouts.setdefault((condition, arm.name), []).append(reading)
        progress(first + len(batch), len(pairs))
    return DrawnScenarios({place: stacked(entries) for place, entries in readouts.items()}, count, worn.every)


def _scenarios(
    waist: CuffParameters | None, arm: CuffParameters, spans: Mapping[Place, tuple[float, float]], reference: float
) -> list[SuitScenario]:
    """A pair of cuffs in every condition, at rest lengths over its span and at the reference."""
    scenarios = []
    for condition in CUFF_CONDITIONS:
        cord = SuitScenario(condition, waist, arm, np.linspace(*spans[condition, arm.name], NODES))
        scenarios.append(replace(cord, rest_lengths=np.append(cord.rest_lengths - cord.migration, reference)))
    return scenarios

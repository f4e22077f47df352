"""How sure the assessment is: cuffs are drawn from the covariance of their fit and worn again.

Muscles are solved in fewer frames and at fewer rest lengths than in the study itself, so each drawn number is taken
against the same number of the fitted cuffs on the same frames and lengths; what that thinning changes is reported.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from solver.cuff import CuffParameters
from solver.readings import Readings, read_curves, stacked
from solver.worn import CUFF_CONDITIONS, Condition, Wearing, WornMotion, solve_wearings

Array = NDArray[np.float64]
Place = tuple[Condition, str | None]
"""Condition and arm cuff's name, None where all cuffs are rigid."""

SEED = 1
NODES = 8  # rest lengths of a drawn curve


@dataclass(frozen=True, eq=False)
class Draws:
    """Readings of each condition with each cuff: first of the fitted cuffs, then of every draw.

    One draw is one set of cuffs: its waist is worn with each of its arm cuffs, so that arm cuffs compare pair by pair.
    """

    readings: Mapping[Place, Readings]
    count: int
    every: int


def draw_cuff(cuff: CuffParameters, count: int, generator: np.random.Generator) -> list[CuffParameters]:
    """The fitted cuff, then so many drawn from its covariance; where no spring came out, drawn again."""
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


def wear_draws(
    worn: WornMotion,
    waist: CuffParameters | None,
    arms: Sequence[CuffParameters],
    count: int,
    spans: Mapping[Place, tuple[float, float]],
    progress: Callable[[int, int], None] = lambda *_: None,
) -> Draws:
    """Wear `count` draws of all cuffs, each curve at a few rest lengths over its span [m], around its optimum."""
    generator = np.random.default_rng(SEED)
    reference = worn.suit.reference_rest_length
    waists = draw_cuff(waist, count, generator) if waist else [None] * (count + 1)
    pairs = [pair for arm in arms for pair in zip(waists, draw_cuff(arm, count, generator), strict=True)]
    wearings = [Wearing("rigid", None, None, np.append(worn.suit.rest_lengths, reference))]
    for pair in pairs:
        for condition in CUFF_CONDITIONS:
            nodes = np.linspace(*spans[condition, pair[1].name], NODES)
            wearings.append(Wearing(condition, *pair, np.append(nodes, reference)))
    slack, efforts = solve_wearings(worn, wearings, progress)
    rigid, *others = zip(wearings, efforts, strict=True)
    readings: dict[Place, list[Readings]] = {("rigid", None): [read_curves(worn, slack, {"rigid": rigid})["rigid"]]}
    for number, pair in enumerate(pairs):
        own = others[number * len(CUFF_CONDITIONS) :][: len(CUFF_CONDITIONS)]
        curves = read_curves(worn, slack, {"rigid": rigid, **dict(zip(CUFF_CONDITIONS, own, strict=True))})
        for condition in CUFF_CONDITIONS:
            readings.setdefault((condition, pair[1].name), []).append(curves[condition])
    return Draws({place: stacked(each) for place, each in readings.items()}, count, worn.every)

"""Random factors of the sources, and their quasi-random sample: Latin hypercube or Sobol sequence (scipy.stats.qmc)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from solver.cuff import CuffParameters
from solver.model import Array, Model
from solver.uncertainty.sources import Group, UncertaintySources

Scores = Mapping[str, Array]
"""Name of a factor → its standard normal scores (size,)."""

SamplingMethod = Literal["latin_hypercube", "sobol"]

OUTERMOST = 1e-9
"""Least and greatest probability of a sample; a Sobol sequence contains 0, whose normal score is infinite."""


@dataclass(frozen=True)
class RandomFactor:
    """A random factor: `size` independent standard normal scores."""

    name: str
    group: Group
    size: int


def random_factors(
    sources: UncertaintySources, model: Model, cuffs: Sequence[CuffParameters], drawn_motions: int = 0
) -> tuple[RandomFactor, ...]:
    """The factors with a spread, group by group. With motions of a wearer, each drawn with its own body, one score
    chooses among them in place of the size and of errors of posture, which remain for angles that no draw varies.
    """
    muscles, coordinates = len(model.muscles), len(model.coordinates)
    body, muscle, motion = sources.body, sources.muscles, sources.motion
    has_donning = any(sources.donning.spreads)
    has_estimate = has_donning and bool(np.isfinite(sources.donning.freedom).any())
    has_own = drawn_motions > 0
    given: list[tuple[str, Group, int, float]] = [
        *(
            (f"fit.{cuff.name}", "fit", len(cuff.UNITS), sources.fit.factor * float(cuff.covariance.any()))
            for cuff in cuffs
        ),
        *((f"donning.{cuff.name}", "donning", 3, float(has_donning)) for cuff in cuffs),
        ("donning_spread", "donning", 3, float(has_estimate)),
        ("size", "body", 1, 0.0 if has_own else body.size),
        ("segment_mass", "body", 3, body.segment_mass),
        ("attachment_point", "body", 9, body.attachment_point),
        ("cord_stiffness", "body", 1, body.cord_stiffness),
        ("strength", "muscles", 1, muscle.strength),
        ("max_isometric_force", "muscles", muscles, muscle.max_isometric_force),
        ("optimal_fiber_length", "muscles", muscles, muscle.optimal_fiber_length),
        ("tendon_slack_length", "muscles", muscles, muscle.tendon_slack_length),
        ("path_point", "muscles", 6 * muscles, muscle.path_point),
        ("glenoid_radius", "muscles", 1, muscle.glenoid_radius),
        ("reserve_weight", "muscles", 1, muscle.reserve_weight),
        ("drawn_motion", "motion", 1, float(has_own)),
        ("posture", "motion", coordinates, motion.posture),
        ("noise", "motion", 1, 0.0 if has_own else motion.noise),
        ("amplitude", "motion", coordinates, motion.amplitude),
        ("duration", "motion", 1, motion.duration),
    ]
    return tuple(RandomFactor(name, group, size) for name, group, size, spread in given if spread > 0)


def unit_sample(factors: Sequence[RandomFactor], count: int, method: SamplingMethod, seed: int) -> Array:
    """(count, scores) in [0, 1): stratified in every score (Latin hypercube), or a scrambled Sobol sequence, which is
    balanced if count is a power of two.
    """
    scores = sum(factor.size for factor in factors)
    if method == "latin_hypercube":
        sample: Array = scipy.stats.qmc.LatinHypercube(scores, rng=np.random.default_rng(seed)).random(count)
        return sample
    exponent = int(np.ceil(np.log2(max(count, 1))))
    sequence: Array = scipy.stats.qmc.Sobol(scores, rng=np.random.default_rng(seed)).random_base2(exponent)[:count]
    return sequence


def normal_scores(unit: Array) -> Array:
    """Standard normal quantiles of samples in [0, 1]."""
    scores: Array = scipy.special.ndtri(unit.clip(OUTERMOST, 1 - OUTERMOST))
    return scores


def scores_by_factor(factors: Sequence[RandomFactor], scores: Array) -> dict[str, Array]:
    """Scores (scores,) of one person, by the name of the factor."""
    ends = np.cumsum([factor.size for factor in factors])
    return dict(zip((factor.name for factor in factors), np.split(scores, ends[:-1]), strict=True))


def factor_columns(factors: Sequence[RandomFactor], names: Sequence[str]) -> NDArray[np.int64]:
    """Columns of the scores of these factors."""
    of_column = np.repeat([factor.name for factor in factors], [factor.size for factor in factors])
    columns: NDArray[np.int64] = np.flatnonzero(np.isin(of_column, list(names)))
    return columns

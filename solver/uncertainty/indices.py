"""Sobol indices of the groups of sources: how much of a result's variance each of them explains.

First order: expected share of the variance that disappears once the group is known. Total: share that remains if
everything else is known, interactions included. Sample and estimators are SALib's (Saltelli et al. 2010, Comput. Phys.
Commun. 181:259), groups as in Saltelli et al. 2008, Global Sensitivity Analysis, chapter 4.
"""

from __future__ import annotations

import warnings
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from solver.uncertainty.factors import RandomFactor, normal_scores

Array = NDArray[np.float64]
Result = TypeVar("Result", bound=Hashable)

RESAMPLES = 200  # of the bootstrap
LEAST_BLOCKS = 8
"""Complete blocks of the sample below which there are no indices."""


@dataclass(frozen=True, eq=False)
class SobolIndices:
    """Indices (groups,) of one result with the half-widths of their 95 % bootstrap intervals.

    variance of the result;  blocks: complete blocks of the sample, which the estimates are made of
    """

    groups: tuple[str, ...]
    first: Array
    first_half_width: Array
    total: Array
    total_half_width: Array
    variance: float
    blocks: int


def group_names(factors: Sequence[RandomFactor]) -> tuple[str, ...]:
    """The groups of these factors, in their order."""
    return tuple(dict.fromkeys(factor.group for factor in factors))


def group_sample(factors: Sequence[RandomFactor], blocks: int, seed: int) -> Array:
    """Normal scores (blocks · (groups + 2), scores) of Saltelli's design; blocks should be a power of two."""
    from SALib.sample import sobol

    return normal_scores(sobol.sample(_problem(factors), blocks, calc_second_order=False, scramble=True, seed=seed))


def sobol_indices(
    factors: Sequence[RandomFactor], results: Mapping[Result, Array], seed: int
) -> dict[Result, SobolIndices | None]:
    """Indices of every result (people,) of group_sample. Blocks with an unknown value are left out; None where too few
    remain, or where the result does not vary.
    """
    return {name: _indices(factors, values, seed) for name, values in results.items()}


def _indices(factors: Sequence[RandomFactor], values: Array, seed: int) -> SobolIndices | None:
    from SALib.analyze import sobol

    groups = group_names(factors)
    blocks = values.reshape(-1, len(groups) + 2)
    blocks = blocks[np.isfinite(blocks).all(axis=1)]
    if len(blocks) < LEAST_BLOCKS or np.ptp(blocks) == 0:
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of an index whose bootstrap does not vary
        found = sobol.analyze(
            _problem(factors), blocks.ravel(), calc_second_order=False, num_resamples=RESAMPLES, seed=seed + 1
        )
    return SobolIndices(
        groups=groups,
        first=np.array(found["S1"], dtype=np.float64),
        first_half_width=np.array(found["S1_conf"], dtype=np.float64),
        total=np.array(found["ST"], dtype=np.float64),
        total_half_width=np.array(found["ST_conf"], dtype=np.float64),
        variance=float(np.var(blocks[:, [0, -1]])),
        blocks=len(blocks),
    )


def _problem(factors: Sequence[RandomFactor]) -> dict[str, Any]:
    scores = sum(factor.size for factor in factors)
    return {
        "num_vars": scores,
        "names": [f"{factor.name}.{index}" for factor in factors for index in range(factor.size)],
        "groups": [factor.group for factor in factors for _ in range(factor.size)],
        "bounds": [[0.0, 1.0]] * scores,
    }

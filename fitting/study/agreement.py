"""Agreement of pairs of measurements (Bland and Altman 1999, Stat. Methods Med. Res. 8:135)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from fitting.study.fixed_effects import quantile
from fitting.study.reml import Array
from fitting.uncertainty import NORMAL_95

FEWEST_PAIRS = 3


@dataclass(frozen=True)
class Agreement:
    """Bias (second − first) and 95 % limits of agreement with their 95 % intervals, in the unit of the pairs.

    means and differences (pairs,); the limits are NaN for fewer than three pairs.
    """

    means: Array
    differences: Array
    bias: float
    bias_ci95: tuple[float, float]
    limits: tuple[float, float]
    limits_ci95: tuple[tuple[float, float], tuple[float, float]]


def agree(pairs: Array) -> Agreement:
    """Bland–Altman analysis of independent pairs (pairs, 2).

    The interval of a limit is t √(1/n + 1.96²/(2 (n − 1))) standard deviations of the differences, as in section 2.2.
    """
    differences = pairs[:, 1] - pairs[:, 0]
    count = len(differences)
    means, bias = pairs.mean(axis=1), float(differences.mean()) if count else math.nan
    if count < FEWEST_PAIRS:
        none = (math.nan, math.nan)
        return Agreement(means, differences, bias, none, none, (none, none))
    spread, t = float(differences.std(ddof=1)), quantile(count - 1)
    reach = t * spread / math.sqrt(count)
    limits = (bias - NORMAL_95 * spread, bias + NORMAL_95 * spread)
    half = t * spread * math.sqrt(1 / count + NORMAL_95**2 / (2 * (count - 1)))
    low, high = limits
    return Agreement(
        means,
        differences,
        bias,
        (bias - reach, bias + reach),
        limits,
        ((low - half, low + half), (high - half, high + half)),
    )

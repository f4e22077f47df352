"""Power of a comparison of two cuffs that the same volunteers wear."""

from __future__ import annotations

import math
from dataclasses import dataclass

import scipy


@dataclass(frozen=True)
class ExpectedSpread:
    """Standard deviations of a quantity: between volunteers beyond what both cuffs share, donnings, and repeats."""

    volunteer_by_cuff: float
    donning: float
    repeat: float


def difference_error(spread: ExpectedSpread, noise: float, volunteers: int, donnings: int, repeats: int) -> float:
    """Standard error of the mean difference; noise: standard error of a donning's value from the trials' noise.

    Each cuff of each volunteer is donned `donnings` times, with `repeats` trials in each.
    """
    of_donning = spread.donning**2 + spread.repeat**2 / repeats + noise**2
    return math.sqrt(2 * (spread.volunteer_by_cuff**2 + of_donning / donnings) / volunteers)


def paired_power(difference: float, standard_error: float, volunteers: int, significance: float) -> float:
    """Probability that a two-sided paired t test finds the difference: noncentral t, n − 1 degrees of freedom."""
    dof = volunteers - 1
    critical = float(scipy.stats.t.ppf(1 - significance / 2, dof))
    shift = abs(difference) / standard_error
    return float(scipy.stats.nct.sf(critical, dof, shift) + scipy.stats.nct.cdf(-critical, dof, shift))

"""Power of a comparison of two cuffs that the same volunteers wear, and the information of one trial.

The Fisher information about stiffness and damping follows from the noise of the instruments and the measurement model
alone, not from the code of the fits; the tests compare the standard errors that the fits report with it. All noise is
white, and the law is F = k x + c ẋ + m ẍ + F0.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from documents.validation import NonNegative
from fitting.study.restricted_likelihood import Array


@dataclass(frozen=True)
class ExpectedSpread:
    """Standard deviations of the quantity to be detected, in its unit, as in study.json.

    volunteer_by_cuff: between volunteers, in the value of one cuff beyond what both cuffs share.
    """

    volunteer_by_cuff: NonNegative
    donning: NonNegative
    repeat: NonNegative = 0.0


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


SETTLING = 1.5
"""Seconds of a hold that are not averaged: the load settles, and the next step begins."""


@dataclass(frozen=True)
class InstrumentNoise:
    """Standard deviations per sample: displacement [m] at frame_rate [Hz], force [N] at force_rate [Hz]."""

    displacement: float
    force: float
    frame_rate: float
    force_rate: float


def held_levels(steps: Sequence[float], *, is_first: bool) -> Array:
    """Loads [N] that determine k of one static trial with these load steps [N].

    The cuff slips while the load rises above all loads before, so that the first trial of a donning counts from the
    largest load down; later ones count on both ways.
    """
    rising = np.concatenate([[0.0], np.cumsum(steps)])
    falling = rising[::-1]
    return falling if is_first else np.concatenate([rising, falling[1:]])


def stiffness_error(stiffness: float, levels: Array, hold: float, noise: InstrumentNoise) -> float:
    """Standard error of k [N/m] from held loads (levels,) [N] of `hold` seconds each.

    x_j = F_j / k + x0 with the variance u² = s_x²/n_x + s_F²/(n_F k²) of a mean; the information about 1/k is
    Σ (F_j − F̄)² / u².
    Raises ValueError for a hold that is too short to average.
    """
    information = float(np.sum((levels - levels.mean()) ** 2)) / _variance_of_a_hold(stiffness, hold, noise)
    return stiffness**2 / math.sqrt(information)


def migration_error(stiffness: float, hold: float, noise: InstrumentNoise) -> float:
    """Standard error of the migration [m]: difference of the displacement at two unloaded holds.

    Raises ValueError for a hold that is too short to average.
    """
    return math.sqrt(2 * _variance_of_a_hold(stiffness, hold, noise))


def damping_error(
    law: tuple[float, float, float], force_amplitude: float, frequency: float, duration: float, noise: InstrumentNoise
) -> float:
    """Standard error of c [N s/m] from an oscillation; law is k [N/m], c [N s/m] and the cuff's mass m [kg].

    With G = k − m ω² + i ω c, a complex amplitude X of the displacement and n samples, the measured ratio of force and
    displacement has the variance 2 (s_F²/n_F + |G|² s_x²/n_x) / |X|² in its real and its imaginary part; Im G = ω c.
    """
    stiffness, damping, mass = law
    omega = 2 * math.pi * frequency
    magnitude = math.hypot(stiffness - mass * omega**2, omega * damping)
    amplitude = force_amplitude / magnitude
    variance = noise.force**2 / (duration * noise.force_rate)
    variance += magnitude**2 * noise.displacement**2 / (duration * noise.frame_rate)
    return math.sqrt(2 * variance) / (amplitude * omega)


def _variance_of_a_hold(stiffness: float, hold: float, noise: InstrumentNoise) -> float:
    """Variance u² [m²] of the mean displacement over the averaged part of a hold, with that of its load."""
    averaged = hold - SETTLING
    if averaged <= 0:
        raise ValueError(f"a hold of {hold:g} s is too short, expected more than {SETTLING:g} s")
    variance = noise.displacement**2 / (averaged * noise.frame_rate)
    return variance + (noise.force / stiffness) ** 2 / (averaged * noise.force_rate)

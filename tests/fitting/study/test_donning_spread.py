"""Relative spread between donnings: against analysis of variance, in coverage, and where it cannot be estimated."""

from __future__ import annotations

import numpy as np
import pytest

from fitting.study.donning_spread import SpreadOutcome, estimate_donning_spread
from fitting.study.measurements import Observation

SPREAD, WITHIN = 0.15, 0.02


def measured(
    seed: int, cuffs: int = 3, donnings: int = 4, repeats: int = 3, *, spread: float = SPREAD, noise: float = 0.0
) -> list[Observation]:
    """Values of cuffs of different stiffness, with normal logarithms."""
    generator = np.random.default_rng(seed)
    found = []
    for cuff in range(cuffs):
        for donning in range(donnings):
            centre = np.log(2000.0 * (cuff + 1)) + spread * generator.normal()
            for repeat in range(1, repeats + 1):
                value = float(np.exp(centre + np.hypot(WITHIN, noise) * generator.normal()))
                found.append(
                    Observation(
                        value, noise * value, 0.01 * value, "P01", "A", "monday", str(donning), repeat, f"{cuff}"
                    )
                )
    return found


def test_the_spread_is_that_of_an_analysis_of_variance_of_logarithms() -> None:
    # balanced, without known noise: REML and the method of moments are the same estimator
    found = estimate_donning_spread(measured(1))
    table = np.log([one.value for one in measured(1)]).reshape(3, 4, 3)
    between = 3 * table.mean(axis=2).var(axis=1, ddof=1).mean()
    within = table.var(axis=2, ddof=1).mean()
    assert found.outcome is SpreadOutcome.ESTIMATED
    assert found.spread == pytest.approx(np.sqrt((between - within) / 3), rel=1e-4)
    assert (found.donnings, found.cuffs) == (12, 3)
    assert found.freedom == pytest.approx(9, abs=0.5)
    assert found.ci95[0] < found.spread < found.ci95[1]


def test_the_scale_of_a_cuff_and_an_error_of_the_whole_session_do_not_matter() -> None:
    plain = estimate_donning_spread(measured(2))
    scaled = [
        Observation(7 * one.value, 0.0, 0.3 * 7 * one.value, "P01", "A", "monday", one.donning, one.repeat, one.cuff)
        for one in measured(2)
    ]
    assert estimate_donning_spread(scaled).spread == pytest.approx(plain.spread, rel=1e-6)


def test_intervals_of_many_studies_contain_the_true_spread() -> None:
    found = [estimate_donning_spread(measured(seed, repeats=2)) for seed in range(80)]
    inside = [one.ci95[0] <= SPREAD <= one.ci95[1] for one in found]
    assert 0.88 <= np.mean(inside) <= 1.0
    assert np.mean([one.spread**2 for one in found]) == pytest.approx(SPREAD**2, rel=0.1)


@pytest.mark.parametrize(("cuffs", "donnings"), [(3, 1), (3, 2), (1, 4), (0, 0)])
def test_few_donnings_give_no_spread(cuffs: int, donnings: int) -> None:
    found = estimate_donning_spread(measured(3, cuffs, donnings))
    assert found.outcome is SpreadOutcome.FEW_DONNINGS
    assert np.isnan(found.spread)


def test_a_spread_below_the_noise_of_the_fits_is_not_resolved() -> None:
    found = estimate_donning_spread(measured(4, spread=0.0, noise=0.3))
    assert found.outcome is SpreadOutcome.UNRESOLVED


def test_values_that_are_not_positive_and_cuffs_donned_once_are_left_out() -> None:
    once = Observation(9000.0, 0.0, 0.0, "P01", "A", "monday", "1", 1, "single")
    negative = Observation(-3.0, 0.1, 0.0, "P01", "A", "monday", "9", 1, "0")
    assert estimate_donning_spread([*measured(1), once, negative]) == estimate_donning_spread(measured(1))

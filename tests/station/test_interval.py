from __future__ import annotations

import math

import numpy as np
import pytest

from fitting.cuffs.cuff_fit import CuffFit
from fitting.results.codes import Verdict
from fitting.uncertainty import Estimate
from station.interval import between, bracketed, digits_of, of_cuff, plus_minus


def test_an_interval_has_two_digits_of_its_half_width() -> None:
    assert bracketed(0.89893, (0.89881, 0.89905)) == "0.89893 (0.89881\u00a0to\u00a00.89905)"
    assert plus_minus(2140.123, (2134.323, 2145.923)) == "2140.1 ± 5.8"
    assert bracketed(8524.4, (8480.4, 8567.9)) == "8524 (8480\u00a0to\u00a08568)"


@pytest.mark.parametrize("half", [9.4e-7, 0.00012, 0.0996, 0.5, 1.04, 9.96, 43.0, 1234.0])
def test_the_ends_of_an_interval_never_look_the_same(half: float) -> None:
    low, high = between((0.9 - half, 0.9 + half)).replace("−", "-").split(" to ")
    assert float(high) - float(low) == pytest.approx(2 * half, rel=0.06)


def test_a_half_width_that_rounds_up_to_the_next_power_of_ten_has_no_third_figure() -> None:
    assert plus_minus(1.0, (1.0 - 0.0996, 1.0 + 0.0996)) == "1.00 ± 0.10"


def test_a_scale_is_applied_before_rounding_and_a_negative_one_swaps_the_ends() -> None:
    assert bracketed(0.012224, (0.012183, 0.012265), 1e3) == "12.224 (12.183\u00a0to\u00a012.265)"
    assert between((-0.3, -0.1), -1.0) == "0.10 to 0.30"


def test_without_a_width_the_number_has_the_requested_digits() -> None:
    assert bracketed(0.8703, None, digits=3) == "0.870"
    assert bracketed(0.8703, (0.8703, math.nextafter(0.8703, 1.0)), digits=3) == "0.870"
    assert digits_of((-math.inf, math.inf), otherwise=1) == 1


def test_both_ends_of_an_interval_are_shown_where_its_halves_differ_in_the_printed_digits() -> None:
    assert plus_minus(0.88, (0.39, 0.97)) == "0.88 (0.39\u00a0to\u00a00.97)"
    assert plus_minus(0.00695, (0.00581, 0.00731), 100.0) == "0.695 (0.581\u00a0to\u00a00.731)"
    assert plus_minus(0.88, (0.7501, 1.0100)) == "0.88 ± 0.13"


def test_zero_has_no_sign() -> None:
    assert plus_minus(-0.0004, (-0.1204, 0.1196)) == "0.00 ± 0.12"


def test_a_figure_that_is_not_identified_is_marked() -> None:
    wide, known = Estimate(210.0, 120.0, (-25.0, 445.0)), Estimate(8520.0, 10.0, (8500.0, 8540.0))
    fit = CuffFit("hand", "arm", "1", known, wide, None, (Verdict.LAG,), np.zeros((3, 3)), {})
    assert of_cuff(fit, "damping", "210 ± 240") == "not identified: 210 ± 240"
    assert of_cuff(fit, "stiffness", "8520 ± 20") == "8520 ± 20"
    assert of_cuff(fit, "migration", "not identified") == "not identified"


def test_negative_numbers_have_a_minus_sign() -> None:
    assert bracketed(-2267.0, (-3431.0, -1103.0)) == "−2267 (−3431\u00a0to\u00a0−1103)"
    assert plus_minus(-2.0, (-4.0, 0.0)) == "−2.0 ± 2.0"
    assert between((-3.0, -1.0)) == "−3.0 to −1.0"

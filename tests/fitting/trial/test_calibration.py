"""Volts, newtons and codes."""

from __future__ import annotations

import numpy as np
import pytest

from fitting.results.codes import GainMistake
from fitting.trial.calibration import Calibration, code_width, find_mistake, full_scale, level_bias, to_newtons
from fitting.uncertainty import normal_estimate
from recordings.manifest import LoadCell

CODE = 20 / 4096


def test_newtons_carry_the_declared_polarity() -> None:
    volts = np.array([0.0, 1.0, -2.0])
    np.testing.assert_allclose(to_newtons(volts, LoadCell("daq", 98.0665, -1)), [0.0, -98.0665, 196.133])


@pytest.mark.parametrize(
    ("ratio", "mistake"),
    [
        (2.0, GainMistake.CAPACITY_DOUBLED),
        (-0.5, GainMistake.CAPACITY_HALVED),
        (10.0, GainMistake.CAPACITY_TENFOLD),
        (0.1, GainMistake.CAPACITY_TENTH),
        (1.133980925, GainMistake.CAPACITY_25_LB),
        (0.45359237, GainMistake.POUNDS_FOR_KILOGRAMS),
        (2.2046226218, GainMistake.KILOGRAMS_FOR_POUNDS),
        (4.4482216153, GainMistake.NEWTONS_FOR_POUNDS),
        (0.2248089431, GainMistake.POUNDS_FOR_NEWTONS),
        (9.80665, GainMistake.NEWTONS_FOR_KILOGRAMS),
        (0.1019716213, GainMistake.KILOGRAMS_FOR_NEWTONS),
    ],
)
def test_a_mistake_is_recognised_by_its_exact_ratio_and_within_three_percent(
    ratio: float, mistake: GainMistake
) -> None:
    """1 lb is 0.45359237 kg, and 25 lb are 11.33980925 kg in place of 10."""
    assert find_mistake(ratio) is mistake
    if not 9 < abs(np.log10(abs(ratio))) * 10 < 11:  # a tenth of the capacity and kilograms for newtons are neighbours
        assert find_mistake(ratio * np.exp(0.029)) is find_mistake(ratio * np.exp(-0.029)) is mistake
        assert find_mistake(ratio * np.exp(0.032)) is find_mistake(ratio * np.exp(-0.032)) is GainMistake.UNKNOWN


def calibration(gain: float, sd: float = 0.003) -> Calibration:
    none = normal_estimate(0.0, 0.0)
    return Calibration(none, normal_estimate(gain, sd), none, 0.0, 0, {})


@pytest.mark.parametrize(("gain", "is_used"), [(1.0499, True), (1.0501, False), (0.9501, True), (0.9499, False)])
def test_a_gain_more_than_five_percent_off_is_a_mistake_and_not_used(gain: float, is_used: bool) -> None:
    assert calibration(gain).is_gain_used is is_used
    assert calibration(gain).gain_with(0.0) == ((gain, 0.003 / gain) if is_used else (1.0, 0.0))
    assert is_used or calibration(gain).gain_with(0.002) == (1.0, 0.002)


def test_the_gain_is_the_mean_of_bounces_and_certificate_weighted_by_their_variances() -> None:
    bounces, certificate = (0.003 / 1.02) ** -2, 0.004**-2
    value, sd = calibration(1.02).gain_with(0.004)
    assert value == pytest.approx((1.02 * bounces + 1.0 * certificate) / (bounces + certificate))
    assert sd == pytest.approx((bounces + certificate) ** -0.5)


@pytest.mark.parametrize(
    ("capacity_kg", "converter", "expected"),
    [(10.0, 10.0, 2.0), (10.0, 1.0, 1.0), (None, 10.0, 10.0), (None, np.inf, np.inf)],
)
def test_the_full_scale_is_that_of_the_converter_or_of_the_cell(
    capacity_kg: float | None, converter: float, expected: float
) -> None:
    """10 kg weigh 98.0665 N, at 49.03325 N/V 2 V."""
    cell = LoadCell("daq", 49.03325, 1, capacity_kg=capacity_kg)
    assert full_scale(cell, converter) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("levels", "width"),
    [
        ([], 0.0),
        ([0.0, 0.5], 0.5),
        ([0.0, 8e-9, 10.0], 10.0),
        ([0.0, 1.2e-8, 10.0], 0.0),
        ([0.0, 1.0, 3.04], 1.0),
        ([0.0, 1.0, 3.06], 0.0),
    ],
    ids=["empty", "one code", "rounding", "no rounding", "multiples", "no multiples"],
)
def test_a_code_is_the_smallest_step_if_all_steps_are_multiples_of_it(levels: list[float], width: float) -> None:
    assert code_width(np.array(levels)) == pytest.approx(width)


def test_the_code_width_shows_in_the_values() -> None:
    codes = np.random.default_rng(1).integers(-5, 90, 500)
    assert code_width(CODE * codes) == pytest.approx(CODE)


def test_values_without_codes_have_no_width() -> None:
    assert code_width(np.random.default_rng(1).standard_normal(500)) == 0.0
    assert code_width(np.full(10, 2.0)) == 0.0


def test_a_still_level_is_known_to_a_code_and_a_dithered_one_much_better() -> None:
    assert level_bias(CODE, 0.0) == pytest.approx(CODE / np.sqrt(12))
    assert level_bias(2.0, 0.8) == pytest.approx(2 / np.sqrt(12) * np.exp(-2 * np.pi**2 * (0.4**2 - 1 / 12)))
    assert level_bias(0.0, 1.0) == 0.0


def test_the_bias_covers_what_a_converter_does_to_levels_and_not_much_more() -> None:
    random = np.random.default_rng(2)
    levels = random.uniform(0, 1, 300)
    for noise in (0.02, 0.15, 0.3):
        read = np.round(levels[:, None] + noise * random.standard_normal((300, 4000)))
        found = np.sqrt(np.mean((read.mean(axis=1) - levels) ** 2))
        said = np.mean([level_bias(1.0, float(np.std(row))) for row in read])
        assert 0.9 * found < said < 2.5 * found

"""Volts, newtons and codes."""

from __future__ import annotations

import numpy as np
import pytest

from fitting.trial.calibration import code_width, level_bias, to_newtons
from recordings.manifest import LoadCell

CODE = 20 / 4096


def test_newtons_carry_the_declared_polarity() -> None:
    volts = np.array([0.0, 1.0, -2.0])
    np.testing.assert_allclose(to_newtons(volts, LoadCell("daq", 98.0665, -1)), [0.0, -98.0665, 196.133])


def test_the_code_width_shows_in_the_values() -> None:
    codes = np.random.default_rng(1).integers(-5, 90, 500)
    assert code_width(CODE * codes) == pytest.approx(CODE)


def test_values_without_codes_have_no_width() -> None:
    assert code_width(np.random.default_rng(1).standard_normal(500)) == 0.0
    assert code_width(np.full(10, 2.0)) == 0.0


def test_a_still_level_is_known_to_a_code_and_a_dithered_one_much_better() -> None:
    assert level_bias(CODE, 0.0) == pytest.approx(CODE / np.sqrt(12))
    assert level_bias(CODE, CODE) < 1e-6 * CODE
    assert level_bias(0.0, 1.0) == 0.0


def test_the_bias_covers_what_a_converter_does_to_levels_and_not_much_more() -> None:
    random = np.random.default_rng(2)
    levels = random.uniform(0, 1, 300)
    for noise in (0.02, 0.15, 0.3):
        read = np.round(levels[:, None] + noise * random.standard_normal((300, 4000)))
        found = np.sqrt(np.mean((read.mean(axis=1) - levels) ** 2))
        said = np.mean([level_bias(1.0, float(np.std(row))) for row in read])
        assert 0.9 * found < said < 2.5 * found

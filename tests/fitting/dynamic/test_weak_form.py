"""The weak form and the complex stiffness on records whose truth is written out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fitting.dynamic.weak_form import complex_stiffness, fit_lines, tapered_lines
from tests.fitting.swinging import DAMPING, MASS, STIFFNESS, swing


def test_without_noise_it_returns_what_was_put_in() -> None:
    fitted = fit_lines(tapered_lines(swing(1, force_noise=0.0, marker_noise=0.0), 0.0), MASS)
    assert fitted
    assert fitted[0].value == pytest.approx(STIFFNESS, rel=1e-4)
    assert fitted[1].value == pytest.approx(DAMPING, rel=1e-3)


def test_its_interval_covers_as_student_says() -> None:
    places = []
    for seed in range(120):
        fitted = fit_lines(tapered_lines(swing(seed), 0.157e-3), MASS)
        assert fitted
        low, high = fitted[0].ci95
        places.append((STIFFNESS - low) / (high - low))
    covered, halved = (np.mean([0.5 - reach < place < 0.5 + reach for place in places]) for reach in (0.5, 0.25))
    assert covered > 0.89  # 95 % less three standard errors
    assert halved < 0.89


def test_a_mass_left_out_is_missed() -> None:
    with_mass, without = (
        fit_lines(tapered_lines(swing(1, force_noise=0.0, marker_noise=0.0), 0.0), mass) for mass in (MASS, 0.0)
    )
    assert with_mass
    assert without
    assert with_mass[0].value - without[0].value == pytest.approx(MASS * (2 * np.pi) ** 2, rel=0.15)


def test_the_complex_stiffness_of_a_spring_and_damper_is_the_same_in_every_band() -> None:
    slow, fast = (swing(3, force_noise=0.02, marker_noise=0.01e-3, frequency=f) for f in (1.0, 2.0))
    bands = complex_stiffness([*tapered_lines(slow, 0.01e-3), *tapered_lines(fast, 0.01e-3)], MASS, 1.0)
    assert len(bands) >= 2
    for band in bands:
        assert abs(band.stiffness.value - STIFFNESS) < 4 * band.stiffness.standard_error
        assert abs(band.damping.value - DAMPING) < 4 * band.damping.standard_error
    assert any(abs(band.frequency - 1.0) < 0.05 for band in bands)


def test_a_hole_in_the_markers_splits_the_record() -> None:
    record = swing(4)
    seen = (record.marker_time < 9.0) | (record.marker_time > 10.0)
    holed = replace(record, marker_time=record.marker_time[seen], displacement=record.displacement[seen])
    lines = tapered_lines(holed, 0.157e-3)
    assert len(lines) == 2
    fitted = fit_lines(lines, MASS)
    assert fitted
    assert abs(fitted[0].value - STIFFNESS) < 4 * fitted[0].standard_error


def test_a_motion_within_the_noise_has_no_lines() -> None:
    assert fit_lines(tapered_lines(swing(5, marker_noise=5e-3), 5e-3), MASS) is None

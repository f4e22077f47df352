"""Errors in variables, output error, weak form and complex stiffness on records whose truth is known."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from fitting.dynamic.cross_checks import (
    Checks,
    check,
    complex_stiffness,
    disagreements,
    fit_lines,
    output_error,
    tapered_lines,
    without_lag,
)
from fitting.dynamic.errors_in_variables import C, K, Swing, SwingFit, estimate
from fitting.results.codes import FitOutcome
from fitting.results.trial_codes import TrialNoteCode
from fitting.session import fit_session
from fitting.trial.trial import build_trial
from tests.fitting.experiment import Session, published
from tests.fitting.pulls import DAMPING, MASS, STIFFNESS, swing

TRUE_K, TRUE_C, MOVED_MASS = 5500.0, 120.0, 0.2


def _checked(record: Swing) -> tuple[SwingFit, Checks]:
    solution = estimate(record)
    return solution, check(record, solution, 1.0)


@pytest.mark.parametrize("seeds", [range(2), pytest.param(range(2, 12), marks=pytest.mark.slow)])
def test_three_other_methods_agree_on_a_spring_and_a_damper(seeds: range) -> None:
    for seed in seeds:
        solution, checks = _checked(swing(seed))
        assert [other.method for other in checks.others] == ["weak form", "output error", "complex stiffness"]
        assert disagreements(without_lag(solution), checks) == ()


def test_a_method_that_is_four_standard_errors_off_is_named_with_both_figures() -> None:
    solution, checks = _checked(swing(1))
    other = checks.others[0]
    k, c = without_lag(solution)
    apart = 4 * np.hypot(c.standard_error, other.damping.standard_error)
    wrong = replace(other, damping=replace(other.damping, value=c.value + apart))
    (note,) = disagreements((k, c), replace(checks, others=(wrong,)))
    assert (note.code, note.figures["method"], note.figures["quantity"]) == (
        TrialNoteCode.DISAGREES,
        "weak form",
        "damping",
    )
    assert note.figures["other"] == c.value + apart


@pytest.mark.parametrize("seeds", [range(2), pytest.param(range(2, 8), marks=pytest.mark.slow)])
@pytest.mark.parametrize(("colour", "is_coloured"), [(0.0, False), (0.05, True), (0.5, True)])
def test_correlated_marker_noise_is_distinguished_from_white_noise(
    colour: float, is_coloured: bool, seeds: range
) -> None:
    found = [_checked(swing(seed, colour=colour))[1].is_coloured for seed in seeds]
    assert found == [is_coloured] * len(seeds)


def test_a_bent_spring_shows_at_twice_the_swings_frequency() -> None:
    record = swing(2, force_noise=0.05, marker_noise=0.02e-3)
    way = np.interp(record.force_time, record.marker_time, record.displacement)
    _, straight = _checked(record)
    _, bent = _checked(replace(record, force=record.force + 4e5 * way**2))
    assert straight.harmonics[0] < 5 * straight.harmonic_noise
    assert bent.harmonics[0] > 5 * bent.harmonic_noise
    assert bent.harmonics[0] == pytest.approx(4e5 * np.var(way), rel=0.3)


def _by_output_error() -> tuple[float, float]:
    k, c = output_error(swing(1, force_noise=0.0, marker_noise=0.0), 5000.0, 100.0).estimates
    return k.value, c.value


def _by_the_weak_form() -> tuple[float, float]:
    k, c = fit_lines(tapered_lines(swing(1, force_noise=0.0, marker_noise=0.0), 0.0), MASS)
    return k.value, c.value


def _by_errors_in_variables() -> tuple[float, float]:
    parameters = estimate(swing(1, force_noise=1e-4, marker_noise=1e-7)).parameters
    return parameters[K], parameters[C]


@pytest.mark.parametrize(
    ("fitted", "k_tol", "c_tol"),
    [
        pytest.param(_by_output_error, 2e-3, 1e-2, id="output error"),
        pytest.param(_by_the_weak_form, 1e-4, 1e-3, id="weak form"),
        pytest.param(_by_errors_in_variables, 1e-4, 1e-3, id="errors in variables"),
    ],
)
def test_without_noise_every_method_returns_what_was_put_in(
    fitted: Callable[[], tuple[float, float]], k_tol: float, c_tol: float
) -> None:
    k, c = fitted()
    assert k == pytest.approx(STIFFNESS, rel=k_tol)
    assert c == pytest.approx(DAMPING, rel=c_tol)


def _record(seed: int, **more: float) -> Swing:
    return swing(seed, **({"rate": 100.0, "seconds": 10.0, "marker_noise": 0.2e-3, "lag_sd": 0.0} | more))


def test_noise_in_the_force_does_not_bias_the_damping_of_a_light_damper() -> None:
    found = [output_error(swing(seed, c=38.0), STIFFNESS, 38.0).estimates for seed in range(20)]
    assert np.mean([fit[1].value for fit in found if fit]) == pytest.approx(38.0, abs=2.0)


@pytest.mark.parametrize("colour", [pytest.param(0.0, marks=pytest.mark.slow), 0.05])
def test_its_standard_error_is_honest_whatever_the_colour_of_the_noise(colour: float) -> None:
    z = []
    for seed in range(60):
        fitted = output_error(swing(seed, colour=colour), STIFFNESS, DAMPING).estimates
        z.append((fitted[1].value - DAMPING) / fitted[1].standard_error)
    low, high = stats.chi2.ppf([0.0005, 0.9995], 60)
    total = float(np.dot(z, z))
    assert low < total < high
    assert 4 * total > high


def test_a_force_that_falls_as_the_cuff_goes_has_no_answer_and_a_motion_within_the_noise_no_lines() -> None:
    record = swing(1)
    backwards = output_error(replace(record, force=-record.force), STIFFNESS, DAMPING)
    assert (backwards.outcome, backwards.estimates) == (FitOutcome.NO_SOLUTION, None)
    assert fit_lines(tapered_lines(swing(5, marker_noise=5e-3), 5e-3), MASS) is None


@pytest.mark.slow
def test_its_interval_covers_as_student_says() -> None:
    places = []
    for seed in range(120):
        fitted = fit_lines(tapered_lines(swing(seed), 0.157e-3), MASS)
        low, high = fitted[0].ci95
        places.append((STIFFNESS - low) / (high - low))
    covered, halved = (np.mean([0.5 - reach < place < 0.5 + reach for place in places]) for reach in (0.5, 0.25))
    assert covered > 0.89  # 95 % less three standard errors
    assert halved < 0.89


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
    assert abs(fitted[0].value - STIFFNESS) < 4 * fitted[0].standard_error


def test_marker_noise_does_not_destroy_damping() -> None:
    found = [estimate(_record(seed)) for seed in range(12)]
    errors = [solution.parameters[C] / DAMPING - 1 for solution in found]
    assert abs(np.mean(errors)) < 0.03  # a difference quotient at 100 Hz loses about half
    assert np.mean([s.marker_noise for s in found]) == pytest.approx(0.2e-3, rel=0.05)
    assert np.mean([s.force_noise for s in found]) == pytest.approx(0.25, rel=0.05)


def _errors(fits: int) -> np.ndarray:
    """(fits,) errors of c in standard errors, the true lag drawn from its prior."""
    z = np.empty(fits)
    for seed in range(fits):
        solution = estimate(_record(seed, lag_sd=0.5e-3, seconds=8.0))
        z[seed] = (solution.parameters[C] - DAMPING) / np.sqrt(solution.covariance[C, C])
    return z


@pytest.mark.slow
def test_the_standard_error_of_damping_is_honest() -> None:
    z = _errors(60)
    low, high = stats.chi2.ppf([0.0005, 0.9995], 60)
    assert low < z @ z < high
    assert 4 * (z @ z) > high  # half the standard error would be found out


def test_a_lag_adds_stiffness_times_itself_to_the_error_of_damping() -> None:
    known, unknown = (estimate(replace(_record(1), lag_sd=sd)) for sd in (0.0, 1e-3))
    added = np.sqrt(unknown.covariance[C, C] - known.covariance[C, C])
    assert added == pytest.approx(STIFFNESS * 1e-3, rel=0.05)


def test_ghosts_and_holes_are_survived() -> None:
    record = _record(3)
    seen = np.ones(len(record.marker_time), bool)
    seen[200:320] = False
    ghosts = record.displacement.copy()
    ghosts[500:503] += 15e-3
    holed = replace(record, marker_time=record.marker_time[seen], displacement=ghosts[seen])
    clean, found = estimate(record), estimate(holed)
    assert abs(found.parameters[C] - clean.parameters[C]) < 3 * np.sqrt(found.covariance[C, C])
    assert found.marker_noise == pytest.approx(0.2e-3, rel=0.1)


def test_the_damper_force_over_velocity_has_the_slope_of_the_damping() -> None:
    solution = estimate(_record(4))
    slope = np.polyfit(solution.velocity, solution.damper_force, 1)[0]
    assert slope == pytest.approx(solution.parameters[C], rel=0.01)


def test_half_a_second_in_which_the_cuff_was_hidden_does_not_lead_it_astray() -> None:
    """A start that trusts the spline where no marker was seen ends, with this seed, with no motion at all."""
    session = Session(published("hand", hold=4.2, unloads_at_once=True), seed=0)
    session.static()
    manifest, tracks = session.dynamic()
    values = tracks["/markers"].values.copy()
    values[700:750, -1] = np.nan
    trial = build_trial(manifest, tracks | {"/markers": replace(tracks["/markers"], values=values)}, "dynamic", "")
    fit = fit_session([trial]).cuffs["hand"]
    assert fit.damping and abs(fit.damping.value - 210.0) < 4 * fit.damping.standard_error

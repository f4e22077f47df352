"""The estimator of damping on records whose truth is known exactly: F = k x + c ẋ + m ẍ + offset, written out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from fitting.dynamic.errors_in_variables import C, K, Swing, estimate
from fitting.session import fit_session
from fitting.trial.trial import build_trial
from tests.fitting.experiment import Session, published

TRUE_K, TRUE_C, MASS = 5500.0, 120.0, 0.2
W = 2 * np.pi * 1.1


def _record(seed: int, *, lag: float = 0.0, lag_sd: float = 0.5e-3, noise: float = 1.0, seconds: float = 10.0) -> Swing:
    random = np.random.default_rng(seed)
    force_time, marker_time = np.arange(0, seconds, 0.01), np.arange(0.003, seconds, 0.01)
    phase = random.uniform(0, 6)

    def motion(t: np.ndarray, order: int) -> np.ndarray:
        turn = order * np.pi / 2
        return 3e-3 * W**order * np.sin(W * t + phase + turn) + 4e-4 * (2.3 * W) ** order * np.sin(2.3 * W * t + turn)

    at = force_time + lag
    force = TRUE_K * motion(at, 0) + TRUE_C * motion(at, 1) + MASS * motion(at, 2) + 25.0 + 0.02 * force_time
    return Swing(
        force_time,
        force + noise * 0.25 * random.standard_normal(len(force_time)),
        marker_time,
        motion(marker_time, 0) + noise * 0.2e-3 * random.standard_normal(len(marker_time)),
        MASS,
        lag_sd,
    )


def test_without_noise_it_returns_what_was_put_in() -> None:
    solution = estimate(_record(1, noise=1e-3))
    assert solution.parameters[K] == pytest.approx(TRUE_K, rel=1e-4)
    assert solution.parameters[C] == pytest.approx(TRUE_C, rel=1e-3)


def test_marker_noise_does_not_destroy_damping() -> None:
    found = [estimate(_record(seed)) for seed in range(12)]
    errors = [solution.parameters[C] / TRUE_C - 1 for solution in found]
    assert abs(np.mean(errors)) < 0.03  # a difference quotient at 100 Hz loses about half
    assert np.mean([s.marker_noise for s in found]) == pytest.approx(0.2e-3, rel=0.05)
    assert np.mean([s.force_noise for s in found]) == pytest.approx(0.25, rel=0.05)


def _errors(fits: int, lag_error: float = 0.0) -> np.ndarray:
    """(fits,) errors of c in standard errors, the true lag drawn from its prior."""
    z = np.empty(fits)
    for seed in range(fits):
        lag = 0.5e-3 * np.random.default_rng(900 + seed).standard_normal() + lag_error
        solution = estimate(_record(seed, lag=lag, seconds=8.0))
        z[seed] = (solution.parameters[C] - TRUE_C) / np.sqrt(solution.covariance[C, C])
    return z


def test_the_standard_error_of_damping_is_honest() -> None:
    z = _errors(60)
    low, high = stats.chi2.ppf([0.0005, 0.9995], 60)
    assert low < z @ z < high
    assert 4 * (z @ z) > high  # half the standard error would be found out


def test_a_lag_beyond_its_prior_is_seen_in_the_errors() -> None:
    z = _errors(20, lag_error=5e-3)
    assert z @ z > stats.chi2.ppf(0.9995, 20)


def test_a_lag_adds_stiffness_times_itself_to_the_error_of_damping() -> None:
    known, unknown = estimate(_record(1, lag_sd=0.0)), estimate(_record(1, lag_sd=1e-3))
    added = np.sqrt(unknown.covariance[C, C] - known.covariance[C, C])
    assert added == pytest.approx(TRUE_K * 1e-3, rel=0.05)


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

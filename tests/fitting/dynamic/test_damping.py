"""Which stretch of a dynamic trial is fitted, and which trials cannot tell damping."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from fitting.dynamic.damping import fit_damping
from fitting.pull.pull import Pull
from fitting.results.codes import RejectionCode, TrialNoteCode
from fitting.trial.clocks import LagUncertainty
from fitting.trial.oscillation import find_oscillation
from fitting.trial.trial import Trial
from recordings.manifest import CuffSite
from tests.fitting.pulls import pull_of
from tests.fitting.refusals import figures_by_code, raises_refusal

K, C = 2140.0, 124.0


def _pull(
    frequency: float = 1.0,
    amplitude: float = 12.0,
    seconds: float = 20.0,
    rate: float = 500.0,
    lag: float = 0.5e-3,
    colour: float = 0.0,
) -> Pull:
    """Three seconds at rest, then the weight swings, then three seconds at rest."""
    random = np.random.default_rng(6)
    force_time, marker_time = np.arange(0, seconds, 1 / rate), np.arange(0, seconds, 0.01)
    w = 2 * np.pi * frequency
    way = amplitude / abs(K + 1j * w * C)

    def motion(t: np.ndarray, order: int) -> np.ndarray:
        swinging = (t > 3) & (t < seconds - 3)
        return np.where(swinging, way * w**order * np.sin(w * (t - 3) + order * np.pi / 2), 0.0)

    force = 25 + K * motion(force_time, 0) + C * motion(force_time, 1) + 0.2 * motion(force_time, 2)
    trial = Trial(
        cuff=CuffSite("waist", "waist", (), ()),
        test="dynamic",
        repeat=1,
        run=1,
        donning="1",
        start_utc_ns=0,
        file="a.mcap",
        sha256="",
        force_time=force_time,
        force=force + 0.3 * random.standard_normal(len(force)),
        force_step=0.0,
        marker_time=marker_time,
        labels=(),
        markers=np.zeros((len(marker_time), 0, 3)),
        lag=LagUncertainty(0.3e-3, lag, 0.0),
    )
    memory = math.exp(-0.01 / colour) if colour else 0.0
    noise = lfilter([math.sqrt(1 - memory**2)], [1, -memory], random.standard_normal(len(marker_time)))
    return pull_of(trial, motion(marker_time, 0) + 0.2e-3 * noise)


def test_the_swinging_stretch_is_found_without_its_ends() -> None:
    pull = _pull(frequency=1.3)
    found = find_oscillation(pull.force_time, pull.force)
    assert 3.0 <= found.start <= 5.0
    assert 15.0 <= found.end <= 17.0
    assert found.frequency == pytest.approx(1.3, abs=0.03)
    assert found.amplitude == pytest.approx(12.0, rel=0.05)


def test_damping_comes_back_with_the_lag_in_its_error() -> None:
    fit = fit_damping(_pull(lag=2e-3))
    assert fit.damping.value == pytest.approx(C, rel=0.05)
    assert fit.damping.common == pytest.approx(K * 2e-3, rel=0.02)
    assert fit.stiffness.value == pytest.approx(K, rel=0.02)
    assert fit.damping.noise > fit.noise > 0


@pytest.mark.parametrize(
    ("pull", "code"),
    [
        (_pull(seconds=3.5), RejectionCode.SHORT),
        (_pull(frequency=0.3, seconds=14.0), RejectionCode.FEW_CYCLES),
        (_pull(frequency=4.0, rate=20.0), RejectionCode.FEW_SAMPLES),
        (_pull(amplitude=0.15), RejectionCode.SMALL_MOTION),
    ],
)
def test_a_trial_from_which_damping_is_not_identified_is_refused(pull: Pull, code: RejectionCode) -> None:
    with raises_refusal(code):
        fit_damping(pull)


def test_a_small_motion_is_fitted_with_a_note_of_how_small_it_is() -> None:
    fit = fit_damping(_pull(amplitude=0.9))  # ± 0.40 mm of motion beside 0.2 mm of noise
    assert figures_by_code(fit.notes)[TrialNoteCode.SMALL_MOTION]["ratio"] == pytest.approx(2.0, abs=0.05)
    assert abs(fit.stiffness.value - K) < 4 * fit.stiffness.standard_error
    assert TrialNoteCode.SMALL_MOTION not in figures_by_code(fit_damping(_pull()).notes)


def test_hidden_markers_through_most_of_the_pull_are_refused() -> None:
    pull = _pull()
    x = pull.displacement.copy()
    x[400:1400] = np.nan
    with raises_refusal(RejectionCode.SWING_HIDDEN):
        fit_damping(replace(pull, displacement=x))


def test_frames_that_end_before_the_pull_are_refused() -> None:
    pull = _pull()
    early = replace(pull, marker_time=pull.marker_time[:200], displacement=pull.displacement[:200])
    with raises_refusal(RejectionCode.SWING_HIDDEN):
        fit_damping(early)


def test_markers_with_a_memory_make_output_error_the_method() -> None:
    fit = fit_damping(_pull(colour=0.05))
    assert fit.method == "output error"
    assert TrialNoteCode.COLOURED in figures_by_code(fit.notes)
    assert abs(fit.damping.value - C) < 3.5 * fit.damping.estimate.standard_error
    assert fit_damping(_pull()).method == "errors in variables"


def test_common_errors_of_the_trials_are_listed_by_cause() -> None:
    pull = _pull(lag=2e-3)
    fit = fit_damping(replace(pull, trial=replace(pull.trial, gain_sd=0.01, lag=LagUncertainty(0.0, 2e-3, 1e-4))))
    assert math.hypot(*fit.damping.causes.values()) == pytest.approx(fit.damping.common)
    assert fit.damping.causes["lag"] == pytest.approx(K * 2e-3, rel=0.02)
    assert fit.damping.causes["drift"] == pytest.approx(K * 1e-4 * fit.oscillation.middle, rel=0.02)
    assert fit.damping.causes["gain"] == pytest.approx(0.01 * C, rel=0.1)


def test_the_energy_of_a_cycle_is_the_loops_area() -> None:
    fit = fit_damping(_pull())
    way = 12.0 / abs(K + 2j * np.pi * C)
    assert fit.energy.value == pytest.approx(np.pi * 2 * np.pi * C * way**2, rel=0.05)
    assert fit.energy.standard_error / fit.energy.value == pytest.approx(
        fit.damping.estimate.standard_error / fit.damping.value, rel=1e-6
    )

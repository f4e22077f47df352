"""Stretch of a dynamic trial that is fitted, trials without damping, the lag from a known stiffness, and slip."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from fitting.dynamic import errors_in_variables
from fitting.dynamic.damping import Slip, find_slip, fit_damping
from fitting.dynamic.errors_in_variables import KNOT_STEP, LagPosterior, SwingFit, estimate, lag_from_magnitude
from fitting.pull.pull import Pull
from fitting.results.trial_codes import RejectionCode, TrialNoteCode
from fitting.session import fit_session
from fitting.trial.bounce import Oscillation, find_oscillation
from fitting.trial.clocks import LagUncertainty
from fitting.trial.trial import build_trial
from fitting.uncertainty import normal_estimate
from recordings.manifest import CuffSite
from tests.fitting.experiment import Session, published
from tests.fitting.pulls import MASS, pull_of, swing, trial_of
from tests.refusals import figures_by_code, raises_refusal

K, C = 2140.0, 124.0
SPREAD = 0.025 / np.sqrt(3)
"""Seconds: a lag anywhere within half a sample at 20 Hz."""
SLIPPING_K = 8000.0
SWING = Oscillation(2.0, 14.0, 1.0, 16.0)
time = np.arange(2.0, 14.0, 0.01)


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
    measured = force_time, force + 0.3 * random.standard_normal(len(force))
    markers = marker_time, (), np.zeros((len(marker_time), 0, 3))
    trial = trial_of(
        CuffSite("waist", "waist", (), ()), measured, markers, LagUncertainty(0.3e-3, lag, 0.0), test="dynamic"
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


@pytest.mark.parametrize(
    ("pull", "code"),
    [
        (_pull(seconds=3.5), RejectionCode.SHORT),
        (_pull(frequency=0.3, seconds=14.0), RejectionCode.FEW_CYCLES),
        (_pull(frequency=4.0, rate=20.0), RejectionCode.FEW_SAMPLES),
        (_pull(amplitude=0.15), RejectionCode.SMALL_MOTION),
        (replace(_pull(), marker_time=_pull().marker_time + 0.3), RejectionCode.INDISTINCT),
        (replace(_pull(), marker_time=_pull().marker_time + 0.6), RejectionCode.INDISTINCT),
    ],
)
def test_a_trial_from_which_damping_is_not_identified_is_refused(pull: Pull, code: RejectionCode) -> None:
    with raises_refusal(code):
        fit_damping(pull)


def test_markers_with_few_frames_or_hidden_through_most_of_the_pull_or_that_end_before_it_are_refused() -> None:
    pull = _pull()
    few = replace(pull, marker_time=pull.marker_time[::8], displacement=pull.displacement[::8])
    with raises_refusal(
        RejectionCode.FEW_FRAMES, rate_hz=pytest.approx(12.5), expected_hz=pytest.approx(1.01 / KNOT_STEP)
    ):
        fit_damping(few)
    pull = _pull()
    x = pull.displacement.copy()
    x[400:1400] = np.nan
    with raises_refusal(RejectionCode.SWING_HIDDEN):
        fit_damping(replace(pull, displacement=x))
    pull = _pull()
    early = replace(pull, marker_time=pull.marker_time[:200], displacement=pull.displacement[:200])
    with raises_refusal(RejectionCode.SWING_HIDDEN):
        fit_damping(early)


def test_a_small_motion_is_fitted_with_a_note_of_how_small_it_is() -> None:
    fit = fit_damping(_pull(amplitude=0.9))  # ± 0.40 mm of motion beside 0.2 mm of noise
    assert figures_by_code(fit.notes)[TrialNoteCode.SMALL_MOTION]["ratio"] == pytest.approx(2.0, abs=0.05)
    assert abs(fit.stiffness.value - K) < 4 * fit.stiffness.standard_error
    assert TrialNoteCode.SMALL_MOTION not in figures_by_code(fit_damping(_pull()).notes)


def test_markers_with_a_memory_make_output_error_the_method() -> None:
    fit = fit_damping(_pull(colour=0.05))
    assert fit.method == "output error"
    assert TrialNoteCode.COLOURED in figures_by_code(fit.notes)
    assert abs(fit.damping.value - C) < 3.5 * fit.damping.estimate.standard_error
    assert fit_damping(_pull()).method == "errors in variables"


def test_common_errors_of_the_trials_are_listed_by_cause() -> None:
    pull = _pull(lag=2e-3)
    fit = fit_damping(replace(pull, trial=replace(pull.trial, gain_sd=0.01, lag=LagUncertainty(3e-4, 2e-3, 1e-4))))
    assert fit.damping.value == pytest.approx(C, rel=0.05) and fit.stiffness.value == pytest.approx(K, rel=0.02)
    assert fit.damping.noise > fit.noise > 0
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


def _posterior(seed: int, k: float, c: float, lag: float) -> tuple[LagPosterior, float]:
    """What is found, and c at the lag that was found; the stiffness is known to 0.5 %, and drawn so."""
    record = swing(seed, k=k, c=c, rate=100.0, seconds=15.0, lag_error=lag)
    known = normal_estimate(k * (1 + 0.005 * float(np.random.default_rng(seed).standard_normal())), 0.005 * k)
    posterior = lag_from_magnitude(estimate(record), MASS, 1.0, known, SPREAD)
    at_lag: SwingFit = estimate(replace(record, force_time=record.force_time + posterior.lag))
    return posterior, float(at_lag.parameters[errors_in_variables.C])


@pytest.mark.parametrize("lag", [-0.025, 0.0, 0.025])
def test_a_damping_that_makes_much_of_the_magnitude_is_found_under_any_lag(lag: float) -> None:
    posterior, damping = _posterior(1, 2530.0, 139.0, lag)
    assert abs(damping - 139.0) < 3 * posterior.damping_sd < 0.2 * 139.0
    assert abs(posterior.lag - lag) < 3 * posterior.lag_sd


@pytest.mark.parametrize("seeds", [range(2), pytest.param(range(2, 12), marks=pytest.mark.slow)])
@pytest.mark.parametrize("lag", [-0.02, 0.02])
def test_one_that_makes_little_of_it_is_not_said_to_be_known(lag: float, seeds: range) -> None:
    """At c = 38 the magnitude is that of the spring alone within 0.1 %: whatever comes out, its error must hold it."""
    found = [_posterior(seed, 5530.0, 38.0, lag) for seed in seeds]
    assert all(abs(damping - 38.0) < 3 * posterior.damping_sd for posterior, damping in found)
    assert min(posterior.damping_sd / damping for posterior, damping in found) > 0.15


@pytest.mark.slow
def test_errors_are_those_of_the_draw() -> None:
    random = np.random.default_rng(9)
    z = []
    for seed in range(40):
        posterior, damping = _posterior(seed, 2530.0, 139.0, SPREAD * random.standard_normal())
        z.append((damping - 139.0) / posterior.damping_sd)
    assert 0.6 < float(np.std(z)) < 1.4


def test_a_lag_that_would_leave_a_negative_damping_does_not_count() -> None:
    posterior, damping = _posterior(2, 5530.0, 38.0, -0.025)
    assert damping > 0
    assert posterior.lag < 0


def _find(offset: np.ndarray) -> Slip:
    noise = 2e-4 * np.random.default_rng(2).standard_normal(len(time))
    return find_slip(time, offset + noise, 2e-4, SWING, SLIPPING_K, 2.0)


def test_a_cuff_that_holds_or_hardly_slips_loses_no_cycle() -> None:
    slip = _find(np.full(len(time), 0.011))
    assert (slip.settles, slip.cycles) == (True, 0)
    assert slip.damping < 10
    assert _find(np.minimum(time - 2.0, 2.0) * 1.5e-5).cycles == 0


def test_the_cycles_before_it_settles_are_counted() -> None:
    slip = _find(np.minimum((time - 2.0) / 3.0, 1.0) * 1e-3)
    assert slip.settles
    assert 2 <= slip.cycles <= 3
    assert slip.distance == pytest.approx(0.83e-3, abs=0.1e-3)
    assert slip.damping < 20


def test_slip_without_an_end_is_found_by_its_dissipated_work() -> None:
    slip = _find(0.5e-3 * (time - 2.0))
    assert not slip.settles
    assert slip.damping == pytest.approx(16 * 0.5e-3 / (np.pi * 2 * np.pi * (16 / SLIPPING_K) ** 2), rel=0.05)


def test_a_hidden_cycle_is_no_slip_and_too_few_cycles_cannot_tell() -> None:
    seen = (time < 6.0) | (time > 7.0)
    slip = find_slip(time[seen], np.full(np.count_nonzero(seen), 0.01), 2e-4, SWING, SLIPPING_K, 2.0)
    assert slip == Slip(settles=True, cycles=0, distance=0.0, damping=pytest.approx(0.0, abs=1e-6))
    assert find_slip(time, 1e-3 * time, 2e-4, replace(SWING, end=5.0), SLIPPING_K, 2.0) == Slip(
        settles=True, cycles=0, distance=0.0, damping=0.0
    )


def test_damping_of_a_cuff_that_slips_anew_in_the_swing_is_from_the_cycles_after() -> None:
    """The static loads end below the crest of the swing, so that the swing carries the cuff on."""
    truth = published("hand", weights=(15.0, 25.0, 35.0), hold=4.0, amplitude=20.0, slowness=2000.0, duration=18.0)
    session = Session(truth, 5)
    trials = [build_trial(*session.static(), "s.mcap", "s"), build_trial(*session.dynamic(), "d.mcap", "d")]
    fit = fit_session(trials).cuffs["hand"]
    assert abs(fit.damping.value - truth.damping) < 3 * fit.damping.standard_error
    assert fit.trials[1].notes[-1].code is TrialNoteCode.START_LEFT_OUT

"""Volts, newtons and codes; lag, gain and zero from a bounce of a rig that another physics moved."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from fitting.results.trial_codes import RejectionCode, TrialNoteCode
from fitting.trial.bounce import BounceFit, BounceTrial, calibrate, fit_bounce
from fitting.trial.calibration import (
    Calibration,
    GainMistake,
    code_width,
    find_mistake,
    find_spikes,
    full_scale,
    level_bias,
    require_sound_force,
)
from fitting.trial.timeline import build_timeline
from fitting.trial.trial import build_bounce
from fitting.uncertainty import normal_estimate
from recordings.manifest import LoadCell, Timing
from tests.fitting.bouncing import Bounce, recorded
from tests.fitting.experiment import Session, published
from tests.refusals import figures_by_code, raises_refusal

CODE = 20 / 4096
COUNT = 30
ODD = Bounce(lag=0.004, gain=1.01)
SLOW = Bounce(force_rate=20.0, frequency=3.0, amplitude=0.01)


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
        (1000.0, GainMistake.MILLINEWTONS_FOR_NEWTONS),
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
        ([2.0, 2.0], 0.0),
        ([0.0, 0.5], 0.5),
        ([0.0, 8e-9, 10.0], 10.0),
        ([0.0, 1.2e-8, 10.0], 0.0),
        ([0.0, 1.0, 3.04], 1.0),
        ([0.0, 1.0, 3.06], 0.0),
    ],
    ids=["empty", "one level", "one code", "rounding", "no rounding", "multiples", "no multiples"],
)
def test_a_code_is_the_smallest_step_if_all_steps_are_multiples_of_it(levels: list[float], width: float) -> None:
    assert code_width(np.array(levels)) == pytest.approx(width)


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


@pytest.mark.parametrize(
    ("values", "limit", "code", "figures"),
    [
        ([0.0, np.nan, np.inf], 10.0, "NOT_FINITE", {"count": 2, "total": 3}),
        ([0.0, 9.9, -9.9, 10.0, 11.0], 10.0, "SATURATED", {"count": 4, "total": 5, "limit": 10.0, "unit": "N"}),
        ([0.5, 0.5], np.inf, "CONSTANT", {"value": 0.5, "total": 2}),
        ([0.5], np.inf, "CONSTANT", {"value": 0.5, "total": 1}),
        ([0.0, 9.9, 9.9, 9.9], 10.0, None, None),
        ([0.0, 9.89, 9.89, 9.89, 9.89], 10.0, None, None),
        ([], 10.0, None, None),
    ],
)
def test_force_that_cannot_be_right_is_refused_with_its_count(
    values: list[float], limit: float, code: str | None, figures: dict[str, object] | None
) -> None:
    if code is None:
        require_sound_force(np.array(values), limit, "N")
        return
    with raises_refusal(RejectionCode[f"FORCE_{code}"], **(figures or {})):
        require_sound_force(np.array(values), limit, "N")


@pytest.mark.parametrize(("samples", "count"), [(1, 12), (2, 24), (4, 0), (50, None)])
def test_spikes_of_the_force_are_left_out_and_counted(samples: int, count: int | None) -> None:
    """A load lasts for longer than two samples; many spikes are refused."""
    manifest, tracks = Session(published("hand"), 1).static()
    clean, force, starts = build_timeline(manifest, tracks, manifest.cuff.labels), tracks["/force"], np.arange(5, 53, 4)
    volts, cell = force.values.copy(), manifest.load_cell
    spikes = (1000 * starts[:, None] + (np.arange(samples) if samples < 50 else 4 * np.arange(samples * 4))).ravel()
    volts[spikes] += 500.0 / cell.newtons_per_unit
    spiked = {**tracks, "/force": replace(force, values=volts)}
    if count is None:
        with raises_refusal(RejectionCode.FORCE_SPIKES, count=len(spikes), total=len(volts)):
            build_timeline(manifest, spiked, manifest.cuff.labels)
        return
    timeline = build_timeline(manifest, spiked, manifest.cuff.labels)
    assert len(clean.force) - len(timeline.force) == count and timeline.force_gaps == ()
    found = figures_by_code(timeline.notes).get(TrialNoteCode.FORCE_SPIKES, {"count": 0})
    assert found["count"] == count
    if count:
        assert found["total"] == len(clean.force) and np.max(timeline.force) == np.max(clean.force)
        assert found["most_n"] == pytest.approx(500.0, abs=5.0)
        limited = replace(manifest, load_cell=replace(cell, capacity_kg=30.0))
        with raises_refusal(RejectionCode.FORCE_SATURATED, count=count):
            build_timeline(limited, spiked, manifest.cuff.labels)


@pytest.mark.parametrize("sample", [0, 1, 700, -1])
def test_a_spike_has_its_height_above_the_samples_around_also_at_an_end(sample: int) -> None:
    force = np.repeat([0.0, 150.0], 500)
    spiked = force.copy()
    spiked[sample] += 100.0
    np.testing.assert_array_equal(find_spikes(spiked, 1000.0), spiked - force)


def _spikes(force: NDArray[np.float64], *heights: float, rate_hz: float = 40.0) -> int:
    """Count of spikes if every fortieth sample from 41 on is that high."""
    spiked = force.copy()
    spiked[41 : 41 + 40 * len(heights) : 40] = heights
    return int(np.count_nonzero(find_spikes(spiked, rate_hz)))


def test_a_spike_is_above_5_n_ten_distances_of_the_noise_and_half_of_the_range() -> None:
    still, noise = np.zeros(300), np.tile([0.0, -1.0, 1.0], 100)  # of which two of three are 1 N from their median
    steps, few = np.repeat([20.0, 120.0], 150), np.concatenate((np.zeros(994), np.full(6, -100.0)))
    assert (_spikes(still, 5.0), _spikes(still, 5.0625), _spikes(still, -5.0625)) == (0, 1, 1)
    assert (_spikes(noise, 10.0), _spikes(noise, 10.0625)) == (0, 1)
    assert (_spikes(steps, 70.0), _spikes(steps, 70.0625)) == (0, 1)
    assert (_spikes(few, 50.0), _spikes(-few, -50.0), _spikes(few, 50.0625)) == (0, 0, 1), "0.6 % of the samples"


def test_more_than_two_percent_of_spikes_are_refused_and_few_or_slow_samples_show_none() -> None:
    still = np.zeros(200)
    assert _spikes(still, 9.0, 9.0, 9.0, 9.0) == 4
    with raises_refusal(RejectionCode.FORCE_SPIKES, count=5, total=200, most_n=9.0):
        find_spikes(np.where(np.isin(np.arange(200), [20, 60, 100, 140, 180]), 9.0, 0.0), 1000.0)
    with raises_refusal(RejectionCode.FORCE_SPIKES, count=1, total=5, most_n=9.0):
        find_spikes(np.array([0.0, 0.0, 9.0, 0.0, 0.0]), 40.0)
    assert _spikes(still, 9.0, rate_hz=39.9) == 0
    np.testing.assert_array_equal(find_spikes(np.array([0.0, 0.0, 9.0, 0.0]), 40.0), np.zeros(4))


def _trial(truth: Bounce, seed: int = 1, run: int = 1) -> BounceTrial:
    return build_bounce(*recorded(truth, seed, run), f"test-bounce_run-{run}.mcap", f"hash {run}")


@cache
def _fits(truth: Bounce) -> tuple[BounceFit, ...]:
    return tuple(fit_bounce(_trial(truth, seed)) for seed in range(COUNT))


def _scores(truth: Bounce) -> np.ndarray:
    """(fits, 3) errors of lag, gain, zero in their standard errors."""
    true = np.array([truth.lag, truth.gain, truth.zero])
    found = [[each.estimate for each in (fit.lag, fit.gain, fit.zero)] for fit in _fits(truth)]
    values = np.array([[each.value for each in fit] for fit in found])
    errors = np.array([[each.standard_error for each in fit] for fit in found])
    return (values - true) / errors


@pytest.mark.parametrize(
    ("rate", "lag_rmse", "gain_rmse"), [(1000.0, 0.3e-3, 0.003), (20.0, 1.5e-3, 0.01)], ids=["1 kHz", "20 Hz"]
)
def test_lag_gain_and_zero_come_back_as_closely_as_they_claim(rate: float, lag_rmse: float, gain_rmse: float) -> None:
    truth = replace(ODD, force_rate=rate)
    scores, fits = _scores(truth), _fits(truth)
    assert np.sqrt(np.mean([(fit.lag.value - truth.lag) ** 2 for fit in fits])) < lag_rmse
    assert np.sqrt(np.mean([(fit.gain.value - truth.gain) ** 2 for fit in fits])) < gain_rmse
    low, high = stats.chi2.ppf([0.0005, 0.9995], COUNT)
    chi_square = np.sum(scores**2, axis=0)
    assert np.all(chi_square < high)
    assert chi_square[0] > low, "the interval of the lag is no wider than it need be"


def test_an_amplifier_s_filter_is_part_of_the_lag_and_widens_the_gain() -> None:
    fit = fit_bounce(_trial(Bounce(filter_hz=10.0)))
    assert fit.lag.value == pytest.approx(-np.arctan(0.1) / (2 * np.pi), abs=0.4e-3)
    assert abs(fit.gain.value - 1) < 0.01
    assert abs(fit.gain.value - 1) < 2.5 * fit.gain.estimate.standard_error


def test_the_spring_s_own_mass_is_counted() -> None:
    fit = fit_bounce(_trial(Bounce(spring_mass=0.4)))
    assert fit.gain.value == pytest.approx(1.0, abs=0.004)
    assert fit.zero.value == pytest.approx(1.5, abs=0.1)


def test_which_way_is_down_ghosts_and_hidden_frames_do_not_matter() -> None:
    plain = fit_bounce(_trial(Bounce()))
    turned = fit_bounce(_trial(Bounce(down=(0.6, 0.0, 0.8), ghosts=0.01, occlusion=0.05)))
    assert turned.lag.value == pytest.approx(plain.lag.value, abs=2e-4)
    assert turned.gain.value == pytest.approx(plain.gain.value, rel=2e-3)


def test_a_lag_that_the_configuration_knew_is_not_counted_twice() -> None:
    truth = Bounce(lag=0.03)
    manifest, tracks = recorded(truth, 1)
    reported = replace(manifest, timing=Timing(lag_s=0.025, lag_sd_s=0.001, stop_edge="end_of_frame"))
    assert fit_bounce(build_bounce(reported, tracks, "a", "a")).lag.value == pytest.approx(0.03, abs=4e-4)


@pytest.mark.parametrize(
    ("truth", "code", "figures"),
    [
        (Bounce(polarity=-1, zero=0.0), "POLARITY", {"force_n": pytest.approx(-24.5, abs=0.5), "mass_kg": 2.5}),
        (Bounce(duration=8.0), "FEW_CYCLES", {"expected": 10}),
        (SLOW, "FEW_SAMPLES", {"samples": pytest.approx(6.7, abs=0.05)}),
        (Bounce(occlusion=0.5), "HIDDEN", {"marker": "weight", "seen": pytest.approx(0.55, abs=0.05)}),
        (Bounce(marker_noise=0.02), "STILL", {}),
        (Bounce(down=(0.0, 0.0, 0.0), marker_noise=0.0), "STILL", {}),
    ],
)
def test_a_bounce_that_cannot_calibrate_is_refused(truth: Bounce, code: str, figures: dict[str, object]) -> None:
    with raises_refusal(RejectionCode[f"BOUNCE_{code}"], **figures):
        fit_bounce(_trial(truth))


@pytest.mark.parametrize(("gain", "mistake"), [(2.0, GainMistake.CAPACITY_DOUBLED), (1.3, GainMistake.UNKNOWN)])
def test_a_gain_that_is_a_mistake_is_named_and_not_used(gain: float, mistake: GainMistake) -> None:
    calibration, refused = calibrate([_trial(Bounce(gain=gain))])
    assert refused == {}
    assert calibration.notes[0].figures["mistake"] is mistake
    assert calibration.gain_with(0.002) == (1.0, 0.002)
    assert calibration.lag.value == pytest.approx(0.0, abs=5e-4)


def test_a_cell_that_was_zeroed_with_the_weight_on_is_reported() -> None:
    fit = fit_bounce(_trial(Bounce(zero=-2.5 * 9.81)))
    assert fit.notes[0].code is TrialNoteCode.BOUNCE_TARED


def test_bounces_are_put_together_and_the_newest_run_of_each_counts() -> None:
    early, late = _trial(Bounce(lag=0.01), run=1), _trial(Bounce(lag=0.002), run=2)
    second = replace(_trial(Bounce(lag=0.002), seed=5, run=3), repeat=2, start_utc_ns=99)
    broken = replace(_trial(Bounce(duration=8.0), run=4), repeat=3)
    calibration, refused = calibrate([late, early, second, broken])
    assert calibration.lag.value == pytest.approx(0.002, abs=3e-4)
    assert set(calibration.sources) == {"test-bounce_run-2.mcap", "test-bounce_run-3.mcap"}
    assert calibration.recorded_utc_ns == max(late.start_utc_ns, 99)
    assert list(refused) == ["test-bounce_run-4.mcap"]
    assert calibrate([]) == (None, {})

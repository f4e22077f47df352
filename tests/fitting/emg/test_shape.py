"""Shape, change and regression of EMG beside a model: known truth comes out, and intervals cover it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal, stats

from fitting.emg.change import RepeatUnit, emg_change, pool_shapes
from fitting.emg.envelopes import PUBLISHED, EnvelopeSettings, emg_envelope
from fitting.emg.shape import MAX_LAG_S, ShapeComparison, ShapeOutcome, compare_shapes
from fitting.results.codes import FitErrorCode
from tests.fitting.emg.simulated import FAST, NOISES, RATE, activation, compare_pair, emg_pairs, raw_emg
from tests.refusals import raises_refusal

TIME = np.arange(0, 8, 0.01)
MODEL = activation(TIME)
LAG = 0.06


def correlated(rate: float, scale: float, random: np.random.Generator, draws: int) -> np.ndarray:
    """Noise (draws, frames) with a correlation time of scale [s], low-passed like an envelope at the rate [Hz]."""
    whole = signal.lfilter([1.0], [1.0, -np.exp(-0.01 / scale)], random.standard_normal((draws, len(TIME) + 800)))
    low_pass = signal.butter(2, rate, fs=100.0, output="sos")
    noise = signal.sosfiltfilt(low_pass, whole, axis=1)[:, 400:-400]
    return np.asarray(noise / noise.std())


def coverage(bandwidth: float, scale: float, relative_noise: float, draws: int) -> tuple[float, float]:
    """Shares of the intervals of lag and correlation that cover the truth, over lags from the whole of the search."""
    random = np.random.default_rng(12)
    smoothed = signal.filtfilt(*signal.butter(2, bandwidth, fs=100.0), MODEL)
    noise = relative_noise * np.ptp(smoothed)
    inner = np.arange(0.5, 7.5, 0.1)
    within = 1 - np.exp(-np.abs(np.subtract.outer(inner, inner)) / scale).mean()
    hits = np.zeros(2)
    for disturbance in correlated(bandwidth, scale, random, draws):
        lag = random.uniform(-MAX_LAG_S, MAX_LAG_S)
        envelope = 2 + 30 * (np.interp(TIME - lag, TIME, smoothed) + noise * disturbance)
        found = compare_shapes((TIME, envelope), (TIME, MODEL), bandwidth)
        true = np.interp(inner - lag, TIME, smoothed)
        followed = true if found.outcome is ShapeOutcome.COMPARED else np.interp(inner, TIME, smoothed)
        truth = np.corrcoef(true, followed)[0, 1] * true.std() / np.hypot(true.std(), noise * np.sqrt(within))
        ends = (*found.lag_ci95, *found.correlation_ci95)
        hits += (ends[0] <= lag <= ends[1], ends[2] <= truth <= ends[3])
    return float(hits[0] / draws), float(hits[1] / draws)


def test_a_shifted_copy_has_its_lag_a_correlation_of_one_and_no_difference() -> None:
    found = compare_shapes((TIME, 5 + 7 * activation(TIME - 0.12)), (TIME, MODEL), 6.0)
    assert found.outcome is ShapeOutcome.COMPARED
    assert found.lag == pytest.approx(0.12, abs=0.002)
    assert found.correlation > 0.9999
    assert found.rmse < 0.01
    assert (found.emg.min(), found.emg.max(), found.model.min(), found.model.max()) == (0, 1, 0, 1)


@pytest.mark.parametrize("settings", [EnvelopeSettings(), PUBLISHED, EnvelopeSettings(smoothing="rms")])
def test_raw_emg_that_follows_the_model_is_found_to_lag_as_it_does(settings: EnvelopeSettings) -> None:
    time = np.arange(8000) / RATE
    raw = raw_emg(activation(time - LAG), np.random.default_rng(5))
    envelope = emg_envelope(raw, RATE, settings)[:, 0]
    found = compare_shapes((time, envelope), (TIME, MODEL), settings.bandwidth)
    assert found.outcome is ShapeOutcome.COMPARED
    assert found.lag_ci95[0] <= LAG <= found.lag_ci95[1]
    assert found.lag_ci95[1] - found.lag_ci95[0] < 0.4
    assert found.correlation > 0.95


def test_neither_gain_nor_floor_of_the_emg_changes_anything() -> None:
    envelope = np.maximum(MODEL + 0.03 * correlated(6.0, 0.1, np.random.default_rng(1), 1)[0], 0)
    one, other = (compare_shapes((TIME, values), (TIME, MODEL), 6.0) for values in (envelope, 4 + 1e-6 * envelope))
    for name in ("correlation", "lag", "rmse"):
        assert getattr(one, name) == pytest.approx(getattr(other, name), abs=1e-6)


@pytest.mark.parametrize(
    ("emg", "model", "outcome"),
    [
        (MODEL, 0.004 * MODEL, ShapeOutcome.MODEL_AT_REST),
        (np.full_like(MODEL, 0.3), MODEL, ShapeOutcome.CONSTANT_EMG),
        (np.random.default_rng(2).random(len(TIME)), MODEL, ShapeOutcome.LAG_NOT_IDENTIFIED),
        (activation(TIME - 0.7), MODEL, ShapeOutcome.LAG_NOT_IDENTIFIED),
    ],
    ids=["muscle at rest", "no EMG", "no relation", "a lag beyond the search"],
)
def test_what_cannot_be_compared_has_a_code(emg: np.ndarray, model: np.ndarray, outcome: ShapeOutcome) -> None:
    assert compare_shapes((TIME, emg), (TIME, model), 6.0).outcome is outcome


def test_a_trial_too_short_has_a_code_and_one_of_another_time_is_refused() -> None:
    short = TIME[:200]
    assert compare_shapes((short, MODEL[:200]), (TIME, MODEL), 2.5).outcome is ShapeOutcome.TOO_SHORT
    with raises_refusal(FitErrorCode.EMG_OTHER_TIME):
        compare_shapes((TIME + 100, MODEL), (TIME, MODEL), 6.0)


def test_noise_proportional_to_the_level_is_in_the_interval_of_the_lag() -> None:
    """Raw EMG of a burst of 0.35 s: 68 % were covered with noise of one size throughout."""
    random, time = np.random.default_rng(6), np.arange(8000) / RATE
    settings, covered = EnvelopeSettings(), []
    for lag in random.uniform(-0.2, 0.2, 30):
        raw = raw_emg(activation(time - lag, peak=4.0, width=0.35), random)
        envelope = emg_envelope(raw, RATE, settings)[:, 0]
        found = compare_shapes((time, envelope), (TIME, activation(TIME, peak=4.0, width=0.35)), settings.bandwidth)
        covered.append(found.lag_ci95[0] <= lag <= found.lag_ci95[1])
    assert np.mean(covered) >= 0.87


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("bandwidth", [2.5, 6.0])
def test_intervals_cover_the_truth_over_fast_and_slow_noise(bandwidth: float) -> None:
    """On average over noise as fast as the smoothing lets through and as slow as a movement; each alone above 91."""
    cells = [(scale, noise) for scale in (0.05, 0.3, 1.0) for noise in (0.1, 0.3)]
    found = np.array([coverage(bandwidth, *cell, 300) for cell in cells])
    assert (found >= 0.91).all()  # 1.6 standard errors of 300 draws below 93 %
    assert ((found.mean(axis=0) >= 0.93) & (found.mean(axis=0) <= 0.98)).all()


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_intervals_cover_the_truth_over_noise_that_does_not_follow_the_model() -> None:
    """Of some noises more than 95 % (docs/emg.md): there the width is bounded.

    100 pairs of each noise, two of each movement: with four, the variance of the share is up to 1.4 times the binomial
    one, that of independent pairs.
    """
    settings = EnvelopeSettings()
    pairs = {
        noise: [compare_pair(pair, settings) for i in range(50) for pair in emg_pairs(noise, settings, i, count=2)]
        for noise in NOISES
    }
    covered = {noise: np.array(found, dtype=float)[:, [1, 3]].mean(axis=0) for noise, found in pairs.items()}
    assert all(np.mean([is_known for is_known, *_ in found]) > 0.5 for found in pairs.values()), "not by open intervals"
    assert all((share >= 0.9).all() for share in covered.values())  # 2.3 standard errors below 95 %
    slow = np.array([share for noise, share in covered.items() if noise not in FAST])
    assert 0.93 <= slow[:, 0].mean() <= 0.97
    assert 0.93 <= np.mean([share[0] for share in covered.values()]) <= 0.97
    of_random_size = np.array([covered["gain drift"], covered["disagreement"]])
    assert 0.93 <= of_random_size[:, 1].mean() <= 0.97
    widths = {noise: np.median([width for *_, width, _ in pairs[noise]]) for noise in FAST}
    assert widths["none"] < 0.09 and widths["amplifier"] < 0.1 and widths["few motor units"] < 0.17


TRIAL, CYCLE = RepeatUnit.TRIAL, RepeatUnit.CYCLE


def single(levels: list[float]) -> list[list[float]]:
    """Trials of one cycle."""
    return [[level] for level in levels]


def test_the_interval_is_welch_s_on_logarithms() -> None:
    without, worn = [1.0, 1.2, 0.9, 1.1], [0.7, 0.8, 0.95]
    expected = stats.ttest_ind(np.log(worn), np.log(without), equal_var=False).confidence_interval()
    for reference, condition, units in (
        (single(without), single(worn), (TRIAL, TRIAL)),
        ([without], [worn], (CYCLE, CYCLE)),
    ):
        found = emg_change(reference, condition)
        assert found.ci95 == pytest.approx(tuple(np.exp([expected.low, expected.high])))
        assert found.ratio == pytest.approx(stats.gmean(worn) / stats.gmean(without))
        assert (found.repeats, found.units) == ((4, 3), units)


def test_a_single_repeat_has_a_ratio_and_no_interval() -> None:
    found = emg_change(single([2.0]), [[1.0, 1.0]])
    assert (found.ratio, found.ci95, found.standard_error) == (0.5, None, None)
    assert found.units == (TRIAL, CYCLE)


def covered(trials: int, cycles: int, spread: tuple[float, float], *, is_flat: bool = False) -> float:
    """Share of intervals that contain the ratio 0.7; spread between trials and between the cycles of a trial."""
    random, hits, sessions = np.random.default_rng(6), 0, 1000
    for _ in range(sessions):
        person = spread[0] * random.standard_normal((2, trials, 1))
        levels = np.exp(person + spread[1] * random.standard_normal((2, trials, cycles)))
        before, after = levels[0], 0.7 * levels[1]
        if is_flat:
            before, after = before.reshape(1, -1), after.reshape(1, -1)
        low, high = emg_change(before.tolist(), after.tolist()).ci95 or (0.0, 0.0)
        hits += low <= 0.7 <= high
    return hits / sessions


def test_the_interval_over_trials_covers_what_cycles_taken_as_independent_would_miss() -> None:
    assert 0.93 <= covered(3, 4, (0.2, 0.1)) <= 0.98
    assert covered(3, 4, (0.2, 0.1), is_flat=True) < 0.8


@pytest.mark.parametrize(("repeats", "spread"), [((3, 3), (0.1, 0.1)), ((5, 3), (0.05, 0.15)), ((8, 8), (0.3, 0.1))])
def test_the_interval_covers_the_true_ratio(repeats: tuple[int, int], spread: tuple[float, float]) -> None:
    random = np.random.default_rng(6)
    hits = 0
    for _ in range(1500):
        without = np.exp(spread[0] * random.standard_normal(repeats[0]))
        worn = 0.7 * np.exp(spread[1] * random.standard_normal(repeats[1]))
        low, high = emg_change(single(without.tolist()), single(worn.tolist())).ci95 or (0.0, 0.0)
        hits += low <= 0.7 <= high
    assert 0.93 <= hits / 1500 <= 0.975


# Correlation and lag over several trials: against Student's interval, and coverage on simulated sessions.


EMPTY = np.zeros(0)


def compared(
    correlation: float, lag: float, half_width: float = 0.02, outcome: ShapeOutcome = ShapeOutcome.COMPARED
) -> ShapeComparison:
    low, high = np.tanh(np.arctanh(correlation) + np.array([-0.1, 0.1])).tolist()
    ends = lag - half_width, lag + half_width
    return ShapeComparison(outcome, EMPTY, EMPTY, EMPTY, correlation, (low, high), lag, ends)


def test_trials_that_differ_by_far_more_than_their_intervals_have_student_s_interval() -> None:
    correlations, lags = [0.5, 0.7, 0.9], [0.0, 0.1, 0.3]
    found = pool_shapes([compared(*pair, half_width=1e-4) for pair in zip(correlations, lags, strict=True)])
    assert found is not None and found.lag is not None
    expected = stats.ttest_1samp(lags, 0.0).confidence_interval()
    assert found.lag.value == pytest.approx(np.mean(lags), rel=1e-5)
    assert found.lag.ci95 == pytest.approx((expected.low, expected.high), rel=1e-4)
    z = stats.ttest_1samp(np.arctanh(correlations), 0.0).confidence_interval()
    assert found.correlation == pytest.approx(np.tanh(np.arctanh(correlations).mean()), rel=1e-2)
    assert found.correlation_ci95 == pytest.approx(np.tanh([z.low, z.high]), rel=2e-2)


def test_equal_trials_have_an_interval_narrower_by_the_root_of_their_number() -> None:
    found = pool_shapes([compared(0.8, 0.05)] * 4)
    assert found is not None and found.lag is not None
    assert found.lag.ci95 == pytest.approx((0.04, 0.06))
    assert found.correlation_ci95 == pytest.approx(np.tanh(np.arctanh(0.8) + np.array([-0.05, 0.05])))


def test_a_trial_without_a_lag_enters_the_correlation_alone() -> None:
    unidentified = compared(0.2, 0.4, outcome=ShapeOutcome.LAG_NOT_IDENTIFIED)
    resting = ShapeComparison(ShapeOutcome.MODEL_AT_REST, EMPTY, EMPTY, EMPTY)
    found = pool_shapes([compared(0.8, 0.05), unidentified, compared(0.8, 0.06), resting])
    assert found is not None and found.lag is not None
    assert (found.trials, found.trials_of_lag) == (3, 2)
    assert found.lag.value == pytest.approx(0.055)
    assert found.correlation < 0.75
    alone = pool_shapes([compared(0.8, 0.05), unidentified])
    assert alone is not None and alone.lag is None


def test_a_single_trial_is_not_pooled() -> None:
    assert pool_shapes([compared(0.8, 0.05)]) is None


def test_perfect_correlations_stay_finite() -> None:
    perfect = replace(compared(0.9, 0.0, half_width=0.0), correlation=1.0, correlation_ci95=(1.0, 1.0))
    found = pool_shapes([perfect] * 3)
    assert found.correlation == pytest.approx(1.0) and np.isfinite(found.correlation_ci95).all()


@pytest.mark.slow
@pytest.mark.parametrize("between_s", [0.0, 0.03])
def test_the_interval_of_the_lag_covers_the_mean_lag_of_a_person(between_s: float) -> None:
    """Three trials a session; the lag of a trial is normal about the person's."""
    random, hits, sessions = np.random.default_rng(4), 0, 300
    low_pass = signal.butter(2, 6.0, fs=100.0, output="sos")
    model = activation(TIME)
    for _ in range(sessions):
        trials = []
        for _ in range(3):
            lag = 0.05 + between_s * random.standard_normal()
            noise = signal.sosfiltfilt(low_pass, random.standard_normal(len(TIME) + 200))[100:-100]
            envelope = np.interp(TIME - lag, TIME, model) + 0.15 * noise
            trials.append(compare_shapes((TIME, envelope), (TIME, model), 6.0))
        found = pool_shapes(trials)
        assert found is not None and found.lag is not None
        hits += found.lag.ci95[0] <= 0.05 <= found.lag.ci95[1]
    assert 0.93 <= hits / sessions <= 1.0

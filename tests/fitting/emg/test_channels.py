"""Channels of no use are found before they are processed, sound ones are kept; their envelopes."""

import gzip
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import signal

from fitting.emg.channels import ChannelFinding, bridge_gaps, find_faults
from fitting.emg.envelopes import (
    PUBLISHED,
    EmgTrial,
    EnvelopeSettings,
    compute_envelopes,
    emg_envelope,
    largest_envelopes,
    maximum_voluntary_contraction,
    normalised,
    resampled,
)
from fitting.results.codes import FitErrorCode
from recordings.exchange.delimited_emg import read_exp
from tests.conftest import SHARED
from tests.fitting.emg.simulated import RATE, activation, raw_emg
from tests.refusals import raises_refusal

TIME = np.arange(6000) / RATE
SOUND = raw_emg(activation(TIME), np.random.default_rng(1))[:, 0]
LEVEL = np.where(TIME < 3, 0.2, 0.4)
RAW = np.column_stack((raw_emg(LEVEL, np.random.default_rng(1), 2), np.zeros(6000)))
TRIAL = EmgTrial("trial", ("a", "b", "off"), 2.0, RATE, RAW, "V")
ENVELOPES = compute_envelopes(TRIAL)
LONG_TIME = np.arange(8000) / RATE
INNER = slice(2000, 6000)


def faults(channel: np.ndarray) -> tuple[ChannelFinding, ...]:
    return find_faults(channel[:, None], RATE)[0]


def envelope(**changes: Any) -> np.ndarray:
    return emg_envelope(SOUND[:, None], RATE, EnvelopeSettings(**changes))[:, 0]


def with_gap(length: int) -> np.ndarray:
    channel = SOUND.copy()
    channel[3000 : 3000 + length] = np.nan
    return channel


@pytest.mark.parametrize(
    "channel",
    [SOUND, np.round(SOUND, 2), np.round(SOUND, 1) + 2.5, SOUND - SOUND.min(), with_gap(10)],
    ids=["as it is", "of few levels", "of very few levels, with an offset", "never negative", "with 10 ms lost"],
)
def test_a_sound_channel_has_no_finding(channel: np.ndarray) -> None:
    assert faults(channel) == ()


FAULTS = {
    "constant": (np.full(6000, -0.8), ChannelFinding.FLAT),
    "off for 8 %": (np.where(TIME < 0.5, 0.0, SOUND), ChannelFinding.FLAT),
    "clipped": (np.clip(SOUND, -0.7, 0.7), ChannelFinding.CLIPPED),
    "clipped above": (np.clip(np.round(SOUND, 2), -5, 0.7), ChannelFinding.CLIPPED),
    "its offset is clipped": (np.clip(SOUND - 0.8, -0.5, 0.5), ChannelFinding.CLIPPED),
    "rectified": (np.abs(SOUND), ChannelFinding.RECTIFIED),
    "linear envelope": (envelope(), ChannelFinding.RECTIFIED),
    "RMS": (envelope(smoothing="rms", window_s=0.05), ChannelFinding.RECTIFIED),
    "baseline subtracted": (envelope() - 1.01 * envelope().min(), ChannelFinding.RECTIFIED),
    "11 ms lost": (with_gap(11), ChannelFinding.GAP),
    "nothing": (np.full(6000, np.nan), ChannelFinding.GAP),
    "50 Hz": (SOUND + np.sin(2 * np.pi * 50 * TIME), ChannelFinding.HUM),
    "third of 60 Hz": (SOUND + np.sin(2 * np.pi * 180 * TIME), ChannelFinding.HUM),
}


@pytest.mark.parametrize(("channel", "finding"), FAULTS.values(), ids=FAULTS)
def test_a_fault_is_named_by_its_code(channel: np.ndarray, finding: ChannelFinding) -> None:
    assert faults(channel) == (finding,)


@pytest.mark.parametrize(
    ("samples", "rate", "code"), [(6000, 200.0, FitErrorCode.EMG_RATE), (300, 1000.0, FitErrorCode.EMG_SHORT)]
)
def test_too_slow_or_too_short_a_recording_is_refused(samples: int, rate: float, code: FitErrorCode) -> None:
    with raises_refusal(code):
        find_faults(SOUND[:samples, None], rate)


def test_lost_samples_are_bridged_by_a_straight_line() -> None:
    values = np.array([[0.0, 1.0], [np.nan, 2.0], [np.nan, np.nan], [3.0, 4.0]])
    assert bridge_gaps(values).tolist() == [[0.0, 1.0], [1.0, 2.0], [2.0, 3.0], [3.0, 4.0]]
    assert np.isnan(values).sum() == 3


@pytest.mark.shared
def test_the_public_trial_has_hum_on_the_infraspinatus_alone_and_is_rectified_where_it_was(tmp_path: Path) -> None:
    """Rectified behind a band-pass, as programs of amplifiers export it."""
    path = tmp_path / "flx01.exp"
    path.write_bytes(gzip.decompress((SHARED / "markers" / "FLX01_emg.exp.gz").read_bytes()))
    read = read_exp(path)
    raw = np.column_stack(list(read.signals.values()))
    found = zip(read.names, find_faults(raw, 1000.0), strict=True)
    assert {name: codes for name, codes in found if codes} == {"Infra": (ChannelFinding.HUM,)}
    band = signal.butter(2, (20.0, 450.0), "bandpass", fs=1000.0, output="sos")
    rectified = np.abs(signal.sosfiltfilt(band, raw, axis=0))
    with_offset = find_faults(raw + 2 * np.abs(raw).max(), 1000.0)
    assert not any(ChannelFinding.RECTIFIED in found for found in with_offset)
    assert all(ChannelFinding.RECTIFIED in found for found in find_faults(rectified, 1000.0))


def test_a_channel_that_cannot_be_used_has_no_numbers_and_the_others_have() -> None:
    assert ENVELOPES.usable == ("a", "b")
    assert np.isnan(ENVELOPES.of("off")).all()
    assert ENVELOPES.findings == {"a": (), "b": (), "off": (ChannelFinding.FLAT,)}
    with raises_refusal(FitErrorCode.EMG_NO_CHANNEL):
        compute_envelopes(EmgTrial("off", ("off",), 0.0, RATE, RAW[:, 2:], "V"))


def test_the_mean_is_that_of_the_time_or_of_every_cycle_within_it() -> None:
    """|x| of noise with standard deviation s has the mean s √(2/π)."""
    half = np.sqrt(2 / np.pi)
    assert ENVELOPES.means("a", 2.5, 4.5) == pytest.approx([0.2 * half], rel=0.1)
    cycled = replace(ENVELOPES, cycles=((2.5, 4.5), (5.5, 7.5), (7.0, 9.0)))
    assert cycled.means("a", 0.0, 8.0) == pytest.approx([0.2 * half, 0.4 * half], rel=0.1)


def test_levels_are_fractions_of_the_maximum_none_without_one_and_above_half_of_it_a_finding() -> None:
    levels = normalised(ENVELOPES, {"a": 2.0})
    np.testing.assert_allclose(levels.of("a"), ENVELOPES.of("a") / 2)
    assert (levels.unit, levels.usable, levels.findings["b"]) == ("1", ("a",), (ChannelFinding.NO_MVC,))
    largest = largest_envelopes([ENVELOPES])
    assert normalised(ENVELOPES, largest).findings == ENVELOPES.findings
    doubled = normalised(ENVELOPES, {label: value / 2 for label, value in largest.items()})
    assert doubled.findings["a"] == (ChannelFinding.ABOVE_MVC,)


def test_the_least_value_is_taken_off_where_that_is_asked() -> None:
    lowered = compute_envelopes(TRIAL, minimum_subtracted=["b"])
    assert lowered.of("b").min() == 0
    np.testing.assert_array_equal(lowered.of("a"), ENVELOPES.of("a"))


def test_at_another_rate_the_curve_stays_the_same() -> None:
    slow = resampled(ENVELOPES, 100.0)
    assert (slow.labels, slow.values.shape, slow.time[0]) == (("a", "b"), (600, 2), 2.0)
    np.testing.assert_allclose(slow.of("a"), ENVELOPES.of("a")[::10], rtol=1e-9)


# Envelopes against what is known of a sine, and against filters that are written down here from their formulas.


def biquad(values: np.ndarray, cutoff: float, quality: float, *, is_high_pass: bool) -> np.ndarray:
    """A second-order section by the bilinear transform."""
    turn = 2 * np.pi * cutoff / RATE
    alpha, cosine = np.sin(turn) / (2 * quality), np.cos(turn)
    middle = -(1 + cosine) if is_high_pass else 1 - cosine
    b = np.array([abs(middle) / 2, middle, abs(middle) / 2]) / (1 + alpha)
    a = np.array([-2 * cosine, 1 - alpha]) / (1 + alpha)
    return np.asarray(signal.lfilter(b, [1.0, *a], values))


def test_the_published_envelope_is_what_its_formulas_give() -> None:
    """A Butterworth filter of order 4 is two sections with Q = 1 / (2 cos 22.5°) and 1 / (2 cos 67.5°)."""
    raw = raw_emg(activation(LONG_TIME), np.random.default_rng(3))
    filtered = raw[:, 0]
    for quality in (0.5 / np.cos(np.pi / 8), 0.5 / np.cos(3 * np.pi / 8)):
        filtered = biquad(filtered, 100.0, quality, is_high_pass=True)
    smoothed = np.abs(filtered)
    for _ in range(2):
        smoothed = biquad(smoothed, 2.5, np.sqrt(0.5), is_high_pass=False)[::-1]
    np.testing.assert_allclose(emg_envelope(raw, RATE, PUBLISHED)[INNER, 0], smoothed[INNER], rtol=1e-6)


def test_a_sine_has_its_mean_rectified_value_and_its_rms() -> None:
    """2/π of the amplitude; a modulation at the cut-off comes through at half, and in phase."""
    modulation = 0.5 * np.sin(2 * np.pi * 6.0 * LONG_TIME)
    raw = (1 + modulation) * np.sin(2 * np.pi * 137.0 * LONG_TIME)
    found = emg_envelope(raw[:, None], RATE)[INNER, 0]
    np.testing.assert_allclose(found, 2 / np.pi * (1 + 0.5 * modulation[INNER]), atol=0.01)
    settings = EnvelopeSettings(smoothing="rms", window_s=0.1)
    raw = np.column_stack((np.sin(2 * np.pi * 100 * LONG_TIME), 3 * np.sin(2 * np.pi * 100 * LONG_TIME)))
    np.testing.assert_allclose(emg_envelope(raw, RATE, settings)[INNER], [[0.5**0.5, 3 * 0.5**0.5]] * 4000, rtol=2e-3)
    assert settings.bandwidth == pytest.approx(6.0)


@pytest.mark.parametrize("settings", [EnvelopeSettings(), PUBLISHED, EnvelopeSettings(smoothing="rms")])
def test_an_offset_and_a_slow_drift_leave_no_trace_and_the_gain_is_kept(settings: EnvelopeSettings) -> None:
    raw = raw_emg(activation(LONG_TIME), np.random.default_rng(4))
    plain = emg_envelope(raw, RATE, settings)[INNER]
    drifted = emg_envelope(5 * (raw + 0.8 + 0.3 * np.sin(2 * np.pi * 0.3 * LONG_TIME)[:, None]), RATE, settings)[INNER]
    np.testing.assert_allclose(drifted, 5 * plain, rtol=0.02, atol=1e-3)
    assert (plain >= 0).all()


@pytest.mark.parametrize("band", [(20.0, 500.0), (600.0, None)])
def test_a_band_beyond_half_the_rate_is_refused(band: tuple[float, float | None]) -> None:
    with raises_refusal(FitErrorCode.EMG_BAND):
        emg_envelope(np.zeros((1000, 1)), RATE, EnvelopeSettings(band_hz=band))


# The maximum voluntary contraction: the best half second of all trials, found by brute force here.


def test_a_maximum_contraction_is_the_largest_mean_over_the_window_in_any_trial_of_enough_samples() -> None:
    random = np.random.default_rng(2)
    trials = [random.random((400, 2)), random.random((300, 2))]
    trials[1][:, 1] = np.nan
    means = [[np.mean(trial[i : i + 50], axis=0) for i in range(len(trial) - 49)] for trial in trials]
    expected = np.nanmax(np.concatenate(means), axis=0)
    np.testing.assert_allclose(maximum_voluntary_contraction(trials, 100.0, 0.5), expected, rtol=1e-12)
    assert np.isnan(maximum_voluntary_contraction([np.full((100, 1), np.nan)], 100.0)).all()
    with raises_refusal(FitErrorCode.EMG_MVC_SHORT):
        maximum_voluntary_contraction([np.zeros((49, 1))], 100.0)

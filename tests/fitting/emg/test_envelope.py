"""Envelopes against what is known of a sine, and against filters that are written down here from their formulas."""

from __future__ import annotations

import numpy as np
import pytest

from fitting.emg.envelope import PUBLISHED, EnvelopeSettings, emg_envelope
from fitting.results.codes import FitErrorCode
from tests.fitting.emg.simulated import RATE, activation, raw_emg
from tests.fitting.refusals import raises_refusal

TIME = np.arange(8000) / RATE
INNER = slice(2000, 6000)


def biquad(values: np.ndarray, cutoff: float, quality: float, *, is_high_pass: bool) -> np.ndarray:
    """A second-order section by the bilinear transform, sample by sample."""
    turn = 2 * np.pi * cutoff / RATE
    alpha, cosine = np.sin(turn) / (2 * quality), np.cos(turn)
    middle = -(1 + cosine) if is_high_pass else 1 - cosine
    b = np.array([abs(middle) / 2, middle, abs(middle) / 2]) / (1 + alpha)
    a = np.array([-2 * cosine, 1 - alpha]) / (1 + alpha)
    found = np.zeros_like(values)
    for i in range(2, len(values)):
        found[i] = b @ values[i - 2 : i + 1][::-1] - a @ found[i - 2 : i][::-1]
    return found


def test_the_published_envelope_is_what_its_formulas_give() -> None:
    """A Butterworth filter of order 4 is two sections with Q = 1 / (2 cos 22.5°) and 1 / (2 cos 67.5°)."""
    raw = raw_emg(activation(TIME), np.random.default_rng(3))
    filtered = raw[:, 0]
    for quality in (0.5 / np.cos(np.pi / 8), 0.5 / np.cos(3 * np.pi / 8)):
        filtered = biquad(filtered, 100.0, quality, is_high_pass=True)
    smoothed = np.abs(filtered)
    for _ in range(2):
        smoothed = biquad(smoothed, 2.5, np.sqrt(0.5), is_high_pass=False)[::-1]
    np.testing.assert_allclose(emg_envelope(raw, RATE, PUBLISHED)[INNER, 0], smoothed[INNER], rtol=1e-6)


def test_the_linear_envelope_of_a_modulated_sine_is_its_mean_rectified_value() -> None:
    """2/π of the amplitude; a modulation at the cut-off comes through at half, and in phase."""
    modulation = 0.5 * np.sin(2 * np.pi * 6.0 * TIME)
    raw = (1 + modulation) * np.sin(2 * np.pi * 137.0 * TIME)
    found = emg_envelope(raw[:, None], RATE)[INNER, 0]
    np.testing.assert_allclose(found, 2 / np.pi * (1 + 0.5 * modulation[INNER]), atol=0.01)


def test_the_rms_of_a_sine_is_its_amplitude_over_root_two() -> None:
    settings = EnvelopeSettings(smoothing="rms", window_s=0.1)
    raw = np.column_stack((np.sin(2 * np.pi * 100 * TIME), 3 * np.sin(2 * np.pi * 100 * TIME)))
    np.testing.assert_allclose(emg_envelope(raw, RATE, settings)[INNER], [[0.5**0.5, 3 * 0.5**0.5]] * 4000, rtol=2e-3)
    assert settings.bandwidth == pytest.approx(6.0)


@pytest.mark.parametrize("settings", [EnvelopeSettings(), PUBLISHED, EnvelopeSettings(smoothing="rms")])
def test_an_offset_and_a_slow_drift_leave_no_trace_and_the_gain_is_kept(settings: EnvelopeSettings) -> None:
    raw = raw_emg(activation(TIME), np.random.default_rng(4))
    plain = emg_envelope(raw, RATE, settings)[INNER]
    drifted = emg_envelope(5 * (raw + 0.8 + 0.3 * np.sin(2 * np.pi * 0.3 * TIME)[:, None]), RATE, settings)[INNER]
    np.testing.assert_allclose(drifted, 5 * plain, rtol=0.02, atol=1e-3)
    assert (plain >= 0).all()


@pytest.mark.parametrize("band", [(20.0, 500.0), (600.0, None)])
def test_a_band_beyond_half_the_rate_is_refused(band: tuple[float, float | None]) -> None:
    with raises_refusal(FitErrorCode.EMG_BAND):
        emg_envelope(np.zeros((1000, 1)), RATE, EnvelopeSettings(band_hz=band))

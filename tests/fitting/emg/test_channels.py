"""Channels of no use are found before they are processed, and sound ones are left alone."""

from __future__ import annotations

import gzip
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import signal

from fitting.emg.channels import ChannelFinding, bridge_gaps, find_faults
from fitting.emg.envelopes import EnvelopeSettings, emg_envelope
from fitting.results.codes import FitErrorCode
from recordings.exchange.exp import read_exp
from tests.conftest import SHARED
from tests.fitting.emg.simulated import RATE, activation, raw_emg
from tests.refusals import raises_refusal

TIME = np.arange(6000) / RATE
SOUND = raw_emg(activation(TIME), np.random.default_rng(1))[:, 0]


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


@pytest.mark.parametrize(
    ("channel", "finding"),
    [
        (np.full(6000, -0.8), ChannelFinding.FLAT),
        (np.where(TIME < 0.5, 0.0, SOUND), ChannelFinding.FLAT),
        (np.clip(SOUND, -0.7, 0.7), ChannelFinding.CLIPPED),
        (np.clip(np.round(SOUND, 2), -5, 0.7), ChannelFinding.CLIPPED),
        (np.clip(SOUND - 0.8, -0.5, 0.5), ChannelFinding.CLIPPED),
        (np.abs(SOUND), ChannelFinding.RECTIFIED),
        (envelope(), ChannelFinding.RECTIFIED),
        (envelope(smoothing="rms", window_s=0.05), ChannelFinding.RECTIFIED),
        (envelope() - 1.01 * envelope().min(), ChannelFinding.RECTIFIED),
        (with_gap(11), ChannelFinding.GAP),
        (np.full(6000, np.nan), ChannelFinding.GAP),
        (SOUND + np.sin(2 * np.pi * 50 * TIME), ChannelFinding.HUM),
        (SOUND + np.sin(2 * np.pi * 180 * TIME), ChannelFinding.HUM),
    ],
    ids=[
        "constant",
        "off for 8 %",
        "clipped",
        "clipped above",
        "its offset is clipped",
        "rectified",
        "linear envelope",
        "RMS",
        "baseline subtracted",
        "11 ms lost",
        "nothing",
        "50 Hz",
        "third of 60 Hz",
    ],
)
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
def test_the_public_trial_has_hum_on_the_infraspinatus_alone(tmp_path: Path) -> None:
    path = tmp_path / "flx01.exp"
    path.write_bytes(gzip.decompress((SHARED / "markers" / "FLX01_emg.exp.gz").read_bytes()))
    read = read_exp(path)
    found = find_faults(np.column_stack(list(read.signals.values())), 1000.0)
    assert {name: codes for name, codes in zip(read.names, found, strict=True) if codes} == {
        "Infra": (ChannelFinding.HUM,)
    }


@pytest.mark.shared
def test_the_public_channels_have_no_finding_with_an_offset_and_one_when_they_are_rectified(tmp_path: Path) -> None:
    """Rectified behind a band-pass, as programs of amplifiers export it."""
    path = tmp_path / "flx01.exp"
    path.write_bytes(gzip.decompress((SHARED / "markers" / "FLX01_emg.exp.gz").read_bytes()))
    raw = np.column_stack(list(read_exp(path).signals.values()))
    band = signal.butter(2, (20.0, 450.0), "bandpass", fs=1000.0, output="sos")
    rectified = np.abs(signal.sosfiltfilt(band, raw, axis=0))
    with_offset = find_faults(raw + 2 * np.abs(raw).max(), 1000.0)
    assert not any(ChannelFinding.RECTIFIED in found for found in with_offset)
    assert all(ChannelFinding.RECTIFIED in found for found in find_faults(rectified, 1000.0))

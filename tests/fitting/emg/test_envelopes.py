"""Envelopes of a trial: what can be used, levels over the MVC, means over cycles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fitting.emg.channels import ChannelFinding
from fitting.emg.envelopes import EmgTrial, envelopes_of, largest_envelopes, normalised, resampled
from fitting.results.codes import FitErrorCode
from tests.fitting.emg.simulated import RATE, raw_emg
from tests.fitting.refusals import raises_refusal

TIME = np.arange(6000) / RATE
LEVEL = np.where(TIME < 3, 0.2, 0.4)
RAW = np.column_stack((raw_emg(LEVEL, np.random.default_rng(1), 2), np.zeros(6000)))
TRIAL = EmgTrial("trial", ("a", "b", "off"), 2.0, RATE, RAW, "V")
ENVELOPES = envelopes_of(TRIAL)


def test_a_channel_that_cannot_be_used_has_no_numbers_and_the_others_have() -> None:
    assert ENVELOPES.usable == ("a", "b")
    assert np.isnan(ENVELOPES.of("off")).all()
    assert ENVELOPES.findings == {"a": (), "b": (), "off": (ChannelFinding.FLAT,)}
    with raises_refusal(FitErrorCode.EMG_NO_CHANNEL):
        envelopes_of(EmgTrial("off", ("off",), 0.0, RATE, RAW[:, 2:], "V"))


def test_the_mean_is_that_of_the_time_or_of_every_cycle_within_it() -> None:
    """|x| of noise with standard deviation s has the mean s √(2/π)."""
    half = np.sqrt(2 / np.pi)
    assert ENVELOPES.means("a", 2.5, 4.5) == pytest.approx([0.2 * half], rel=0.1)
    cycled = replace(ENVELOPES, cycles=((2.5, 4.5), (5.5, 7.5), (7.0, 9.0)))
    assert cycled.means("a", 0.0, 8.0) == pytest.approx([0.2 * half, 0.4 * half], rel=0.1)


def test_levels_are_fractions_of_the_maximum_and_a_channel_without_one_has_none() -> None:
    levels = normalised(ENVELOPES, {"a": 2.0})
    np.testing.assert_allclose(levels.of("a"), ENVELOPES.of("a") / 2)
    assert (levels.unit, levels.usable, levels.findings["b"]) == ("1", ("a",), (ChannelFinding.NO_MVC,))


def test_a_trial_is_never_above_its_own_maximum_and_is_above_half_of_it() -> None:
    largest = largest_envelopes([ENVELOPES])
    assert normalised(ENVELOPES, largest).findings == ENVELOPES.findings
    doubled = normalised(ENVELOPES, {label: value / 2 for label, value in largest.items()})
    assert doubled.findings["a"] == (ChannelFinding.ABOVE_MVC,)


def test_the_least_value_is_taken_off_where_that_is_asked() -> None:
    lowered = envelopes_of(TRIAL, minimum_subtracted=["b"])
    assert lowered.of("b").min() == 0
    np.testing.assert_array_equal(lowered.of("a"), ENVELOPES.of("a"))


def test_at_another_rate_the_curve_stays_the_same() -> None:
    slow = resampled(ENVELOPES, 100.0)
    assert (slow.labels, slow.values.shape, slow.time[0]) == (("a", "b"), (600, 2), 2.0)
    np.testing.assert_allclose(slow.of("a"), ENVELOPES.of("a")[::10], rtol=1e-9)

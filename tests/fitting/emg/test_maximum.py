"""The maximum voluntary contraction: the best half second of all trials, found by brute force here."""

from __future__ import annotations

import numpy as np

from fitting.emg.maximum import maximum_voluntary_contraction
from fitting.results.codes import FitErrorCode
from tests.fitting.refusals import raises_refusal


def test_it_is_the_largest_mean_over_the_window_in_any_trial() -> None:
    random = np.random.default_rng(2)
    trials = [random.random((400, 2)), random.random((300, 2))]
    trials[1][:, 1] = np.nan
    means = [[np.mean(trial[i : i + 50], axis=0) for i in range(len(trial) - 49)] for trial in trials]
    expected = np.nanmax(np.concatenate(means), axis=0)
    np.testing.assert_allclose(maximum_voluntary_contraction(trials, 100.0, 0.5), expected, rtol=1e-12)


def test_a_channel_without_any_trial_has_no_maximum_and_a_short_trial_is_refused() -> None:
    assert np.isnan(maximum_voluntary_contraction([np.full((100, 1), np.nan)], 100.0)).all()
    with raises_refusal(FitErrorCode.EMG_MVC_SHORT):
        maximum_voluntary_contraction([np.zeros((49, 1))], 100.0)

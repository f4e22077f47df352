"""Live results of the public trials beside the offline ones: what a lag costs."""

from __future__ import annotations

import pytest

from benchmarks.live import difference, public_trial, solve_offline


@pytest.mark.slow
@pytest.mark.shared
@pytest.mark.parametrize("name", ["FLX01", "ABD02", "FLX21"])
def test_the_difference_from_the_offline_result_is_small_at_the_stated_lags(name: str) -> None:
    trial = public_trial(name)
    offline = solve_offline(trial)
    usual, short = difference(trial, offline, 0.15), difference(trial, offline, 0.05)
    assert usual.unsolved == short.unsolved == 0
    assert usual.mean_activation <= 0.002
    assert usual.high_force <= 30.0
    assert usual.mean_activation < short.mean_activation <= 0.005

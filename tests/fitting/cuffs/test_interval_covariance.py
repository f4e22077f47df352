"""Draws from a cuff's parameters are as wide as the intervals of its fit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fitting.cuffs.cuff_fit import CuffFit
from fitting.cuffs.wearable_cuff import with_interval_covariance
from fitting.results.codes import Verdict
from fitting.uncertainty import Estimate, normal_estimate


def _fit() -> CuffFit:
    """k with an interval twice as wide as 1.96 standard errors, c and migration with normal ones."""
    covariance = np.array([[100.0, 30.0, 0.0], [30.0, 25.0, 0.0], [0.0, 0.0, 1e-8]])
    wide = Estimate(5000.0, 10.0, (5000 - 2 * 19.59963984540054, 5000 + 2 * 19.59963984540054))
    estimates = wide, normal_estimate(100.0, 5.0), normal_estimate(0.01, 1e-4)
    return CuffFit("hand", "arm", "1", *estimates, (Verdict.IDENTIFIED,), covariance)


def test_the_covariance_gives_the_fit_s_intervals_and_keeps_the_correlation() -> None:
    found = with_interval_covariance(_fit().wearable()).covariance
    np.testing.assert_allclose(np.sqrt(np.diag(found)), [20.0, 5.0, 1e-4], rtol=1e-12)
    assert found[0, 1] / np.sqrt(found[0, 0] * found[1, 1]) == pytest.approx(30 / 50)


def test_an_interval_narrower_than_its_standard_error_does_not_shrink_it() -> None:
    fit = replace(_fit(), stiffness=Estimate(5000.0, 10.0, (5000.0, 5000.0)))
    assert with_interval_covariance(fit.wearable()).covariance[0, 0] == pytest.approx(100.0)

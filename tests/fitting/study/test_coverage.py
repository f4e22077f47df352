"""Intervals hold the true value as often as they say, over studies that are drawn without the code of the fit."""

from __future__ import annotations

import pytest

from benchmarks.study import coverage


def test_twelve_studies_are_mostly_in_their_intervals() -> None:
    """Of 12 intervals of 95 %, fewer than 9 hold the true value in 0.02 % of cases."""
    assert min(coverage(12, seed=4).values()) >= 0.75


@pytest.mark.slow
def test_five_hundred_studies_are_covered_by_93_to_97_percent() -> None:
    """An interval that ends at zero covers more: that of three operators has no upper limit here."""
    runs = [coverage(250, seed) for seed in (3, 4)]
    found = {name: sum(run[name] for run in runs) / len(runs) for name in runs[0]}
    operators = found.pop("sd of operator")
    assert operators >= 0.93
    assert {name: part for name, part in found.items() if not 0.93 <= part <= 0.97} == {}

"""Which repeat does not agree with the others, and in which trial the cuff slipped."""

from __future__ import annotations

from fitting.cuffs.trial_fit import TrialFit, find_outliers, has_slipped
from fitting.uncertainty import normal_estimate


def _trial(stiffness: float, sd: float = 10.0, migration: float = 0.0) -> TrialFit:
    return TrialFit(
        "a.mcap",
        "hash",
        "static",
        1,
        1,
        "used",
        stiffness=normal_estimate(stiffness, sd),
        migration=normal_estimate(migration, 1e-4),
    )


def test_a_repeat_is_outlying_beyond_three_combined_standard_errors() -> None:
    others = [_trial(1000.0), _trial(1000.0)]
    assert find_outliers(_trial(1000.0 + 2.9 * 10 * 2**0.5), others) == ()
    (outlier,) = find_outliers(_trial(1000.0 + 3.1 * 10 * 2**0.5), others)
    assert (outlier.quantity, outlier.mean) == ("stiffness", 1000.0)
    assert round(outlier.distance, 6) == 3.1


def test_the_spread_of_the_others_counts_where_it_exceeds_their_errors() -> None:
    assert find_outliers(_trial(1200.0), [_trial(900.0), _trial(1100.0)]) == ()


def test_a_first_repeat_is_compared_with_nothing() -> None:
    assert find_outliers(_trial(1.0), []) == ()


def test_a_cuff_that_migrates_further_than_any_published_one_has_slipped() -> None:
    assert not has_slipped(_trial(1000.0, migration=0.022))
    assert has_slipped(_trial(1000.0, migration=0.026))

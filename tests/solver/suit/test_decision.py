"""A cuff is chosen only above the certainty; probabilities agree with those of normal distributions."""

import numpy as np
import pytest
from scipy.stats import norm

from solver.suit.decision import DecisionOutcome, DecisionRule, decide

QUANTILES = norm.ppf((np.arange(2000) + 0.5) / 2000)
SHUFFLED = np.random.default_rng(3).permutation(QUANTILES)


def test_probabilities_are_those_of_the_normal_distribution_of_the_difference():
    (pair,) = decide({"hand": 0.85 + 0.02 * QUANTILES, "tube": np.full(2000, 0.82)}).pairs
    assert pair.difference == pytest.approx(0.03)
    assert pair.first_saves_more == pytest.approx(norm.cdf(-0.02, 0.03, 0.02), abs=1e-3)
    assert pair.second_saves_more == pytest.approx(norm.sf(0.02, 0.03, 0.02), abs=1e-3)
    assert pair.first_saves_more + pair.second_saves_more + pair.equivalent == pytest.approx(1)
    np.testing.assert_allclose(pair.ci95, norm.ppf([0.025, 0.975], 0.03, 0.02), atol=1e-4)


@pytest.mark.parametrize(("gap", "outcome"), [(0.034, DecisionOutcome.CHOOSE), (0.032, DecisionOutcome.UNDECIDED)])
def test_a_cuff_is_chosen_only_above_the_certainty(gap, outcome):
    """With a standard deviation of 0.01, 90 % of the differences exceed 0.02 from a mean of 0.0328 on."""
    found = decide({"hand": 0.8 + gap + 0.01 * QUANTILES, "tube": np.full(2000, 0.8)})
    assert found.outcome is outcome
    assert found.leading == ("tube",)
    assert (found.undecided == ("hand",)) == (outcome is DecisionOutcome.UNDECIDED)


def test_equivalent_cuffs_are_named_together_and_a_worse_one_apart():
    found = decide({"elbow": 0.9 + 0.005 * SHUFFLED, "hand": 0.801 + 0.005 * SHUFFLED, "tube": 0.8 + 0.005 * QUANTILES})
    assert (found.outcome, found.leading, found.worse) == (DecisionOutcome.EQUIVALENT, ("tube", "hand"), ("elbow",))
    assert found.probability is not None and found.probability > 0.99


def test_doubt_common_to_both_cuffs_does_not_hinder_the_choice():
    found = decide({"hand": 0.84 + 0.1 * QUANTILES, "tube": 0.8 + 0.1 * QUANTILES})
    assert (found.outcome, found.probability) == (DecisionOutcome.CHOOSE, 1.0)


def test_the_rule_is_configurable():
    efforts = {"hand": 0.85 + 0.01 * QUANTILES, "tube": np.full(2000, 0.8)}
    assert decide(efforts, DecisionRule(relevant_difference=0.1)).outcome is DecisionOutcome.EQUIVALENT
    assert decide(efforts, DecisionRule(certainty=0.9999)).outcome is DecisionOutcome.UNDECIDED


def test_three_cuffs_are_undecided_if_only_the_pairs_are_certain():
    """Each of two rivals is worse for 93 % of the people, both for 86 %."""
    rivals = np.full((2, 1000), 0.9)
    rivals[0, :70], rivals[1, -70:] = 0.8, 0.8
    found = decide({"a": np.full(1000, 0.8), "b": rivals[0], "c": rivals[1]})
    assert (found.outcome, found.undecided) == (DecisionOutcome.UNDECIDED, ("b", "c"))


def test_people_without_a_solution_are_left_out_and_too_many_of_them_prevent_a_decision():
    hand, tube = np.full(100, 0.9), np.full(100, 0.8)
    hand[:5] = np.nan
    assert (decide({"hand": hand, "tube": tube}).people, decide({"tube": tube}).outcome) == (95, "only_cuff")
    hand[:20] = np.nan
    assert decide({"hand": hand, "tube": tube}).outcome is DecisionOutcome.UNKNOWN

"""A cuff is chosen only above the certainty; probabilities agree with those of normal distributions."""

from dataclasses import fields
from typing import get_args

import numpy as np
import pytest
from scipy.stats import gamma, gaussian_kde, norm

from solver.suit.decision import BASES, Basis, DecisionOutcome, DecisionRule, compare, decide
from solver.suit.scenarios import CurveReadouts

QUANTILES = norm.ppf((np.arange(2000) + 0.5) / 2000)
SHUFFLED = np.random.default_rng(3).permutation(QUANTILES)
RULE = DecisionRule(relevant_difference=0.25, certainty=0.875)  # exact in binary, as are the efforts below


def test_probabilities_are_those_of_the_normal_distribution_of_the_difference():
    (pair,) = decide({"hand": 0.85 + 0.02 * QUANTILES, "tube": np.full(2000, 0.82)}).pairs
    assert pair.difference == pytest.approx(0.03)
    assert pair.first_saves_more == pytest.approx(norm.cdf(-0.02, 0.03, 0.02), abs=1e-3)
    assert pair.second_saves_more == pytest.approx(norm.sf(0.02, 0.03, 0.02), abs=1e-3)
    assert pair.first_saves_more + pair.second_saves_more + pair.equivalent == pytest.approx(1)
    np.testing.assert_allclose(pair.ci95, norm.ppf([0.025, 0.975], 0.03, 0.02), atol=1e-4)


def test_a_difference_that_reaches_the_relevant_one_matters():
    efforts = {"hand": np.ones(8), "tube": np.array([1.25, 0.75, *np.ones(6)])}
    pair = compare(efforts, ("hand", "tube"), 0.25)
    assert (pair.first_saves_more, pair.second_saves_more, pair.equivalent) == (0.125, 0.125, 0.75)


@pytest.mark.parametrize("probability", [0.6, 0.95])
def test_probabilities_of_samples_are_right_on_average_and_nearer_to_the_truth_than_their_shares(probability):
    """Of 600 samples of 100 people of a normal and of a skewed distribution."""
    random = np.random.default_rng(5)
    for draws, cut in (
        (random.standard_normal((600, 100)), norm.isf(probability)),
        (random.gamma(9.0, 1.0, (600, 100)), gamma.isf(probability, 9.0)),
    ):
        margins = 0.01 * (draws - cut)
        found = np.array([compare({"a": np.zeros(100), "b": one}, ("a", "b"), 0.0).first_saves_more for one in margins])
        shares = (margins >= 0).mean(axis=1)
        assert abs(found.mean() - probability) < 0.01
        assert np.mean((found - probability) ** 2) < 0.9 * np.mean((shares - probability) ** 2)


@pytest.mark.parametrize("skew", [False, True])
def test_probabilities_of_few_people_are_those_of_a_kernel_density_with_their_variance(skew):
    """SciPy's density around shrunk values; its factor is relative to their own standard deviation."""
    drawn = np.random.default_rng(8).standard_normal(20)
    margin = 0.03 + 0.02 * (np.expm1(2 * drawn) if skew else drawn)
    quartiles = np.quantile(margin, 0.75) - np.quantile(margin, 0.25)
    width = 0.9 * min(margin.std(), quartiles / (2 * norm.ppf(0.75))) / 20**0.2
    shrunk = margin.mean() + (margin - margin.mean()) / np.hypot(1, width / margin.std())
    density = gaussian_kde(shrunk, bw_method=width / shrunk.std(ddof=1))
    found = compare({"a": np.zeros(20), "b": margin}, ("a", "b"), 0.0).first_saves_more
    assert found == pytest.approx(density.integrate_box_1d(0, np.inf), abs=1e-5)


def test_a_choice_is_as_probable_as_that_all_others_are_worse():
    """Each of two rivals is worse for 15 of 16 people, both for 14."""
    rivals = np.full((2, 16), 1.25)
    rivals[0, 0], rivals[1, -1] = 1.0, 1.0
    found = decide({"a": np.ones(16), "b": rivals[0], "c": rivals[1]}, DecisionRule(0.25, 0.75))
    assert (found.outcome, found.leading, found.probability) == (DecisionOutcome.CHOOSE, ("a",), 0.875)


def test_every_basis_of_a_comparison_is_an_effort_of_the_curve():
    assert tuple(BASES) == get_args(Basis)
    assert set(BASES.values()) <= {field.name for field in fields(CurveReadouts)}


@pytest.mark.parametrize(("gap", "outcome"), [(0.034, DecisionOutcome.CHOOSE), (0.032, DecisionOutcome.UNDECIDED)])
def test_a_cuff_is_chosen_only_above_the_certainty(gap, outcome):
    """With a standard deviation of 0.01, 90 % of the differences exceed 0.02 from a mean of 0.0328 on."""
    found = decide({"hand": 0.8 + gap + 0.01 * QUANTILES, "tube": np.full(2000, 0.8)})
    assert found.outcome is outcome
    assert found.leading == ("tube",)
    assert (found.undecided == ("hand",)) == (outcome is DecisionOutcome.UNDECIDED)


@pytest.mark.parametrize(
    ("worse_by", "last", "outcome", "probability"),
    [
        (0.25, 0.25, DecisionOutcome.CHOOSE, 1.0),
        (0.25, 0.0, DecisionOutcome.UNDECIDED, None),
        (0.125, 0.125, DecisionOutcome.EQUIVALENT, 1.0),
        (0.125, 0.25, DecisionOutcome.UNDECIDED, None),
        (0.125, -0.25, DecisionOutcome.UNDECIDED, None),
    ],
)
def test_a_probability_equal_to_the_certainty_decides_nothing(worse_by, last, outcome, probability):
    found = decide({"hand": 1.0 + np.array([*[worse_by] * 7, last]), "tube": np.ones(8)}, RULE)
    assert (found.outcome, found.probability) == (outcome, probability)
    assert found.undecided == (("hand",) if outcome is DecisionOutcome.UNDECIDED else ())


@pytest.mark.parametrize(("gap", "last"), [(0.25, 0.0), (0.125, 0.25)])
def test_a_cuff_at_the_certainty_does_not_hide_another_that_is_worse(gap, last):
    """c is worse by the relevant difference, or equivalent, for 7 of 8 people."""
    c = 1.0 + np.array([*[gap] * 7, last])
    found = decide({"a": np.ones(8), "b": np.full(8, 1.5), "c": c}, RULE)
    assert (found.outcome, found.worse, found.undecided) == (DecisionOutcome.UNDECIDED, ("b",), ("c",))


def test_several_cuffs_are_equivalent_with_the_probability_that_all_are():
    """b and c are each within the relevant difference of a, and at its limit of each other in 1 of 16 people."""
    b, c = np.ones(16), np.ones(16)
    b[0], c[0] = 1.125, 0.875
    a = np.full(16, 0.9375)
    found = decide({"a": a, "b": b, "c": c}, RULE)
    assert (found.outcome, found.leading, found.probability) == (DecisionOutcome.EQUIVALENT, ("a", "c", "b"), 0.9375)
    b[1], c[1] = 1.125, 0.875
    found = decide({"a": a, "b": b, "c": c}, RULE)
    assert (found.outcome, found.leading, found.undecided) == (DecisionOutcome.UNDECIDED, ("a",), ("c", "b"))


def test_equivalent_cuffs_are_named_together_and_a_worse_one_apart():
    found = decide({"elbow": 0.9 + 0.005 * SHUFFLED, "hand": 0.801 + 0.005 * SHUFFLED, "tube": 0.8 + 0.005 * QUANTILES})
    assert (found.outcome, found.leading, found.worse) == (DecisionOutcome.EQUIVALENT, ("tube", "hand"), ("elbow",))
    assert found.probability == pytest.approx(np.mean(np.abs(0.001 + 0.005 * (SHUFFLED - QUANTILES)) < 0.02), abs=1e-3)


def test_doubt_common_to_both_cuffs_does_not_hinder_the_choice():
    found = decide({"hand": 0.84 + 0.1 * QUANTILES, "tube": 0.8 + 0.1 * QUANTILES})
    assert (found.outcome, found.probability) == (DecisionOutcome.CHOOSE, 1.0)


def test_the_rule_is_configurable():
    efforts = {"hand": 0.85 + 0.01 * QUANTILES, "tube": np.full(2000, 0.8)}
    assert decide(efforts, DecisionRule(relevant_difference=0.1)).outcome is DecisionOutcome.EQUIVALENT
    assert decide(efforts, DecisionRule(certainty=0.9999)).outcome is DecisionOutcome.UNDECIDED


def test_three_cuffs_are_undecided_if_only_the_pairs_are_certain():
    """Each of two rivals is worse for 7 of 8 people, both for 6."""
    rivals = np.full((2, 8), 1.25)
    rivals[0, 0], rivals[1, -1] = 1.0, 1.0
    found = decide({"a": np.ones(8), "b": rivals[0], "c": rivals[1]}, RULE)
    assert (found.outcome, found.worse, found.undecided) == (DecisionOutcome.UNDECIDED, (), ("b", "c"))


@pytest.mark.parametrize(
    ("unknown", "people", "outcome"), [(0, 20, "choose"), (2, 18, "choose"), (3, 17, "unknown"), (20, 0, "unknown")]
)
def test_people_without_a_solution_are_left_out_and_above_a_tenth_of_them_prevents_a_decision(unknown, people, outcome):
    hand, tube = np.full(20, 0.9), np.full(20, 0.8)
    hand[:unknown] = np.nan
    found = decide({"hand": hand, "tube": tube})
    assert (found.people, found.outcome) == (people, outcome)
    assert bool(found.pairs) is (outcome == "choose")


def test_a_cuff_without_rivals_leads_and_a_single_person_is_enough():
    found = decide({"tube": np.array([0.8])})
    assert (found.outcome, found.leading, found.people) == (DecisionOutcome.ONLY_CUFF, ("tube",), 1)
    assert decide({"tube": np.empty(0)}).outcome is DecisionOutcome.UNKNOWN

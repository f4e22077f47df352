"""Random factors of the sources of uncertainty, and their Sobol indices."""

from dataclasses import replace

import numpy as np
import pytest

from solver.bundled import bundled_model
from solver.cuff import CuffParameters
from solver.uncertainty.factors import (
    RandomFactor,
    factor_columns,
    normal_scores,
    random_factors,
    scores_by_factor,
    unit_sample,
)
from solver.uncertainty.indices import group_names, group_sample, sobol_indices
from solver.uncertainty.people import solve_people
from solver.uncertainty.sources import (
    GROUPS,
    BodySpread,
    DonningSpread,
    FitSpread,
    MotionSpread,
    MuscleSpread,
    UncertaintySources,
)
from tests.solver.uncertainty.test_people import CASE

MODEL = bundled_model()
GIVEN = CuffParameters("given", "arm", 100.0, 1.0, 0.01)
HAND = CuffParameters("hand", "arm", 8520.0, 210.0, 0.012, np.diag([100.0, 10.0, 0.001]) ** 2)
FACTORS = random_factors(UncertaintySources(), MODEL, [GIVEN, HAND])
INDEXED = (
    RandomFactor("x", "fit", 2),
    RandomFactor("y", "donning", 1),
    RandomFactor("z", "body", 1),
    RandomFactor("w", "muscles", 3),
)


def test_every_group_has_factors_and_a_cuff_without_a_covariance_has_no_doubt_of_its_fit():
    assert {factor.group for factor in FACTORS} == set(GROUPS)
    names = [factor.name for factor in FACTORS]
    assert "fit.hand" in names and "fit.given" not in names and "donning.given" in names


def test_a_spread_of_zero_leaves_the_source_out():
    silent = UncertaintySources(
        donning=DonningSpread(0.0, 0.0, 0.0),
        body=BodySpread(0.0, 0.0, 0.0, 0.0),
        muscles=MuscleSpread(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        motion=MotionSpread(0.0, 0.0, 0.0, 0.0),
    )
    assert random_factors(silent, MODEL, [GIVEN]) == ()


def test_drawn_motions_take_the_place_of_the_size_and_of_noise():
    names = [factor.name for factor in random_factors(UncertaintySources(), MODEL, [HAND], drawn_motions=12)]
    assert "drawn_motion" in names and not {"noise", "size"} & set(names)


def test_a_latin_hypercube_has_one_sample_in_each_interval():
    sample = unit_sample(FACTORS, 50, "latin_hypercube", seed=3)
    assert (np.sort((50 * sample).astype(int), axis=0) == np.arange(50)[:, None]).all()


@pytest.mark.parametrize("method", ["latin_hypercube", "sobol"])
def test_a_seed_gives_the_same_normal_scores_again(method):
    scores = normal_scores(unit_sample(FACTORS, 256, method, seed=1))
    np.testing.assert_array_equal(scores, normal_scores(unit_sample(FACTORS, 256, method, seed=1)))
    assert not np.array_equal(scores, normal_scores(unit_sample(FACTORS, 256, method, seed=2)))
    np.testing.assert_allclose(scores.mean(axis=0), 0, atol=0.05)
    np.testing.assert_allclose(scores.std(axis=0), 1, atol=0.06)


def test_columns_and_scores_belong_to_their_factors():
    row = np.arange(float(sum(factor.size for factor in FACTORS)))
    by_name = scores_by_factor(FACTORS, row)
    assert {name: len(scores) for name, scores in by_name.items()} == {f.name: f.size for f in FACTORS}
    np.testing.assert_array_equal(
        row[factor_columns(FACTORS, ("size", "duration"))], [*by_name["size"], by_name["duration"][0]]
    )


def test_indices_of_a_linear_function_with_an_interaction_are_its_shares_of_variance():
    """x₁ + 2 x₂ + 3 y + 2 y z has the variance 5 + 9 + 4: fit 5, donning 9 alone, donning and body 4 together."""
    x = group_sample(INDEXED, 1024, seed=1)
    found = sobol_indices(INDEXED, {"f": x[:, 0] + 2 * x[:, 1] + 3 * x[:, 2] + 2 * x[:, 2] * x[:, 3]}, seed=1)["f"]
    assert found.groups == ("fit", "donning", "body", "muscles")
    np.testing.assert_allclose(found.first, np.array([5, 9, 0, 0]) / 18, atol=0.03)
    np.testing.assert_allclose(found.total, np.array([5, 13, 4, 0]) / 18, atol=0.03)
    assert found.variance == pytest.approx(18, rel=0.05)
    assert (np.abs(found.first - np.array([5, 9, 0, 0]) / 18) < 2 * found.first_half_width + 1e-12).all()


def test_blocks_with_an_unknown_value_are_left_out_and_a_constant_has_no_indices():
    x = group_sample(INDEXED, 64, seed=1)
    y = x[:, 0].copy()
    y[3] = np.nan
    found = sobol_indices(INDEXED, {"f": y, "constant": np.ones(len(y)), "unknown": y * np.nan}, seed=1)
    assert found["f"].blocks == 63
    assert found["constant"] is None and found["unknown"] is None


@pytest.mark.slow
def test_first_order_indices_of_the_suit_agree_with_brute_force():
    """Brute force: every drawn donning on every drawn body, and an analysis of variance with two crossed factors
    (Searle, Casella and McCulloch 1992, Variance Components, section 4.3).
    """
    silent = replace(
        CASE.sources, fit=FitSpread(0.0), muscles=MuscleSpread(*[0.0] * 7), motion=MotionSpread(*[0.0] * 4)
    )
    case = replace(CASE, sources=replace(silent, body=BodySpread(0.0, 0.0, 0.01, 0.05)))
    count, names = 16, group_names(case.factors)
    assert set(names) == {"donning", "body"}

    def cost(scores):
        return solve_people(case, scores, workers=1)["both", "hand"].at_reference

    found = sobol_indices(case.factors, {"f": cost(group_sample(case.factors, 64, seed=1))}, seed=1)["f"]
    scores = normal_scores(unit_sample(case.factors, 2 * count, "latin_hypercube", seed=2))
    on_body = factor_columns(case.factors, [factor.name for factor in case.factors if factor.group == "body"])
    crossed = np.repeat(scores[:count], count, axis=0)
    crossed[:, on_body] = np.tile(scores[count:, on_body], (count, 1))
    efforts = cost(crossed).reshape(count, count)
    means = {"donning": efforts.mean(axis=1), "body": efforts.mean(axis=0)}
    together = efforts - means["donning"][:, None] - means["body"] + efforts.mean()
    interaction = (together**2).sum() / (count - 1) ** 2
    variances = {group: mean.var(ddof=1) - interaction / count for group, mean in means.items()}
    for group, variance in variances.items():
        index, expected = names.index(group), variance / (interaction + sum(variances.values()))
        assert found.first[index] == pytest.approx(expected, abs=found.first_half_width[index] + 0.1)
    assert found.first.argmax() == names.index("body")

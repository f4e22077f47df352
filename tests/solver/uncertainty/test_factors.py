"""The sample of the random factors: stratified, seeded, and normal."""

import numpy as np
import pytest

from solver.bundled import bundled_model
from solver.cuff import CuffParameters
from solver.uncertainty.factors import columns_of, normal_scores, random_factors, scores_by_factor, unit_sample
from solver.uncertainty.sources import GROUPS, BodySpread, DonningSpread, MotionSpread, MuscleSpread, UncertaintySources

MODEL = bundled_model()
GIVEN = CuffParameters("given", "arm", 100.0, 1.0, 0.01)
HAND = CuffParameters("hand", "arm", 8520.0, 210.0, 0.012, np.diag([100.0, 10.0, 0.001]) ** 2)
FACTORS = random_factors(UncertaintySources(), MODEL, [GIVEN, HAND])


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
        row[columns_of(FACTORS, ("size", "duration"))], [*by_name["size"], by_name["duration"][0]]
    )

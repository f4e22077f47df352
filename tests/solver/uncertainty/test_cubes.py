"""The same people with squares and with cubes: changes, shares of the variance by brute force, and agreement."""

from dataclasses import fields, replace

import numpy as np
import pytest

from solver.suit.decision import DecisionOutcome, DecisionRule
from solver.suit.readouts import CurveReadouts
from solver.uncertainty.cubes import compare_exponents
from solver.uncertainty.people import solve_people
from tests.solver.uncertainty.test_people import CASE, SCORES

RULE = DecisionRule()
PEOPLE = 60


def curve(at_reference, rest_length=0.7, lowest_cost=0.8):
    """Readouts of people with these figures, the assessed one first; all other figures are 0."""
    count = len(at_reference)
    zeros = {
        field.name: np.zeros((count, 1)[: 2 if field.name in {"bounds", "reduction", "efforts"} else 1])
        for field in FIELDS
    }
    own = {"at_reference": at_reference, "rest_length": rest_length, "lowest_cost": lowest_cost}
    return CurveReadouts(**zeros | {name: np.broadcast_to(value, count).copy() for name, value in own.items()})


FIELDS = fields(CurveReadouts)


def readouts(hand, tube):
    return {("both", "hand"): curve(hand), ("both", "tube"): curve(tube)}


@pytest.fixture
def drawn():
    """Efforts (people,) of a cuff with squares and with cubes, which differ by person."""
    generator = np.random.default_rng(4)
    squares = 0.85 + 0.05 * generator.normal(size=PEOPLE + 1)
    return squares, squares - 0.06 + 0.02 * generator.normal(size=PEOPLE + 1)


def test_shares_of_the_variance_are_those_of_a_two_level_factor_by_brute_force(drawn):
    squares, cubes = drawn
    found = compare_exponents(readouts(squares, squares), readouts(cubes, squares), RULE)
    change = found.changes["effort_at_reference", ("hand",)]
    values = np.stack([squares[1:], cubes[1:]])  # exponent, person: both equally likely
    variance = values.var()
    assert change.first == pytest.approx(values.mean(axis=1).var() / variance)
    assert change.total == pytest.approx(values.var(axis=0).mean() / variance)
    assert change.change.value == pytest.approx((cubes - squares)[1:].mean())
    assert change.change.ci95 == pytest.approx(np.quantile((cubes - squares)[1:], [0.025, 0.975]))
    assert np.isnan(found.changes["best_rest_length", ("hand",)].first), "it does not vary"


def test_figures_are_of_the_assessed_person_with_cubes_and_unknown_people_are_counted(drawn):
    squares, cubes = drawn
    cubes[7] = np.nan
    found = compare_exponents(readouts(squares, squares), readouts(cubes, squares), RULE)
    assert (found.people, found.solved) == (PEOPLE, PEOPLE - 1)
    assert found.figures["both", "hand"]["at_reference"].value == cubes[0]
    cubes[0] = np.nan
    assert (
        compare_exponents(readouts(squares, squares), readouts(cubes, squares), RULE)
        .figures["both", "hand"]["at_reference"]
        .value
        is None
    )


def test_without_two_known_people_there_is_no_change(drawn):
    squares, _ = drawn
    unknown = np.full(PEOPLE + 1, np.nan)
    unknown[1] = 0.8
    found = compare_exponents(readouts(squares, squares), readouts(unknown, squares), RULE)
    assert found.changes["effort_at_reference", ("hand",)] is None


def test_exponents_agree_where_they_lead_to_the_same_statement(drawn):
    squares, _ = drawn
    alike = readouts(squares, squares + 0.001)
    assert compare_exponents(alike, alike, RULE).agrees("at_reference")
    apart = compare_exponents(alike, readouts(squares, squares + 0.05), RULE)
    assert apart.decisions["at_reference"].outcome is DecisionOutcome.CHOOSE
    assert apart.of_squares["at_reference"].outcome is DecisionOutcome.EQUIVALENT
    assert not apart.agrees("at_reference")
    assert apart.agrees("at_best")


def test_people_are_solved_with_cubes_and_save_by_that_effort():
    scores = np.vstack([np.zeros(SCORES.shape[1]), SCORES[:1]])
    options = replace(CASE.motion.options, exponent=3)
    cubes = solve_people(replace(CASE, motion=replace(CASE.motion, options=options)), scores, workers=1)
    squares = solve_people(CASE, scores, workers=1)
    reading, other = cubes["rigid", None], squares["rigid", None]
    assert np.isfinite(reading.at_reference).all()
    assert (reading.at_reference < other.at_reference).all(), "a cube falls faster than a square"
    np.testing.assert_allclose(reading.cord_force, other.cord_force)

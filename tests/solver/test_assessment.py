"""The assessment: what must hold between its curves, its intervals, and the form of its JSON."""

import json
from dataclasses import replace

import numpy as np
import pytest

from solver.assessment import CUFF_CONDITIONS, assess
from solver.bundled import bundled_model
from solver.cuff import CuffParameters
from solver.motion import differentiate
from solver.raise_arm import raise_arm
from solver.suit import SuitError, read_suit

MODEL = bundled_model()
MOTION = differentiate(raise_arm(MODEL))
SUIT = replace(read_suit(), rest_lengths=np.linspace(0.66, 0.90, 9), reference_rest_length=0.75)
WAIST = CuffParameters("waist", "waist", 2140.0, 124.0, 0.015)
HAND = CuffParameters("hand", "arm", 8520.0, 210.0, 0.015, np.diag([100.0, 10.0, 0.002]) ** 2)


def coarse(*cuffs, suit=SUIT):
    return assess(MODEL, MOTION, suit, cuffs, every=60)


@pytest.fixture(scope="module")
def assessment():
    return coarse(WAIST, HAND)


def curve(assessment, condition, cuff="hand"):
    (found,) = [c for c in assessment.curves if c.condition == condition and (c.cuff or cuff) == cuff]
    return found


def test_every_frame_of_every_scenario_is_solved(assessment):
    assert assessment.frames == 11
    assert assessment.scenarios == 2 + 4 * 10 + 3 * 3  # none and bare, 4 curves, 3 directions of the hand's covariance
    assert assessment.unsolved == 0


def test_a_cord_longer_than_its_line_saves_nothing(assessment):
    assert assessment.longest_cord < SUIT.rest_lengths[-1]
    for found in assessment.curves:
        assert found.cost[-1] == pytest.approx(1, abs=1e-6)


def test_the_suits_mass_costs_something(assessment):
    assert 0.9 < assessment.bare_body_cost < 0.995


def test_the_suit_saves_effort_and_hardly_needs_reserves(assessment):
    for found in assessment.curves:
        assert found.cost.min() < 0.95
        assert found.reserve_cost.max() < 0.01


def test_migration_moves_the_curve_and_changes_nothing_else(assessment):
    # both cuffs migrate by 15 mm and the rest lengths are 30 mm apart
    np.testing.assert_allclose(curve(assessment, "shift").cost[:-1], curve(assessment, "rigid").cost[1:], atol=1e-6)


def test_a_cuff_that_yields_takes_force_from_the_cord(assessment):
    forces = [curve(assessment, condition).cord_force for condition in ("rigid", "visco_elastic", "both")]
    assert forces[0] > forces[1] > forces[2] > 0


def test_stiff_cuffs_in_place_are_rigid(assessment):
    stiff = [replace(cuff, stiffness=1e9, damping=0.0, migration=0.0) for cuff in (WAIST, HAND)]
    for condition in CUFF_CONDITIONS:
        found = curve(coarse(*stiff, suit=replace(SUIT, rest_lengths=SUIT.rest_lengths[::2])), condition)
        np.testing.assert_allclose(found.cost, curve(assessment, "rigid").cost[::2], atol=1e-4)


def test_the_interval_of_the_shift_is_the_slope_times_the_error_of_migration(assessment):
    found = curve(assessment, "shift").at_reference
    step = 0.002
    beyond = curve(coarse(WAIST, replace(HAND, migration=HAND.migration + step, covariance=np.zeros((3, 3)))), "shift")
    low, high = found.ci95
    assert (high - low) / 2 == pytest.approx(1.96 * abs(beyond.at_reference.value - found.value), rel=1e-3)
    assert low < found.value < high
    assert beyond.at_reference.ci95 is None


def test_the_optimum_lies_between_the_lengths_and_is_no_worse_than_any(assessment):
    found = curve(assessment, "rigid")
    optimum = found.optimum
    assert SUIT.rest_lengths[0] < optimum.rest_length.value < SUIT.rest_lengths[-1]
    assert optimum.normalised_cost.value <= found.cost.min() + 1e-9
    assert 0 < optimum.permissible_error.value < 0.1


def test_an_optimum_at_the_edge_of_what_was_tried_is_none():
    optimum = curve(coarse(HAND, suit=replace(SUIT, rest_lengths=np.linspace(0.76, 0.9, 5))), "rigid").optimum
    assert optimum.rest_length.value is None
    assert optimum.normalised_cost.value is None


def test_json_holds_each_number_with_its_interval_under_its_cuff(assessment):
    document = json.loads(json.dumps(assessment.to_json(), allow_nan=False))
    assert document["reference_rest_length_m"] == 0.75
    for table in (document["at_rigid_optimum"], document["optimum"]):
        assert set(table) == {"rigid", "hand"}
        assert set(table["hand"]) == set(CUFF_CONDITIONS)
    assert document["at_rigid_optimum"]["rigid"]["ci95"] is None
    assert set(document["at_rigid_optimum"]["hand"]["both"]) == {"value", "ci95"}
    assert set(document["optimum"]["hand"]["both"]) == {"rest_length_m", "normalised_cost", "permissible_error_m"}


def test_without_a_waist_cuff_the_waist_is_rigid_and_named_so():
    alone, with_stiff_waist = coarse(HAND), coarse(HAND, replace(WAIST, stiffness=1e9, damping=0.0, migration=0.0))
    assert alone.waist_cuff is None
    np.testing.assert_allclose(curve(alone, "both").cost, curve(with_stiff_waist, "both").cost, atol=1e-4)


@pytest.mark.parametrize("cuffs", [(), (WAIST,), (HAND, WAIST, WAIST)])
def test_too_few_arm_cuffs_or_too_many_at_the_waist_are_refused(cuffs):
    with pytest.raises(SuitError, match="needs arm cuffs and at most one waist cuff"):
        coarse(*cuffs)

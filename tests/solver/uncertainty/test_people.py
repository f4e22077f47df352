"""Drawn people: zero scores are the assessed person, cuffs reuse the problem, and every source acts as declared."""

from dataclasses import replace

import numpy as np
import pytest

import solver.uncertainty.people
from solver.bundled import bundled_model, simulate_arm_raise
from solver.cuff import CuffParameters
from solver.errors import SolverCode
from solver.motion import differentiate
from solver.multibody.constraints import constraint_gaps
from solver.multibody.postures import postures
from solver.redundancy.motion_solution import LoadedMotion
from solver.redundancy.problem import FrameOutcome
from solver.scaling import Scaling, scale_model
from solver.suit.assessment import assess
from solver.suit.scenarios import prepare_suited_motion, solve_scenarios
from solver.suit.suit import read_suit
from solver.uncertainty.factors import factor_columns, normal_scores, unit_sample
from solver.uncertainty.people import PeopleCase, solve_people
from solver.uncertainty.sources import BodySpread, DonningSpread, MuscleSpread, UncertaintySources
from solver.uncertainty.varied_model import covariance_root, varied_cuff, varied_model, varied_suit
from solver.uncertainty.varied_motion import DrawnMotion, MotionDraws, varied_motion

MODEL = bundled_model()
MOTION = differentiate(simulate_arm_raise(MODEL))
SUIT = replace(read_suit(), rest_lengths=np.linspace(0.63, 0.87, 9), reference_rest_length=0.75)
WAIST = CuffParameters("waist", "waist", 2140.0, 124.0, 0.015)
COVARIANCE = np.array([[100.0**2, 0.6 * 100 * 10, 0.0], [0.6 * 100 * 10, 10.0**2, 0.0], [0.0, 0.0, 0.002**2]])
HAND = CuffParameters("hand", "arm", 8520.0, 210.0, 0.015, COVARIANCE)
EVERY = 60
CASE = PeopleCase(LoadedMotion(MODEL, MOTION), SUIT, WAIST, (HAND,), UncertaintySources(), EVERY)
SCORES = normal_scores(unit_sample(CASE.factors, 3, "latin_hypercube", seed=1))
CUFF_COLUMNS = factor_columns(CASE.factors, ("fit.hand", "donning.hand", "donning.waist", "cord_stiffness"))
LIMITS = {"min_control": -0.1, "max_control": 0.1}


def of_muscles(model, name):
    return np.array([getattr(muscle, name) for muscle in model.muscles])


FIBERS = of_muscles(MODEL, "optimal_fiber_length")


@pytest.fixture(scope="module")
def people():
    return solve_people(CASE, np.vstack([np.zeros(SCORES.shape[1]), SCORES]), workers=1)


def test_zero_scores_are_the_assessment_with_the_fitted_cuffs(people):
    found = assess(CASE.motion, SUIT, (WAIST, HAND), every=EVERY)
    for curve in found.curves:
        reading = people[curve.condition, curve.cuff]
        assert reading.at_reference[0] == pytest.approx(curve.figures["at_reference"].value, abs=1e-9)
        assert reading.cord_force[0] == pytest.approx(curve.figures["cord_force"].value, abs=1e-9)
        assert reading.rest_length[0] == pytest.approx(curve.figures["rest_length"].value, abs=2e-3)
        assert reading.lowest_cost[0] == pytest.approx(curve.figures["lowest_cost"].value, abs=1e-3)


def test_the_effort_over_all_rest_lengths_is_that_of_solving_each_of_them(people):
    found = assess(CASE.motion, SUIT, (WAIST, HAND), every=EVERY)
    (curve,) = (curve for curve in found.curves if curve.condition == "both")
    efforts = people["both", "hand"].efforts
    np.testing.assert_allclose(efforts[0], curve.cost, atol=5e-3)
    assert efforts.shape == (4, len(SUIT.rest_lengths)) and np.isfinite(efforts).all()
    assert people["shift", "hand"].efforts.shape == (4, 0), "only what is worn has a band"


def test_people_differ_and_each_is_solved(people):
    for reading in people.values():
        assert np.isfinite(reading.at_reference).all()
        assert np.isfinite(reading.rest_length).all()
        assert len(np.unique(reading.at_reference)) == 4


def test_people_with_other_cuffs_share_the_problem_and_the_result_is_that_of_solving_them_alone(monkeypatch):
    scores = np.zeros_like(SCORES)
    scores[:, CUFF_COLUMNS] = SCORES[:, CUFF_COLUMNS]
    prepared = []
    monkeypatch.setattr(
        solver.uncertainty.people,
        "prepare_suited_motion",
        lambda *given: prepared.append(given) or prepare_suited_motion(*given),
    )
    together = solve_people(CASE, scores, workers=1)
    assert len(prepared) == 1
    alone = solve_people(CASE, scores[[2]], workers=1)
    assert together["both", "hand"].at_reference[2] == alone["both", "hand"].at_reference[0]
    assert len(np.unique(together["both", "hand"].at_reference)) == 3
    assert np.ptp(together["shift", "hand"].rest_length) > 1e-4


def test_an_optimum_below_the_rest_lengths_of_the_suit_is_sought_further(people):
    long = replace(CASE, suit=replace(SUIT, rest_lengths=np.linspace(0.80, 0.87, 9)))
    found = solve_people(long, np.zeros((1, SCORES.shape[1])), workers=1)
    for place, reading in found.items():
        assert reading.rest_length[0] == pytest.approx(people[place].rest_length[0], abs=2e-3)


def test_a_suit_that_saves_nothing_is_best_with_a_slack_cord():
    """A straight cord from waist to arm pulls down the arm that is raised."""
    down = replace(SUIT, is_straight=True, rest_lengths=np.linspace(0.45, 0.55, 9), reference_rest_length=0.5)
    found = solve_people(replace(CASE, suit=down), np.zeros((1, SCORES.shape[1])), workers=1)["both", "hand"]
    assert found.at_reference[0] > 1 and np.isnan(found.rest_length[0])
    assert found.lowest_cost[0] == 1
    side, length, cost, to_slack = found.bounds[0]
    assert (side, cost) == (1, 1) and to_slack == pytest.approx(0, abs=1e-9)
    assert length > 0.5


@pytest.mark.parametrize("direction", ["cord", "bone"])
def test_curves_of_migrated_cuffs_are_those_of_solving_their_own_rest_lengths(direction):
    """A curve that is shared by migration along the cord misses the damping's lever arm, less than 0.0005 of effort."""
    case = replace(CASE, suit=replace(SUIT, migration_direction=direction))
    found = solve_people(case, np.zeros((1, SCORES.shape[1])), workers=1)
    lengths = np.linspace(0.66, 0.80, 24)
    solved = assess(case.motion, replace(case.suit, rest_lengths=lengths), (WAIST, HAND), every=EVERY)
    for curve in solved.curves:
        reading = found[curve.condition, curve.cuff]
        assert reading.rest_length[0] == pytest.approx(curve.figures["rest_length"].value, abs=1.5e-3)
        assert reading.lowest_cost[0] == pytest.approx(curve.figures["lowest_cost"].value, abs=5e-4)


@pytest.mark.parametrize(("unknown", "is_known"), [([2], True), ([2, 11], False)])
def test_a_curve_begins_above_its_longest_rest_length_without_a_solution(monkeypatch, unknown, is_known):
    """If that is the longest of all, the curve is unknown, but not at the reference and with a slack cord."""

    def solve(suited, scenarios, **options):
        slack, efforts = solve_scenarios(suited, scenarios, **options)
        for effort in efforts:
            if len(effort.muscles) > max(unknown):
                effort.muscles[unknown] = np.nan
        return slack, efforts

    monkeypatch.setattr(solver.uncertainty.people, "solve_scenarios", solve)
    found = solve_people(CASE, np.zeros((1, SCORES.shape[1])), workers=1)["both", "hand"]
    assert np.isfinite([found.rest_length[0], found.lowest_cost[0]]).tolist() == [is_known, is_known]
    assert np.isfinite(found.at_reference[0]) and found.bounds[0, 0] == 0
    assert np.isnan(found.efforts[0, 0]) and found.efforts[0, -1] == 1


def test_a_person_without_a_solution_is_unknown_and_the_others_are_not(people):
    scores = np.zeros((3, SCORES.shape[1]))
    scores[1, factor_columns(CASE.factors, ("donning.hand",))] = 20.0  # migrates beyond the shoulder point
    scores[2, factor_columns(CASE.factors, ("strength",))] = -20.0  # a fiftieth of the force, also with a slack cord
    shoulder = MODEL.coordinate_index("shoulder_elv")
    limited = (replace(one, **LIMITS) if one.coordinate == shoulder else one for one in MODEL.actuators)
    model = replace(MODEL, actuators=tuple(limited))
    everyone = solve_people(replace(CASE, motion=LoadedMotion(model, MOTION)), scores, workers=1)
    found = everyone["both", "hand"]
    assert found.at_reference[0] == pytest.approx(people["both", "hand"].at_reference[0], abs=1e-6)
    assert np.isnan(found.at_reference[1:]).all() and np.isnan(found.reduction[1]).all()
    for reading in everyone.values():
        outcomes = [FrameOutcome.SOLVED, SolverCode.CUFF_BEYOND_SHOULDER, FrameOutcome.INFEASIBLE]
        assert reading.outcome.tolist() == outcomes


def test_a_drawn_cuff_has_the_covariance_of_the_fit_and_the_spread_of_donnings():
    root = covariance_root(COVARIANCE)
    np.testing.assert_allclose(root @ root.T, COVARIANCE, rtol=1e-12)
    score = np.array([1.0, -1.0, 2.0])
    donned = varied_cuff(HAND, CASE.sources.fit, DonningSpread(0.1, 0.2, 0.3), {"donning.hand": score})
    next_one = np.sqrt(1 + 1 / 1)  # about the mean of one measured donning
    assert donned.stiffness == pytest.approx(8520 * np.exp(0.1 * next_one))
    assert donned.damping == pytest.approx(210 * np.exp(-0.2 * next_one))
    assert donned.migration == pytest.approx(0.015 * np.exp(0.6 * next_one))


def test_a_larger_body_has_a_longer_cord_and_muscles_and_heavier_segments():
    scores = {"size": np.ones(1), "segment_mass": np.array([1.0, 0.0, 0.0])}
    body = BodySpread(size=0.05, segment_mass=0.1)
    model, suit = varied_model(MODEL, body, MuscleSpread(), scores), varied_suit(SUIT, body, scores)
    own = prepare_suited_motion(LoadedMotion(model, MOTION), suit, EVERY).line.length
    assert own / prepare_suited_motion(CASE.motion, SUIT, EVERY).line.length == pytest.approx(np.exp(0.05), abs=1e-9)
    humerus = MODEL.body_index("humerus")
    assert model.bodies[humerus].mass / MODEL.bodies[humerus].mass == pytest.approx(np.exp(3 * 0.05 + 0.1))
    ratios = [
        a.optimal_fiber_length / b.optimal_fiber_length for a, b in zip(model.muscles, MODEL.muscles, strict=True)
    ]
    np.testing.assert_allclose(ratios, np.exp(0.05), rtol=2e-3)


def test_muscle_parameters_have_their_own_factor_and_the_common_strength():
    single = np.zeros(len(MODEL.muscles))
    single[4] = 2.0
    scores = {"strength": np.ones(1), "max_isometric_force": single, "tendon_slack_length": single}
    model = varied_model(MODEL, BodySpread(), MuscleSpread(), scores)
    strengths = of_muscles(MODEL, "max_isometric_force")
    np.testing.assert_allclose(of_muscles(model, "max_isometric_force"), strengths * np.exp(0.2 + 0.15 * single))
    tendons = of_muscles(MODEL, "tendon_slack_length")
    np.testing.assert_allclose(of_muscles(model, "tendon_slack_length"), tendons * np.exp(0.03 * single))


def test_an_error_of_posture_keeps_the_joints_together_and_has_its_size():
    generator = np.random.default_rng(5)
    draws = MotionDraws(MODEL, MOTION)
    scores = {"posture": generator.standard_normal(17), "noise": np.ones(1)}
    found = varied_motion(draws, CASE.sources.motion, scores)
    gaps = [
        constraint_gaps(MODEL, postures(MODEL, motion.positions, np.zeros_like(motion.positions)))
        for motion in (MOTION, found)
    ]
    assert np.abs(gaps[1] - gaps[0]).max() < 1e-3
    elevation = MODEL.coordinate_index("shoulder_elv")
    error = (found.positions - MOTION.positions)[:, elevation]
    assert error.mean() == pytest.approx(0.0436 * scores["posture"][elevation], abs=1e-3)
    assert error.std() == pytest.approx(0.0035, rel=0.5)


def test_a_slower_cycle_has_lower_speeds_and_accelerations():
    found = varied_motion(MotionDraws(MODEL, MOTION), CASE.sources.motion, {"duration": np.ones(1)})
    np.testing.assert_allclose(found.speeds, MOTION.speeds / np.exp(0.1))
    np.testing.assert_allclose(found.accelerations, MOTION.accelerations / np.exp(0.2))
    assert found.time[-1] == pytest.approx(MOTION.time[-1] * np.exp(0.1))


def test_a_score_chooses_among_the_drawn_motions():
    first, other = (DrawnMotion(Scaling(), replace(MOTION, positions=MOTION.positions + by)) for by in (0.0, 0.01))
    draws = MotionDraws(MODEL, MOTION, (first, other))
    for score, motion in ((-1.0, first.kinematics), (6.0, other.kinematics), (0.0, MOTION)):
        assert varied_motion(draws, CASE.sources.motion, {"drawn_motion": np.array([score])}) is motion


def test_an_angle_that_no_draw_varies_keeps_the_error_of_a_posture_without_markers():
    elbow, raised = MODEL.coordinate_index("elbow_flexion"), MODEL.coordinate_index("shoulder_elv")
    positions = MOTION.positions.copy()
    positions[:, raised] += 0.01
    draws = MotionDraws(MODEL, MOTION, (DrawnMotion(Scaling(), replace(MOTION, positions=positions)),))
    scores = {"drawn_motion": np.ones(1), "posture": np.ones(17)}
    away = varied_motion(draws, CASE.sources.motion, scores).positions - positions
    np.testing.assert_allclose(away[:, elbow], CASE.sources.motion.posture)
    np.testing.assert_allclose(away[:, raised], 0.0, atol=1e-12)


def test_a_drawn_motion_is_assessed_on_the_body_that_was_drawn_with_it():
    arm = {"humerus": np.full(3, 1.05)}
    case = replace(CASE, sources=CASE.sources.fit_only, drawn=(DrawnMotion(Scaling(arm, keeps_masses=True), MOTION),))
    scores = np.zeros((1, sum(factor.size for factor in case.factors)))
    scores[:, factor_columns(case.factors, ("drawn_motion",))] = 1.0
    own = replace(CASE, motion=LoadedMotion(scale_model(MODEL, Scaling(arm, keeps_masses=True)), MOTION))
    expected = solve_people(own, np.zeros((1, SCORES.shape[1])), workers=1)
    found = solve_people(case, scores, workers=1)
    for place, reading in found.items():
        assert reading.at_reference[0] == pytest.approx(expected[place].at_reference[0], rel=1e-9)

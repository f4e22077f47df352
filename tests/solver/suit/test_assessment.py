"""The assessment: relations between its curves, readouts, intervals of draws, and what it refuses."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import solver.suit.scenarios
from solver.bundled import bundled_model, simulate_arm_raise
from solver.cuff import CuffParameters
from solver.errors import SolverCode
from solver.motion import differentiate
from solver.muscle import MuscleOutcome
from solver.osim.suited import SuitedModel
from solver.redundancy.effort import RedundancyOptions
from solver.redundancy.motion_solution import LoadedMotion, solve_motion
from solver.redundancy.problem import FrameOutcome
from solver.suit.assessment import assess
from solver.suit.cord import CUFF_CONDITIONS
from solver.suit.optimise import optimise_suit
from solver.suit.quantity import (
    CensoredEnd,
    EdgeBounds,
    Quantity,
    content_of_intervals,
    edge_bounds,
    interval_of_draws,
    quantity_of_draws,
)
from solver.suit.scenarios import find_minimum
from solver.suit.suit import read_suit
from tests.refusals import raises_refusal
from tests.solver.redundancy.test_problem import with_a_singular_elbow

MODEL = bundled_model()
MOTION = differentiate(simulate_arm_raise(MODEL))
SUIT = replace(read_suit(), rest_lengths=np.linspace(0.63, 0.87, 9), reference_rest_length=0.75)
WAIST = CuffParameters("waist", "waist", 2140.0, 124.0, 0.015)
HAND = CuffParameters("hand", "arm", 8520.0, 210.0, 0.015, np.diag([100.0, 10.0, 0.002]) ** 2)
LENGTHS = np.linspace(0.6, 0.9, 16)
DRAWN = 0.7 + 0.05 * np.random.default_rng(1).standard_normal(2001)
DRAWN[0] = 0.7


def coarse(*cuffs, suit=SUIT, motion=MOTION):
    return assess(LoadedMotion(MODEL, motion), suit, cuffs, every=60)


@pytest.fixture(scope="module")
def assessment():
    return coarse(WAIST, HAND)


def curve(assessment, condition, cuff="hand"):
    (found,) = [c for c in assessment.curves if c.condition == condition and (c.cuff or cuff) == cuff]
    return found


def test_every_scenario_is_solved_and_saves_effort_but_for_the_suits_mass_and_a_slack_cord(assessment):
    assert len(assessment.time) == 11
    assert assessment.scenarios == 2 + 4 * 10  # slack and bare, 4 curves at 9 rest lengths and the reference
    assert assessment.unsolved == 0 and assessment.outcomes == {}
    assert 0.9 < assessment.bare_body_cost < 0.995
    assert assessment.longest_cord < SUIT.rest_lengths[-1]
    for found in assessment.curves:
        assert found.cost[-1] == pytest.approx(1, abs=1e-6)
        assert found.cost.min() < 0.95
        assert found.reserve_cost.max() < 0.01


def test_frames_with_a_path_that_did_not_converge_are_counted(assessment):
    found = assess(LoadedMotion(MODEL, MOTION), SUIT, (HAND,), every=135)
    assert found.muscle_outcomes == {MuscleOutcome.PATH_NOT_CONVERGED: 1}  # in frame 135, over OpenSim's cylinder
    assert found.outcomes == assessment.muscle_outcomes == {}


def test_a_posture_without_finite_accelerations_is_left_out_of_every_cost(assessment):
    model, positions = with_a_singular_elbow(MODEL), MOTION.positions.copy()
    positions[120, MODEL.coordinate_index("elbow_flexion")] = 1.0
    bent = replace(MOTION, positions=positions)
    found = assess(LoadedMotion(model, bent), SUIT, (HAND,), every=60)
    assert found.outcomes == {FrameOutcome.NOT_FINITE: found.scenarios}
    for each in found.curves:
        assert np.isfinite(each.cost).all()
        assert np.isfinite([figure.value for figure in each.reduction.values() if figure.value is not None]).all()
        assert np.flatnonzero(np.isnan(each.activations).any(axis=1)).tolist() == [2]


def test_migration_moves_the_curve_and_changes_nothing_else(assessment):
    # both cuffs migrate by 15 mm and the rest lengths are 30 mm apart
    np.testing.assert_allclose(curve(assessment, "shift").cost[:-1], curve(assessment, "rigid").cost[1:], atol=1e-6)
    # and where they also yield, the lever of their damping is 15 mm shorter
    both, yielding = curve(assessment, "both"), curve(assessment, "visco_elastic")
    np.testing.assert_allclose(both.cost[:-1], yielding.cost[1:], atol=3e-4)


def test_a_cuff_that_yields_takes_force_from_the_cord(assessment):
    forces = [value(curve(assessment, c), "cord_force") for c in ("rigid", "visco_elastic", "both")]
    assert forces[0] > forces[1] > forces[2] > 0


def test_migration_takes_the_slack_times_the_stiffness_from_the_cord(assessment):
    shift, rigid = curve(assessment, "shift"), curve(assessment, "rigid")
    lost = value(rigid, "cord_force") - value(shift, "cord_force")
    assert lost == pytest.approx(SUIT.stiffness * 0.03)
    assert value(shift, "cord_force_lost") == pytest.approx(lost / value(rigid, "cord_force"))
    assert rigid.figures["cord_force_lost"].value is None


def test_the_cost_of_migration_is_that_of_the_one_cuff_that_migrates(assessment):
    """Against whole assessments in which one cuff alone migrates by 4 mm less and more; linear within 4 mm."""
    suit = replace(SUIT, rest_lengths=SUIT.rest_lengths[-2:])
    for condition in ("shift", "both"):
        found = curve(assessment, condition)
        for name, cuff in (("cost_per_arm_migration", HAND), ("cost_per_waist_migration", WAIST)):
            less, more = (
                value(
                    curve(
                        coarse(
                            *(replace(c, migration=c.migration + step) if c is cuff else c for c in (WAIST, HAND)),
                            suit=suit,
                        ),
                        condition,
                    ),
                    "at_reference",
                )
                for step in (-4e-3, 4e-3)
            )
            assert value(found, name) == pytest.approx((more - less) / 8e-3, rel=0.01)
    assert curve(assessment, "rigid").figures["cost_per_arm_migration"].value is None


def test_from_the_optimum_to_slack_is_the_same_way_shifted_or_not(assessment):
    for condition in ("rigid", "shift"):
        found = curve(assessment, condition)
        slack = assessment.longest_cord - (0.03 if condition == "shift" else 0)
        assert value(found, "to_slack") == pytest.approx(slack - value(found, "rest_length"))


def test_stiff_cuffs_in_place_are_rigid(assessment):
    stiff = [replace(cuff, stiffness=1e9, damping=0.0, migration=0.0) for cuff in (WAIST, HAND)]
    for condition in CUFF_CONDITIONS:
        found = curve(coarse(*stiff, suit=replace(SUIT, rest_lengths=SUIT.rest_lengths[::2])), condition)
        np.testing.assert_allclose(found.cost, curve(assessment, "rigid").cost[::2], atol=1e-4)


def test_a_groups_reduction_is_of_its_muscles_mean_activation(assessment):
    found = curve(assessment, "rigid")
    serratus = [i for i, name in enumerate(assessment.muscles) if name.startswith("SerratusAnterior")]
    expected = 1 - found.activations[:, serratus].mean() / assessment.slack[:, serratus].mean()
    assert found.reduction["serratus_anterior"].value == pytest.approx(expected)


def test_the_optimum_lies_between_the_lengths_and_is_no_worse_than_any(assessment):
    found = curve(assessment, "rigid")
    assert SUIT.rest_lengths[0] < value(found, "rest_length") < SUIT.rest_lengths[-1]
    assert value(found, "lowest_cost") <= found.cost.min() + 1e-9
    assert 0 < value(found, "permissible_error") < 0.1


def test_an_optimum_at_the_edge_of_what_was_tried_is_none():
    found = curve(coarse(HAND, suit=replace(SUIT, rest_lengths=np.linspace(0.76, 0.9, 5))), "rigid")
    assert found.figures["rest_length"].value is None
    assert found.figures["lowest_cost"].value is None


def test_without_a_waist_cuff_the_waist_is_rigid_and_named_so():
    alone, with_stiff_waist = coarse(HAND), coarse(HAND, replace(WAIST, stiffness=1e9, damping=0.0, migration=0.0))
    assert alone.waist_cuff is None
    np.testing.assert_allclose(curve(alone, "both").cost, curve(with_stiff_waist, "both").cost, atol=1e-4)


@pytest.mark.parametrize("cuffs", [(), (WAIST,), (HAND, WAIST, WAIST)])
def test_too_few_arm_cuffs_or_too_many_at_the_waist_are_refused(cuffs):
    with raises_refusal(SolverCode.NO_ARM_CUFF):
        coarse(*cuffs)


@pytest.mark.parametrize(
    ("cuff", "suit", "code", "naming"),
    [
        ({}, {"reference_rest_length": 1.2}, SolverCode.CORD_SLACK, "reference_rest_length_m"),
        ({}, {"rest_lengths": np.linspace(0.9, 1.2, 6)}, SolverCode.CORD_SLACK, "rest_lengths_m"),
        ({"stiffness": -5.0}, {}, SolverCode.WRONG_CUFF, "-5 N/m"),
        ({}, {"waist": replace(SUIT.waist, body="pelvis")}, SolverCode.SUIT_BODY, "pelvis"),
    ],
    ids=["reference slack in all frames", "all lengths slack", "negative stiffness", "unknown body"],
)
def test_a_suit_that_cannot_be_worn_is_refused(cuff, suit, code, naming):
    with raises_refusal(code, naming):
        coarse(replace(HAND, **cuff), suit=replace(SUIT, **suit))


def test_a_motion_outside_a_joints_range_is_refused_with_the_time():
    positions = MOTION.positions.copy()
    positions[300, MODEL.coordinate_index("shoulder_elv")] = np.radians(200)
    with raises_refusal(SolverCode.OUT_OF_RANGE, naming="200° at 3 s"):
        coarse(HAND, motion=replace(MOTION, positions=positions))


def test_a_frame_that_is_not_solved_is_counted_and_its_curve_has_no_optimum(monkeypatch):
    def with_a_hole(problem, loads=None, progress=None, workers=None):
        found = solve_redundancy(problem, loads)
        outcomes, controls = found.outcomes.copy(), found.controls.copy()
        if len(controls) > 1:
            outcomes[4, 2], controls[4, 2] = FrameOutcome.INFEASIBLE, np.nan
        return replace(found, outcomes=outcomes, controls=controls)

    solve_redundancy = solver.suit.scenarios.solve_redundancy
    monkeypatch.setattr(solver.suit.scenarios, "solve_redundancy", with_a_hole)
    found = coarse(WAIST, HAND)
    assert found.unsolved == 1
    assert found.outcomes == {FrameOutcome.INFEASIBLE: 1}
    rigid = curve(found, "rigid")
    assert rigid.unsolved == 1
    assert np.isnan(rigid.cost).sum() == 1
    assert rigid.figures["rest_length"].value is None
    assert curve(found, "both").figures["rest_length"].value is not None


def value(curve, name):
    return curve.figures[name].value


def parabola(lowest, cost, curvature):
    return cost + curvature * (LENGTHS - lowest) ** 2


def test_of_a_parabola_all_three_are_exact():
    found = find_minimum(LENGTHS, parabola(0.733, 0.8, 10.0))
    assert found.rest_length == pytest.approx(0.733, abs=1e-12)
    assert found.cost == pytest.approx(0.8, abs=1e-12)
    assert found.width == pytest.approx(2 * np.sqrt(0.1 * 0.2 / 10.0), abs=1e-12)  # where 0.02 of 0.2 is lost


@pytest.mark.parametrize("lowest", [0.5, 0.95])
def test_at_the_edge_of_what_was_tried_there_is_none(lowest):
    found = find_minimum(LENGTHS, parabola(lowest, 0.8, 10.0))
    assert np.isnan([found.rest_length, found.cost, found.width]).all()
    assert found.edge == np.sign(lowest - 0.75)


@pytest.mark.parametrize(
    ("lowest", "cost", "curvature", "rest_length"),
    [(0.63, 0.8, 1.0, 0.63), (0.733, 1.01, 10.0, 0.733)],
    ids=["beyond what was tried", "saves nothing"],
)
def test_a_width_that_is_unknown_leaves_the_rest_length(lowest, cost, curvature, rest_length):
    found = find_minimum(LENGTHS, parabola(lowest, cost, curvature))
    assert found.rest_length == pytest.approx(rest_length)
    assert np.isnan(found.width)


def test_a_curve_with_a_gap_has_no_optimum():
    cost = parabola(0.733, 0.8, 10.0)
    cost[3] = np.nan
    assert np.isnan(find_minimum(LENGTHS, cost).rest_length)


@pytest.mark.parametrize(
    ("fitted", "ci95"),
    [(0.5, (9.525, 10.475)), (0.0, (10.0, 10.975)), (1.0, (9.025, 10.0))],
    ids=["around the fitted cuffs", "all draws above", "all draws below"],
)
def test_an_interval_holds_95_percent_of_equally_spaced_draws_and_the_value(
    fitted: float, ci95: tuple[float, float]
) -> None:
    found = quantity_of_draws(10.0, np.array([fitted, *np.arange(1, 1000) / 1000]))
    assert found.ci95 == pytest.approx(ci95, abs=1e-12) and (found.value, found.censored) == (10.0, None)


@pytest.mark.parametrize(
    ("lowest", "highest", "censored"),
    [(0.4, 0.9, None), (0.65, 1.0, CensoredEnd.LOW), (0.5, 0.75, CensoredEnd.HIGH), (0.65, 0.75, CensoredEnd.BOTH)],
)
def test_an_end_beyond_the_lengths_tried_is_a_bound_and_the_other_stays(
    lowest: float, highest: float, censored: CensoredEnd | None
) -> None:
    sides = np.where(lowest > DRAWN, -1.0, np.where(highest < DRAWN, 1.0, 0.0))
    bounds = EdgeBounds(np.where(sides, np.clip(DRAWN, lowest, highest), np.nan), sides)
    found = quantity_of_draws(0.7, np.where(sides, np.nan, DRAWN), bounds)
    truth = quantity_of_draws(0.7, DRAWN)
    assert found.censored == censored
    assert found.ci95 == pytest.approx((max(truth.ci95[0], lowest), min(truth.ci95[1], highest)))


@pytest.mark.parametrize(
    ("draws", "at_edge", "is_bound"),
    [(38, 0, False), (38, 1, True), (39, 1, True), (78, 1, True), (79, 1, False), (79, 2, True), (118, 2, True)],
)
@pytest.mark.parametrize(("side", "censored"), [(-1.0, CensoredEnd.LOW), (1.0, CensoredEnd.HIGH)])
def test_an_end_is_a_bound_if_the_lower_draw_of_its_quantile_is_at_the_edge(
    draws: int, at_edge: int, is_bound: bool, side: float, censored: CensoredEnd
) -> None:
    """The lower end of n draws lies between the draws k and k + 1 with k = ⌊0.025 (n + 1)⌋, counted from 1."""
    versions, sides = np.linspace(-1.0, 1.0, 1 + draws) * side, np.zeros(1 + draws)
    versions[1 : 1 + at_edge], sides[1 : 1 + at_edge] = np.nan, side
    found = quantity_of_draws(0.0, versions, EdgeBounds(np.full(1 + draws, 2.0 * side), sides))
    assert found.ci95 is not None and found.censored == (censored if is_bound else None)


@pytest.mark.parametrize(("draws", "order"), [(39, 1), (79, 2), (199, 5)])
def test_the_ends_are_order_statistics_between_which_the_next_draw_lies_with_95_percent(draws: int, order: int) -> None:
    """P(X(r) < X < X(s)) = (s − r) / (n + 1)."""
    values = np.random.default_rng(3).standard_normal(draws)
    ends = np.sort(values)[[order - 1, draws - order]]
    assert interval_of_draws(values) == pytest.approx(ends, abs=1e-12)
    assert (draws + 1 - 2 * order) / (draws + 1) == pytest.approx(0.95)


def test_the_content_of_an_interval_has_the_stated_bounds() -> None:
    """Intervals of 100 uniform draws, whose content is their width."""
    ends = np.array([interval_of_draws(draws) for draws in np.random.default_rng(2).random((4000, 100))])
    least, most = content_of_intervals(100)
    content = np.diff(ends, axis=1)
    assert (least, most) == pytest.approx(np.quantile(content, [0.025, 0.975]), abs=0.005)
    assert content.mean() == pytest.approx(0.95, abs=0.002)


def test_draws_without_a_number_are_left_out_and_above_a_tenth_of_them_there_is_no_interval() -> None:
    versions = DRAWN.copy()
    versions[1:201] = np.nan
    assert quantity_of_draws(0.7, versions) == quantity_of_draws(0.7, np.append(DRAWN[0], DRAWN[201:]))
    versions[201] = np.nan
    assert quantity_of_draws(0.7, versions) == Quantity(0.7)
    assert quantity_of_draws(None, DRAWN) == Quantity(None)
    versions[0] = np.nan
    assert quantity_of_draws(0.7, versions, EdgeBounds(np.zeros(2001), np.ones(2001))) == Quantity(0.7)


@pytest.mark.parametrize(
    ("name", "sides", "column"),
    [("rest_length", [-1, 1, 0], 1), ("lowest_cost", [-1, -1, 0], 2), ("to_slack", [1, -1, 0], 3)],
)
def test_beyond_the_edge_the_cost_is_lower_and_a_shorter_cord_is_farther_from_slack(
    name: str, sides: list[int], column: int
) -> None:
    table = np.array([[-1.0, 0.5, 0.9, 0.2], [1.0, 0.8, 0.7, 0.0], [0.0, np.nan, np.nan, np.nan]])
    bounds = edge_bounds(SimpleNamespace(bounds=table), name)  # type: ignore[arg-type]
    assert bounds is not None and bounds.sides.tolist() == sides
    np.testing.assert_array_equal(bounds.values, table[:, column])
    assert edge_bounds(SimpleNamespace(bounds=table), "cord_force") is None  # type: ignore[arg-type]


# Muscles with elastic tendons: the same as with the forces of the cord as external loads, and what is refused.


SHORT = replace(SUIT, rest_lengths=np.array([0.7, 0.75]))
SIX_FRAMES = differentiate(simulate_arm_raise(MODEL), start=1.0, end=1.05)
ELASTIC = LoadedMotion(MODEL, SIX_FRAMES, options=RedundancyOptions(tendons="elastic"))


def test_an_elastic_scenario_is_the_motion_with_the_forces_of_the_cord_as_loads():
    found, suited = assess(ELASTIC, SHORT, (HAND,)), SuitedModel(MODEL, SHORT, None, None)
    slack, worn = (
        solve_motion(suited.model, SIX_FRAMES, ELASTIC.options, loads=loads) for loads in ((), suited.loads(SIX_FRAMES))
    )
    np.testing.assert_allclose(found.slack, slack.activations, rtol=0, atol=1e-7)
    rigid = found.curves[0]
    np.testing.assert_allclose(rigid.activations, worn.activations, rtol=0, atol=1e-6)
    effort, before = (float((solution.activations**2).sum()) for solution in (worn, slack))
    assert rigid.cost[1] == pytest.approx(effort / before, rel=1e-6)
    assert rigid.cost[1] != pytest.approx(1.0, abs=0.02)
    with_rigid_tendons = assess(LoadedMotion(MODEL, SIX_FRAMES), SHORT, (HAND,))
    assert found.unsolved == with_rigid_tendons.unsolved == 0
    assert abs(rigid.cost[0] - with_rigid_tendons.curves[0].cost[0]) > 1e-4


def test_single_frames_with_elastic_tendons_are_refused():
    with raises_refusal(SolverCode.UNSUPPORTED, naming="every 2-th"):
        assess(ELASTIC, SHORT, (HAND,), every=2)
    with raises_refusal(SolverCode.UNSUPPORTED, naming="fibre velocities"):
        optimise_suit(ELASTIC, SHORT, (None, HAND), every=20)

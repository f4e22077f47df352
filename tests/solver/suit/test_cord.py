"""The worn suit: cord and cuffs are springs in series, a slack cord never pulls, forces are the slope of the energy."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from solver.bundled import bundled_model, simulate_arm_raise
from solver.cuff import CuffParameters
from solver.errors import SolverCode
from solver.motion import decimate, differentiate
from solver.multibody.postures import postures
from solver.suit.cord import (
    SuitScenario,
    check_cord,
    cord_line,
    ensure_possible,
    line_between,
    suit_forces,
    with_migration,
)
from solver.suit.suit import read_suit
from tests.refusals import raises_refusal

MODEL = bundled_model()
SUIT = read_suit()
ARM = CuffParameters("hand", "arm", stiffness=8520.0, damping=210.0, migration=0.012)
WAIST = CuffParameters("waist", "waist", stiffness=2140.0, damping=124.0, migration=0.012)
CUFFS = (WAIST, ARM)
REST_LENGTHS = np.array([0.60, 0.70, 0.95])
LENGTHS = np.array([0.5, 0.53125, 0.625, 0.5])  # m, exact in binary
STRAIGHT = replace(SUIT, stiffness=1000.0, is_straight=True)


@pytest.fixture
def line():
    """A cord some 0.8 m long whose three points wander at random, cuffs on bodies that turn."""
    generator = np.random.default_rng(3)
    frames = 7
    rotations = np.linalg.qr(generator.normal(size=(frames, 2, 3, 3)))[0]
    return line_between(
        anchors=np.array([[0.0, -0.5, 0.1], [0.2, 0.1, 0.0]]) + 0.02 * generator.normal(size=(frames, 2, 3)),
        shoulder=np.array([0.0, 0.05, 0.1]) + 0.02 * generator.normal(size=(frames, 3)),
        anchors_to_ground=rotations,
        interval=0.1,
    )


def series(*stiffness):
    return 1 / sum(1 / k for k in stiffness)


def energy(line, rest_length, displacement):
    reach = np.linalg.norm(line.shoulder[:, None] - line.anchors - displacement, axis=-1).sum(axis=-1)
    cord = SUIT.stiffness / 2 * np.maximum(reach - rest_length, 0) ** 2
    stiffness = np.array([WAIST.stiffness, ARM.stiffness])
    return cord + (stiffness / 2 * (displacement**2).sum(axis=-1)).sum(axis=-1)


@pytest.mark.parametrize(
    ("cuffs", "is_shifted"), [(CUFFS, False), (CUFFS, True), ((None, ARM), False), ((None, ARM), True)]
)
def test_cord_and_cuffs_are_springs_in_series_along_a_line_that_migration_shortens(line, cuffs, is_shifted):
    worn = suit_forces(SUIT, line, REST_LENGTHS, cuffs, is_shifted=is_shifted, yields=True)
    worn_cuffs = [cuff for cuff in cuffs if cuff]
    slack = is_shifted * sum(cuff.migration for cuff in worn_cuffs)
    stretch = np.maximum(line.length - slack - REST_LENGTHS[:, None], 0)
    stiffness = series(SUIT.stiffness, *(cuff.stiffness for cuff in worn_cuffs))
    np.testing.assert_allclose(worn.tension, stiffness * stretch, atol=1e-9)
    assert worn.tension.max() > 50
    assert worn.displacement[..., 0, :].any() == (cuffs[0] is not None)


def test_the_equilibrium_is_where_the_stored_energy_is_least(line):
    # found here by descent from unloaded cuffs, which knows nothing of springs in series
    worn = suit_forces(SUIT, line, REST_LENGTHS[:1], CUFFS, yields=True)
    for frame in range(len(line.shoulder)):
        alone = replace(line, anchors=line.anchors[[frame]], shoulder=line.shoulder[[frame]])
        found = minimize(lambda q, at=alone: energy(at, REST_LENGTHS[0], q.reshape(1, 2, 3))[0], np.zeros(6), tol=1e-12)
        np.testing.assert_allclose(worn.displacement[0, frame].ravel(), found.x, atol=1e-6)


def test_a_cuff_too_soft_to_hold_the_cord_finds_no_rest(line):
    soft = replace(ARM, stiffness=20.0)
    with raises_refusal(SolverCode.CUFFS_NOT_AT_REST, naming="20 N/m"):
        suit_forces(SUIT, line, np.array([0.1, 0.9]), (WAIST, soft), yields=True)


def test_along_the_bone_a_cuff_slips_in_its_body_and_the_line_changes(line):
    along_bone = replace(SUIT, migration_direction="bone")
    moved = with_migration(along_bone, line, CUFFS).anchors - line.anchors
    in_body = np.einsum("fcij,fci->fcj", line.anchors_to_ground, moved)
    np.testing.assert_allclose(in_body, np.broadcast_to([[[0, 0.012, 0]] * 2], in_body.shape), atol=1e-15)
    along_cord = with_migration(SUIT, line, CUFFS)
    assert np.abs(along_cord.anchors - line.anchors - moved).max() > 0.005
    np.testing.assert_allclose(along_cord.length, line.length - 0.024, atol=1e-12)


def test_a_cuff_does_not_slip_over_the_shoulder_point(line):
    with raises_refusal(SolverCode.CUFF_BEYOND_SHOULDER, naming="0.178 m, its distance to the shoulder point"):
        with_migration(SUIT, line, (WAIST, replace(ARM, migration=1.0)))


def test_very_stiff_cuffs_are_rigid_ones(line):
    stiff = tuple(replace(cuff, stiffness=1e12, damping=0.0) for cuff in CUFFS)
    nearly, rigid = suit_forces(SUIT, line, REST_LENGTHS, stiff, yields=True), suit_forces(SUIT, line, REST_LENGTHS)
    np.testing.assert_allclose(nearly.forces, rigid.forces, atol=1e-5)
    np.testing.assert_allclose(nearly.points, rigid.points, atol=1e-9)


def test_migration_slackens_the_cord_by_both_cuffs_along_an_unchanged_line(line):
    shifted = suit_forces(SUIT, line, REST_LENGTHS, CUFFS, is_shifted=True)
    longer = suit_forces(SUIT, line, REST_LENGTHS + WAIST.migration + ARM.migration)
    np.testing.assert_allclose(shifted.tension, longer.tension, atol=1e-9)
    np.testing.assert_allclose(shifted.forces, longer.forces, atol=1e-9)


def test_a_slack_cord_pulls_with_nothing_and_moves_no_cuff(line):
    worn = suit_forces(SUIT, line, REST_LENGTHS, CUFFS, yields=True)
    assert (line.length < REST_LENGTHS[2]).all()
    assert not worn.tension[2].any()
    assert not worn.displacement[2].any()
    assert not worn.forces[2].any()
    assert (worn.tension >= 0).all()


def test_a_cord_without_stiffness_is_no_suit(line):
    worn = suit_forces(replace(SUIT, stiffness=0.0), line, REST_LENGTHS, CUFFS, yields=True)
    assert not worn.forces.any()


def test_without_damping_the_forces_cancel_and_do_no_turning(line):
    still = tuple(replace(cuff, damping=0.0) for cuff in CUFFS)
    worn = suit_forces(SUIT, line, REST_LENGTHS, still, is_shifted=True, yields=True)
    np.testing.assert_allclose(worn.forces.sum(axis=-2), 0, atol=1e-8)
    np.testing.assert_allclose(np.cross(worn.points, worn.forces).sum(axis=-2), 0, atol=1e-8)


def test_forces_are_the_slope_of_the_stored_energy(line):
    # virtual work: at the equilibrium the energy of cord and cuffs changes only with what the bodies move
    still = tuple(replace(cuff, damping=0.0) for cuff in CUFFS)
    worn = suit_forces(SUIT, line, REST_LENGTHS[:1], still, yields=True)
    generator, step = np.random.default_rng(5), 1e-6
    anchors, shoulder = generator.normal(size=line.anchors.shape), generator.normal(size=line.shoulder.shape)
    stored = []
    for sign in (1, -1):
        moved = replace(
            line, anchors=line.anchors + sign * step * anchors, shoulder=line.shoulder + sign * step * shoulder
        )
        settled = suit_forces(SUIT, moved, REST_LENGTHS[:1], still, yields=True).displacement[0]
        stored.append(energy(moved, REST_LENGTHS[0], settled))
    slope = (stored[0] - stored[1]) / (2 * step)
    work = (worn.forces[0, :, :2] * anchors).sum(axis=(-1, -2)) + (worn.forces[0, :, 2] * shoulder).sum(axis=-1)
    np.testing.assert_allclose(work, -slope, rtol=1e-6, atol=1e-5)


def test_damping_resists_a_growing_displacement_seen_from_the_body(line):
    worn = suit_forces(SUIT, line, REST_LENGTHS, CUFFS, yields=True)
    still = suit_forces(SUIT, line, REST_LENGTHS, [replace(cuff, damping=0.0) for cuff in CUFFS], yields=True)
    extra = worn.forces - still.forces
    assert not extra[:, 0].any()  # the first frame has no past
    np.testing.assert_array_equal(extra[..., 2, :], 0)  # the shoulder feels the cord alone
    in_body = np.einsum("fcij,rfci->rfcj", line.anchors_to_ground, worn.displacement)
    rate = np.diff(in_body, axis=1) / line.interval
    expected = np.einsum("fcij,rfcj->rfci", line.anchors_to_ground[1:], rate) * [[WAIST.damping], [ARM.damping]]
    np.testing.assert_allclose(extra[:, 1:, :2], expected, atol=1e-9)


def test_the_central_difference_looks_both_ways(line):
    central = replace(SUIT, rate="central")
    worn = suit_forces(central, line, REST_LENGTHS[:1], CUFFS, yields=True)
    still = [replace(cuff, damping=0.0) for cuff in CUFFS]
    extra = worn.forces - suit_forces(central, line, REST_LENGTHS[:1], still, yields=True).forces
    in_body = np.einsum("fcij,rfci->rfcj", line.anchors_to_ground, worn.displacement)
    for frame, before, after in ((0, 0, 1), (3, 2, 4), (6, 5, 6)):
        rate = (in_body[:, after] - in_body[:, before]) / ((after - before) * line.interval)
        expected = np.einsum("cij,rcj->rci", line.anchors_to_ground[frame], rate) * [[WAIST.damping], [ARM.damping]]
        np.testing.assert_allclose(extra[:, frame, :2], expected, atol=1e-9)


def test_a_damped_cord_pulls_more_while_it_lengthens_and_never_pushes(line):
    damped = suit_forces(replace(SUIT, damping=30.0), line, REST_LENGTHS)
    plain = suit_forces(SUIT, line, REST_LENGTHS)
    lengthens = np.diff(line.length) > 0
    taut = plain.tension[0, 1:] > 0
    assert (damped.tension[0, 1:] > plain.tension[0, 1:])[lengthens & taut].all()
    assert (damped.tension >= 0).all()
    assert not damped.tension[2].any()
    strong = suit_forces(replace(SUIT, damping=1e5), line, REST_LENGTHS).tension[0, 1:]
    assert strong[lengthens & taut].any() and not strong[~lengthens].any()


def test_the_cords_points_ride_on_their_bodies():
    q = np.tile(MODEL.default_coordinates, (2, 1))
    q[1, MODEL.coordinate_index("shoulder_elv")] += 1.0
    line = cord_line(SUIT, MODEL, postures(MODEL, q, np.zeros_like(q)), interval=0.1)
    np.testing.assert_allclose(line.shoulder[0], line.shoulder[1])
    np.testing.assert_allclose(line.anchors[0, 0], line.anchors[1, 0])
    assert line.length[1] < line.length[0]  # the raised arm gives the cord slack
    apart = np.linalg.norm(SUIT.waist.location - SUIT.shoulder.location)
    np.testing.assert_allclose(np.linalg.norm(line.anchors[:, 0] - line.shoulder, axis=1), apart)


@pytest.mark.parametrize("cuffs", [CUFFS, (None, ARM), (None, None)])
def test_a_measured_tension_differs_from_the_predicted_one_by_an_offset_and_a_spread(cuffs):
    motion = decimate(differentiate(simulate_arm_raise(MODEL)), 60).cut(slice(0, 10))
    suit = replace(SUIT, reference_rest_length=0.7)
    stretch = cord_line(suit, MODEL, postures(MODEL, motion.positions, motion.speeds), motion.interval).length - 0.7
    expected = series(SUIT.stiffness, *(cuff.stiffness for cuff in cuffs if cuff)) * np.maximum(stretch, 0.0)
    measured = expected + 5.0 + np.resize([2.0, -2.0], 10)
    found = check_cord(suit, MODEL, motion, measured, cuffs)
    np.testing.assert_allclose(found.predicted, expected, atol=1e-9)
    assert (found.offset, found.rms) == pytest.approx((5.0, 2.0), abs=1e-9)
    assert found.correlation == pytest.approx(np.corrcoef(measured, expected)[0, 1], abs=1e-9)
    assert np.isnan(check_cord(suit, MODEL, motion, np.full(10, 5.0), cuffs).correlation)
    slack = check_cord(replace(SUIT, reference_rest_length=2.0), MODEL, motion, measured, cuffs)
    assert np.isnan(slack.correlation) and slack.offset == pytest.approx(measured.mean())


@pytest.fixture
def straight():
    """A straight cord along x from the waist at the origin; the cuff at the arm moves along it, 0.125 s a frame."""
    anchors = np.zeros((len(LENGTHS), 2, 3))
    anchors[:, 1, 0] = LENGTHS
    return line_between(anchors, anchors.mean(axis=1), np.broadcast_to(np.eye(3), (len(LENGTHS), 2, 3, 3)), 0.125)


@pytest.mark.parametrize("rest_length", [0.5, 0.3])
def test_a_straight_cord_pulls_its_cuffs_together_as_three_springs_in_series(straight, rest_length):
    """Cord 1000 N/m, waist 2000 N/m, arm 4000 N/m: 4000/7 N/m together."""
    soft = replace(WAIST, stiffness=2000.0, damping=0.0), replace(ARM, stiffness=4000.0, damping=0.0)
    worn = suit_forces(STRAIGHT, straight, np.array([rest_length]), soft, yields=True)
    tension = 4000 / 7 * (LENGTHS - rest_length)
    np.testing.assert_allclose(worn.tension[0], tension, atol=1e-9)
    along_x = np.stack([tension, -tension, 0 * tension], axis=1)
    np.testing.assert_allclose(worn.forces[0], along_x[..., None] * [1.0, 0.0, 0.0], atol=1e-9)
    travel = np.stack([tension / 2000, -tension / 4000], axis=1)
    np.testing.assert_allclose(worn.displacement[0, ..., 0], travel, atol=1e-12)
    x = [travel[:, 0], LENGTHS + travel[:, 1], LENGTHS / 2]
    np.testing.assert_allclose(worn.points[0, ..., 0], np.transpose(x), atol=1e-12)
    assert not worn.points[..., 1:].any() and not worn.displacement[..., 1:].any()


@pytest.mark.parametrize(("arm", "total"), [(ARM, 0.024), (None, 0.012)])
def test_migration_shortens_a_straight_cord_and_keeps_its_middle_between_the_cuffs(straight, arm, total):
    moved = with_migration(STRAIGHT, straight, (WAIST, arm))
    np.testing.assert_allclose(moved.length, LENGTHS - total, atol=1e-12)
    np.testing.assert_allclose(moved.anchors[:, 0], [[0.012, 0.0, 0.0]] * len(LENGTHS), atol=1e-15)
    np.testing.assert_allclose(moved.shoulder, moved.anchors.sum(axis=1) / 2)
    along_bone = with_migration(replace(STRAIGHT, migration_direction="bone"), straight, (None, ARM))
    np.testing.assert_allclose(along_bone.length, np.hypot(LENGTHS, 0.012))


def test_a_cuff_on_a_straight_cord_does_not_slip_over_its_middle(straight):
    with raises_refusal(SolverCode.CUFF_BEYOND_SHOULDER, naming="the middle of the cord"):
        with_migration(STRAIGHT, straight, (None, replace(ARM, migration=0.25)))
    with_migration(STRAIGHT, straight, (None, replace(ARM, migration=0.2499)))


@pytest.mark.parametrize(
    ("rate", "tension"),
    [("backward", [0.0, 31.25 + 30 * 0.25, 125 + 30 * 0.75, 0.0]), ("central", [0.0, 31.25 + 30 * 0.5, 121.25, 0.0])],
)
def test_spring_and_damper_of_a_cord_are_parallel_while_it_is_taut(straight, rate, tension):
    """1000 N/m and 30 N s/m, rest length 0.5 m; without stretch there is no force, although the cord lengthens."""
    damped = replace(STRAIGHT, damping=30.0, rate=rate)
    np.testing.assert_allclose(suit_forces(damped, straight, np.array([0.5])).tension[0], tension, atol=1e-9)


def test_the_middle_of_a_straight_cord_lies_between_its_two_points():
    q = MODEL.default_coordinates[None]
    line = cord_line(STRAIGHT, MODEL, postures(MODEL, q, np.zeros_like(q)), interval=0.1)
    apart = np.linalg.norm(line.anchors[0, 0] - line.anchors[0, 1])
    np.testing.assert_allclose(line.length, apart)
    np.testing.assert_allclose(np.linalg.norm(line.shoulder[0] - line.anchors[0], axis=1), apart / 2)


@pytest.mark.parametrize(
    "broken",
    [{"stiffness": -3.0}, {"stiffness": 0.0}, {"stiffness": np.inf}, {"damping": np.nan}, {"migration": np.nan}],
)
def test_a_cuff_that_is_no_spring_is_refused(line, broken):
    with raises_refusal(SolverCode.WRONG_CUFF, naming="hand"):
        suit_forces(SUIT, line, REST_LENGTHS, (WAIST, replace(ARM, **broken)), yields=True)


def test_a_cuff_that_gives_energy_is_refused_but_draws_about_a_small_damping_are_not(line):
    ensure_possible(replace(ARM, stiffness=0.5, damping=0.0, migration=-0.01))
    giving = replace(ARM, damping=-1.0)
    with raises_refusal(SolverCode.WRONG_CUFF, naming="-1 N s/m"):
        ensure_possible(giving)
    assert np.isfinite(suit_forces(SUIT, line, REST_LENGTHS, (WAIST, giving), yields=True).tension).all()


def test_forces_in_every_second_frame_are_those_of_all_frames(line):
    options = {"is_shifted": True, "yields": True}
    whole = suit_forces(SUIT, line, REST_LENGTHS, CUFFS, **options)
    decimated = suit_forces(SUIT, line, REST_LENGTHS, CUFFS, every=2, **options)
    np.testing.assert_array_equal(decimated.tension, whole.tension[:, ::2])
    np.testing.assert_array_equal(decimated.largest_tension, whole.tension.max(axis=1))
    for name in ("displacement", "points", "forces"):
        np.testing.assert_array_equal(getattr(decimated, name), getattr(whole, name)[:, ::2])


@pytest.mark.parametrize(
    ("condition", "is_shifted", "yields"),
    [("rigid", False, False), ("shift", True, False), ("visco_elastic", False, True), ("both", True, True)],
)
def test_a_scenario_moves_and_yields_by_its_condition(condition, is_shifted, yields):
    scenario = SuitScenario(condition, WAIST, ARM, REST_LENGTHS)
    assert (scenario.is_shifted, scenario.yields, scenario.migrated) == (is_shifted, yields, [])
    assert scenario.migration == pytest.approx(0.024 * is_shifted)
    assert replace(scenario, waist=None).migration == pytest.approx(0.012 * is_shifted)
    for waist, arm in ((WAIST, ARM), (None, ARM), (WAIST, None)):
        sloped = replace(scenario, waist=waist, arm=arm, with_slopes=True).migrated
        worn = [cuff for cuff in (waist, arm) if cuff]
        moved = [
            (step if cuff is waist else 0.0, step if cuff is arm else 0.0) for step in (-1e-3, 1e-3) for cuff in worn
        ]
        assert len(sloped) == len(moved) * is_shifted
        for each, steps in zip(sloped, moved, strict=is_shifted):
            assert each.rest_lengths.tolist() == [0.95] and not each.with_slopes and each.condition == condition
            for cuff, given, step in zip(each.cuffs, (waist, arm), steps, strict=True):
                assert (cuff and cuff.migration) == (given and pytest.approx(given.migration + step, rel=1e-12))

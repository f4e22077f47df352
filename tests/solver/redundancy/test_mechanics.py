"""Mechanics of a motion: forces left out of a model, and the glenoid's cone with its published angle and axes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from solver.bundled import bundled_model, simulate_arm_raise
from solver.errors import SolverCode
from solver.forces.actuators import PointActuator, TorqueActuator
from solver.forces.passive_forces import CoordinateSpring, PathSpring
from solver.motion import Kinematics, decimate, differentiate
from solver.multibody.dynamics import equations_of_motion, inverse_dynamics
from solver.multibody.loads import ExternalForce
from solver.multibody.postures import points_in_ground, postures, rotation_body_fixed_xyz
from solver.osim.model_reader import read_osim
from solver.redundancy.mechanics import (
    actuator_forces,
    angle_between,
    cone_rows,
    contact_points,
    force_agreement,
    glenoid_axes,
    glenoid_cone,
    passive_force_on_coordinates,
    with_rim,
    without_forces,
)
from tests.refusals import raises_refusal
from tests.solver.legs import step_in

BARE = bundled_model()
BAND = PathSpring("band", BARE.muscles[0].path, 0.05, 500.0, 0.1)
STOP = CoordinateSpring("stop", BARE.coordinate_index("shoulder_elv"), 20.0, 0.1, 0.5)
MODEL = replace(BARE, forces=(BAND,), coordinate_forces=(STOP,))
MOTION = decimate(differentiate(simulate_arm_raise(BARE)), 40)
CONE = glenoid_cone(BARE)


def test_a_force_is_what_it_takes_off_the_bias_force() -> None:
    state = postures(BARE, MOTION.positions, MOTION.speeds)
    bias = equations_of_motion(BARE, state).bias_force
    for name in ("band", "stop"):
        others = [force for force in ("band", "stop") if force != name]
        alone = equations_of_motion(without_forces(MODEL, others), state).bias_force
        found = passive_force_on_coordinates(MODEL, MOTION, name)
        np.testing.assert_allclose(found, bias - alone, atol=1e-9)
        assert np.abs(found).max() > 1.0


def test_without_its_forces_the_model_is_the_bare_one_and_names_them() -> None:
    bare = without_forces(MODEL, ["band", "stop", "band"])
    assert (bare.forces, bare.coordinate_forces, bare.left_out) == ((), (), ("band", "stop"))
    with raises_refusal(SolverCode.UNKNOWN_NAME, naming="rope to leave out; it has stop, band"):
        without_forces(MODEL, ["rope"])


def test_the_thorax_s_actuators_give_what_is_needed_to_carry_the_body_and_a_load() -> None:
    """At rest on the ground the vertical force is the weight of all bodies, less a pull upwards."""
    still = replace(MOTION, speeds=0 * MOTION.speeds, accelerations=0 * MOTION.accelerations)
    frames, vertical = len(still.time), BARE.coordinate_index("ground_thorax_ty")
    weight = 9.80665 * sum(body.mass for body in BARE.bodies)
    assert abs(inverse_dynamics(BARE, still)[:, vertical] - weight).max() < 1e-9
    up = np.tile([0.0, 50.0, 0.0], (frames, 1))
    pull = ExternalForce("pull", BARE.body_index("hand"), 0, up, 0 * up, BARE.body_index("hand"), 0 * up)
    assert abs(inverse_dynamics(BARE, still, [pull])[:, vertical] - (weight - 50.0)).max() < 1e-9


def test_forces_of_actuators_are_by_coordinate() -> None:
    reserves = np.arange(float(len(MOTION.time) * len(BARE.actuators))).reshape(len(MOTION.time), -1)
    found = actuator_forces(BARE, MOTION, reserves)
    for index, actuator in enumerate(BARE.actuators):
        np.testing.assert_array_equal(found[:, actuator.coordinate], reserves[:, index])


def test_forces_of_actuators_on_bodies_have_the_power_of_their_loads(tmp_path: Path) -> None:
    """Force by the velocity of its point, from finite differences, and moment by the angular velocity of its body."""
    model, rng = read_osim(step_in(tmp_path).model), np.random.default_rng(5)
    foot, point = model.body_index("foot"), np.array([0.02, -0.05, 0.01])
    force, axis = np.array([0.0, 0.6, 0.8]), np.array([1.0, 0.0, 0.0])
    push = PointActuator(
        name="push", optimal_force=20.0, body=foot, point=point, direction=force, is_direction_in_ground=True
    )
    turn = TorqueActuator(name="turn", optimal_force=5.0, body_a=foot, body_b=model.body_index("thigh"), axis=axis)
    model, values = replace(model, actuators=(push, turn)), np.array([30.0, -4.0])
    q, u = rng.uniform(-0.5, 0.5, (2, 6, len(model.coordinates)))
    kinematics = Kinematics(np.arange(6.0), 1.0, q, u, 0 * u, None)
    forces = actuator_forces(model, kinematics, np.tile(values, (6, 1)))
    ahead, behind = (points_in_ground(postures(model, q + h * u, u), foot, point) for h in (1e-5, -1e-5))
    turning = postures(model, q, u).angular_velocity
    power = 30.0 * (ahead - behind) / 2e-5 @ force - 4.0 * (turning[:, foot] - turning[:, turn.body_b]) @ axis
    assert np.abs(power).max() > 1.0
    np.testing.assert_allclose((forces * u).sum(axis=1), power, atol=1e-6)


def test_the_cone_is_that_of_the_published_markers():
    assert np.degrees(CONE.half_angle) == pytest.approx(19.033794314488, abs=1e-9)
    toward_glenoid = np.array([-0.01995036627856, -0.00364826527646, -0.02767297723668])
    np.testing.assert_allclose(CONE.axis, toward_glenoid / np.linalg.norm(toward_glenoid), atol=1e-9)
    assert BARE.bodies[CONE.body].name == "scapula"


def test_a_force_meets_the_rows_exactly_where_its_angle_is_within_the_cone():
    generator = np.random.default_rng(0)
    rotations = rotation_body_fixed_xyz(generator.uniform(-1, 1, (500, 3)))
    forces = 100 * (2 * rotations @ CONE.axis + generator.normal(size=(500, 3)))
    rays = np.einsum("fij,fj->fi", cone_rows(CONE, rotations), forces)
    is_inside = rays[:, 0] >= np.linalg.norm(rays[:, 1:], axis=1)
    np.testing.assert_array_equal(is_inside, angle_between(rotations @ CONE.axis, forces) <= CONE.half_angle)
    assert 0.1 < is_inside.mean() < 0.9


def test_a_force_away_from_the_glenoid_is_outside_though_on_the_axis():
    rotation = np.eye(3)[None]
    assert angle_between(rotation @ CONE.axis, -CONE.axis[None])[0] == pytest.approx(np.pi)
    assert (cone_rows(CONE, rotation) @ -CONE.axis)[0, 0] < 0


def test_an_elliptic_rim_goes_through_the_edge_marker_and_is_narrower_across():
    cone = glenoid_cone(BARE, aspect=0.75)
    rows = cone_rows(cone, np.eye(3)[None])[0]
    slope = np.tan(cone.half_angle)
    along, across = cone.edge, np.cross(cone.axis, cone.edge)
    for direction, width in ((along, 1.0), (-along, 1.0), (across, 0.75), (-across, 0.75)):
        ray = rows @ (cone.axis + width * slope * direction)
        assert ray[0] == pytest.approx(np.hypot(ray[1], ray[2]))


MOVED = tuple(
    replace(marker, location=marker.location + 0.01) if marker.name == "HumHead_Center" else marker
    for marker in BARE.markers
)


@pytest.mark.parametrize(
    ("model", "aspect", "code", "naming"),
    [
        (BARE, 0.0, SolverCode.WRONG_GLENOID, ""),
        (replace(BARE, markers=MOVED), 1.0, SolverCode.WRONG_GLENOID, "HumHead_Center"),
        (replace(BARE, markers=()), 1.0, SolverCode.UNKNOWN_NAME, "Glenoid_Center"),
    ],
    ids=["rim without width", "marker that makes no cone", "no markers"],
)
def test_a_model_without_a_cone_is_refused(model, aspect, code, naming):
    with raises_refusal(code, naming):
        glenoid_cone(model, aspect=aspect)


def test_a_reaction_meets_the_plane_where_its_line_through_the_head_does():
    rotation = rotation_body_fixed_xyz([[0.3, -0.2, 0.5]])
    along, across = CONE.edge, np.cross(CONE.axis, CONE.edge)
    force = 700 * rotation[0] @ (CONE.distance * CONE.axis + 0.004 * along - 0.003 * across)
    np.testing.assert_allclose(contact_points(CONE, rotation, force[None]), [[0.004, -0.003]], atol=1e-12)
    assert np.isnan(contact_points(CONE, rotation, -force[None])).all()


def test_the_rim_is_as_far_from_the_centre_as_the_edge_marker_is_seen_from_the_head():
    center, edge = (BARE.marker(name).location for name in ("Glenoid_Center", "Glenoid_Edge"))
    head = BARE.joint("GlenoHumeral").frame_in_parent.translation
    ray = (edge - head) * CONE.distance / ((edge - head) @ CONE.axis)
    assert np.linalg.norm(head + ray - center) == pytest.approx(CONE.rim[0])
    assert glenoid_cone(BARE, aspect=0.8).rim == pytest.approx((CONE.rim[0], 0.8 * CONE.rim[0]))


@pytest.mark.parametrize("seed", range(5))
def test_the_figures_are_those_of_scipy_over_the_known_frames(seed: int) -> None:
    generator = np.random.default_rng(seed)
    reference = generator.uniform(100, 900, 80)
    predicted = reference + generator.normal(30, 60, 80)
    gaps = generator.choice(80, 7, replace=False)
    with_gaps = predicted.copy()
    with_gaps[gaps] = np.nan
    found = force_agreement(with_gaps, reference)
    ours, theirs = np.delete(predicted, gaps), np.delete(reference, gaps)
    assert found.correlation == pytest.approx(stats.pearsonr(ours, theirs).statistic, abs=1e-12)
    assert found.rmse == pytest.approx(stats.tmean((ours - theirs) ** 2) ** 0.5, rel=1e-12)
    assert found.peak_ratio == max(ours) / max(theirs)


def test_a_constant_force_has_no_correlation_and_a_lost_one_no_figures() -> None:
    rising = np.arange(5.0)
    assert np.isnan(force_agreement(np.ones(5), rising).correlation)
    assert np.isnan(force_agreement(np.full(5, np.nan), rising).rmse)


def test_angles_are_those_of_the_cosine() -> None:
    generator = np.random.default_rng(0)
    first, second = generator.normal(size=(2, 50, 3))
    cosine = (first * second).sum(axis=1) / (np.linalg.norm(first, axis=1) * np.linalg.norm(second, axis=1))
    np.testing.assert_allclose(angle_between(first, second), np.arccos(cosine), atol=1e-12)


def test_the_glenoids_axes_are_right_handed_and_a_compressive_force_is_medial() -> None:
    cone = glenoid_cone(BARE)
    axes = glenoid_axes(cone.axis, cone.edge)
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    np.testing.assert_allclose(axes @ cone.axis, [0, 0, -1], atol=1e-12)
    up_in_scapula = axes[1]
    assert up_in_scapula[1] > 0.5, "the scapula's y axis points up"


@pytest.mark.parametrize("tangent", [0.34, 0.5, 1.2])
def test_a_rim_of_a_given_tangent_leaves_axis_and_direction_of_the_edge(tangent: float) -> None:
    before, after = glenoid_cone(BARE), glenoid_cone(with_rim(BARE, tangent))
    assert np.tan(after.half_angle) == pytest.approx(tangent, rel=1e-12)
    np.testing.assert_allclose(after.axis, before.axis, atol=1e-12)
    np.testing.assert_allclose(after.edge, before.edge, atol=1e-12)

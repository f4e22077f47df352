"""Variants of the joint force: the published one as solved by the command, optimal penalties, held-out errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.joint_force import CONES, CORRECTIONS, corrected_subsets, drawn_variants, held_out_errors, with_changes
from benchmarks.joint_force_posture import POSTURES, triad, twist
from benchmarks.joint_force_transfer import RULES, Predictions, choose_best, weight_equally
from benchmarks.joint_force_variants import ContactVariant, Lift, tilted, with_masses, with_penalty
from solver.bundled import bundled_model
from solver.motion import differentiate
from solver.personalisation.tendons import fit_tendons
from solver.raise_arm import simulate_arm_raise
from solver.redundancy.glenoid import angle_to_axis, glenoid_cone
from solver.redundancy.mechanics import evaluate_motion
from solver.redundancy.motion import solve_motion
from solver.redundancy.options import RedundancyOptions
from solver.redundancy.problem import build_redundancy
from solver.redundancy.scenarios import solve_redundancy
from solver.scaling_findings import muscle_ranges
from station.validation.variants import PUBLISHED_VARIANTS
from tests.conftest import SHARED

MODEL = bundled_model()


@pytest.mark.shared
def test_the_published_variant_is_that_of_the_command() -> None:
    lift = Lift(SHARED / "subject", "S8R_back")
    assert [part.start for part in lift.repeats] == [0, 170, lift.repeats[1].stop]
    model, options = PUBLISHED_VARIANTS[1].applied(lift.model)
    motion = lift.posed_motion(POSTURES["as published"])
    solution = solve_motion(model, differentiate(motion), options)
    expected = np.linalg.norm(solution.reaction[:, 3:], axis=1)
    np.testing.assert_allclose(lift.predicted(ContactVariant()), expected, rtol=1e-6)


@pytest.mark.parametrize("weight", [0.1, 10.0])
def test_a_penalised_force_meets_the_optimality_conditions_of_the_whole_objective(weight: float) -> None:
    """Gradient of Σ w x² + weight Σ (d·F)² along the null space of A, computed without the further controls."""
    kinematics = differentiate(simulate_arm_raise(MODEL), None, 0.5, 0.56)
    options = RedundancyOptions(has_glenoid_cone=False, unweighted_coordinates=())
    plain = build_redundancy(MODEL, evaluate_motion(MODEL, kinematics), options)
    problem = replace(plain, interval=1e6)  # no activation dynamics: frames are independent
    frames, controls = len(problem.time), len(problem.weights)
    directions = np.tile(np.eye(3)[:2], (frames, 1, 1))
    solution = solve_redundancy(with_penalty(problem, directions, weight))
    muscles = len(MODEL.muscles)
    for frame in range(frames):
        x = solution.controls[0, frame, :controls]
        rows = 1e-3 * directions[frame]
        force = problem.reaction_at_rest[frame, 3:] + problem.reaction_matrix[frame, 3:] @ x
        gradient = 2 * problem.weights * x + 2 * weight * problem.reaction_matrix[frame, 3:].T @ rows.T @ (rows @ force)
        is_low = np.arange(controls) < muscles
        is_low &= x < 1e-7
        is_free = ~is_low & ~((np.arange(controls) < muscles) & (x > 1 - 1e-7))
        A = problem.acceleration_matrix[frame]
        multipliers = np.linalg.lstsq(A[:, is_free].T, gradient[is_free], rcond=1e-10)[0]
        rest = gradient - A.T @ multipliers
        np.testing.assert_allclose(rest[is_free], 0.0, atol=1e-5)
        assert rest[is_low].min(initial=0.0) > -1e-5


def test_masses_of_the_arm_are_those_of_the_body_mass_and_the_load_stays() -> None:
    loaded = replace(MODEL, bodies=tuple(replace(b, mass=b.mass + 2.4 * (b.name == "hand")) for b in MODEL.bodies))
    mass = {b.name: b.mass for b in with_masses(loaded, ContactVariant(arm_masses="own", held=0.2), 80.0).bodies}
    arm = mass["humerus"] + mass["ulna"] + mass["radius"] + mass["hand"] - 2.6
    assert arm == pytest.approx(80.0 * 0.049, rel=0.05)  # de Leva (1996), men: 2.71, 1.62 and 0.61 %
    hand = {b.name: b for b in with_masses(loaded, ContactVariant(grip=0.035), 80.0).bodies}["hand"]
    before = next(b for b in loaded.bodies if b.name == "hand")
    expected = before.mass * before.mass_center + 2.4 * np.array([0.0, -0.035, 0.0])
    np.testing.assert_allclose(hand.mass * hand.mass_center, expected, atol=1e-12)
    assert mass["scapula"] == next(b.mass for b in MODEL.bodies if b.name == "scapula")


@pytest.mark.parametrize(("up", "forward"), [(10.0, 0.0), (0.0, -10.0), (-20.0, 0.0)])
def test_a_tilted_cone_has_its_axis_at_that_angle(up: float, forward: float) -> None:
    cone = glenoid_cone(MODEL)
    turned = tilted(cone, up, forward)
    angle = angle_to_axis(cone, np.eye(3)[None], turned.axis[None])[0]
    assert np.degrees(angle) == pytest.approx(abs(up + forward), rel=1e-9)
    assert turned.axis @ turned.edge == pytest.approx(0.0, abs=1e-12)


def test_fitted_tendons_keep_the_fibres_in_a_given_range() -> None:
    motion = simulate_arm_raise(MODEL).coordinates[::10]
    fitted, changes = fit_tendons(MODEL, [motion], (0.7, 1.2))
    found = muscle_ranges(fitted, motion)
    assert changes
    for change in changes:
        place = MODEL.muscle_names.index(change.muscle)
        width = found.longest[place] - found.shortest[place]
        low, high = (0.7, 1.2) if width <= 0.5 else (0.95 - width / 2, 0.95 + width / 2)
        if fitted.muscles[place].tendon_slack_length > 0:
            assert found.shortest[place] > low - 0.02
            assert found.longest[place] < high + 0.02


def test_held_out_errors_are_those_of_a_search_by_hand() -> None:
    errors = np.random.default_rng(3).uniform(5, 60, (40, 6))
    group = np.array([0, 1, 2, 0, 1, 2])
    found = held_out_errors(errors, group)
    for place in range(6):
        seen = [column for column in range(6) if group[column] != group[place]]
        best = min(range(40), key=lambda row: sum(errors[row, column] for column in seen))
        assert found[place] == errors[best, place]


def test_a_seed_draws_the_same_variants() -> None:
    assert drawn_variants(20, 4) == drawn_variants(20, 4) != drawn_variants(20, 5)
    assert len(set(drawn_variants(100, 4))) > 90


@pytest.mark.shared
def test_rules_see_only_the_other_lift() -> None:
    """Chosen by hand: the variant that is best in one lift predicts the other; equal weights give the mean force."""
    lifts = [Lift(SHARED / "subject", name) for name in ("S8R_side", "S8R_back")]
    generator = np.random.default_rng(2)
    variants = list(corrected_subsets())[:12]
    forces = [lift.measured + generator.normal(0, 200, (12, 1)) + 0 * lift.measured for lift in lifts]
    errors = np.array([np.concatenate([lifts[k].errors_of(forces[k][v]) for k in (0, 1)]) for v in range(12)])
    found = Predictions(lifts, variants, forces, errors)
    side, back = errors[:, :3].mean(axis=1).argmin(), errors[:, 3:].mean(axis=1).argmin()
    expected = np.concatenate([errors[back, :3], errors[side, 3:]])
    np.testing.assert_allclose(found.transferred_errors(choose_best), expected, rtol=1e-12)
    means = [lift.errors_of(force.mean(axis=0)) for lift, force in zip(lifts, forces, strict=True)]
    np.testing.assert_allclose(found.transferred_errors(weight_equally), np.concatenate(means), rtol=1e-9)
    assert -1.0 <= found.bias_correlation() <= 1.0


@pytest.mark.parametrize("name", RULES)
def test_a_rule_gives_weight_to_the_variant_without_error(name: str) -> None:
    errors = np.vstack([np.full((19, 3), 60.0) + np.arange(3), np.arange(3) * 1e-3])
    changes = np.arange(20.0)[::-1]
    weights = RULES[name](errors, changes)
    assert weights.min() >= 0
    assert weights[19] == weights.max() > 0
    if RULES[name] is not weight_equally:
        assert weights[19] > 0.999 * weights.sum()


def test_subsets_are_all_bodies_with_all_cones() -> None:
    found = corrected_subsets()
    assert len(set(found)) == len(found) == len(CONES) * 2 ** len(CORRECTIONS)
    assert with_changes(CORRECTIONS.values()) in found
    assert ContactVariant() in found


@pytest.mark.parametrize("angle", [-170.0, -30.0, 0.0, 45.0, 120.0])
def test_the_twist_is_the_turn_about_the_axis_that_a_swing_does_not_change(angle: float) -> None:
    from scipy.spatial.transform import Rotation

    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    across = np.cross(axis, [0.0, 0.0, 1.0])
    swing = Rotation.from_rotvec(0.9 * across / np.linalg.norm(across))
    turned = swing * Rotation.from_rotvec(np.radians(angle) * axis)
    assert np.degrees(twist(turned.as_matrix(), axis)) == pytest.approx(angle, abs=1e-9)


def test_a_triad_is_a_rotation_whose_first_axis_is_the_line() -> None:
    points = np.random.default_rng(1).normal(size=(3, 7, 3))
    axes = triad(*points)
    np.testing.assert_allclose(axes.swapaxes(1, 2) @ axes, np.tile(np.eye(3), (7, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(axes), 1.0)
    line = points[1] - points[0]
    np.testing.assert_allclose((axes[..., 0] * line).sum(axis=-1), np.linalg.norm(line, axis=-1))

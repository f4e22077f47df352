"""The smoother of a wearer's motion, on persons with a known truth whose simulation shares no code with it."""

from collections.abc import Sequence
from functools import cache

import numpy as np
import pytest

from solver.inverse_kinematics.solve import Array, InverseKinematics, solve_inverse_kinematics
from solver.personalisation.estimate import BodyEstimate, estimate_body, within_ranges
from solver.personalisation.normal_equations import linearise_constraints
from solver.personalisation.wearer_motion import WearerMotion, smooth_wearer
from solver.scaling import scale_skeleton
from tests.solver.personalisation.measured_person import MARKERS, MeasuredPerson, measure_person
from tests.solver.personalisation.simulated_person import MODEL

TRACKED = tuple(MODEL.marker(name) for name in MARKERS)
NORMAL_95 = 1.96
RAISED = MODEL.coordinate_index("shoulder_elv")


def solve(body: BodyEstimate, trials: Sequence[Array]) -> list[tuple[Array, InverseKinematics]]:
    model, tasks = within_ranges(body.model, body.tasks)
    return [(observed, solve_inverse_kinematics(model, observed, tasks)) for observed in trials]


@cache
def smoothed(seed: int) -> tuple[MeasuredPerson, BodyEstimate, WearerMotion]:
    person = measure_person(seed)
    body = estimate_body(MODEL, TRACKED, person.trials)
    solved = solve(body, person.trials)
    return person, body, smooth_wearer(MODEL, TRACKED, body, solved, solved[-1][1].coordinates)


def places(person: MeasuredPerson) -> list[int]:
    return [MODEL.coordinate_index(name) for name in person.shoulder.coordinate_names]


@pytest.mark.slow
def test_a_person_who_was_measured_is_never_known_worse_than_one_without_markers() -> None:
    """Without: the same postures, of which one marker is seen in one frame."""
    person, body, motion = smoothed(0)
    solved = solve(body, person.trials)
    hidden = [(np.full_like(observed, np.nan), postures) for observed, postures in solved]
    hidden[-1][0][0, 0] = solved[-1][0][0, 0]
    without = smooth_wearer(MODEL, TRACKED, body, hidden, solved[-1][1].coordinates)
    assert motion.is_converged and without.is_converged
    known, unknown = motion.standard_deviation, without.standard_deviation
    assert (known <= unknown + 1e-12).all()
    moved = places(person)
    assert (known[:, moved].mean(axis=0) < 0.8 * unknown[:, moved].mean(axis=0)).all()
    girdle = [MODEL.coordinate_index(name) for name in motion.body.priors.girdle]
    assert (unknown[:, girdle] < np.radians(20.0)).all(), "anatomy says something without any marker"


@pytest.mark.parametrize("seed", [0, pytest.param(2, marks=pytest.mark.slow)])
def test_the_truth_lies_within_the_spread_of_the_draws(seed: int) -> None:
    """Person 2 begins with an elevation of 10 degrees, where the elbow's axis reversed fits the markers as well."""
    person, _, motion = smoothed(seed)
    away = motion.coordinates[:, places(person)] - person.coordinates[-1]
    spread = motion.standard_deviation[:, places(person)]
    assert np.sqrt(np.mean((away / spread) ** 2)) < 2.0
    assert motion.coordinates[:, RAISED].min() > 0.0


@pytest.mark.parametrize("trial", [1, 2])
def test_the_prior_of_the_rhythm_takes_error_from_the_elevation_of_the_arm_in_every_trial(trial: int) -> None:
    person, body, motion = smoothed(0)
    truth = person.coordinates[trial][:, person.shoulder.index("shoulder_elv")]
    found = motion.postures(solve(body, person.trials)[trial][1].coordinates)
    alone = body.postures[trial].coordinates
    errors = [np.sqrt(np.mean((one[:, RAISED] - truth) ** 2)) for one in (found, alone)]
    assert errors[0] < 0.7 * errors[1]


def test_postures_of_the_wanted_trial_are_the_wanted_coordinates() -> None:
    person, body, motion = smoothed(0)
    found = motion.postures(solve(body, person.trials)[-1][1].coordinates)
    np.testing.assert_allclose(found, motion.coordinates, atol=1e-9)


def test_draws_have_the_stated_spread_stay_in_range_keep_the_joints_together_and_are_smooth() -> None:
    _, _, motion = smoothed(0)
    drawn = list(motion.draw(200, seed=3))
    coordinates = np.array([one for _, one in drawn])
    ranges = np.array([one.range if one.motion == "rotation" else (-np.inf, np.inf) for one in MODEL.coordinates])
    lowest, highest = ranges.T
    assert ((coordinates >= lowest) & (coordinates <= highest)).all()
    spread, stated = coordinates.std(axis=0), motion.standard_deviation
    moved = [MODEL.coordinate_index(name) for name in ("scapula_upward_rot", "scapula_winging", "axial_rot")]
    np.testing.assert_allclose(spread[:, moved].mean(axis=0), stated[:, moved].mean(axis=0), rtol=0.25)
    for scaling, one in drawn[:5]:
        gap, _ = linearise_constraints(scale_skeleton(motion.skeleton, scaling), one)
        assert np.abs(gap).max() < 1e-3
    away = (coordinates - motion.coordinates)[:, :, moved]
    steps = np.diff(away, axis=1).std(axis=0) / away.std(axis=0)[1:]
    assert steps.max() < 0.5, "white errors would step by √2 standard deviations"
    assert np.ptp([scaling.factors["humerus"][0] for scaling, _ in drawn]) > 0.05


def test_a_coordinate_that_no_marker_moves_keeps_its_value_and_a_hidden_marker_does_not_count() -> None:
    person, body, motion = smoothed(0)
    elbow = MODEL.coordinate_index("elbow_flexion")
    assert motion.standard_deviation[:, elbow].max() < 1e-5
    assert np.ptp(motion.coordinates[:, elbow]) < 1e-6
    hidden = [observed.copy() for observed in person.trials]
    for observed in hidden:
        observed[:, MARKERS.index("EpM")] = np.nan
    solved = solve(body, hidden)
    fewer = smooth_wearer(MODEL, TRACKED, body, solved, solved[-1][1].coordinates)
    turned = MODEL.coordinate_index("axial_rot")
    assert fewer.standard_deviation[:, turned].mean() > 1.1 * motion.standard_deviation[:, turned].mean()


def test_a_motion_that_is_recorded_twice_is_hardly_known_better() -> None:
    """Skin slides by the same amount in the same posture."""
    person, body, motion = smoothed(0)
    solved = solve(body, person.trials)
    twice = smooth_wearer(MODEL, TRACKED, body, [*solved, solved[-1]], solved[-1][1].coordinates)
    angles = [MODEL.coordinate_index(name) for name in ("scapula_upward_rot", "shoulder_elv", "axial_rot")]
    ratio = twice.standard_deviation[:, angles].mean() / motion.standard_deviation[:, angles].mean()
    assert 0.9 < ratio < 1.001


def test_the_origin_of_the_laboratory_does_not_matter() -> None:
    person, body, motion = smoothed(0)
    away = np.array([5.0, 0.0, -4.0])
    solved = solve(body, [observed + away for observed in person.trials])
    moved = smooth_wearer(MODEL, TRACKED, body, solved, solved[-1][1].coordinates)
    expected = motion.coordinates.copy()
    expected[:, [MODEL.coordinate_index(f"ground_thorax_t{axis}") for axis in "xyz"]] += away
    np.testing.assert_allclose(moved.coordinates, expected, atol=1e-3)


@pytest.mark.slow
def test_intervals_hold_the_truth_of_sixty_persons() -> None:
    """Of 95 % of the angles, within three standard errors between persons; docs/uncertainty.md has
    more persons, with effort and best rest length."""
    names = smoothed(0)[0].shoulder.coordinate_names
    angles = [k for k, name in enumerate(names) if not name.startswith("ground")]
    held, errors = [], []
    for seed in range(60):
        person, _, motion = smoothed(seed)
        error = (motion.coordinates[:, places(person)] - person.coordinates[-1])[:, angles]
        held.append(np.mean(np.abs(error) < NORMAL_95 * motion.standard_deviation[:, places(person)][:, angles]))
        errors.append(error.mean(axis=0))
    assert abs(np.mean(held) - 0.95) < 3.0 * np.std(held) / np.sqrt(len(held))
    bias, between = np.mean(errors, axis=0), np.std(errors, axis=0) / np.sqrt(len(errors))
    assert (np.abs(bias) < 3.0 * between + np.radians(0.5)).all()

"""A body from markers: simulated persons come back, with standard errors that hold; derivatives are exact.

Masses, tendons and marker errors of a person: published values come back, and nothing else changes.
"""

import xml.etree.ElementTree as Xml
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from solver.errors import ScalingCode, SolverCode
from solver.inverse_kinematics.solve import TrackingTasks, assemble, solve_inverse_kinematics
from solver.model import Marker
from solver.multibody.postures import points_in_ground, postures
from solver.osim.model_reader import read_osim
from solver.osim.model_writer import osim_document
from solver.personalisation.anthropometry import (
    LOG_COVARIANCE,
    SHARED_CORRELATION,
    SIZE_FACTORS,
    body_factors,
    marker_errors,
    population_priors,
    size_factors,
)
from solver.personalisation.estimate import EstimateOutcome, _Problem, effective_frames, estimate_body, within_ranges
from solver.personalisation.normal_equations import linearise_postures, parameter_derivatives
from solver.personalisation.segment_masses import (
    fit_tendons,
    hold_load,
    mass_ratios,
    segment_masses,
    set_arm_masses,
    upper_arm_length,
    usual_masses,
)
from solver.scaling import FIBRE_RANGE, LARGEST_JUMP, Scaling, muscle_ranges, scale_skeleton
from tests.refusals import raises_refusal
from tests.solver.personalisation.measured_person import MARKERS as MEASURED
from tests.solver.personalisation.measured_person import measure_person, scaled_shoulder
from tests.solver.personalisation.simulated_person import MARKERS, MODEL, draw_person
from tests.solver.references import SHARED

PRIORS = population_priors(MODEL, MARKERS)


def test_a_person_whose_skin_hardly_moves_comes_back() -> None:
    """The prior's offsets remain, so a size is known to a few percent and no better; what is reported says so."""
    person = draw_person(3, scatter=0.1)
    body = estimate_body(MODEL, MARKERS, person.trials)
    assert body.outcome is EstimateOutcome.CONVERGED
    away = (np.log(body.factors) - np.log(person.factors)) / (body.factor_errors / body.factors)
    assert np.abs(away).max() < 3.0
    prior = np.sqrt(np.diag(PRIORS.covariance))
    assert (body.factor_errors / body.factors < prior).all()
    residual = np.concatenate([solution.residuals for solution in body.postures])
    assert float(np.sqrt(np.mean(residual**2))) < 0.005
    marker = body.tasks.markers[0]
    np.testing.assert_allclose(marker.location, MARKERS[0].location * body.factors[:3] + body.offsets[0], atol=1e-12)


@pytest.mark.slow
def test_standard_errors_hold_for_twenty_persons() -> None:
    """Squares of errors over standard errors have mean 1 (a chi-square over 20 × 7 and 20 × 36 values, correlated)."""
    sizes, places = [], []
    for seed in range(20):
        person = draw_person(100 + seed)
        body = estimate_body(MODEL, MARKERS, person.trials)
        assert body.outcome is EstimateOutcome.CONVERGED
        sizes.append((np.log(body.factors) - np.log(person.factors)) / (body.factor_errors / body.factors))
        places.append(((body.offsets - person.offsets) / body.offset_errors).ravel())
    assert 0.6 < np.mean(np.square(sizes)) < 1.5
    assert 0.6 < np.mean(np.square(places)) < 1.5


@pytest.mark.parametrize("seed", [5, 8])
def test_a_hanging_arm_is_solved_within_the_ranges_of_its_joints(seed: int) -> None:
    """The simulation of the person shares no code with the estimate. At a small elevation, a negative one with the
    plane turned by 180 degrees is nearly the same posture; without the ranges the elevation is wrong by 100 degrees.
    """
    person = measure_person(seed, hanging_deg=8.0)
    estimate = estimate_body(MODEL, [MODEL.marker(name) for name in MEASURED], person.trials)
    elevation = MODEL.coordinate_index("shoulder_elv")
    truth = person.coordinates[-1][:, person.shoulder.index("shoulder_elv")]
    assert estimate.postures[-1].coordinates[:, elevation].min() < np.radians(-80.0)
    model, tasks = within_ranges(estimate.model, estimate.tasks)
    found = solve_inverse_kinematics(model, person.trials[-1], tasks)
    assert found.unsolved == 0
    assert np.degrees(np.sqrt(np.mean((found.coordinates[:, elevation] - truth) ** 2))) < 6.0
    assert "elbow_flexion" not in tasks.coordinate_weights, "no marker moves it: it keeps its value"


def test_an_angle_whose_range_is_a_single_value_has_no_prior() -> None:
    fixed = [replace(one, range=(0.3, 0.3)) if one.name == "axial_rot" else one for one in MODEL.coordinates]
    given = TrackingTasks(tuple(MODEL.marker(name) for name in MEASURED), np.full(len(MEASURED), 1e4), {}, {})
    model, tasks = within_ranges(replace(MODEL, coordinates=tuple(fixed)), given)
    assert "axial_rot" not in tasks.coordinate_weights and "shoulder_elv" in tasks.coordinate_weights
    assert not model.coordinates[model.coordinate_index("axial_rot")].is_clamped


def test_the_bones_of_the_independent_person_are_those_of_the_scaled_model() -> None:
    """Two derivations of the published bones, scaled to another size, in one posture."""
    sizes = {"thorax": [1.1, 0.95, 1.05], "clavicle": [1.08] * 3, "scapula": [0.93] * 3, "humerus": [1.06] * 3}
    factors = {segment: np.array(size) for segment, size in sizes.items()}
    shoulder, model = scaled_shoulder(factors), scale_skeleton(MODEL, Scaling(factors))
    at = MODEL.default_coordinates[None]
    own = at[:, [MODEL.coordinate_index(name) for name in shoulder.coordinate_names]]
    state = postures(model, at, np.zeros_like(at))
    for name in MEASURED:
        marker = model.marker(name)
        expected = points_in_ground(state, marker.body, marker.location)
        np.testing.assert_allclose(shoulder.places(own, [shoulder.markers[name]])[:, 0], expected, atol=1e-6)


def test_the_reduced_gradient_is_that_of_the_cost_with_postures_solved_again() -> None:
    person = draw_person(5)
    hidden = person.trials[0].copy()
    hidden[3:9, 2] = np.nan  # a marker that is hidden in some frames
    problem = _Problem(MODEL, MARKERS, (hidden, person.trials[1]), PRIORS, np.array([5.0, 3.0]))
    sizes = np.repeat([0.1, 0.01, 0.1], [len(PRIORS.factors), 3 * len(MARKERS), len(PRIORS.girdle)])
    at = 0.3 * sizes * np.random.default_rng(1).standard_normal(problem.parameters)
    state = problem.solve(at)
    _, gradient = problem.normal_equations(state)
    step = 1e-5
    for k in (0, 2, 4, 5, len(PRIORS.factors), len(PRIORS.factors) + 16, len(at) - 2):
        along = step * (np.arange(len(at)) == k)
        above, below = (problem.solve(at + side, state).cost for side in (along, -along))
        assert gradient[k] == pytest.approx((above - below) / (2 * step), rel=1e-4, abs=1e-2)


def test_marker_jacobians_are_the_derivatives_of_the_markers() -> None:
    problem = _Problem(MODEL, MARKERS, (), PRIORS, np.zeros(0))
    tasks = problem.body(np.zeros(problem.parameters))[1]
    at = MODEL.default_coordinates + np.random.default_rng(2).uniform(-0.3, 0.3, (3, len(MODEL.coordinates)))
    found = linearise_postures(MODEL, tasks, at)
    step = 1e-6
    for k in range(at.shape[1]):
        along = step * (np.arange(at.shape[1]) == k)
        above, below = (_points(at + side) for side in (along, -along))
        np.testing.assert_allclose(found.jacobian[..., k], (above - below) / (2 * step), atol=1e-8)


def test_places_and_gaps_are_differentiated_by_every_size_and_offset_of_a_body_of_other_sizes() -> None:
    problem = _Problem(MODEL, MARKERS, (), PRIORS, np.zeros(0))
    chance, count = np.random.default_rng(3), len(PRIORS.factors)
    parameters = 0.1 * chance.standard_normal(problem.parameters)
    at = MODEL.default_coordinates + chance.uniform(-0.3, 0.3, (3, len(MODEL.coordinates)))
    points, gaps = parameter_derivatives(problem.body, parameters, at, count)
    step = 1e-5
    for k in range(count + 3 * len(MARKERS)):
        along = step * (np.arange(len(parameters)) == k)
        above, below = (linearise_postures(*problem.body(parameters + side), at) for side in (along, -along))
        np.testing.assert_allclose(points[..., k], (above.points - below.points) / (2 * step), atol=1e-9)
        np.testing.assert_allclose(gaps[..., k], (above.gap - below.gap) / (2 * step), atol=1e-9)
    assert np.abs(gaps[..., :count]).max() > 1e-3


def _points(coordinates: np.ndarray) -> np.ndarray:
    state = postures(MODEL, coordinates, np.zeros_like(coordinates))
    rotation, origin = state.rotation_to_ground, state.origin_in_ground
    return np.stack([origin[:, m.body] + rotation[:, m.body] @ m.location for m in MARKERS], axis=1)


def test_a_pose_is_one_observation_and_a_motion_is_as_many_as_it_decorrelates() -> None:
    chance = np.random.default_rng(3)
    pose = np.tile(chance.uniform(-0.3, 0.3, (1, 4, 3)), (200, 1, 1)) + 1e-4 * chance.standard_normal((200, 4, 3))
    assert effective_frames(pose, 0.01) == pytest.approx(1.0, abs=0.05)
    white = 0.3 * chance.standard_normal((200, 4, 3))
    assert effective_frames(white, 0.01) == pytest.approx(200.0, rel=0.15)
    slow = np.repeat(0.3 * chance.standard_normal((20, 4, 3)), 10, axis=0)  # each posture held for ten frames
    assert effective_frames(slow, 0.01) == pytest.approx(20.0, rel=0.3)


def test_trials_that_do_not_fit_are_refused() -> None:
    with raises_refusal(SolverCode.WRONG_SHAPE):
        estimate_body(MODEL, MARKERS, [np.zeros((5, 2, 3))])
    with raises_refusal(SolverCode.MARKERS_DO_NOT_FIT, naming="trial 1"):
        estimate_body(MODEL, MARKERS, [np.full((5, len(MARKERS), 3), np.nan)])


def test_sizes_of_the_population_are_a_covariance_of_known_coefficients_of_variation() -> None:
    """Published for men (Gordon et al. 2014): chest depth 10.4 %, acromion-radiale 5.2 %; both sexes vary more."""
    assert np.linalg.eigvalsh(LOG_COVARIANCE).min() > 0
    deviations = dict(zip([factor.name for factor in SIZE_FACTORS], np.sqrt(np.diag(LOG_COVARIANCE)), strict=True))
    assert deviations["thorax depth"] == pytest.approx(0.108, abs=0.001)
    assert deviations["upper arm"] == pytest.approx(0.065, abs=0.001)
    factors, covariance = size_factors(MODEL)
    ratio = covariance / (2.0 * LOG_COVARIANCE)
    np.testing.assert_allclose(ratio, np.where(np.eye(len(factors)) > 0.0, 1.0, SHARED_CORRELATION))
    deviation = np.sqrt(np.diag(covariance))
    clavicle, scapula = (k for k, one in enumerate(factors) if one.name in ("clavicle", "scapula"))
    correlation = covariance[clavicle, scapula] / (deviation[clavicle] * deviation[scapula])
    assert 0.56 * 0.6 < correlation < 0.79, "between stature alone in common and dimensions that overlap"
    by_body = body_factors(factors, np.arange(1.0, 8.0))
    np.testing.assert_array_equal(by_body["thorax"], [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(by_body["hand"], [7.0, 7.0, 7.0])
    with raises_refusal(SolverCode.UNKNOWN_NAME):
        size_factors(replace(MODEL, bodies=tuple(replace(body, name=f"b{k}") for k, body in enumerate(MODEL.bodies))))


def test_skin_slides_by_what_was_measured_in_upright_ct() -> None:
    """The three landmarks of the generic thoracoscapular model [m]."""
    places = {"aa": (-0.0448, 0.0035, 0.0172), "ts": (-0.0922, -0.0025, -0.1059), "ai": (-0.1154, -0.1164, -0.091)}
    scapula, thorax = MODEL.body_index("scapula"), MODEL.body_index("thorax")
    markers = [Marker(name, scapula, np.array(place)) for name, place in places.items()]
    errors = marker_errors(MODEL, [*markers, Marker("ij", thorax, np.zeros(3))])
    slide = 6.0 * np.sqrt(errors.scatter**2 - errors.scatter[3] ** 2)
    np.testing.assert_allclose(slide[:3], [0.0304, 0.0531, 0.0700], atol=0.002)
    assert errors.scatter[3] == pytest.approx(errors.offset[3])
    drawn = np.random.default_rng(1).standard_normal((4000, 3))
    medians = np.median(np.linalg.norm(drawn, axis=1)) * errors.slide[:3]
    np.testing.assert_allclose(medians, [0.0304, 0.0531, 0.0700], rtol=0.07)


def test_the_arm_has_the_masses_of_de_leva_and_the_trunk_stays() -> None:
    person = set_arm_masses(MODEL, 80.0)
    masses = segment_masses(person)
    assert masses["upper arm"] == pytest.approx(80 * 0.0263)
    assert masses["forearm"] == pytest.approx(80 * 0.0150)
    assert masses["hand"] == pytest.approx(80 * 0.00585)
    ulna, radius = (MODEL.body_index(name) for name in ("ulna", "radius"))
    ratio = [model.bodies[ulna].mass / model.bodies[radius].mass for model in (MODEL, person)]
    assert ratio[0] == pytest.approx(ratio[1])
    for body in ("thorax", "clavicle", "scapula"):
        assert person.bodies[MODEL.body_index(body)].mass == MODEL.bodies[MODEL.body_index(body)].mass


def test_a_load_is_a_body_of_its_own_that_opensim_files_keep(tmp_path: Path) -> None:
    """Its place moves with the hand; masses of the person are set again without touching it."""
    holding = hold_load(MODEL, 2.4)
    assert set_arm_masses(holding, 80.0).bodies[-1].mass == 2.4
    Xml.ElementTree(osim_document(holding)).write(tmp_path / "holding.osim")
    back = read_osim(tmp_path / "holding.osim")
    at = assemble(back)[None]
    state = postures(back, at, np.zeros_like(at))
    hand = back.bodies[back.body_index("hand")]
    grip = points_in_ground(state, back.body_index("hand"), hand.mass_center)
    np.testing.assert_allclose(points_in_ground(state, back.body_index("held_load"), np.zeros(3)), grip, atol=1e-12)
    with raises_refusal(SolverCode.LOAD_PRESENT):
        hold_load(holding, 1.0)


@pytest.mark.shared
def test_a_dumb_bell_inside_the_hand_of_a_published_model_is_found() -> None:
    """2.4 kg of the 2.87 kg; the model without the dumb-bell has no such ratio."""
    ratios = mass_ratios(read_osim(SHARED / "subject" / "generic.osim"))
    assert ratios["hand"] == pytest.approx(6.85, abs=0.05)
    assert mass_ratios(MODEL) == {}


def test_a_models_mass_is_no_persons() -> None:
    length = upper_arm_length(MODEL)
    assert 0.24 < length < 0.26
    lowest, highest = usual_masses(length)
    assert sum(body.mass for body in MODEL.bodies) / 2 < lowest < 45.0
    assert 90.0 < highest < 200.0


def test_tendons_bring_fibres_into_their_range_and_leave_the_others() -> None:
    """Arm to the back: a posterior deltoid that is too short for it becomes long enough, by its tendon alone."""
    motion = np.tile(assemble(MODEL), (8, 1))
    motion[:, MODEL.coordinate_index("plane_elv")] = np.linspace(-0.5, -1.1, 8)
    motion[:, MODEL.coordinate_index("shoulder_elv")] = np.linspace(0.3, 0.8, 8)
    fitted, changes = fit_tendons(MODEL, [motion])
    assert changes
    ranges = muscle_ranges(fitted, motion)
    assert ranges.shortest.min() > FIBRE_RANGE[0] - 1e-9
    assert ranges.longest.max() < FIBRE_RANGE[1] + 1e-9
    changed = {change.muscle for change in changes}
    for old, new in zip(MODEL.muscles, fitted.muscles, strict=True):
        assert (old is new) == (old.name not in changed)
        assert old.optimal_fiber_length == new.optimal_fiber_length


def test_a_muscle_whose_path_jumps_keeps_its_tendon() -> None:
    motion = np.tile(assemble(MODEL), (8, 1))
    motion[:, MODEL.coordinate_index("plane_elv")] = np.linspace(-0.5, -1.1, 8)
    motion[4:, MODEL.coordinate_index("shoulder_elv")] += 0.9
    jumps = muscle_ranges(MODEL, motion).jump > LARGEST_JUMP
    assert jumps.any()
    changed = {change.muscle for change in fit_tendons(MODEL, [motion])[1]}
    assert not changed & {name for name, jumped in zip(MODEL.muscle_names, jumps, strict=True) if jumped}


def test_a_path_that_jumps_and_a_fibre_that_is_pulled_are_findings() -> None:
    motion = np.tile(assemble(MODEL), (9, 1))
    motion[:, MODEL.coordinate_index("shoulder_elv")] = np.linspace(0.3, 0.5, 9)
    assert {finding.code for finding in muscle_ranges(MODEL, motion).findings} <= {ScalingCode.FIBRE_LENGTH_IN_MOTION}
    torn = motion.copy()
    torn[4:, MODEL.coordinate_index("shoulder_elv")] += 0.6
    assert ScalingCode.PATH_JUMP in {finding.code for finding in muscle_ranges(MODEL, torn).findings}
    short = tuple(replace(each, tendon_slack_length=0.8 * each.tendon_slack_length) for each in MODEL.muscles)
    codes = {finding.code for finding in muscle_ranges(replace(MODEL, muscles=short), motion).findings}
    assert codes == {ScalingCode.FIBRE_LENGTH_IN_MOTION, ScalingCode.PASSIVE_FORCE}

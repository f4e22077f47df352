"""What a path does to the bodies: speeds against lengths, forces against equilibrium and against lengths."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from solver.bundled import bundled_model
from solver.errors import SolverCode
from solver.functions.coordinate_functions import polynomial
from solver.model import GROUND, ConditionalPathPoint, MovingPathPoint, Path, PathWrap, Placement
from solver.multibody.postures import jacobians, postures, speeds_from_rates
from solver.muscle import evaluate_paths
from tests.refusals import raises_refusal
from tests.solver.wrapping.laid import point

Array = NDArray[np.float64]

MODEL = bundled_model()
RANDOM = np.random.default_rng(5)
Q = MODEL.default_coordinates + 0.2 * RANDOM.normal(size=(8, len(MODEL.coordinates)))
RATES = RANDOM.normal(size=Q.shape)
STATE = postures(MODEL, Q, speeds_from_rates(MODEL, Q, RATES))
STEP = 1e-6

HAND, THORAX, HUMERUS = (MODEL.body_index(name) for name in ("hand", "thorax", "humerus"))
CORD = Path((point(GROUND, (0.1, 0.2, 0.3)), point(THORAX, (0.0, -0.1, 0.2)), point(HAND, (0.0, -0.05, 0.0))), ())


def _mover(body: int, coordinate: int, limits: tuple[float, float]) -> MovingPathPoint:
    lines = (polynomial([0.0, 0.02]), polynomial([0.1, -0.03, 0.02]), polynomial([0.0, 0.01]))
    return MovingPathPoint(body, Placement(np.eye(3), np.zeros(3)), coordinate, lines, limits)


def _lengths(coordinates: Array, paths: list[Path]) -> Array:
    return evaluate_paths(MODEL, postures(MODEL, coordinates, np.zeros_like(coordinates)), paths).lengths


def test_there_are_no_geodesics_over_a_torus() -> None:
    torus = replace(MODEL.surfaces[0], kind="torus", dimensions=np.array([0.01, 0.05, 0.0]))
    model = replace(MODEL, surfaces=(torus, *MODEL.surfaces[1:]))
    path = replace(CORD, wraps=(PathWrap(0, "hybrid"),))
    assert np.isfinite(evaluate_paths(model, STATE, [path]).lengths).all()
    with raises_refusal(SolverCode.UNSUPPORTED):
        evaluate_paths(model, STATE, [path], mode="geodesic")


def test_without_other_paths_those_of_the_muscles_are_evaluated() -> None:
    muscles = evaluate_paths(MODEL, STATE)
    one = evaluate_paths(MODEL, STATE, [MODEL.muscles[7].path])
    assert muscles.lengths.shape == (len(Q), len(MODEL.muscles))
    assert np.array_equal(one.lengths[:, 0], muscles.lengths[:, 7])
    assert np.array_equal(one.wrench_per_tension[:, 0], muscles.wrench_per_tension[:, 7])


def test_frames_do_not_know_of_one_another() -> None:
    backwards = postures(MODEL, Q[::-1], STATE.speeds[::-1])
    assert np.array_equal(evaluate_paths(MODEL, backwards).lengths[::-1], evaluate_paths(MODEL, STATE).lengths)


def test_no_paths_and_no_frames_are_fine() -> None:
    assert evaluate_paths(MODEL, STATE, []).lengths.shape == (len(Q), 0)
    no_frames = postures(MODEL, Q[:0], Q[:0])
    assert evaluate_paths(MODEL, no_frames).wrench_per_tension.shape == (0, len(MODEL.muscles), len(MODEL.bodies), 6)


def test_speed_is_the_rate_of_the_length() -> None:
    rate = (_lengths(Q + STEP * RATES, [CORD]) - _lengths(Q - STEP * RATES, [CORD])) / (2 * STEP)
    assert np.allclose(evaluate_paths(MODEL, STATE, [CORD]).speeds, rate, atol=1e-8)


def test_a_moving_point_moves_with_its_coordinate_and_stops_at_the_end_of_its_range() -> None:
    elevation = MODEL.coordinate_index("shoulder_elv")
    mover = _mover(THORAX, elevation, (-0.5, 2.0))
    path = Path((mover, point(HUMERUS, (0.0, -0.1, 0.0))), ())
    state = evaluate_paths(MODEL, STATE, [path])
    rate = (_lengths(Q + STEP * RATES, [path]) - _lengths(Q - STEP * RATES, [path])) / (2 * STEP)
    assert np.allclose(state.speeds, rate, atol=1e-8)

    beyond, at_the_end = Q.copy(), Q.copy()
    beyond[:, elevation], at_the_end[:, elevation] = 2.4, 2.0
    thorax = Path((mover, point(THORAX, (0.0, 0.0, 0.0))), ())
    assert np.array_equal(_lengths(beyond, [thorax]), _lengths(at_the_end, [thorax]))


def test_a_conditional_point_is_passed_only_within_its_range() -> None:
    elevation = MODEL.coordinate_index("shoulder_elv")
    start, end = point(THORAX, (0.0, 0.0, 0.0)), point(THORAX, (0.2, 0.0, 0.0))
    detour = ConditionalPathPoint(THORAX, np.array([0.1, 0.1, 0.0]), elevation, (0.5, 1.0))
    raised = np.tile(Q[:1], (4, 1))
    raised[:, elevation] = 0.4, 0.5 - 5e-6, 0.7, 1.1
    lengths = _lengths(raised, [Path((start, detour, end), ())])[:, 0]
    assert np.allclose(lengths, [0.2, 0.02**0.5 * 2, 0.02**0.5 * 2, 0.2], atol=1e-14)


def test_generalised_forces_are_minus_the_derivative_of_the_length() -> None:
    elevation = MODEL.coordinate_index("shoulder_elv")
    mover = _mover(THORAX, elevation, (-9.0, 9.0))
    paths = [CORD, Path((mover, point(HUMERUS, (0.0, -0.1, 0.0))), ())]
    state = evaluate_paths(MODEL, STATE, paths)
    forces = np.einsum("fpbi,fbij->fpj", state.wrench_per_tension, jacobians(MODEL, STATE)) + state.mobility_per_tension
    assert np.allclose(np.einsum("fpj,fj->fp", forces, STATE.speeds), -state.speeds, atol=1e-12)


def test_a_path_pulls_the_bodies_together_in_equilibrium() -> None:
    total = evaluate_paths(MODEL, STATE).wrench_per_tension.sum(axis=2)
    straight = [k for k, muscle in enumerate(MODEL.muscles) if not muscle.path.wraps]
    assert np.abs(total[..., 3:]).max() < 1e-14
    assert np.abs(total[:, straight]).max() < 1e-14


def test_points_on_one_body_pull_on_nothing() -> None:
    within = Path((point(HAND, (0.0, 0.0, 0.0)), point(HAND, (0.1, 0.0, 0.0))), ())
    state = evaluate_paths(MODEL, STATE, [within])
    assert state.lengths == pytest.approx(0.1)
    assert not state.wrench_per_tension.any()
    assert np.abs(state.speeds).max() < 1e-15


def test_a_path_that_does_not_fit_the_model_is_refused() -> None:
    beginning, nowhere = point(GROUND, (0.0, 0.0, 0.0)), point(99, (0.0, 0.0, 0.0))
    stranger = _mover(GROUND, 99, (0.0, 1.0))
    for path, naming in (
        (Path((beginning,), ()), "1 point"),
        (Path((beginning, nowhere), ()), "body 99"),
        (Path((beginning, stranger), ()), "coordinate 99"),
        (Path((beginning, beginning), (PathWrap(99, "hybrid"),)), "surface 99"),
    ):
        with raises_refusal(SolverCode.WRONG_PATH, naming):
            evaluate_paths(MODEL, STATE, [path])


def test_results_are_read_only() -> None:
    state = evaluate_paths(MODEL, STATE, [CORD])
    with pytest.raises(ValueError, match="read-only"):
        state.lengths[0, 0] = 0.0

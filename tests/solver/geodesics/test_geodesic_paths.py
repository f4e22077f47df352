"""Paths pulled taut over the surfaces of a person: forces and speeds are derivatives of lengths, and nothing jumps."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from solver.bundled import bundled_model
from solver.functions.coordinate_functions import polynomial
from solver.model import Model, MovingPathPoint, Path, Placement
from solver.motion import decimate, differentiate, read_motion
from solver.multibody.postures import jacobians, postures, rates_of_coordinates, speeds_from_rates
from solver.muscle import muscle_forces
from solver.osim.model_reader import read_osim
from solver.paths import evaluate_paths
from solver.raise_arm import simulate_arm_raise
from solver.redundancy.mechanics import evaluate_motion
from solver.redundancy.motion_solution import solve_motion
from solver.redundancy.redundancy_options import RedundancyOptions
from solver.suit.scenarios import LoadedMotion, prepare_suited_motion
from solver.suit.suit import BUNDLED_SUIT, read_suit
from tests.solver.references import NO_WEIGHT, SHARED, TWO_KILOGRAM_WEIGHT
from tests.solver.wrapping.laid import point

Array = NDArray[np.float64]

MODEL = bundled_model()
RANDOM = np.random.default_rng(3)
STEP = 1e-6


def _lengths(model: Model, coordinates: Array, paths: list[Path] | None = None) -> Array:
    return evaluate_paths(model, postures(model, coordinates, np.zeros_like(coordinates)), paths, "geodesic").lengths


def _random_coordinates(model: Model, frames: int) -> Array:
    coordinates: Array = model.default_coordinates + 0.2 * RANDOM.normal(size=(frames, len(model.coordinates)))
    return coordinates


def _mismatch(model: Model, coordinates: Array, paths: list[Path] | None = None) -> Array:
    """(frames, paths) max |Q + dL/dq|, Q being the generalised forces of a unit tension, by central differences."""
    state = postures(model, coordinates, np.zeros_like(coordinates))
    laid = evaluate_paths(model, state, paths, "geodesic")
    forces = np.einsum("fpbi,fbij->fpj", laid.wrench_per_tension, jacobians(model, state)) + laid.mobility_per_tension
    slopes = np.empty_like(forces)
    for k, step in enumerate(STEP * np.eye(coordinates.shape[1])):
        ahead, back = _lengths(model, coordinates + step, paths), _lengths(model, coordinates - step, paths)
        slopes[..., k] = (ahead - back) / (2 * STEP)
    rates, _ = rates_of_coordinates(model, state)
    mismatch: Array = np.abs(forces + slopes @ rates).max(axis=-1)
    return mismatch


def test_forces_are_the_derivative_of_lengths_for_every_muscle() -> None:
    assert _mismatch(MODEL, _random_coordinates(MODEL, 40)).max() < 1e-8


@pytest.mark.shared
@pytest.mark.parametrize("file", [NO_WEIGHT, TWO_KILOGRAM_WEIGHT])
def test_forces_are_the_derivative_of_lengths_for_every_muscle_of_the_published_models(file) -> None:  # type: ignore[no-untyped-def]
    model = read_osim(file)
    assert _mismatch(model, _random_coordinates(model, 40)).max() < 1e-8


@pytest.mark.shared
@pytest.mark.parametrize("motion", ["FLX01", "ABD02", "SHRUG01"])
def test_forces_are_the_derivative_of_lengths_throughout_the_published_motions(motion: str) -> None:
    model = read_osim(NO_WEIGHT)
    moved = differentiate(read_motion(SHARED / "motions" / f"{motion}.mot", model)).positions
    assert _mismatch(model, moved[::25]).max() < 1e-8


def test_a_moving_point_pulls_at_its_coordinate_also_within_one_body_and_stops_at_the_end_of_its_range() -> None:
    elevation, thorax = MODEL.coordinate_index("shoulder_elv"), MODEL.body_index("thorax")
    lines = (polynomial([0.0, 0.02]), polynomial([0.1, -0.03, 0.02]), polynomial([0.0, 0.01]))
    mover = MovingPathPoint(thorax, Placement(np.eye(3), np.zeros(3)), elevation, lines, (-0.5, 1.0))
    path = Path((point(thorax, (0.0, 0.3, 0.0)), mover, point(thorax, (0.2, 0.0, 0.1))), ())
    coordinates = _random_coordinates(MODEL, 4)
    coordinates[:, elevation] = -0.7, 0.2, 0.8, 1.4
    assert _mismatch(MODEL, coordinates, [path]).max() < 1e-8


def test_speeds_are_the_work_of_the_forces() -> None:
    coordinates = _random_coordinates(MODEL, 40)
    speeds = speeds_from_rates(MODEL, coordinates, RANDOM.normal(size=coordinates.shape))
    state = postures(MODEL, coordinates, speeds)
    laid = evaluate_paths(MODEL, state, mode="geodesic")
    forces = np.einsum("fpbi,fbij->fpj", laid.wrench_per_tension, jacobians(MODEL, state)) + laid.mobility_per_tension
    assert np.allclose(laid.speeds, -np.einsum("fpj,fj->fp", forces, speeds), rtol=0, atol=1e-12)


def test_a_path_pulls_the_bodies_together_in_equilibrium() -> None:
    """Moments too: where the path runs over a surface it is in equilibrium with the surface's body."""
    coordinates = _random_coordinates(MODEL, 40)
    laid = evaluate_paths(MODEL, postures(MODEL, coordinates, np.zeros_like(coordinates)), mode="geodesic")
    assert np.abs(laid.wrench_per_tension.sum(axis=2)).max() < 1e-12


def test_raising_the_arm_in_tiny_steps_no_length_jumps_and_no_moment_arm_either() -> None:
    """Every length changes by what its slopes at both ends say, to the third order, through each touch and lift-off."""
    kinematics = differentiate(simulate_arm_raise(MODEL))
    nodes = kinematics.positions[:: max(len(kinematics.positions) // 12, 1)]
    sweep = np.concatenate([np.linspace(a, b, 100, endpoint=False) for a, b in pairwise(nodes)])
    steps = np.diff(sweep, axis=0)
    before = evaluate_paths(
        MODEL, postures(MODEL, sweep[:-1], speeds_from_rates(MODEL, sweep[:-1], steps)), mode="geodesic"
    )
    behind = evaluate_paths(
        MODEL, postures(MODEL, sweep[1:], speeds_from_rates(MODEL, sweep[1:], steps)), mode="geodesic"
    )
    change = behind.lengths - before.lengths
    straight = evaluate_paths(MODEL, postures(MODEL, sweep, np.zeros_like(sweep)), _without_surfaces(MODEL)).lengths
    touches = np.diff(_lengths(MODEL, sweep) > straight + 1e-12, axis=0).sum()
    assert touches >= 5
    assert np.abs(change - (before.speeds + behind.speeds) / 2).max() < 1e-7


def test_frames_are_independent_and_other_paths_may_be_evaluated() -> None:
    coordinates = _random_coordinates(MODEL, 6)
    forwards, order = _lengths(MODEL, coordinates), RANDOM.permutation(6)
    assert np.array_equal(forwards[order], _lengths(MODEL, coordinates[order]))
    assert np.array_equal(forwards, np.concatenate([_lengths(MODEL, frame[None]) for frame in coordinates]))
    infraspinatus = MODEL.muscle_names.index("Infraspinatus_I")
    one = _lengths(MODEL, coordinates, [MODEL.muscles[infraspinatus].path])
    assert np.array_equal(one[:, 0], forwards[:, infraspinatus])
    assert _lengths(MODEL, coordinates, []).shape == (6, 0)
    assert _lengths(MODEL, coordinates[:0]).shape == (0, len(MODEL.muscles))


def test_it_lays_most_paths_as_opensim_does() -> None:
    """But for paths over two surfaces, where OpenSim mixes two iterations, by millimetres (docs/paths.md)."""
    moved = differentiate(simulate_arm_raise(MODEL)).positions[::20]
    opensim_paths = evaluate_paths(MODEL, postures(MODEL, moved, np.zeros_like(moved))).lengths
    one_surface = [k for k, muscle in enumerate(MODEL.muscles) if len(muscle.path.wraps) < 2]
    difference = np.abs(_lengths(MODEL, moved) - opensim_paths)
    assert difference[:, one_surface].max() < 2e-3
    assert np.median(difference) < 1e-6


def test_the_redundancy_problem_is_posed_on_the_paths_that_are_asked_for() -> None:
    kinematics = decimate(differentiate(simulate_arm_raise(MODEL)), 150)
    lengths = _lengths(MODEL, kinematics.positions)
    state = postures(MODEL, kinematics.positions, kinematics.speeds)
    passive = muscle_forces(MODEL, lengths, evaluate_paths(MODEL, state, mode="geodesic").speeds).passive
    solved = solve_motion(MODEL, kinematics, RedundancyOptions(path_mode="geodesic"))
    assert np.array_equal(solved.passive_forces, passive)
    assert solved.unsolved == 0
    suit = read_suit(BUNDLED_SUIT)
    geodesic, opensim_paths = (
        prepare_suited_motion(LoadedMotion(MODEL, kinematics, options=RedundancyOptions(path_mode=mode)), suit)
        for mode in ("geodesic", "opensim")
    )
    bare = evaluate_motion(MODEL, kinematics, path_mode="geodesic")
    assert np.array_equal(geodesic.bare_problem.acceleration_matrix, bare.maps.acceleration_per_control)
    assert not np.array_equal(geodesic.problem.acceleration_matrix, opensim_paths.problem.acceleration_matrix)


def _without_surfaces(model: Model) -> list[Path]:
    return [Path(muscle.path.points, ()) for muscle in model.muscles]

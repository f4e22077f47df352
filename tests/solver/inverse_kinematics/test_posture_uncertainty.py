"""Uncertainty of postures against solving again with every observation moved.

Motions drawn from the uncertainty of the markers, against the covariance that the linearised optimum gives.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from recordings.exchange.trc import read_trc
from solver.bundled import bundled_model
from solver.inverse_kinematics.solve import (
    TrackingTasks,
    estimate_marker_noise,
    posture_uncertainty,
    solve_inverse_kinematics,
)
from solver.model import CoordinateLock, Model
from solver.osim.model_reader import read_osim
from solver.osim.tool_setups import read_ik_setup
from tests.solver.inverse_kinematics.marked import tasks_of, with_markers
from tests.solver.inverse_kinematics.test_solve import noisy
from tests.solver.linkage import linkage
from tests.solver.references import SHARED

SUBJECT = SHARED / "subject"
NOISE = 1e-3
MODEL = with_markers(bundled_model())
TASKS = tasks_of(MODEL)


def locked_linkage() -> Model:
    model = linkage()
    return replace(model, constraints=(CoordinateLock("lock", 9, 0.1),))


@pytest.mark.parametrize("make", [bundled_model, linkage, locked_linkage])
def test_covariance_is_that_of_solving_again_with_each_marker_moved(make: Callable[[], Model]) -> None:
    """At residuals of centimetres, where Gauss–Newton's figure is wrong."""
    model = with_markers(make(), each=2)
    tasks = tasks_of(model)
    _, observed = noisy(with_markers(make(), each=2), 1, 0.06)
    solution = solve_inverse_kinematics(model, observed, tasks)
    noise = np.random.default_rng(3).uniform(0.5e-3, 2e-3, len(model.markers))
    stated = posture_uncertainty(model, observed, tasks, solution, noise)
    step, covariance = 1e-5, np.zeros_like(stated.covariance[0])
    for marker, axis in np.ndindex(observed.shape[1:]):
        ends = []
        for side in (-step, step):
            moved = observed.copy()
            moved[0, marker, axis] += side
            ends.append(solve_inverse_kinematics(model, moved, tasks, solution.coordinates[0]).coordinates[0])
        slope = (ends[1] - ends[0]) / (2 * step)
        covariance += noise[marker] ** 2 * np.outer(slope, slope)
    scale = np.sqrt(np.diag(covariance)).max()
    np.testing.assert_allclose(stated.covariance[0], covariance, atol=1e-5 * scale**2)
    assert stated.is_held.all()


def test_it_does_not_change_when_all_weights_are_scaled() -> None:
    model = with_markers(bundled_model())
    tasks = tasks_of(model)
    _, observed = noisy(model, 1, 0.02)
    figures = []
    for factor in (1.0, 50.0):
        scaled = replace(tasks, weights=factor * tasks.weights)
        solution = solve_inverse_kinematics(model, observed, scaled)
        figures.append(posture_uncertainty(model, observed, scaled, solution, 1e-3).standard_deviation)
    np.testing.assert_allclose(figures[0], figures[1], rtol=1e-8)


def test_a_coordinate_without_markers_is_not_held_and_a_hidden_frame_has_no_figures() -> None:
    model = with_markers(bundled_model())
    tip = {model.body_index(name) for name in ("hand", "radius")}
    markers = tuple(marker for marker in model.markers if marker.body not in tip)
    model = replace(model, markers=markers)
    tasks = TrackingTasks(markers, np.ones(len(markers)))
    _, observed = noisy(model, 2, 0.01)
    observed[1] = np.nan
    solution = solve_inverse_kinematics(model, observed, tasks)
    stated = posture_uncertainty(model, observed, tasks, solution, 1e-3)
    loose = [name for name, held in zip(model.coordinate_names, stated.is_held[0], strict=True) if not held]
    assert loose == ["pro_sup"]
    assert np.isinf(stated.standard_deviation[0, model.coordinate_index("pro_sup")])
    assert np.isnan(stated.covariance[1]).all()


def test_a_clamped_coordinate_that_no_marker_moves_is_not_held_where_it_stands_at_its_bound() -> None:
    model = with_markers(bundled_model())
    unseen = model.coordinate_index("pro_sup")
    lowest = model.default_coordinates[unseen]
    clamped = replace(model.coordinates[unseen], range=(lowest, lowest + 1.0), is_clamped=True)
    tip = {model.body_index(name) for name in ("hand", "radius")}
    markers = tuple(marker for marker in model.markers if marker.body not in tip)
    coordinates = (*model.coordinates[:unseen], clamped, *model.coordinates[unseen + 1 :])
    model = replace(model, markers=markers, coordinates=coordinates)
    tasks = TrackingTasks(markers, np.ones(len(markers)))
    _, observed = noisy(model, 1, 0.01)
    solution = solve_inverse_kinematics(model, observed, tasks)
    assert solution.coordinates[0, unseen] == lowest
    assert not posture_uncertainty(model, observed, tasks, solution, 1e-3).is_held[0, unseen]


@pytest.mark.shared
@pytest.mark.parametrize("lift", ["side", "back"])
def test_standard_deviations_of_a_patients_lift_are_those_of_four_thousand_draws(lift: str) -> None:
    """Residuals of 23 and 27 mm; coordinates are locked, clamped, and one is at its bound."""
    model = read_osim(SUBJECT / f"S8R_{lift}_as_solved.osim")
    setup = read_ik_setup(SUBJECT / f"S8R_{lift}_ik_setup.xml")
    table = read_trc(SUBJECT / f"S8R_{lift}.trc", tracked=setup.markers)
    tasks = setup.tasks(model, table.labels, table.time_s)
    observed = 1e-3 * table.positions[150:151, [table.labels.index(marker.name) for marker in tasks.markers]]
    solution = solve_inverse_kinematics(model, observed, tasks)
    stated = posture_uncertainty(model, observed, tasks, solution, 1e-3)
    away = 1e-3 * np.random.default_rng(1).standard_normal((4000, *observed.shape[1:]))
    drawn = solve_inverse_kinematics(model, observed + away, tasks, solution.coordinates[0])
    assert drawn.unsolved == 0
    spread = drawn.coordinates.std(axis=0)
    free = stated.is_held[0] & (spread > 1e-9)
    assert free.sum() == {"side": 14, "back": 16}[lift]
    np.testing.assert_allclose(stated.standard_deviation[0, free], spread[free], rtol=0.05)


def test_marker_noise_is_found_beneath_motion_and_gaps() -> None:
    observed, noise = moving_markers()
    np.testing.assert_allclose(estimate_marker_noise(observed, 0.01), noise, rtol=0.06)
    assert np.isnan(estimate_marker_noise(np.full((60, 1, 3), np.nan), 0.01)).all()
    assert np.isnan(estimate_marker_noise(np.zeros((10, 1, 3)), 0.01)).all()


def test_a_marker_that_jumps_for_a_while_keeps_its_noise() -> None:
    observed, noise = moving_markers()
    observed[900:920, 1] += 0.6
    np.testing.assert_allclose(estimate_marker_noise(observed, 0.01), noise, rtol=0.15)


def test_marker_noise_is_found_in_a_file_that_was_filtered_at_20_hz() -> None:
    """What neighbouring frames show of it is a tenth."""
    observed, noise = moving_markers()
    filtered = sosfiltfilt(butter(2, 20.0, fs=100.0, output="sos"), np.nan_to_num(observed[450:]), axis=0)
    np.testing.assert_allclose(estimate_marker_noise(filtered, 0.01), noise, rtol=0.45)
    third = np.diff(filtered, n=3, axis=0).std(axis=(0, 2)) / np.sqrt(20.0)
    assert (third < 0.35 * noise).all()


def moving_markers() -> tuple[np.ndarray, np.ndarray]:
    """Two markers at 100 Hz, the first hidden for a second, and their noise [m]."""
    chance = np.random.default_rng(4)
    time = np.arange(0, 20, 0.01)
    noise = np.array([0.2e-3, 1e-3])
    motion = 0.3 * np.sin(2 * np.pi * 0.8 * time)[:, None, None]
    observed = motion + noise[:, None] * chance.standard_normal((len(time), 2, 3))
    observed[300:400, 0] = np.nan
    return observed, noise

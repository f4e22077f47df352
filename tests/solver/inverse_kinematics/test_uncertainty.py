"""Uncertainty of postures against solving again with every observation moved."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from solver.bundled import bundled_model
from solver.inverse_kinematics.solve import TrackingTasks, solve_inverse_kinematics
from solver.inverse_kinematics.uncertainty import estimate_marker_noise, posture_uncertainty
from solver.model import CoordinateLock, Model
from tests.solver.inverse_kinematics.marked import tasks_of, with_markers
from tests.solver.inverse_kinematics.test_solve import noisy
from tests.solver.linkage import linkage


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


def test_marker_noise_is_found_beneath_motion_and_gaps() -> None:
    chance = np.random.default_rng(4)
    time = np.arange(0, 20, 0.01)
    noise = np.array([0.2e-3, 1e-3])
    motion = 0.3 * np.sin(2 * np.pi * 0.8 * time)[:, None, None]
    observed = motion + noise[:, None] * chance.standard_normal((len(time), 2, 3))
    observed[300:400, 0] = np.nan
    np.testing.assert_allclose(estimate_marker_noise(observed), noise, rtol=0.05)
    assert np.isnan(estimate_marker_noise(np.full((10, 1, 3), np.nan))).all()

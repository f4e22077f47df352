from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from solver.bundled import bundled_model
from solver.functions.muscle_curves import ThelenCurves
from solver.model import Model
from solver.muscle import muscle_forces

MODEL = bundled_model()


def _with_pennation(pennation: float, steepest: float = MODEL.muscles[0].maximum_pennation) -> Model:
    muscle = replace(
        MODEL.muscles[0],
        max_isometric_force=100.0,
        optimal_fiber_length=0.1,
        tendon_slack_length=0.2,
        pennation_at_optimal=pennation,
        maximum_pennation=steepest,
    )
    return replace(MODEL, muscles=(muscle,))


def test_an_isometric_muscle_at_optimal_length_pulls_its_full_force() -> None:
    forces = muscle_forces(_with_pennation(0.0), np.array([[0.3]]), np.zeros((1, 1)))
    assert forces.active[0, 0] == pytest.approx(100.0, rel=1e-14)
    assert forces.passive[0, 0] == pytest.approx(0.0, abs=1e-12)


def test_a_pennate_muscle_pulls_along_its_tendon() -> None:
    pennation = 0.4
    length = np.array([[0.2 + 0.1 * np.cos(pennation)]])
    forces = muscle_forces(_with_pennation(pennation), length, np.zeros((1, 1)))
    assert forces.active[0, 0] == pytest.approx(100.0 * np.cos(pennation), rel=1e-13)


def test_a_muscle_shorter_than_its_tendon_is_slack_and_keeps_its_shortest_fibre() -> None:
    for pennation in (0.0, 0.3):
        forces = muscle_forces(_with_pennation(pennation), np.array([[0.1]]), np.array([[-0.5]]))
        assert forces.active[0, 0] == pytest.approx(0.0, abs=1e-12)


def test_a_slack_muscle_whose_shortest_fibre_still_pulls_has_its_isometric_force_at_any_speed() -> None:
    """At a pennation of at most 0.7, the fibre is never shorter than 0.1 m sin(0.4) / sin(0.7) = 0.060 m."""
    model = _with_pennation(0.4, steepest=0.7)
    slack = muscle_forces(model, np.full((3, 1), 0.1), np.array([[-0.5], [0.0], [0.5]])).active[:, 0]
    taut = muscle_forces(model, np.array([[0.2 + 0.1 * np.sin(0.4) / np.tan(0.7)]]), np.zeros((1, 1))).active[0, 0]
    assert slack.tolist() == pytest.approx([taut] * 3, rel=1e-13)
    assert taut > 10.0


def test_a_lengthening_muscle_pulls_harder_than_a_shortening_one() -> None:
    length = np.full((3, 1), 0.3)
    forces = muscle_forces(_with_pennation(0.0), length, np.array([[-0.2], [0.0], [0.2]]))
    assert forces.active[0] < forces.active[1] < forces.active[2]


def test_a_muscle_of_thelen_below_its_shortest_fibre_is_idle() -> None:
    thelen = replace(_with_pennation(0.4).muscles[0], curves=ThelenCurves())
    model = replace(MODEL, muscles=(thelen,))
    forces = muscle_forces(model, np.array([[0.15], [0.3]]), np.zeros((2, 1)))
    assert forces.active[0, 0] == 0.0
    assert forces.active[1, 0] > 50.0


def test_muscles_with_different_curves_are_in_the_models_order() -> None:
    millard = _with_pennation(0.1).muscles[0]
    thelen = replace(millard, curves=ThelenCurves())
    mixed = replace(MODEL, muscles=(thelen, millard, thelen))
    length, speed = np.full((4, 1), 0.31), np.linspace(-0.3, 0.3, 4)[:, None]
    forces = muscle_forces(mixed, np.tile(length, 3), np.tile(speed, 3))
    for index, muscle in enumerate(mixed.muscles):
        alone = muscle_forces(replace(MODEL, muscles=(muscle,)), length, speed)
        assert np.array_equal(forces.active[:, index], alone.active[:, 0])
        assert np.array_equal(forces.passive[:, index], alone.passive[:, 0])


def test_a_model_without_muscles_has_no_forces() -> None:
    assert muscle_forces(replace(MODEL, muscles=()), np.zeros((3, 0)), np.zeros((3, 0))).active.shape == (3, 0)

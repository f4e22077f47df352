from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from solver.bundled import bundled_model
from solver.curves import MillardCurves
from solver.model import Model
from solver.muscle import muscle_forces

MODEL = bundled_model()
CURVES = MillardCurves(minimum=0.0)


def _with_pennation(pennation: float) -> Model:
    muscle = replace(
        MODEL.muscles[0],
        max_isometric_force=100.0,
        optimal_fiber_length=0.1,
        tendon_slack_length=0.2,
        pennation_at_optimal=pennation,
    )
    return replace(MODEL, muscles=(muscle,))


def test_the_curves_go_through_the_values_of_opensim() -> None:
    lengths = np.array([0.6, 0.8, 0.95, 1.05, 1.3, 1.6])
    active = [
        0.45110187832558,
        0.87067661327986,
        0.99508542776153,
        0.99644099957849,
        0.68403195736869,
        0.26302688371190,
    ]
    assert np.allclose(CURVES.active_force_length(lengths), active, atol=1e-13)
    speeds = np.array([-0.5, -0.1, 0.1, 0.5])
    factors = [0.15808560444170, 0.62521428431297, 1.22515383775386, 1.33113156931448]
    assert np.allclose(CURVES.force_velocity(speeds), factors, atol=2e-13)
    passive = [0.00087743874011, 0.01704483509738, 0.12611118348263, 0.46026150479121, 0.97143048832592]
    assert np.allclose(CURVES.passive_force_length(np.array([1.02, 1.1, 1.3, 1.5, 1.69])), passive, atol=1e-13)


@pytest.mark.parametrize(
    ("curve", "ends", "values", "slopes"),
    [
        (CURVES.active_force_length, (0.4441, 1.8123), (0.0, 0.0), (0.0, 0.0)),
        (CURVES.force_velocity, (-1.0, 1.0), (0.0, 1.4), (0.0, 0.0)),
        (CURVES.passive_force_length, (1.0, 1.7), (0.0, 1.0), (0.0, 20.0 / 7.0)),
    ],
)
def test_beyond_its_ends_a_curve_goes_on_straight(curve, ends, values, slopes) -> None:  # type: ignore[no-untyped-def]
    for end, value, slope, outward in zip(ends, values, slopes, (-0.3, 0.3), strict=True):
        assert np.allclose(curve(np.array([end, end + outward])), [value, value + slope * outward], atol=1e-14)


def test_a_curve_has_no_jump_where_its_corners_meet() -> None:
    x = np.linspace(-1.1, 2.0, 200_001)
    for curve in (CURVES.active_force_length, CURVES.force_velocity, CURVES.passive_force_length):
        assert np.abs(np.diff(curve(x))).max() < 5.01 * (x[1] - x[0])


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
        assert forces.velocity_factor[0, 0] == 1.0
        assert forces.length_factor[0, 0] == pytest.approx(0.0, abs=1e-14)


def test_a_lengthening_muscle_pulls_harder_than_a_shortening_one() -> None:
    length = np.full((3, 1), 0.3)
    forces = muscle_forces(_with_pennation(0.0), length, np.array([[-0.2], [0.0], [0.2]]))
    assert forces.velocity_factor[0] < forces.velocity_factor[1] == 1.0 < forces.velocity_factor[2]

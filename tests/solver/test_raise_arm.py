"""The bundled motion: it closes its joint, is smooth, goes where it says, and muscles alone hold it up."""

import numpy as np
import pytest

from solver.bundled import bundled_model
from solver.errors import SolverCode
from solver.motion import decimate, differentiate
from solver.multibody.constraints import constraint_gaps
from solver.multibody.postures import postures
from solver.raise_arm import simulate_arm_raise
from solver.redundancy.motion_solution import solve_motion
from tests.solver.refusals import raises_refusal

MODEL = bundled_model()


@pytest.fixture(scope="module")
def kinematics():
    return differentiate(simulate_arm_raise(MODEL))


def test_the_arm_goes_from_15_degrees_past_90_and_back():
    motion = simulate_arm_raise(MODEL)
    elevation = np.degrees(motion.coordinates[:, MODEL.coordinate_index("shoulder_elv")])
    assert elevation[[0, -1]] == pytest.approx([15, 15])
    assert elevation.max() == pytest.approx(100)
    rising = elevation[: len(elevation) // 2]
    assert (np.diff(rising) >= 0).all()


def test_the_acromioclavicular_gap_stays_below_a_micrometre_also_after_the_filter(kinematics):
    for coordinates in (simulate_arm_raise(MODEL).coordinates, kinematics.positions):
        gaps = constraint_gaps(MODEL, postures(MODEL, coordinates, np.zeros_like(coordinates)))
        assert np.linalg.norm(gaps, axis=-1).max() < 1e-6


def test_the_scapula_moves_with_the_arm(kinematics):
    upward = np.degrees(np.ptp(kinematics.positions[:, MODEL.coordinate_index("scapula_upward_rot")]))
    assert 30 < upward < 60


def test_accelerations_are_small_and_without_steps(kinematics):
    assert np.abs(kinematics.accelerations).max() < 3  # rad/s²
    assert np.abs(np.diff(kinematics.accelerations, axis=0)).max() < 0.15
    np.testing.assert_allclose(kinematics.accelerations[[0, -1]], 0, atol=1e-3)


def test_no_frame_is_held_up_by_reserve_actuators(kinematics):
    result = solve_motion(MODEL, decimate(kinematics, 20))
    shoulder = [index for index, a in enumerate(MODEL.actuators) if 6 <= a.coordinate <= 14]
    assert len(shoulder) == 9
    assert result.unsolved == 0
    assert np.abs(result.reserves[:, shoulder]).max() < 0.02  # N m; the arm's weight makes some 10 N m


def test_an_assembly_at_its_limit_of_steps_gives_no_motion(monkeypatch):
    monkeypatch.setattr("solver.raise_arm.MOST_STEPS", 1)
    with raises_refusal(SolverCode.OPEN_JOINT):
        simulate_arm_raise(MODEL)

"""The turn from a laboratory's frame to the model's, for a person who faces any direction."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from solver.bundled import bundled_model
from solver.errors import SolverCode
from solver.inverse_kinematics.laboratory_frame import TO_Y_UP, rotation_laboratory_to_ground
from tests.solver.inverse_kinematics.marked import tasks_of, with_markers
from tests.solver.inverse_kinematics.test_solve import noisy
from tests.solver.refusals import raises_refusal

MODEL = with_markers(bundled_model())
MARKERS = tasks_of(MODEL).markers


@pytest.mark.parametrize("vertical", ["x", "y", "z"])
@pytest.mark.parametrize("facing_deg", [0.0, 90.0, 200.0])
def test_up_is_up_and_the_person_faces_as_the_model(vertical: str, facing_deg: float) -> None:
    expected = noisy(MODEL, 1, 0.0)[1]
    spread = expected - expected.mean(axis=1, keepdims=True)
    turn = Rotation.from_euler("y", facing_deg, degrees=True).as_matrix()
    laboratory = spread @ turn.T @ TO_Y_UP[vertical] + 3.0  # rows: the inverse of TO_Y_UP is its transpose
    rotation = rotation_laboratory_to_ground(MODEL, MARKERS, laboratory, vertical)
    up = np.zeros(3)
    up["xyz".index(vertical)] = 1.0
    np.testing.assert_allclose(rotation @ up, [0.0, 1.0, 0.0], atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    back = laboratory @ rotation.T
    np.testing.assert_allclose(back - back.mean(axis=1, keepdims=True), spread, atol=0.1)  # another posture


def test_two_markers_are_too_few() -> None:
    observed = noisy(MODEL, 1, 0.0)[1]
    observed[:, 2:] = np.nan
    with raises_refusal(SolverCode.TOO_FEW_MARKERS, naming="found 2"):
        rotation_laboratory_to_ground(MODEL, MARKERS, observed)

"""The simulated shoulder's kinematics against OpenSim's poses, against SciPy's matrix exponential, and closed."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from drivers.simulators.errors import SimulatorCode
from drivers.simulators.shoulder import SEGMENTS, Screw, published_shoulder
from drivers.simulators.wearer import RaisedPosture
from tests.conftest import SHARED
from tests.refusals import raises_refusal


@pytest.mark.shared
def test_its_segments_are_where_opensim_puts_them() -> None:
    golden = np.load(SHARED / "golden.npz")
    shoulder, names = published_shoulder(), list(golden["coords"])
    coordinates = golden["q"][:, [names.index(name) for name in shoulder.coordinate_names]]
    poses = shoulder.poses(coordinates)
    for segment in SEGMENTS:
        body = list(golden["bodies"]).index(segment)
        np.testing.assert_allclose(poses[segment][:, :3, :3], golden["R"][:, body], atol=1e-12)
        np.testing.assert_allclose(poses[segment][:, :3, 3], golden["p"][:, body], atol=1e-12)


def test_the_exponential_of_a_screw_is_that_of_its_matrix() -> None:
    axis, point = np.array([0.6, 0.0, -0.8]), np.array([0.1, -0.2, 0.3])
    for is_turn in (True, False):
        x, y, z = axis if is_turn else np.zeros(3)
        linear = -np.cross(axis, point) if is_turn else axis
        twist = np.array([[0, -z, y, linear[0]], [z, 0, -x, linear[1]], [-y, x, 0, linear[2]], [0, 0, 0, 0]])
        amounts = np.array([-1.2, 0.0, 0.4])
        found = Screw(0, axis, point, is_turn).exponential(amounts)
        np.testing.assert_allclose(found, [expm(amount * twist) for amount in amounts], atol=1e-12)


def test_the_acromioclavicular_joint_is_closed_all_the_way_up() -> None:
    shoulder = published_shoulder()
    coordinates = RaisedPosture(shoulder)(np.linspace(0.0, 1.0, 97))
    assert np.abs(shoulder.gap(coordinates)).max() < 1e-8
    raised = np.degrees(coordinates[[0, -1], shoulder.index("shoulder_elv")])
    np.testing.assert_allclose(raised, [15.0, 100.0], atol=1e-9)


def test_a_shoulder_that_cannot_be_closed_is_refused() -> None:
    shoulder = published_shoulder()
    apart = np.zeros((1, len(shoulder.coordinate_names)))
    with raises_refusal(SimulatorCode.OPEN_JOINT):
        shoulder.closed(apart, ("plane_elv", "shoulder_elv", "axial_rot"))

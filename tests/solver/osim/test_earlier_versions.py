"""Documents of OpenSim 2 and 3 that OpenSim need not have converted."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from solver.errors import SolverCode
from solver.model import Model
from solver.osim.model_reader import read_osim
from tests.solver.legs import JOINTS, leg
from tests.solver.osim.opensim_3 import opensim_3_document
from tests.solver.refusals import raises_refusal


def read(folder: Path, *exchanged: tuple[str, str]) -> Model:
    document = opensim_3_document()
    for old, new in exchanged:
        assert old in document
        document = document.replace(old, new)
    file = folder / "earlier.osim"
    file.write_text(document, encoding="utf-8")
    return read_osim(file)


def test_bodies_bring_their_joints_and_joints_follow_their_parents(tmp_path: Path) -> None:
    model = read(tmp_path)
    assert [body.name for body in model.bodies] == ["ground", "lower", "upper"]
    assert [(joint.name, joint.parent, joint.child) for joint in model.joints] == [("first", 0, 2), ("second", 2, 1)]
    assert model.coordinate_names == ("a", "b", "c")
    np.testing.assert_array_equal(model.joints[0].frame_in_parent.translation, (0.123457, 0.2, -0.1))
    np.testing.assert_array_equal(np.diag(model.bodies[1].inertia), (0.0212346, 0.015, 0.018))


def test_a_disabled_constraint_is_left_out_and_named(tmp_path: Path) -> None:
    disabled = '<CoordinateCouplerConstraint name="couple"><isDisabled>true'
    model = read(tmp_path, ('<CoordinateCouplerConstraint name="couple"><isDisabled>false', disabled))
    assert len(model.constraints) == len(read(tmp_path).constraints) - 1
    assert model.left_out == ("CoordinateCouplerConstraint couple",)


def test_a_body_without_a_joint_and_a_loop_are_refused(tmp_path: Path) -> None:
    with raises_refusal(SolverCode.MALFORMED, naming="Body lower has 0 joints"):
        read(tmp_path, ('<PinJoint name="second">', "<!--"), ("</PinJoint>", "-->"))
    with raises_refusal(SolverCode.UNSUPPORTED):
        read(tmp_path, ("<parent_body>ground</parent_body>", "<parent_body>lower</parent_body>"))


def test_joints_of_the_same_name_keep_their_own_frames(tmp_path: Path) -> None:
    whole, renamed = read(tmp_path), read(tmp_path, ('<PinJoint name="second">', '<PinJoint name="first">'))
    assert sorted(joint.name for joint in renamed.joints) == ["first", "first_0"]
    for before, after in zip(whole.joints, renamed.joints, strict=True):
        np.testing.assert_array_equal(after.frame_in_child.translation, before.frame_in_child.translation)
        assert (after.parent, after.child) == (before.parent, before.child)


def test_coordinates_of_the_same_name_are_refused(tmp_path: Path) -> None:
    with raises_refusal(SolverCode.UNSUPPORTED, naming="has a coordinate of a name that the model already has: a"):
        read(tmp_path, ('<Coordinate name="c">', '<Coordinate name="a">'))


def test_only_the_joint_that_repeats_a_coordinate_is_named(tmp_path: Path) -> None:
    """The joints of foot, toes and patella come after that of the shank."""
    file = tmp_path / "leg.osim"
    file.write_text(leg().replace("knee_angle", "hip_adduction"), encoding="utf-8")
    with raises_refusal(SolverCode.UNSUPPORTED, naming="the model already has: hip_adduction") as caught:
        read_osim(file)
    assert [child for child in JOINTS if f"{child}_joint" in str(caught.value)] == ["shank"]

"""Documents of OpenSim 2 and 3 that OpenSim need not have converted."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from solver.errors import SolverCode
from solver.model import Model
from solver.osim.document import read_document
from solver.osim.model_reader import read_osim
from solver.osim.tool_setups import read_scale_setup
from tests.refusals import raises_refusal
from tests.solver.legs import JOINTS, leg
from tests.solver.osim.opensim_3 import opensim_3_document


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


# Elements that a document takes from other files, as OpenSim reads them.


LEG = Path("examples/leg/leg.osim")
HEAD = '<?xml version="1.0" encoding="UTF-8"?>\n<OpenSimDocument Version="40000">'


def write(path: Path, content: str) -> Path:
    path.write_text(f"{HEAD}{content}</OpenSimDocument>", encoding="utf-8")
    return path


@pytest.fixture
def divided(tmp_path: Path) -> Path:
    """The example leg, with its forces and the path of one muscle in files of their own."""
    whole = LEG.read_text(encoding="utf-8")
    forces = re.search(r"<ForceSet.*</ForceSet>", whole, re.DOTALL)
    assert forces is not None
    path = re.search(r"<GeometryPath.*?</GeometryPath>", forces[0], re.DOTALL)
    assert path is not None
    write(tmp_path / "path.xml", path[0])
    (tmp_path / "sets").mkdir()
    write(tmp_path / "sets" / "forces.xml", forces[0].replace(path[0], '<GeometryPath file="path.xml"/>'))
    divided = tmp_path / "leg.osim"
    divided.write_text(whole.replace(forces[0], r'<ForceSet file="sets\forces.xml"/>'), encoding="utf-8")
    return divided


def test_a_model_has_the_muscles_of_a_file_that_it_names(divided: Path) -> None:
    ours, whole = read_osim(divided), read_osim(LEG)
    assert ours.muscle_names == whole.muscle_names != ()
    first, expected = ours.muscles[0].path.points[0], whole.muscles[0].path.points[0]
    np.testing.assert_array_equal(first.location, expected.location)


@pytest.mark.oracle
def test_opensim_has_the_same_muscles(divided: Path) -> None:
    divided.write_text(divided.read_text(encoding="utf-8").replace("sets\\", "sets/"), encoding="utf-8")
    opensim = pytest.importorskip("opensim")
    model = opensim.Model(str(divided))
    model.initSystem()
    assert tuple(muscle.getName() for muscle in model.getMuscleList()) == read_osim(divided).muscle_names


def test_measurements_of_scaling_may_be_in_another_file(tmp_path: Path) -> None:
    pair = "<MarkerPairSet><objects><MarkerPair><markers>hip knee</markers></MarkerPair></objects></MarkerPairSet>"
    scale = "<BodyScaleSet><objects><BodyScale name='thigh'><axes>Y</axes></BodyScale></objects></BodyScaleSet>"
    measurement = f"<Measurement name='length'><apply>true</apply>{pair}{scale}</Measurement>"
    write(tmp_path / "lengths.xml", f"<MeasurementSet><objects>{measurement}</objects></MeasurementSet>")
    scaler = "<ModelScaler><apply>true</apply><MeasurementSet file='lengths.xml'/></ModelScaler>"
    setup = read_scale_setup(write(tmp_path / "setup.xml", f"<ScaleTool>{scaler}</ScaleTool>"))
    assert [measurement.pairs for measurement in setup.measurements] == [(("hip", "knee"),)]


@pytest.mark.parametrize(
    ("content", "code"),
    [
        ("<MarkerSet/>", SolverCode.WRONG_DOCUMENT),  # not the element that is looked for
        ("<ForceSet file='forces.xml'/>", SolverCode.MALFORMED),  # itself
        (None, SolverCode.UNREADABLE_FILE),
    ],
)
def test_a_named_file_without_the_element_is_refused(tmp_path: Path, content: str | None, code: SolverCode) -> None:
    if content is not None:
        write(tmp_path / "forces.xml", content)
    model = write(tmp_path / "model.osim", "<Model><ForceSet file='forces.xml'/></Model>")
    with raises_refusal(code, naming="model.osim, line 2" if content is None else ""):
        read_document(model)

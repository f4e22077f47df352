"""Documents of OpenSim 2 and 3 that OpenSim need not have converted."""

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
    path = re.search(r"<GeometryPath.*?</GeometryPath>", forces[0], re.DOTALL)
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


def _body(name: str, joint: str, wrap: str = "") -> str:
    return f"""<Body name="{name}">
<mass>1.3</mass><mass_center>0.02 -0.11 0.03</mass_center>
<inertia_xx>0.0212345678</inertia_xx><inertia_yy>0.015</inertia_yy><inertia_zz>0.018</inertia_zz>
<inertia_xy>0.001</inertia_xy><inertia_xz>-0.002</inertia_xz><inertia_yz>0.0015</inertia_yz>
<Joint>{joint}</Joint><WrapObjectSet><objects>{wrap}</objects></WrapObjectSet></Body>"""


def _placed(parent: str, coordinates: str) -> str:
    return f"""<parent_body>{parent}</parent_body>
<location_in_parent>0.123456789 0.2 -0.1</location_in_parent><orientation_in_parent>0.3 -0.4 0.5</orientation_in_parent>
<location>0.02 0.05 0.01</location><orientation>-0.2 0.1 0.6</orientation>
<CoordinateSet><objects>{coordinates}</objects></CoordinateSet><reverse>false</reverse>"""


def _axis(name: str, axis: str, coordinate: str, function: str) -> str:
    return f"""<TransformAxis name="{name}"><coordinates>{coordinate}</coordinates><axis>{axis}</axis>
<function>{function}</function></TransformAxis>"""


_SPLINE = "<NaturalCubicSpline><x>-1.123456789 0 0.5 1.5</x><y>0.01 0.0212345678 0.04 -0.03</y></NaturalCubicSpline>"
_LINE, _ZERO = (
    "<LinearFunction><coefficients>1 0</coefficients></LinearFunction>",
    "<Constant><value>0</value></Constant>",
)
_CLAMPED = '<Coordinate name="a"><range>-2 2</range><clamped>true</clamped></Coordinate>'
_CUSTOM = f"""<CustomJoint name="first"><SpatialTransform>
{_axis("rotation1", "0 0 1", "a", _LINE)}{_axis("rotation2", "0 1 0", "", _ZERO)}
{_axis("rotation3", "1 0 0", "", _ZERO)}{_axis("translation1", "1 0 0", "a", _SPLINE)}
{_axis("translation2", "0 1 0", "b", _LINE)}{_axis("translation3", "0 0 1", "", _ZERO)}</SpatialTransform>
{_placed("ground", _CLAMPED + '<Coordinate name="b"/>')}</CustomJoint>"""
_BENT = '<Coordinate name="c"><default_value>0.3</default_value></Coordinate>'
_PIN = f'<PinJoint name="second">{_placed("upper", _BENT)}</PinJoint>'
_WRAP = """<WrapCylinder name="bone"><xyz_body_rotation>0.1 0.2 0.3</xyz_body_rotation>
<translation>0.01 -0.1 0.02</translation><quadrant>all</quadrant>
<radius>0.03</radius><length>0.4</length></WrapCylinder>"""
_MOVING = "".join(
    f"<{axis}_location>{_SPLINE}</{axis}_location><{axis}_coordinate>c</{axis}_coordinate>" for axis in "xyz"
)
_MUSCLE = f"""<Thelen2003Muscle name="pull"><isDisabled>false</isDisabled><GeometryPath>
<PathPointSet><objects>
<PathPoint name="p1"><location>0.05 0.1 0.02</location><body>ground</body></PathPoint>
<ConditionalPathPoint name="p2"><location>0.1 -0.1 0.04</location><body>upper</body><range>-9 0.2</range>
<coordinate>a</coordinate></ConditionalPathPoint>
<MovingPathPoint name="p3"><location>0 0 0</location><body>upper</body>{_MOVING}</MovingPathPoint>
<PathPoint name="p4"><location>0.02 -0.2 0</location><body>lower</body></PathPoint>
</objects></PathPointSet>
<PathWrapSet><objects><PathWrap name="w"><wrap_object>bone</wrap_object></PathWrap></objects></PathWrapSet>
</GeometryPath><max_isometric_force>200</max_isometric_force><optimal_fiber_length>0.2</optimal_fiber_length>
<tendon_slack_length>0.15</tendon_slack_length><{{pennation}}>0.1</{{pennation}}></Thelen2003Muscle>"""
_COUPLER = f"""<CoordinateCouplerConstraint name="couple"><isDisabled>false</isDisabled>
<coupled_coordinates_function>{_SPLINE}</coupled_coordinates_function>
<independent_coordinate_names>c</independent_coordinate_names>
<dependent_coordinate_name>b</dependent_coordinate_name></CoordinateCouplerConstraint>"""


def opensim_3_document(version: int = 30000, pennation: str = "pennation_angle_at_optimal") -> str:
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<OpenSimDocument Version="{version}"><Model name="earlier"><gravity>0.5 -9.7 0.3</gravity>
<BodySet><objects><Body name="ground"><mass>0</mass><mass_center>0 0 0</mass_center><Joint/></Body>
{_body("lower", _PIN)}{_body("upper", _CUSTOM, _WRAP)}</objects></BodySet>
<ConstraintSet><objects>{_COUPLER}</objects></ConstraintSet>
<ForceSet><objects>{_MUSCLE.format(pennation=pennation)}</objects></ForceSet>
<MarkerSet><objects><Marker name="m"><body>upper</body><location>0.1 0.2 0.3</location></Marker></objects></MarkerSet>
</Model></OpenSimDocument>"""

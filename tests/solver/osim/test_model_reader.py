"""Models in OpenSim XML, their forces and actuators: values read, defaults, and refusals by element."""

from pathlib import Path

import numpy as np
import pytest

from solver.errors import SolverCode
from solver.model import NO_COORDINATE, AxisMotion, Model, MovingPathPoint
from solver.multibody.postures import rotation_body_fixed_xyz
from solver.osim.document import as_utf8, read_document
from solver.osim.model_reader import read_osim
from tests.refusals import raises_refusal
from tests.solver.references import NO_WEIGHT, TWO_KILOGRAM_WEIGHT

CURVES = """<ActiveForceLengthCurve name="length"><minimum_value>0</minimum_value></ActiveForceLengthCurve>
<ForceVelocityCurve name="speed"/><FiberForceLengthCurve name="passive"/><TendonForceLengthCurve name="tendon"/>"""

STILL_AXES = "".join(
    f'<TransformAxis name="{name}{k}"><coordinates/><axis>{axis}</axis><Constant><value>0</value></Constant>'
    "</TransformAxis>"
    for name, numbers in (("rotation", (2, 3)), ("translation", (1, 2, 3)))
    for k, axis in zip(numbers, ("0 1 0", "1 0 0", "0 0 1"), strict=False)
)

DOOR = f"""<?xml version="1.0" encoding="UTF-8"?>
<OpenSimDocument Version="40000">
<Model name="door"><Ground name="ground"/>
<gravity>0 0 -9.81</gravity><BodySet name="bodyset"><objects>
<Body name="leaf">
<mass>20</mass><mass_center>0.4 0 1</mass_center><inertia>7 8 1 0.1 0.2 0.3</inertia>
<WrapObjectSet name="wrapobjectset"><objects>
<WrapCylinder name="hinge"><active>true</active><xyz_body_rotation>0.1 0.2 0.3</xyz_body_rotation>
<translation>0 0 1</translation><quadrant>-y</quadrant><radius>0.02</radius><length>0.1</length></WrapCylinder>
</objects></WrapObjectSet></Body></objects></BodySet><JointSet name="jointset"><objects>
<CustomJoint name="swing"><socket_parent_frame>frame</socket_parent_frame>
<socket_child_frame>/bodyset/leaf</socket_child_frame><coordinates><Coordinate name="angle">
<default_value>0.5</default_value><range>-1 2</range><locked>false</locked><prescribed>false</prescribed></Coordinate>
</coordinates><frames><PhysicalOffsetFrame name="frame"><socket_parent>/ground</socket_parent>
<translation>1 2 3</translation><orientation>0 0 0.7</orientation></PhysicalOffsetFrame></frames><SpatialTransform>
<TransformAxis name="rotation1"><coordinates>angle</coordinates><axis>0 0 2</axis>
<LinearFunction name="function"><coefficients>3 0.25</coefficients></LinearFunction></TransformAxis>
{STILL_AXES}
</SpatialTransform></CustomJoint></objects></JointSet><ForceSet name="forceset"><objects>
<Millard2012EquilibriumMuscle name="closer"><appliesForce>true</appliesForce><GeometryPath name="path">
<PathPointSet><objects><PathPoint name="a"><socket_parent_frame>/jointset/swing/frame</socket_parent_frame>
<location>0.1 0 0</location></PathPoint>
<MovingPathPoint name="b"><socket_parent_frame>/bodyset/leaf</socket_parent_frame>
<socket_x_coordinate>/jointset/swing/angle</socket_x_coordinate>
<socket_y_coordinate>/jointset/swing/angle</socket_y_coordinate>
<socket_z_coordinate>/jointset/swing/angle</socket_z_coordinate>
<x_location><SimmSpline><x>1 3</x><y>0.2 0.6</y></SimmSpline></x_location>
<y_location><Constant><value>0.3</value></Constant></y_location><z_location>
<MultiplierFunction><function><LinearFunction><coefficients>1 2</coefficients></LinearFunction></function>
<scale>0.5</scale></MultiplierFunction></z_location></MovingPathPoint></objects></PathPointSet><PathWrapSet><objects>
<PathWrap name="wrap"><wrap_object>hinge</wrap_object><method>midpoint</method><range>-1 -1</range></PathWrap>
</objects></PathWrapSet></GeometryPath><max_isometric_force>500</max_isometric_force>
<optimal_fiber_length>0.1</optimal_fiber_length><tendon_slack_length>0.2</tendon_slack_length>
{CURVES}
</Millard2012EquilibriumMuscle><CoordinateActuator name="motor"><min_control>-Inf</min_control>
<coordinate>angle</coordinate><optimal_force>40</optimal_force></CoordinateActuator></objects></ForceSet>
<MarkerSet name="markerset"><objects>
<Marker name="handle"><socket_parent_frame>/bodyset/leaf</socket_parent_frame><location>0.7 0 1</location></Marker>
</objects></MarkerSet></Model></OpenSimDocument>
"""
LAST = "</objects></ForceSet>"


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "door.osim"


def _read(file: Path, text: str) -> Model:
    file.write_text(text, encoding="utf-8")
    return read_osim(file)


def test_bodies_carry_mass_and_the_whole_inertia_tensor(file: Path) -> None:
    leaf = _read(file, DOOR).bodies[1]
    assert (leaf.name, leaf.mass) == ("leaf", 20.0)
    assert np.array_equal(leaf.inertia, [[7, 0.1, 0.2], [0.1, 8, 0.3], [0.2, 0.3, 1]])


def test_a_comment_within_a_comment_keeps_the_lines(file: Path) -> None:
    with raises_refusal(SolverCode.MALFORMED, "line 7: mass"):
        _read(file, DOOR.replace("<mass>20<", "<!--\n<!-- kg --><mass>heavy<"))
    assert _read(file, DOOR.replace("<mass>20<", "<!--\n<!-- kg --><mass>20<")).bodies[1].mass == 20.0


def test_an_ampersand_is_read_as_itself_and_comments_are_unchanged(tmp_path: Path) -> None:
    # OpenSim reads such credits, and public models have them
    authors = "<credits>Lenhart & Thelen, &lt;2015&gt; &#38;</credits>"
    text = DOOR.replace('<Model name="door">', f'<Model name="door"><!-- a & b -->{authors}')
    (tmp_path / "door.osim").write_text(text, encoding="utf-8")
    model = read_document(tmp_path / "door.osim").child("Model")
    assert model.child("credits").text == "Lenhart & Thelen, <2015> &"
    assert b"<!-- a & b -->" in as_utf8((tmp_path / "door.osim").read_bytes())


def test_credits_in_latin_1_under_a_utf_8_header_are_read(tmp_path: Path) -> None:
    # OpenSim prints the bytes of the credits as it found them, and reads them back
    text = DOOR.replace('<Model name="door">', '<Model name="door"><credits>F. M\xfcller \x96 A. Ren\xe9</credits>')
    (tmp_path / "door.osim").write_bytes(text.encode("latin-1"))
    assert read_osim(tmp_path / "door.osim").name == "door"
    (tmp_path / "utf16.osim").write_bytes(text.replace('encoding="UTF-8"', 'encoding="UTF-16"').encode("utf-16"))
    assert read_osim(tmp_path / "utf16.osim").name == "door"
    (tmp_path / "cut.osim").write_bytes(text.encode("latin-1")[:-200])
    with raises_refusal(SolverCode.UNREADABLE_FILE):
        read_osim(tmp_path / "cut.osim")


ENCODINGS = """Shift_JIS shift_jis, GB2312 gb2312, GBK gbk, Big5 big5, EUC-KR euc_kr, UTF-7 utf-7, UTF-32 utf-32,
UTF-32LE utf-32-le, UTF-16BE utf-16-be, UTF-16 utf-8, windows-1252 cp1252, KOI8-R koi8-r, Shift_JIS latin-1,
nonsense utf-8, hex utf-8, punycode utf-8, utf-8 utf-8-sig"""


@pytest.mark.parametrize(
    ("declared", "written"), [*(pair.split() for pair in ENCODINGS.split(",")), ("n" * 300, "utf-8")]
)
def test_a_model_is_read_in_any_encoding_that_it_declares_or_has(file: Path, declared: str, written: str) -> None:
    letters = {"koi8-r": "Иван", "latin-1": "Ren\xe9", "cp1252": "Ren\xe9", "big5": "\u4e2d", "euc_kr": "\uac00"}
    name = letters.get(written, "\u4e2d\u6587")
    text = DOOR.replace('name="door"', f'name="{name}"').replace('encoding="UTF-8"', f'encoding="{declared}"')
    file.write_bytes(text.encode(written))
    assert read_osim(file).name == name


@pytest.mark.timeout(60)  # of an attribute that is scanned again for every piece: 90 s
def test_an_attribute_of_16_mb_is_scanned_once(file: Path) -> None:
    assert _read(file, DOOR.replace('name="door">', f'name="door"><credits a="{"a" * 2**24}"/>')).name == "door"


@pytest.mark.timeout(60)
def test_comments_that_never_end_are_refused_at_once(file: Path) -> None:
    with raises_refusal(SolverCode.UNREADABLE_FILE):
        _read(file, DOOR + "<!--" * 300_000)


def test_a_joint_axis_is_a_unit_vector_with_the_line_that_drives_it(file: Path) -> None:
    model = _read(file, DOOR)
    joint = model.joint("swing")
    assert (joint.parent, joint.child) == (0, 1)
    assert np.array_equal(joint.frame_in_parent.translation, [1, 2, 3])
    assert np.allclose(joint.frame_in_parent.rotation, rotation_body_fixed_xyz([0, 0, 0.7]))
    assert isinstance(joint.motion, AxisMotion)
    assert np.array_equal(joint.motion.axes[0], [0, 0, 1])
    assert joint.motion.coordinate.tolist() == [0] + [NO_COORDINATE] * 5
    value, slope, _ = joint.motion.functions[0].derivatives(np.array([2.0]))
    assert (value.item(), slope.item()) == (6.25, 3.0)


def test_path_points_in_offset_frames_are_placed_in_their_body(file: Path) -> None:
    point = _read(file, DOOR).muscles[0].path.points[0]
    assert point.body == 0
    assert np.allclose(point.location, [1 + 0.1 * np.cos(0.7), 2 + 0.1 * np.sin(0.7), 3])


def test_a_moving_point_is_a_straight_line_over_its_coordinate(file: Path) -> None:
    point = _read(file, DOOR).muscles[0].path.points[1]
    assert (point.coordinate, point.range) == (0, (-1.0, 2.0))
    assert isinstance(point, MovingPathPoint)
    place, slope, _ = np.array([function.derivatives(np.zeros(1)) for function in point.functions])[..., 0].T
    assert np.allclose(place, [0.0, 0.3, 1.0])
    assert np.allclose(slope, [0.2, 0.0, 0.5])


def test_surfaces_actuators_and_markers(file: Path) -> None:
    model = _read(file, DOOR)
    surface = model.surfaces[model.muscles[0].path.wraps[0].surface]
    assert (surface.name, surface.kind, surface.quadrant) == ("hinge", "cylinder", "-y")
    assert surface.dimensions.tolist() == [0.02, 0.02, 0.1]
    assert np.allclose(surface.placement.rotation, rotation_body_fixed_xyz([0.1, 0.2, 0.3]))
    assert model.actuators[0].optimal_force == 40.0
    assert (model.actuators[0].min_control, model.actuators[0].max_control) == (-np.inf, np.inf)
    assert model.marker("handle").location.tolist() == [0.7, 0.0, 1.0]


LINE = '<LinearFunction name="function"><coefficients>3 0.25</coefficients></LinearFunction>'
GEAR = """<CoordinateCouplerConstraint name="gear"><independent_coordinate_names>{0}</independent_coordinate_names>
<coupled_coordinates_function><{1}/></coupled_coordinates_function></CoordinateCouplerConstraint>"""
RAIL = """<PointOnLineConstraint name="rail"><socket_line_body>/ground</socket_line_body>
<socket_follower_body>/bodyset/leaf</socket_follower_body></PointOnLineConstraint>"""
BOTH_STATES = (
    "<locked>false</locked><prescribed>false</prescribed>",
    "<prescribed>true</prescribed><locked>true</locked><prescribed_function><Constant/></prescribed_function>",
)


def _set(name: str, element: str) -> tuple[str, str]:
    """A set with one element at the end of the model."""
    return "</Model>", f"<{name}Set><objects>{element}</objects></{name}Set></Model>"


REFUSED: dict[SolverCode, list[tuple[str, str, str]]] = {
    SolverCode.UNSUPPORTED: [
        ("WrapCylinder", "WrapCylinderObst", "line 8: WrapCylinderObst hinge"),
        ("CustomJoint", "EllipsoidJoint", "line 11: EllipsoidJoint swing"),
        ("Constant>", "SignalGenerator>", "SignalGenerator"),
        ("MovingPathPoint", "StrangePathPoint", "StrangePathPoint b"),
        ("Millard2012EquilibriumMuscle", "RigidTendonMuscle", "RigidTendonMuscle closer"),
        (LAST, f'<ElasticFoundationForce name="cuff"/>{LAST}', "ElasticFoundationForce cuff"),
        (">midpoint<", ">spiral<", "PathWrap wrap has the method spiral"),
        (*BOTH_STATES, "Coordinate angle is both locked and prescribed"),
        ("angle</socket_y_coordinate>", "other</socket_y_coordinate>", "MovingPathPoint b"),
        (*_set("Controller", '<PrescribedController name="plan"/>'), "PrescribedController plan"),
        (*_set("Constraint", '<RollingOnSurfaceConstraint name="wheel"/>'), "RollingOnSurfaceConstraint wheel"),
        (
            *_set("Constraint", GEAR.format("angle width", "Sine")),
            "coupled_coordinates_function of gear should be a LinearFunction",
        ),
        (*_set("Constraint", GEAR.format("angle", "Constant")), "coupled_coordinates_function of gear"),
        ("<coordinates>angle", "<coordinates>angle width", "rotation1 is driven by angle width"),
        ("<coordinates>angle", "<coordinates>width", "coordinate angle, which moves no axis"),
        (LINE, "<GCVSpline><half_order>3</half_order><error_variance>0.1</error_variance></GCVSpline>", "GCVSpline"),
        (LINE, "<ExpressionBasedFunction><expression>3*x</expression></ExpressionBasedFunction>", "ExpressionBasedF"),
    ],
    SolverCode.MALFORMED: [
        ("-y</quadrant>", "w</quadrant>", "WrapCylinder hinge"),
        (LAST, f'<ExpressionBasedBushingForce name="cuff"/>{LAST}', "ExpressionBasedBushingForce cuff"),
        ("<min_control>-Inf", "<min_control>low", "min_control"),
        ("<min_control>-Inf", "<max_control>2</max_control><min_control>3", "min_control of 3"),
        ("<minimum_value>0<", "<minimum_value>low<", "minimum_value"),
        ("<x>1 3</x>", "<x>1 2 3</x>", "3 x and 2 y"),
        *(("<mass>20<", f"<mass>{mass}<", mass) for mass in ("heavy", "nan", "2_0", "inf")),
        ("<x>1 3<", "<x>1 nan<", "nan"),
        ("<mass_center>0.4 0 1<", "<mass_center>0.4 0<", "mass_center"),
        ("<mass>20</mass>", "", "line 5: Body leaf has no <mass>"),
        ("<coordinates>angle<", "<coordinates><", "rotation1"),
        ("CustomJoint", "FreeJoint", "expected 6"),
        (LINE, "<StepFunction><transition_end_time>0.99</transition_end_time></StepFunction>", "0.99"),
    ],
    SolverCode.UNKNOWN_NAME: [
        ("/jointset/swing/frame<", "/jointset/swing/hook<", "/jointset/swing/hook"),
        ("<coordinate>angle", "<coordinate>width", "CoordinateActuator motor names an unknown coordinate width"),
        ("<wrap_object>hinge", "<wrap_object>knob", "PathWrap wrap names an unknown wrap object knob"),
        ("<socket_parent>/ground<", "<socket_parent>frame<", "frame"),
    ],
    SolverCode.NOT_POSITIVE: [
        ("<mass>20<", "<mass>-20<", "-20 kg"),
        ("<axis>0 0 2<", "<axis>0 0 0<", "0 0 0"),
        ("<radius>0.02<", "<radius>-0.02<", "radius"),
        ("fiber_length>0.1<", "fiber_length>0<", "optimal_fiber_length"),
        ("slack_length>0.2<", "slack_length>-0.1<", "tendon_slack_length"),
        (*_set("Constraint", RAIL), "line_direction_vec 0 0 0"),
    ],
    SolverCode.WRONG_DOCUMENT: [('Version="40000"', 'Version="30501"', "30501")],
}


@pytest.mark.parametrize(
    ("code", "old", "new", "naming"), [(code, *row) for code, rows in REFUSED.items() for row in rows]
)
def test_what_the_solver_lacks_is_refused_by_name_and_line(
    file: Path, code: SolverCode, old: str, new: str, naming: str
) -> None:
    assert old in DOOR
    with raises_refusal(code, naming) as caught:
        _read(file, DOOR.replace(old, new))
    assert str(caught.value).startswith("door.osim, line ")


def test_points_and_sensors_of_a_body_are_left_out_and_named(file: Path) -> None:
    components = "<components><Station name='handle'/><PathPoint name='end'/><IMU name='sensor'/></components>"
    model = _read(file, DOOR.replace('<Body name="leaf">', f'<Body name="leaf">{components}'))
    assert model.left_out == ("Station handle", "PathPoint end", "IMU sensor")
    assert len(model.bodies) == 2


def test_a_body_without_a_joint_is_refused(file: Path) -> None:
    loose = '<Body name="mat"><mass>1</mass><mass_center>0 0 0</mass_center><inertia>1 1 1 0 0 0</inertia></Body>'
    with raises_refusal(SolverCode.NO_JOINT, naming="mat"):
        _read(file, DOOR.replace("</objects></BodySet>", f"{loose}</objects></BodySet>"))


def test_a_file_that_is_no_xml_and_one_that_is_not_there_are_refused(file: Path) -> None:
    with raises_refusal(SolverCode.UNREADABLE_FILE, naming="line 1"):
        _read(file, "time,angle\n0,1\n")
    with raises_refusal(SolverCode.UNREADABLE_FILE, naming="absent.osim"):
        read_osim(file.with_name("absent.osim"))


@pytest.mark.shared
def test_the_loaded_model_differs_in_the_hand_only() -> None:
    bare, loaded = read_osim(NO_WEIGHT), read_osim(TWO_KILOGRAM_WEIGHT)
    bodies = ([(each.name, each.mass, each.inertia.tolist()) for each in model.bodies] for model in (bare, loaded))
    assert [other[0] for one, other in zip(*bodies, strict=True) if one != other] == ["hand"]
    assert loaded.bodies[-1].mass == pytest.approx(bare.bodies[-1].mass + 2.0, abs=1e-12)
    assert bare.muscle_names == loaded.muscle_names


@pytest.mark.parametrize(("limits", "expected"), [("", (0.01, 1.0)), ("<max_control>0</max_control>", (0.0, 0.0))])
def test_a_paralysed_muscle_has_no_least_control(file: Path, limits: str, expected: tuple[float, float]) -> None:
    force = "<max_isometric_force>500"
    muscle = _read(file, DOOR.replace(force, limits + force)).muscles[0]
    assert (muscle.min_control, muscle.max_control) == expected


BOTH = "<socket_body1>/bodyset/leaf</socket_body1><socket_body2>/bodyset/leaf</socket_body2>"
ENDS = "<bodyA>leaf</bodyA><bodyB>ground</bodyB>"
POINT = "<PathPoint name='p'><socket_parent_frame>/ground</socket_parent_frame></PathPoint>"
PATH = f"<GeometryPath><PathPointSet><objects>{POINT}{POINT}</objects></PathPointSet></GeometryPath>"
MILLARD, TORQUE, FORMULA = "Millard2012EquilibriumMuscle", "TorqueActuator", "ExpressionBasedCoordinateForce"
STEEP = "<ForceVelocityCurve><isometric_slope>0.5</isometric_slope></ForceVelocityCurve>"
LATE = "<fv_linear_extrap_threshold>0.5</fv_linear_extrap_threshold>"
SINE = "<FunctionSet name='forceFunctions'><objects><Constant/><Sine/><Constant/></objects></FunctionSet>"
FORMULAS = {
    "2*width": "has the unknown variable width, expected q, qdot",
    "floor(q)": "has the unknown function floor of 1 argument",
    "sin(q,q)": "has the unknown function sin of 2 arguments",
    "a*q; a": "has the definition 'a', expected name=formula",
    "-" * 300 + "q": "is nested more than",
    "q" * 6000: "is longer than",
    "True*q": "has 'True', which is not arithmetic",
    **{text: f"has '{text}', which is not arithmetic" for text in ("2*", "q**2", "__import__('os').system()")},
    **dict.fromkeys(("q if q else 1", "(" * 300 + "q" + ")" * 300, "'a'"), "has"),
}
UNREADABLE: dict[SolverCode, list[tuple[str, str, str]]] = {
    SolverCode.WRONG_MUSCLE: [
        (MILLARD, PATH + STEEP, "f should have <isometric_slope> in (1.09722, inf) and has 0.5"),
        ("Thelen2003Muscle", PATH + LATE, "f should have <fv_linear_extrap_threshold> in (0.714286, 1) and has 0.5"),
    ],
    SolverCode.WRONG_PATH: [("PathActuator", PATH.replace(POINT, "", 1), "has 1 point, expected at least 2")],
    SolverCode.UNSUPPORTED: [
        *(
            (kind, "<FunctionBasedPath/>", "f has a FunctionBasedPath")
            for kind in ("PathActuator", MILLARD, "PathSpring")
        ),
        ("PrescribedForce", f"<socket_frame>/bodyset/leaf</socket_frame>{SINE}", "Sine makes PrescribedForce f depend"),
    ],
    SolverCode.MALFORMED: [
        ("PointActuator", "", "PointActuator f has no <body>"),
        ("PointActuator", "<body>leaf</body><direction>0 0 0</direction>", "f has a <direction> without length"),
        ("PointActuator", "<body>leaf</body><point_is_global>yes</point_is_global>", "true or false for <point_is_g"),
        (TORQUE, f"{ENDS}<axis>0 0</axis>", "axis"),
        (TORQUE, f"{ENDS}<optimal_force>nan</optimal_force>", "optimal_force"),
        (TORQUE, f"{ENDS}<min_control>1</min_control><max_control>0</max_control>", "min_control of 1"),
        ("PointToPointActuator", ENDS.replace("ground", "leaf"), "two points of the same body"),
        ("PointToPointSpring", BOTH, "two points of the same body"),
        *((kind, "", f"{kind} f has no <GeometryPath>") for kind in ("PathSpring", "PathActuator")),
        *(
            (
                FORMULA,
                f"<coordinate>angle</coordinate><expression>{text}</expression>",
                f"expression of {FORMULA} f {why}",
            )
            for text, why in FORMULAS.items()
        ),
    ],
    SolverCode.UNKNOWN_NAME: [
        ("PointActuator", "<body>wall</body>", "unknown body wall"),
        ("BodyActuator", "<socket_body>/bodyset/wall</socket_body>", "/bodyset/wall"),
    ],
    SolverCode.NOT_POSITIVE: [
        (TORQUE, f"{ENDS}<optimal_force>0</optimal_force>", "TorqueActuator f has an <optimal_force> of 0"),
        ("PathSpring", f"{PATH}<resting_length>-1</resting_length>", "<resting_length> of 0 or above"),
        ("Blankevoort1991Ligament", PATH, "slack_length"),
        ("CoordinateLimitForce", "<coordinate>angle</coordinate><transition>0</transition>", "transition"),
    ],
}


@pytest.mark.parametrize(
    ("code", "kind", "properties", "naming"),
    [pytest.param(code, *row, id=row[2][:60]) for code, rows in UNREADABLE.items() for row in rows],
)
def test_a_force_that_cannot_be_read_is_refused_with_its_line(
    file: Path, code: SolverCode, kind: str, properties: str, naming: str
) -> None:
    written = f"<{kind} name='f'>{properties}</{kind}>"
    text = DOOR.replace(LAST, f"{written}\n{LAST}")
    line = 1 + text[: text.index(written)].count("\n")
    with raises_refusal(code, naming=naming) as caught:
        _read(file, text)
    assert f"door.osim, line {line}: " in str(caught.value)

"""Joints, the functions that drive their axes, and frames that another version keeps elsewhere, against OpenSim."""

import re
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solver.errors import SolverCode
from solver.model import CoordinateLock
from solver.osim.model_reader import read_osim
from tests.refusals import raises_refusal
from tests.solver.oracle.two_bodies import (
    add_muscle,
    body,
    difference,
    difference_to,
    frame_of,
    given,
    made,
    model_with,
    opensim,
    path_of,
    printed,
    read_back,
    vec3,
)

KNOTS = np.array([-2.1, -0.9, -0.2, 0.4, 0.7, 1.9])
HEIGHTS = np.array([0.3, -0.2, 0.5, 0.4, -0.3, 0.2])


def points_of(kind: str, count: int = 6) -> Any:
    function = getattr(opensim, kind)()
    for x, y in zip(KNOTS[:count], HEIGHTS[:count], strict=True):
        function.addPoint(float(x), float(y))
    return function


def natural_spline(degree: int) -> Any:
    spline = opensim.GCVSpline()
    spline.setDegree(degree)
    for x in (-1.6, -1.1, -0.9, -0.4, 0.1, 0.3, 0.8, 1.1, 1.5):
        spline.addPoint(x, round(np.sin(2 * x), 3))  # with few figures, because these are not printed in full
    return spline


def polynomial(*coefficients: float) -> Any:
    return opensim.PolynomialFunction(opensim.Vector(list(coefficients)))


FUNCTIONS: dict[str, Callable[[], Any]] = {
    "constant": lambda: opensim.Constant(0.3),
    "line": lambda: opensim.LinearFunction(-0.7, 0.2),
    "polynomial": lambda: polynomial(0.2, -0.5, 0.3, 0.1),
    **{f"SIMM spline through {count}": partial(points_of, "SimmSpline", count) for count in (2, 3, 4, 6)},
    "piecewise linear": lambda: points_of("PiecewiseLinearFunction"),
    "piecewise constant": lambda: points_of("PiecewiseConstantFunction"),
    **{f"natural spline of degree {degree}": partial(natural_spline, degree) for degree in (1, 3, 5, 7)},
    "step up": lambda: opensim.StepFunction(-0.6, 0.9, 0.1, -0.4),
    "sine": lambda: opensim.Sine(0.5, 1.7, 0.3, 0.1),
    "multiple": lambda: opensim.MultiplierFunction(given(points_of("SimmSpline")), -1.3),
}
KINDS = ("Pin", "Slider", "Universal", "Planar", "Gimbal", "Ball", "Free", "Weld")
JOINTS: dict[str, Callable[..., Any]] = {
    **{f"{kind}Joint": getattr(opensim, f"{kind}Joint") for kind in KINDS},
    **{f"custom, {name}": lambda *sides, name=name: coupled(sides, name) for name in FUNCTIONS},
    "an axis that nothing drives": lambda *sides: custom(
        sides,
        [("", opensim.Constant(0.4)), ("bend", line(1.0)), ("turn", line(-1.0)), *[("", opensim.Constant(0.1))] * 3],
    ),
}


@pytest.mark.parametrize("kind", JOINTS)
def test_a_joint_moves_as_in_opensim(kind: str, tmp_path: Path) -> None:
    assert difference(model_with(JOINTS[kind]), tmp_path).is_nought()


def test_only_a_coordinate_that_is_the_motion_of_an_axis_is_an_angle_or_a_distance(tmp_path: Path) -> None:
    model = model_with(lambda *sides: coupled(sides, "sine"))
    ours = read_back(model, tmp_path)
    theirs = [model.getCoordinateSet().get(name).getMotionType() for name in ours.coordinate_names]
    names = {1: "rotation", 2: "translation", 3: "coupled"}
    assert [coordinate.motion for coordinate in ours.coordinates] == [names[kind] for kind in theirs]


@pytest.mark.parametrize(
    ("kind", "arguments"),
    [
        ("ExpressionBasedFunction", ("0.3*x^2 + x + 0.2", ["x"])),
        ("MultivariatePolynomialFunction", (opensim.Vector([0.2, 1.0, 0.3]), 1, 2)),
    ],
)
def test_what_is_refused_for_its_curvature_accelerates_wrongly_in_opensim(
    kind: str, arguments: tuple[Any, ...], tmp_path: Path
) -> None:
    # where this fails, OpenSim has mended it, and the solver can read it
    function = getattr(opensim, kind)(*arguments)
    slope_for_curvature, right = (accelerated_along(each) for each in (function, polynomial(0.3, 1.0, 0.2)))
    assert abs(slope_for_curvature - right) > 0.1
    with raises_refusal(SolverCode.UNSUPPORTED, naming=kind):
        read_back(model_with(lambda *sides: custom(sides, [("bend", function), *[("", line(0.0))] * 5])), tmp_path)


def accelerated_along(function: Any) -> float:
    """How a coordinate accelerates that turns the first body by this function."""
    axes = [("bend", function), *[("", opensim.Constant(0.0))] * 5]
    model = model_with(lambda *sides: custom(sides, axes))
    state = model.initSystem()
    bend = model.getCoordinateSet().get("bend")
    bend.setValue(state, 0.7, False)
    bend.setSpeedValue(state, 1.3)
    model.realizeAcceleration(state)
    return float(bend.getAccelerationValue(state))


def line(slope: float) -> Any:
    return opensim.LinearFunction(slope, 0.1)


def coupled(sides: tuple[Any, ...], name: str) -> Any:
    """`bend` moves three axes at once, `turn` two; three of the six by the function."""
    second, third = (opensim.MultiplierFunction(given(FUNCTIONS[name]()), scale) for scale in (0.7, -0.4))
    axes = [("bend", FUNCTIONS[name]()), ("turn", second), ("bend", third)]
    return custom(sides, [*axes, ("turn", line(-0.6)), ("lift", line(1.0)), ("bend", line(0.5))])


def custom(sides: tuple[Any, ...], axes: list[tuple[str, Any]]) -> Any:
    """A custom joint with six oblique axes, each with its coordinate and function."""
    transform = opensim.SpatialTransform()
    for index, (driver, function) in enumerate(axes):
        axis = transform.updTransformAxis(index)
        axis.setAxis(vec3(*(np.eye(3)[index % 3] + 0.3 * np.sin([1.0 + index, 2.0 * index, 5.0]))))
        if driver:
            axis.setCoordinateNames(opensim.ArrayStr(driver, 1))
        axis.set_function(function)
    return opensim.CustomJoint(*sides, transform)


def bare(*bodies: Any) -> Any:
    model = opensim.Model()
    model.setName("two_bodies")
    for each in bodies:
        model.addBody(given(each))
    return model


@pytest.mark.parametrize("axes", [("+x", "+y"), ("-z", "+x"), ("y", "-z"), ("-y", "-x"), ("+z", "-y")], ids=" ".join)
def test_a_frame_is_defined_by_points(axes: tuple[str, str], tmp_path: Path) -> None:
    """A joint, a path point and a wrap object are in it, and a point of it is in an offset frame."""
    upper, lower = body("upper"), body("lower")
    model = bare(upper, lower)
    model.addJoint(given(opensim.PinJoint("first", model.getGround(), upper)))
    tilted = opensim.PhysicalOffsetFrame("tilted", upper, opensim.Transform(opensim.Rotation(0.4, vec3(0, 1, 0))))
    upper.addComponent(given(tilted))
    owner = upper if axes[0] in ("+x", "y") else model
    frame = made("StationDefinedFrame", "triangle", set_ab_axis=axes[0], set_ab_x_ac_axis=axes[1])
    owner.addComponent(given(frame))  # before its points, as a file may list them
    places = {"a": (upper, (0.1, 0.2, 0.0)), "b": (tilted, (0.3, -0.1, 0.2)), "c": (upper, (-0.2, 0.1, 0.4))}
    for name, (parent, place) in places.items():
        point = made("Station", name, parent, vec3(*place))
        owner.addComponent(given(point))
        getattr(frame, f"connectSocket_point_{name}")(point)
    frame.connectSocket_origin_point(point)
    model.addJoint(given(opensim.PinJoint("second", frame, lower)))
    surface = made("WrapCylinder", "bump", set_radius=0.05, set_translation=vec3(0.02, -0.05, 0.01))
    frame.addWrapObject(given(surface))
    model.finalizeConnections()
    path = path_of(add_muscle(model, "pull", [("ground", (0.3, 0.2, -0.1)), ("lower", (0.02, -0.2, 0.1))]))
    path.addPathWrap(surface)
    path.appendNewPathPoint("last", frame, vec3(0.1, 0.1, -0.2))
    assert difference(model, tmp_path).is_nought()


def test_bodies_joints_and_constraints_may_be_components_of_the_model(tmp_path: Path) -> None:
    model, zero = bare(), vec3(0, 0, 0)
    upper, lower = body("upper"), body("lower")
    first = opensim.FreeJoint("first", model.getGround(), upper)
    second = opensim.PinJoint("second", upper, vec3(0, -0.3, 0), zero, lower, zero, zero)
    held = opensim.PointConstraint(model.getGround(), vec3(0.1, 0.2, 0.0), lower, vec3(0.0, -0.1, 0.2))
    for part in (upper, lower, first, second, held, opensim.Marker("m", lower, vec3(0.1, 0.0, 0.0))):
        model.addComponent(given(part))
    model.finalizeConnections()
    add_muscle(model, "pull", [("ground", (0.0, 0.1, 0.0)), ("ground", (0.2, 0.3, 0.1))])
    assert difference(model, tmp_path).is_nought()


def test_joints_may_be_listed_in_any_order(tmp_path: Path) -> None:
    """The joint of the lower body comes before that of its parent."""
    upper, lower = body("upper"), body("lower")
    model = bare(lower, upper)
    places = (vec3(0, -0.3, 0.1), vec3(0.2, 0, 0)), (vec3(0.1, 0, 0), vec3(0, 0.3, 0))
    model.addJoint(given(opensim.PinJoint("second", upper, *places[0], lower, *places[1])))
    model.addJoint(given(opensim.GimbalJoint("first", model.getGround(), *places[1], upper, *places[0])))
    model.finalizeConnections()
    add_muscle(model, "pull", [("ground", (0.05, 0.1, 0.02)), ("lower", (0.02, -0.2, 0))])
    ours = read_back(model, tmp_path)
    assert [joint.name for joint in ours.joints] == ["first", "second"]
    assert difference_to(model, ours).is_nought()


def test_the_last_development_version_has_the_layout_of_opensim_4_and_opensim_does_not_open_those_before_it(
    tmp_path: Path,
) -> None:
    """Their joints refer to bodies by paths without the sets, as OpenSim wrote them until then."""
    last, before = (as_version(version, tmp_path) for version in (30517, 30516))
    assert difference_to(opensim.Model(str(last)), read_osim(last)).is_nought()
    text = before.read_text(encoding="utf-8").replace("/bodyset/", "../../")
    before.write_text(re.sub(r"<(/?)(socket_\w+)>", r"<\1\2_connectee_name>", text), encoding="utf-8")
    with pytest.raises(RuntimeError, match="Failed to connect Socket"):
        opensim.Model(str(before)).initSystem()
    with raises_refusal(SolverCode.WRONG_DOCUMENT, naming="30516"):
        read_osim(before)


def as_version(version: int, folder: Path) -> Path:
    file = printed(model_with(opensim.FreeJoint), folder / f"{version}.osim")
    text = re.sub(r'Version="\d+"', f'Version="{version}"', file.read_text(encoding="utf-8"))
    file.write_text(text, encoding="utf-8")
    return file


# What holds bodies and coordinates together, against OpenSim.


ENDS = [("ground", "upper"), ("ground", "lower"), ("upper", "ground"), ("lower", "ground"), ("upper", "lower")]
HELD = vec3(0.1, 0.2, -0.1), vec3(0.05, -0.1, 0.2)


HOLDING: dict[str, Callable[[Any, Any], Any]] = {
    "a point": lambda one, two: opensim.PointConstraint(one, HELD[0], two, HELD[1]),
    "a distance": lambda one, two: opensim.ConstantDistanceConstraint(one, HELD[0], two, HELD[1], 0.3),
    **{
        f"a line along {direction}": lambda one, two, direction=direction: opensim.PointOnLineConstraint(
            one, vec3(*direction), HELD[0], two, HELD[1]
        )
        for direction in ((1.0, 0.0, 0.0), (0.3, -2.0, 0.4), (-0.5, 0.6, 0.1))
    },
    "a frame": lambda one, two: opensim.WeldConstraint(
        "weld", one, HELD[0], vec3(0.3, -0.2, 0.4), two, HELD[1], vec3(-0.1, 0.5, 0.2)
    ),
}


@pytest.mark.parametrize(
    ("kind", "ends"), [(kind, ENDS[(index + step) % 5]) for index, kind in enumerate(HOLDING) for step in (0, 2)]
)
def test_a_body_is_held_on_another(kind: str, ends: tuple[str, str], tmp_path: Path) -> None:
    model = model_with(opensim.FreeJoint)
    model.getJointSet().get("second").upd_coordinates(0).setDefaultValue(0.2)
    model.addConstraint(given(HOLDING[kind](*(frame_of(model, end) for end in ends))))
    assert difference(model, tmp_path).is_nought()


@pytest.mark.parametrize("kind", ["a point", "a distance", "a line along (1.0, 0.0, 0.0)"])
def test_an_offset_frame_is_refused_because_opensim_ignores_its_offset(kind: str, tmp_path: Path) -> None:
    # where this fails, OpenSim has mended it, and the solver can read it
    gaps = []
    for is_offset in (False, True):
        model = model_with(opensim.FreeJoint)
        lower = frame_of(model, "lower")
        aside = opensim.PhysicalOffsetFrame("aside", lower, opensim.Transform(vec3(0.1, 0.2, 0.3)))
        if is_offset:
            lower.addComponent(given(aside))
        model.finalizeConnections()
        constraint = HOLDING[kind](model.getGround(), aside if is_offset else lower)
        model.addConstraint(given(constraint))
        state = model.initSystem()
        model.realizePosition(state)
        gaps.append(state.getQErr().to_numpy())
    np.testing.assert_array_equal(*gaps)
    with raises_refusal(SolverCode.UNSUPPORTED, naming=constraint.getConcreteClassName()):
        read_back(model, tmp_path)


@pytest.mark.parametrize(
    ("name", "joint"),
    [(name, ("UniversalJoint", "BallJoint")[k % 2]) for k, name in enumerate(FUNCTIONS) if name != "constant"],
)
def test_a_coordinate_follows_another(joint: str, name: str, tmp_path: Path) -> None:
    model = model_with(getattr(opensim, joint))
    model.addConstraint(coupler(["first_coord_1"], "second_coord_0", FUNCTIONS[name](), 0.8))
    assert difference(model, tmp_path).is_nought()


@pytest.mark.parametrize("joint", ["GimbalJoint", "BallJoint", "FreeJoint"])
def test_a_coordinate_follows_several_by_a_line(joint: str, tmp_path: Path) -> None:
    model = model_with(getattr(opensim, joint))
    model.addConstraint(coupler([f"first_coord_{k}" for k in (2, 0, 1)], "second_coord_0", plane(0.4, -0.7, 1.1), 0.8))
    assert difference(model, tmp_path).is_nought()


def test_a_function_of_one_coordinate_couples_the_first_two_of_several_in_opensim(tmp_path: Path) -> None:
    model = model_with(opensim.GimbalJoint)
    independents = ["first_coord_0", "first_coord_1"]
    model.addConstraint(coupler(independents, "second_coord_0", opensim.Sine(1.0, 1.0, 0.0)))
    state = model.initSystem()
    for name, value in zip([*independents, "second_coord_0"], (0.3, 0.5, 0.7), strict=True):
        model.getCoordinateSet().get(name).setValue(state, value, False)
    model.realizePosition(state)
    assert state.getQErr().get(0) == pytest.approx(np.sin(0.3) - 0.5)
    with raises_refusal(SolverCode.UNSUPPORTED, naming="coupled_coordinates_function"):
        read_back(model, tmp_path)


def test_a_polynomial_of_several_coordinates_accelerates_wrongly_in_opensim(tmp_path: Path) -> None:
    # where this fails, OpenSim has mended it, and the solver can read it
    independents, found = ["first_coord_0", "first_coord_1"], []
    coefficients = opensim.Vector([0.2, 0.7, 0.4])  # 0.2 + 0.7 y + 0.4 x
    for function in (plane(0.4, 0.7), opensim.MultivariatePolynomialFunction(coefficients, 2, 1)):
        model = model_with(opensim.GimbalJoint)
        model.addConstraint(coupler(independents, "second_coord_0", function))
        state = model.initSystem()
        for name in independents:
            model.getCoordinateSet().get(name).setSpeedValue(state, 1.3)
        model.realizeAcceleration(state)
        acceleration = model.getCoordinateSet().get("second_coord_0").getAccelerationValue(state)
        found.append((state.getQErr().get(0), acceleration))
    (same_gap, right), (gap, wrong) = found
    assert gap == pytest.approx(same_gap)
    assert abs(wrong - right) > 0.1
    with raises_refusal(SolverCode.UNSUPPORTED, naming="MultivariatePolynomialFunction"):
        read_back(model, tmp_path)


def held(joint: str, **settings: Any) -> Any:
    """A model whose second coordinate of the first joint has these settings."""
    model = model_with(getattr(opensim, joint))
    coordinate = model.getJointSet().get("first").upd_coordinates(1)
    for setter, value in settings.items():
        getattr(coordinate, setter)(value)
    return model


@pytest.mark.parametrize("joint", ["PlanarJoint", "FreeJoint"])
def test_a_locked_coordinate_stays_where_it_is(joint: str, tmp_path: Path) -> None:
    assert difference(held(joint, setDefaultValue=0.3, set_locked=True), tmp_path).is_nought()


@pytest.mark.parametrize("name", FUNCTIONS)
@pytest.mark.parametrize("joint", ["PlanarJoint", "FreeJoint"])
def test_a_prescribed_coordinate_follows_a_function_of_time(joint: str, name: str, tmp_path: Path) -> None:
    model = held(joint, setPrescribedFunction=FUNCTIONS[name](), set_prescribed=True)
    assert difference(model, tmp_path).is_nought()


@pytest.mark.parametrize("settings", [{"set_prescribed": True}, {"setPrescribedFunction": FUNCTIONS["sine"]()}])
def test_a_prescription_needs_a_function_and_its_flag(settings: dict[str, Any], tmp_path: Path) -> None:
    model = held("PlanarJoint", **settings)
    ours = read_back(model, tmp_path)
    assert ours.constraints == ()
    assert difference_to(model, ours).is_nought()


def test_opensim_enforces_both_a_lock_and_a_prescription(tmp_path: Path) -> None:
    function = opensim.Constant(0.0)
    model = held("PlanarJoint", set_prescribed=True, set_locked=True, setPrescribedFunction=function)
    assert model.initSystem().getNQErr() == 2
    with raises_refusal(SolverCode.UNSUPPORTED, naming="Coordinate"):
        read_back(model, tmp_path)


NONE = vec3(0, 0, 0)
TWICE: dict[str, Callable[[Any, Any], Any]] = {
    "the same point twice": lambda one, two: made("PointConstraint", "two", one, HELD[0], two, HELD[1]),
    "a weld and its point": lambda one, two: opensim.WeldConstraint("weld", one, HELD[0], NONE, two, HELD[1], NONE),
}


@pytest.mark.parametrize("kind", TWICE)
def test_redundant_points_share_the_load(kind: str, tmp_path: Path) -> None:
    model = model_with(opensim.FreeJoint)
    for constraint in (HOLDING["a point"], TWICE[kind]):
        model.addConstraint(given(constraint(frame_of(model, "ground"), frame_of(model, "lower"))))
    assert difference(model, tmp_path).is_nought()


@pytest.mark.parametrize("is_locked", [False, True], ids=["a chain of couplers", "a lock of what is held"])
def test_redundant_couplers_share_the_load(is_locked: bool, tmp_path: Path) -> None:
    model = model_with(opensim.UniversalJoint)
    followers = [("first_coord_0", "first_coord_1"), ("first_coord_1", "second_coord_0")]
    followers += [] if is_locked else [("first_coord_0", "second_coord_0")]
    for leader, follower in followers:
        model.addConstraint(coupler([leader], follower, opensim.LinearFunction(1.0, 0.0)))
    for joint in ("first", "second"):
        model.getJointSet().get(joint).upd_coordinates(0).set_locked(is_locked)
    assert difference(model, tmp_path).is_nought()


def coupler(independents: list[str], dependent: str, function: Any, scale: float = 1.0) -> Any:
    names = opensim.ArrayStr()
    for name in independents:
        names.append(name)
    settings = {"setFunction": given(function), "setIndependentCoordinateNames": names}
    name = f"{independents[0]}_{dependent}"
    found = made("CoordinateCouplerConstraint", name, **settings, setDependentCoordinateName=dependent)
    opensim.PropertyHelper.setValueDouble(scale, found.updPropertyByName("scale_factor"))
    return given(found)


def plane(*slopes: float) -> Any:
    coefficients = opensim.ArrayDouble()
    for value in (*slopes, 0.2):
        coefficients.append(value)
    return opensim.LinearFunction(coefficients)


@pytest.mark.parametrize("text", ["true", "True", "TRUE", "1", " true ", "false", "False", "0", ""])
def test_a_coordinate_is_locked_where_opensim_reads_it_so(text: str, tmp_path: Path) -> None:
    model = model_with(opensim.PinJoint)
    model.updCoordinateSet().get(0).setDefaultLocked(True)
    file = printed(model, tmp_path / "locked.osim", ("<locked>true</locked>", f"<locked>{text}</locked>"))
    theirs = opensim.Model(str(file))
    expected = theirs.getCoordinateSet().get(0).getDefaultLocked()
    assert any(isinstance(held, CoordinateLock) for held in read_osim(file).constraints) == expected

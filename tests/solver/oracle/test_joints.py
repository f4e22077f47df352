"""Joints, the functions that drive their axes, and frames that another version keeps elsewhere, against OpenSim."""

from __future__ import annotations

import re
from collections.abc import Callable
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
    model_with,
    opensim,
    read_back,
    vec3,
)

KNOTS = np.array([-2.1, -0.9, -0.2, 0.4, 0.7, 1.9])
HEIGHTS = np.array([0.3, -0.2, 0.5, 0.4, -0.3, 0.2])


def points_of(kind: str, count: int) -> Any:
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
    vector = opensim.Vector(len(coefficients), 0.0)
    for index, coefficient in enumerate(coefficients):
        vector.set(index, coefficient)
    return opensim.PolynomialFunction(vector)


FUNCTIONS = {
    "constant": lambda: opensim.Constant(0.3),
    "line": lambda: opensim.LinearFunction(-0.7, 0.2),
    "polynomial": lambda: polynomial(0.2, -0.5, 0.3, 0.1),
    "SIMM spline through 2": lambda: points_of("SimmSpline", 2),
    "SIMM spline through 3": lambda: points_of("SimmSpline", 3),
    "SIMM spline through 4": lambda: points_of("SimmSpline", 4),
    "SIMM spline through 6": lambda: points_of("SimmSpline", 6),
    "piecewise linear": lambda: points_of("PiecewiseLinearFunction", 6),
    "piecewise constant": lambda: points_of("PiecewiseConstantFunction", 6),
    "natural spline of degree 1": lambda: natural_spline(1),
    "natural spline of degree 3": lambda: natural_spline(3),
    "natural spline of degree 5": lambda: natural_spline(5),
    "natural spline of degree 7": lambda: natural_spline(7),
    "step up": lambda: opensim.StepFunction(-0.6, 0.9, 0.1, -0.4),
    "sine": lambda: opensim.Sine(0.5, 1.7, 0.3, 0.1),
    "multiple": lambda: opensim.MultiplierFunction(given(points_of("SimmSpline", 6)), -1.3),
}


@pytest.mark.parametrize(
    "kind",
    ["PinJoint", "SliderJoint", "UniversalJoint", "PlanarJoint", "GimbalJoint", "BallJoint", "FreeJoint", "WeldJoint"],
)
def test_a_plain_joint_moves_as_in_opensim(kind: str, tmp_path: Path) -> None:
    assert difference(model_with(getattr(opensim, kind)), tmp_path).is_nought()


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_custom_joint_moves_as_in_opensim(name: str, tmp_path: Path) -> None:
    assert difference(model_with(lambda *sides: coupled(sides, name)), tmp_path).is_nought()


def test_an_axis_that_nothing_drives_is_turned_as_in_opensim(tmp_path: Path) -> None:
    still = [("", opensim.Constant(0.4)), ("bend", line(1.0)), ("turn", line(-1.0)), *[("", opensim.Constant(0.1))] * 3]
    assert difference(model_with(lambda *sides: custom(sides, still)), tmp_path).is_nought()


def test_only_a_coordinate_that_is_the_motion_of_an_axis_is_an_angle_or_a_distance(tmp_path: Path) -> None:
    model = model_with(lambda *sides: coupled(sides, "sine"))
    ours = read_back(model, tmp_path)
    theirs = [model.getCoordinateSet().get(name).getMotionType() for name in ours.coordinate_names]
    names = {1: "rotation", 2: "translation", 3: "coupled"}
    assert [coordinate.motion for coordinate in ours.coordinates] == [names[kind] for kind in theirs]


@pytest.mark.parametrize("kind", ["ExpressionBasedFunction", "MultivariatePolynomialFunction"])
def test_what_is_refused_for_its_curvature_accelerates_wrongly_in_opensim(kind: str, tmp_path: Path) -> None:
    # where this fails, OpenSim has mended it, and the solver can read it
    rising = opensim.Vector(3, 0.0)
    for power, coefficient in enumerate((0.2, 1.0, 0.3)):
        rising.set(power, coefficient)
    made = {
        "ExpressionBasedFunction": lambda: opensim.ExpressionBasedFunction("0.3*x^2 + x + 0.2", ["x"]),
        "MultivariatePolynomialFunction": lambda: opensim.MultivariatePolynomialFunction(rising, 1, 2),
    }[kind]()
    slope_for_curvature, right = (accelerated_along(each) for each in (made, polynomial(0.3, 1.0, 0.2)))
    assert abs(slope_for_curvature - right) > 0.1
    with raises_refusal(SolverCode.UNSUPPORTED, naming=kind):
        read_back(model_with(lambda *sides: custom(sides, [("bend", made), *[("", line(0.0))] * 5])), tmp_path)


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


@pytest.mark.parametrize("axes", [("+x", "+y"), ("-z", "+x"), ("y", "-z"), ("-y", "-x"), ("+z", "-y")], ids=" ".join)
def test_a_frame_is_defined_by_points(axes: tuple[str, str], tmp_path: Path) -> None:
    """A joint, a path point and a wrap object are in it, and a point of it is in an offset frame."""
    model = opensim.Model()
    model.setName("two_bodies")
    upper, lower = body("upper"), body("lower")
    model.addBody(given(upper))
    model.addBody(given(lower))
    model.addJoint(given(opensim.PinJoint("first", model.getGround(), upper)))
    tilted = opensim.PhysicalOffsetFrame("tilted", upper, opensim.Transform(opensim.Rotation(0.4, vec3(0, 1, 0))))
    upper.addComponent(given(tilted))
    owner = upper if axes[0] in ("+x", "y") else model
    places = {"a": (upper, (0.1, 0.2, 0.0)), "b": (tilted, (0.3, -0.1, 0.2)), "c": (upper, (-0.2, 0.1, 0.4))}
    points = {name: opensim.Station(frame, vec3(*place)) for name, (frame, place) in places.items()}
    frame = opensim.StationDefinedFrame()
    frame.setName("triangle")
    frame.set_ab_axis(axes[0])
    frame.set_ab_x_ac_axis(axes[1])
    owner.addComponent(given(frame))  # before its points, as a file may list them
    for name, point in points.items():
        point.setName(name)
        owner.addComponent(given(point))
        getattr(frame, f"connectSocket_point_{name}")(point)
    frame.connectSocket_origin_point(points["c"])
    model.addJoint(given(opensim.PinJoint("second", frame, lower)))
    surface = opensim.WrapCylinder()
    surface.setName("bump")
    surface.set_radius(0.05)
    surface.set_translation(vec3(0.02, -0.05, 0.01))
    frame.addWrapObject(given(surface))
    model.finalizeConnections()
    muscle = add_muscle(model, "pull", [("ground", (0.3, 0.2, -0.1)), ("lower", (0.02, -0.2, 0.1))])
    path = opensim.GeometryPath.safeDownCast(muscle.updPath())
    path.addPathWrap(surface)
    path.appendNewPathPoint("last", frame, vec3(0.1, 0.1, -0.2))
    assert difference(model, tmp_path).is_nought()


def test_bodies_joints_and_constraints_may_be_components_of_the_model(tmp_path: Path) -> None:
    model = opensim.Model()
    model.setName("two_bodies")
    upper, lower = body("upper"), body("lower")
    first = opensim.FreeJoint("first", model.getGround(), upper)
    second = opensim.PinJoint("second", upper, vec3(0, -0.3, 0), vec3(0, 0, 0), lower, vec3(0, 0, 0), vec3(0, 0, 0))
    held = opensim.PointConstraint(model.getGround(), vec3(0.1, 0.2, 0.0), lower, vec3(0.0, -0.1, 0.2))
    for part in (upper, lower, first, second, held, opensim.Marker("m", lower, vec3(0.1, 0.0, 0.0))):
        model.addComponent(given(part))
    model.finalizeConnections()
    add_muscle(model, "pull", [("ground", (0.0, 0.1, 0.0)), ("ground", (0.2, 0.3, 0.1))])
    assert difference(model, tmp_path).is_nought()


def test_joints_may_be_listed_in_any_order(tmp_path: Path) -> None:
    """The joint of the lower body comes before that of its parent."""
    model = opensim.Model()
    model.setName("two_bodies")
    upper, lower = body("upper"), body("lower")
    for part in (lower, upper):
        model.addBody(given(part))
    places = (vec3(0, -0.3, 0.1), vec3(0.2, 0, 0)), (vec3(0.1, 0, 0), vec3(0, 0.3, 0))
    model.addJoint(given(opensim.PinJoint("second", upper, *places[0], lower, *places[1])))
    model.addJoint(given(opensim.GimbalJoint("first", model.getGround(), *places[1], upper, *places[0])))
    model.finalizeConnections()
    add_muscle(model, "pull", [("ground", (0.05, 0.1, 0.02)), ("lower", (0.02, -0.2, 0))])
    ours = read_back(model, tmp_path)
    assert [joint.name for joint in ours.joints] == ["first", "second"]
    assert difference_to(model, ours).is_nought()


def test_the_last_development_version_has_the_layout_of_opensim_4(tmp_path: Path) -> None:
    file = as_version(30517, tmp_path)
    assert difference_to(opensim.Model(str(file)), read_osim(file)).is_nought()


def test_opensim_does_not_open_the_development_versions_before_it(tmp_path: Path) -> None:
    """Its joints refer to bodies by paths without the sets, as OpenSim wrote them until then."""
    file = as_version(30516, tmp_path)
    text = file.read_text(encoding="utf-8").replace("/bodyset/", "../../")
    file.write_text(re.sub(r"<(/?)(socket_\w+)>", r"<\1\2_connectee_name>", text), encoding="utf-8")
    with pytest.raises(RuntimeError, match="Failed to connect Socket"):
        opensim.Model(str(file)).initSystem()
    with raises_refusal(SolverCode.WRONG_DOCUMENT, naming="30516"):
        read_osim(file)


def as_version(version: int, folder: Path) -> Path:
    model: Any = model_with(opensim.FreeJoint)
    model.finalizeConnections()
    file = folder / "model.osim"
    model.printToXML(str(file))
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


@pytest.mark.parametrize("kind", ["PointConstraint", "ConstantDistanceConstraint", "PointOnLineConstraint"])
def test_an_offset_frame_is_refused_because_opensim_ignores_its_offset(kind: str, tmp_path: Path) -> None:
    # where this fails, OpenSim has mended it, and the solver can read it
    def gaps(*, is_offset: bool) -> tuple[Any, Any]:
        model = model_with(opensim.FreeJoint)
        lower = frame_of(model, "lower")
        end = opensim.PhysicalOffsetFrame("aside", lower, opensim.Transform(vec3(0.1, 0.2, 0.3)))
        if is_offset:
            lower.addComponent(given(end))
        model.finalizeConnections()
        extra = {"ConstantDistanceConstraint": [0.3]}.get(kind, [])
        line = [vec3(1.0, 0.0, 0.0)] if kind == "PointOnLineConstraint" else []
        ends = model.getGround(), *line, HELD[0], end if is_offset else lower, HELD[1]
        model.addConstraint(given(getattr(opensim, kind)(*ends, *extra)))
        state = model.initSystem()
        model.realizePosition(state)
        return model, state.getQErr().to_numpy()

    (model, with_offset), (_, without) = gaps(is_offset=True), gaps(is_offset=False)
    np.testing.assert_array_equal(with_offset, without)
    with raises_refusal(SolverCode.UNSUPPORTED, naming=kind):
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
    coefficients = opensim.Vector(3, 0.0)
    for index, coefficient in enumerate((0.2, 0.7, 0.4)):  # 0.2 + 0.7 y + 0.4 x
        coefficients.set(index, coefficient)
    functions = opensim.MultivariatePolynomialFunction(coefficients, 2, 1), plane(0.4, 0.7)
    independents = ["first_coord_0", "first_coord_1"]
    accelerations = []
    for function in functions:
        model = model_with(opensim.GimbalJoint)
        model.addConstraint(coupler(independents, "second_coord_0", function))
        state = model.initSystem()
        for name in independents:
            model.getCoordinateSet().get(name).setSpeedValue(state, 1.3)
        model.realizeAcceleration(state)
        gap = state.getQErr().get(0)
        accelerations.append([gap, model.getCoordinateSet().get("second_coord_0").getAccelerationValue(state)])
    (gap, wrong), (same_gap, right) = accelerations
    assert gap == pytest.approx(same_gap)
    assert abs(wrong - right) > 0.1
    model = model_with(opensim.GimbalJoint)
    model.addConstraint(coupler(independents, "second_coord_0", functions[0]))
    with raises_refusal(SolverCode.UNSUPPORTED, naming="MultivariatePolynomialFunction"):
        read_back(model, tmp_path)


@pytest.mark.parametrize("joint", ["PlanarJoint", "FreeJoint"])
def test_a_locked_coordinate_stays_where_it_is(joint: str, tmp_path: Path) -> None:
    model = model_with(getattr(opensim, joint))
    coordinate = model.getJointSet().get("first").upd_coordinates(1)
    coordinate.setDefaultValue(0.3)
    coordinate.set_locked(True)
    assert difference(model, tmp_path).is_nought()


@pytest.mark.parametrize("name", FUNCTIONS)
@pytest.mark.parametrize("joint", ["PlanarJoint", "FreeJoint"])
def test_a_prescribed_coordinate_follows_a_function_of_time(joint: str, name: str, tmp_path: Path) -> None:
    model = model_with(getattr(opensim, joint))
    coordinate = model.getJointSet().get("first").upd_coordinates(1)
    coordinate.setPrescribedFunction(FUNCTIONS[name]())
    coordinate.set_prescribed(True)
    assert difference(model, tmp_path).is_nought()


@pytest.mark.parametrize("is_prescribed", [True, False])
def test_a_prescription_needs_a_function_and_its_flag(is_prescribed: bool, tmp_path: Path) -> None:
    model = model_with(opensim.PlanarJoint)
    coordinate = model.getJointSet().get("first").upd_coordinates(1)
    coordinate.set_prescribed(is_prescribed)
    if not is_prescribed:
        coordinate.setPrescribedFunction(FUNCTIONS["sine"]())
    ours = read_back(model, tmp_path)
    assert ours.constraints == ()
    assert difference(model, tmp_path).is_nought()


def test_opensim_enforces_both_a_lock_and_a_prescription(tmp_path: Path) -> None:
    model = model_with(opensim.PlanarJoint)
    coordinate = model.getJointSet().get("first").upd_coordinates(1)
    coordinate.set_prescribed(True)
    coordinate.set_locked(True)
    coordinate.setPrescribedFunction(opensim.Constant(0.0))
    assert model.initSystem().getNQErr() == 2
    with raises_refusal(SolverCode.UNSUPPORTED, naming="Coordinate"):
        read_back(model, tmp_path)


@pytest.mark.parametrize(
    "kind", ["the same point twice", "a weld and its point", "a chain of couplers", "a lock of what is held"]
)
def test_redundant_constraints_share_the_load(kind: str, tmp_path: Path) -> None:
    model = model_with(opensim.FreeJoint if "point" in kind else opensim.UniversalJoint)
    if "point" in kind:
        ends = frame_of(model, "ground"), HELD[0], frame_of(model, "lower"), HELD[1]
        point = opensim.PointConstraint(*ends)
        model.addConstraint(given(point))
        if kind == "the same point twice":
            second = opensim.PointConstraint(*ends)
            second.setName("two")
        else:
            second = opensim.WeldConstraint("weld", *ends[:2], vec3(0, 0, 0), *ends[2:], vec3(0, 0, 0))
        model.addConstraint(given(second))
    else:
        followers = [("first_coord_0", "first_coord_1"), ("first_coord_1", "second_coord_0")]
        closing = ("first_coord_0", "second_coord_0")
        for leader, follower in followers + ([closing] if kind == "a chain of couplers" else []):
            model.addConstraint(coupler([leader], follower, opensim.LinearFunction(1.0, 0.0)))
        if kind == "a lock of what is held":
            for joint, index in (("first", 0), ("second", 0)):
                model.getJointSet().get(joint).upd_coordinates(index).set_locked(True)
    assert difference(model, tmp_path).is_nought()


def coupler(independents: list[str], dependent: str, function: Any, scale: float = 1.0) -> Any:
    made = opensim.CoordinateCouplerConstraint()
    made.setName(f"{independents[0]}_{dependent}")
    made.setFunction(given(function))
    names = opensim.ArrayStr()
    for name in independents:
        names.append(name)
    made.setIndependentCoordinateNames(names)
    made.setDependentCoordinateName(dependent)
    opensim.PropertyHelper.setValueDouble(scale, made.updPropertyByName("scale_factor"))
    return given(made)


def plane(*slopes: float) -> Any:
    coefficients = opensim.ArrayDouble()
    for value in (*slopes, 0.2):
        coefficients.append(value)
    return opensim.LinearFunction(coefficients)


@pytest.mark.parametrize("text", ["true", "True", "TRUE", "1", " true ", "false", "False", "0", ""])
def test_a_coordinate_is_locked_where_opensim_reads_it_so(text: str, tmp_path: Path) -> None:
    file = tmp_path / "locked.osim"
    model = model_with(opensim.PinJoint)
    model.updCoordinateSet().get(0).setDefaultLocked(True)
    model.finalizeConnections()
    model.printToXML(str(file))
    content = file.read_text(encoding="utf-8")
    assert "<locked>true</locked>" in content
    file.write_text(content.replace("<locked>true</locked>", f"<locked>{text}</locked>"), encoding="utf-8")
    theirs = opensim.Model(str(file))
    expected = theirs.getCoordinateSet().get(0).getDefaultLocked()
    assert any(isinstance(held, CoordinateLock) for held in read_osim(file).constraints) == expected

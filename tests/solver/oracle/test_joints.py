"""Joints and the functions that drive their axes, against OpenSim."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solver.errors import SolverCode
from tests.solver.oracle.two_bodies import difference, given, model_with, opensim, read_back, vec3
from tests.solver.refusals import raises_refusal

pytestmark = pytest.mark.oracle

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

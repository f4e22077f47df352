"""What holds bodies and coordinates together, against OpenSim."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solver.errors import SolverCode
from solver.model import CoordinateLock
from solver.osim.model_reader import read_osim
from tests.solver.oracle.test_joints import FUNCTIONS
from tests.solver.oracle.two_bodies import difference, frame_of, given, model_with, opensim, read_back, vec3
from tests.solver.refusals import raises_refusal

ENDS = [("ground", "upper"), ("ground", "lower"), ("upper", "ground"), ("lower", "ground"), ("upper", "lower")]
HELD = vec3(0.1, 0.2, -0.1), vec3(0.05, -0.1, 0.2)


@pytest.mark.parametrize("ends", ENDS)
def test_a_point_is_held_on_a_point_of_another_body(ends: tuple[str, str], tmp_path: Path) -> None:
    model = model_with(opensim.FreeJoint)
    one, two = (frame_of(model, end) for end in ends)
    model.addConstraint(given(opensim.PointConstraint(one, HELD[0], two, HELD[1])))
    assert difference(model, tmp_path).is_nought()


@pytest.mark.parametrize("ends", ENDS)
def test_a_point_is_held_at_a_distance_from_a_point_of_another_body(ends: tuple[str, str], tmp_path: Path) -> None:
    model = model_with(opensim.FreeJoint)
    one, two = (frame_of(model, end) for end in ends)
    model.addConstraint(given(opensim.ConstantDistanceConstraint(one, HELD[0], two, HELD[1], 0.3)))
    assert difference(model, tmp_path).is_nought()


@pytest.mark.parametrize("direction", [(1.0, 0.0, 0.0), (0.3, -2.0, 0.4), (-0.5, 0.6, 0.1)])
@pytest.mark.parametrize("ends", ENDS[:4])
def test_a_point_is_held_on_a_line_of_another_body(
    ends: tuple[str, str], direction: tuple[float, float, float], tmp_path: Path
) -> None:
    model = model_with(opensim.FreeJoint)
    one, two = (frame_of(model, end) for end in ends)
    model.addConstraint(given(opensim.PointOnLineConstraint(one, vec3(*direction), HELD[0], two, HELD[1])))
    assert difference(model, tmp_path).is_nought()


@pytest.mark.parametrize("ends", ENDS)
def test_a_frame_is_held_on_a_frame_of_another_body(ends: tuple[str, str], tmp_path: Path) -> None:
    model = model_with(opensim.FreeJoint)
    model.getJointSet().get("second").upd_coordinates(0).setDefaultValue(0.2)
    one, two = (frame_of(model, end) for end in ends)
    angles = vec3(0.3, -0.2, 0.4), vec3(-0.1, 0.5, 0.2)
    model.addConstraint(given(opensim.WeldConstraint("weld", one, HELD[0], angles[0], two, HELD[1], angles[1])))
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


@pytest.mark.parametrize("name", [name for name in FUNCTIONS if name != "constant"])
@pytest.mark.parametrize("joint", ["UniversalJoint", "BallJoint"])
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

"""What holds bodies and coordinates together, against OpenSim."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.solver.oracle.test_joints import FUNCTIONS
from tests.solver.oracle.two_bodies import difference, frame_of, given, model_with, opensim, vec3

pytestmark = pytest.mark.oracle


@pytest.mark.parametrize("ends", [("ground", "upper"), ("ground", "lower"), ("upper", "ground"), ("lower", "ground")])
def test_a_point_is_held_on_a_point_of_another_body(ends: tuple[str, str], tmp_path: Path) -> None:
    model = model_with(opensim.FreeJoint)
    one, two = (frame_of(model, end) for end in ends)
    model.addConstraint(given(opensim.PointConstraint(one, vec3(0.1, 0.2, -0.1), two, vec3(0.05, -0.1, 0.2))))
    assert difference(model, tmp_path).is_nought()


@pytest.mark.parametrize("name", [name for name in FUNCTIONS if name != "constant"])
@pytest.mark.parametrize("joint", ["UniversalJoint", "BallJoint"])
def test_a_coordinate_follows_another(joint: str, name: str, tmp_path: Path) -> None:
    model = model_with(getattr(opensim, joint))
    coupler = opensim.CoordinateCouplerConstraint()
    coupler.setFunction(given(FUNCTIONS[name]()))
    coupler.setIndependentCoordinateNames(opensim.ArrayStr("first_coord_1", 1))
    coupler.setDependentCoordinateName("second_coord_0")
    opensim.PropertyHelper.setValueDouble(0.8, coupler.updPropertyByName("scale_factor"))
    model.addConstraint(given(coupler))
    assert difference(model, tmp_path).is_nought()


@pytest.mark.parametrize("joint", ["PlanarJoint", "FreeJoint"])
def test_a_locked_coordinate_stays_where_it_is(joint: str, tmp_path: Path) -> None:
    model = model_with(getattr(opensim, joint))
    coordinate = model.getJointSet().get("first").upd_coordinates(1)
    coordinate.setDefaultValue(0.3)
    coordinate.set_locked(True)
    assert difference(model, tmp_path).is_nought()


@pytest.mark.parametrize("kind", ["the same point twice", "a chain of couplers", "a lock of what is held"])
def test_redundant_constraints_share_the_load(kind: str, tmp_path: Path) -> None:
    model = model_with(opensim.FreeJoint if kind == "the same point twice" else opensim.UniversalJoint)
    if kind == "the same point twice":
        for name in ("one", "two"):
            ends = (frame_of(model, "ground"), vec3(0.1, 0.2, -0.1), frame_of(model, "lower"), vec3(0.05, -0.1, 0.2))
            point = opensim.PointConstraint(*ends)
            point.setName(name)
            model.addConstraint(given(point))
    else:
        followers = [("first_coord_0", "first_coord_1"), ("first_coord_1", "second_coord_0")]
        closing = ("first_coord_0", "second_coord_0")
        for leader, follower in followers + ([closing] if kind == "a chain of couplers" else []):
            coupler = opensim.CoordinateCouplerConstraint()
            coupler.setName(f"{leader}_{follower}")
            coupler.setFunction(given(opensim.LinearFunction(1.0, 0.0)))
            coupler.setIndependentCoordinateNames(opensim.ArrayStr(leader, 1))
            coupler.setDependentCoordinateName(follower)
            model.addConstraint(given(coupler))
        if kind == "a lock of what is held":
            for joint, index in (("first", 0), ("second", 0)):
                model.getJointSet().get(joint).upd_coordinates(index).set_locked(True)
    assert difference(model, tmp_path).is_nought()

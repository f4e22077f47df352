"""Frames and components of an OpenSim 4 file that are not where they were before, against OpenSim."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from solver.errors import SolverCode
from solver.osim.model_reader import read_osim
from tests.solver.oracle.two_bodies import (
    add_muscle,
    body,
    difference,
    difference_to,
    given,
    model_with,
    opensim,
    read_back,
    vec3,
)
from tests.solver.refusals import raises_refusal

pytestmark = pytest.mark.oracle


@pytest.mark.parametrize("axes", [("+x", "+y"), ("-z", "+x"), ("y", "-z"), ("-y", "-x"), ("+z", "-y")], ids=" ".join)
@pytest.mark.parametrize("holder", ["body", "model"])
def test_a_frame_is_defined_by_points(axes: tuple[str, str], holder: str, tmp_path: Path) -> None:
    """A joint, a path point and a wrap object are in it, and a point of it is in an offset frame."""
    model = opensim.Model()
    model.setName("two_bodies")
    upper, lower = body("upper"), body("lower")
    model.addBody(given(upper))
    model.addBody(given(lower))
    model.addJoint(given(opensim.PinJoint("first", model.getGround(), upper)))
    tilted = opensim.PhysicalOffsetFrame("tilted", upper, opensim.Transform(opensim.Rotation(0.4, vec3(0, 1, 0))))
    upper.addComponent(given(tilted))
    owner = upper if holder == "body" else model
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

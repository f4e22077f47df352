"""Points and surfaces of paths, read from a file, against OpenSim."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.solver.oracle.test_joints import FUNCTIONS
from tests.solver.oracle.two_bodies import (
    add_muscle,
    difference,
    given,
    model_with,
    opensim,
    path_of,
    random_states,
    read_back,
    solvers_values,
    tilted_frame,
    vec3,
)

ENDS = [("ground", (0.3, 0.2, -0.1)), ("lower", (0.02, -0.2, 0.1))]
SIDES = ("all", "x", "+x", "-x", "y", "+y", "-y", "z", "+z", "-z")
KINDS = ("WrapCylinder", "WrapSphere", "WrapEllipsoid", "WrapTorus")
SURFACES = [(KINDS[(place + step) % 4], side) for place, side in enumerate(SIDES) for step in (0, 1)]
"""Two kinds on every side, and every kind on half of them; test_wrapped_paths.py has all."""


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_moving_point_follows_its_coordinate(name: str, tmp_path: Path) -> None:
    model = model_with(opensim.UniversalJoint)
    coordinate = model.getCoordinateSet().get("first_coord_1")
    coordinate.setRangeMin(-0.5)
    coordinate.setRangeMax(0.6)
    frame = tilted_frame(model, "upper")
    point = opensim.MovingPathPoint()
    point.setName("mover")
    point.setParentFrame(frame)
    for axis, scale in zip("xyz", (0.1, -0.2, 0.15), strict=True):
        getattr(point, f"connectSocket_{axis}_coordinate")(coordinate)
        getattr(point, f"set_{axis}_location")(opensim.MultiplierFunction(given(FUNCTIONS[name]()), scale))
    put_between(model, point)
    assert difference(model, tmp_path).is_nought()


def test_opensim_does_not_open_a_moving_point_of_several_coordinates() -> None:
    # where this fails, OpenSim has mended it, and the solver should read it
    model = model_with(opensim.UniversalJoint)
    coordinates = [model.getCoordinateSet().get(f"first_coord_{k}") for k in range(2)]
    point = opensim.MovingPathPoint()
    point.setName("mover")
    point.setParentFrame(model.getBodySet().get("upper"))
    for axis, coordinate in zip("xyz", [coordinates[0], *coordinates], strict=True):
        getattr(point, f"connectSocket_{axis}_coordinate")(coordinate)
        getattr(point, f"set_{axis}_location")(FUNCTIONS["line"]())
    put_between(model, point)
    with pytest.raises(RuntimeError, match="must depend on the same Coordinate"):
        model.initSystem()


def test_a_conditional_point_is_there_within_its_range(tmp_path: Path) -> None:
    model = model_with(opensim.UniversalJoint)
    point = opensim.ConditionalPathPoint()
    point.setName("condition")
    point.setParentFrame(model.getBodySet().get("upper"))
    point.setLocation(vec3(0.3, -0.2, 0.4))
    point.setCoordinate(model.getCoordinateSet().get("first_coord_1"))
    point.setRangeMin(-0.2)
    point.setRangeMax(0.5)
    put_between(model, point)
    assert difference(model, tmp_path).is_nought()


@pytest.mark.parametrize(("kind", "side"), SURFACES)
def test_a_path_wraps_over_a_surface_on_one_side(kind: str, side: str, tmp_path: Path) -> None:
    model = model_with(opensim.UniversalJoint)
    surface = getattr(opensim, kind)()
    surface.setName("bump")
    surface.set_quadrant(side)
    surface.set_translation(vec3(0.05, -0.05, 0.02))
    surface.set_xyz_body_rotation(vec3(0.3, -0.4, 0.2))
    if kind == "WrapEllipsoid":
        surface.set_dimensions(vec3(0.1, 0.14, 0.12))
    elif kind == "WrapTorus":
        surface.set_inner_radius(0.11)
        surface.set_outer_radius(0.14)
    else:
        surface.set_radius(0.12)
    model.getBodySet().get("upper").addWrapObject(given(surface))
    path = path_of(add_muscle(model, "wrapper", ENDS))
    path.addPathWrap(surface)
    assert difference(model, tmp_path).is_nought()
    assert is_touched(model, tmp_path)


@pytest.mark.parametrize("points", [(-1, -1), (1, 2), (2, 3), (2, -1), (-1, 3), (3, 4), (2, 2), (4, 2)])
def test_a_path_wraps_only_between_two_of_its_points(points: tuple[int, int], tmp_path: Path) -> None:
    model = model_with(opensim.UniversalJoint)
    surface = opensim.WrapSphere() if sum(points) % 2 else opensim.WrapCylinder()
    surface.setName("bump")
    surface.set_translation(vec3(0.15, 0.08, -0.04))
    surface.set_radius(0.06)
    model.getGround().addWrapObject(given(surface))
    course = [ENDS[0], ("ground", (0.0, 0.0, 0.0)), ("upper", (0.2, 0.1, -0.1)), ENDS[1]]
    path = path_of(add_muscle(model, "wrapper", course))
    condition = opensim.ConditionalPathPoint()
    condition.setName("condition")
    condition.setParentFrame(model.getGround())
    condition.setLocation(vec3(-0.05, 0.0, 0.05))
    condition.setCoordinate(model.getCoordinateSet().get("first_coord_1"))
    condition.setRangeMin(-0.2)
    condition.setRangeMax(0.5)
    path.updPathPointSet().insert(2, given(condition))
    path.addPathWrap(surface)
    for end, number in enumerate(points):
        path.updWrapSet().get(0).set_range(end, number)
    assert difference(model, tmp_path).is_nought()


@pytest.mark.parametrize("active", [(True, True), (False, True), (True, False), (False, False)])
def test_a_surface_that_is_not_active_is_passed_through(active: tuple[bool, bool], tmp_path: Path) -> None:
    model = model_with(opensim.UniversalJoint)
    path = path_of(add_muscle(model, "wrapper", ENDS))
    for index, is_active in enumerate(active):
        surface = opensim.WrapCylinder()
        surface.setName(f"bump_{index}")
        surface.set_active(is_active)
        surface.set_radius(0.08 + 0.04 * index)
        surface.set_translation(vec3(0.05, -0.05, 0.1 * index))
        model.getBodySet().get("upper").addWrapObject(given(surface))
        path.addPathWrap(surface)
    assert difference(model, tmp_path).is_nought()


def is_touched(model: Any, folder: Path) -> bool:
    """Whether the surface makes the last muscle's path longer than the straight line, in some posture."""
    ours = read_back(model, folder)
    straight = [np.array(place) for _, place in ENDS]
    values = solvers_values(ours, *random_states(ours))
    poses = values["pose"][:, 1]
    ends = straight[0], np.einsum("fij,j->fi", poses[..., :3], straight[1]) + poses[..., 3]
    longer = values["length"][:, -1] - np.linalg.norm(ends[1] - ends[0], axis=-1)
    return bool((longer > 1e-4).sum() > 3)


def put_between(model: Any, point: Any) -> None:
    """A muscle whose path goes through the point."""
    points = path_of(add_muscle(model, "wanderer", ENDS)).updPathPointSet()
    points.insert(1, given(point))

"""Points and surfaces of paths, read from a file, against OpenSim."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solver.model import Model
from tests.solver.oracle.test_joints import FUNCTIONS
from tests.solver.oracle.two_bodies import (
    add_muscle,
    difference,
    difference_to,
    frame_of,
    given,
    made,
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


def moving_point(frame: Any, coordinates: Sequence[Any], functions: Sequence[Any]) -> Any:
    point = made("MovingPathPoint", "mover", setParentFrame=frame)
    for axis, coordinate, function in zip("xyz", coordinates, functions, strict=True):
        getattr(point, f"connectSocket_{axis}_coordinate")(coordinate)
        getattr(point, f"set_{axis}_location")(function)
    return point


def conditional_point(model: Any, body: str, place: Any) -> Any:
    """It is passed while the second coordinate is between -0.2 and 0.5."""
    coordinate = model.getCoordinateSet().get("first_coord_1")
    settings = {"setLocation": place, "setCoordinate": coordinate, "setRangeMin": -0.2, "setRangeMax": 0.5}
    return made("ConditionalPathPoint", "condition", setParentFrame=frame_of(model, body), **settings)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_moving_point_follows_its_coordinate(name: str, tmp_path: Path) -> None:
    model = model_with(opensim.UniversalJoint)
    coordinate = model.getCoordinateSet().get("first_coord_1")
    coordinate.setRangeMin(-0.5)
    coordinate.setRangeMax(0.6)
    scaled = [opensim.MultiplierFunction(given(FUNCTIONS[name]()), scale) for scale in (0.1, -0.2, 0.15)]
    put_between(model, moving_point(tilted_frame(model, "upper"), [coordinate] * 3, scaled))
    assert difference(model, tmp_path).is_nought()


def test_opensim_does_not_open_a_moving_point_of_several_coordinates() -> None:
    # where this fails, OpenSim has mended it, and the solver should read it
    model = model_with(opensim.UniversalJoint)
    coordinates = [model.getCoordinateSet().get(f"first_coord_{k}") for k in (0, 0, 1)]
    put_between(model, moving_point(frame_of(model, "upper"), coordinates, [FUNCTIONS["line"]() for _ in range(3)]))
    with pytest.raises(RuntimeError, match="must depend on the same Coordinate"):
        model.initSystem()


def test_a_conditional_point_is_there_within_its_range(tmp_path: Path) -> None:
    model = model_with(opensim.UniversalJoint)
    put_between(model, conditional_point(model, "upper", vec3(0.3, -0.2, 0.4)))
    assert difference(model, tmp_path).is_nought()


SIZES: dict[str, dict[str, Any]] = {
    "WrapEllipsoid": {"set_dimensions": vec3(0.1, 0.14, 0.12)},
    "WrapTorus": {"set_inner_radius": 0.11, "set_outer_radius": 0.14},
}


@pytest.mark.parametrize(("kind", "side"), SURFACES)
def test_a_path_wraps_over_a_surface_on_one_side(kind: str, side: str, tmp_path: Path) -> None:
    model = model_with(opensim.UniversalJoint)
    place = {"set_translation": vec3(0.05, -0.05, 0.02), "set_xyz_body_rotation": vec3(0.3, -0.4, 0.2)}
    surface = made(kind, "bump", set_quadrant=side, **place, **SIZES.get(kind, {"set_radius": 0.12}))
    frame_of(model, "upper").addWrapObject(given(surface))
    path_of(add_muscle(model, "wrapper", ENDS)).addPathWrap(surface)
    ours = read_back(model, tmp_path)
    assert difference_to(model, ours).is_nought()
    assert is_touched(ours)


@pytest.mark.parametrize("points", [(-1, -1), (1, 2), (2, 3), (2, -1), (-1, 3), (3, 4), (2, 2), (4, 2)])
def test_a_path_wraps_only_between_two_of_its_points(points: tuple[int, int], tmp_path: Path) -> None:
    model = model_with(opensim.UniversalJoint)
    kind = "WrapSphere" if sum(points) % 2 else "WrapCylinder"
    surface = made(kind, "bump", set_translation=vec3(0.15, 0.08, -0.04), set_radius=0.06)
    model.getGround().addWrapObject(given(surface))
    course = [ENDS[0], ("ground", (0.0, 0.0, 0.0)), ("upper", (0.2, 0.1, -0.1)), ENDS[1]]
    path = path_of(add_muscle(model, "wrapper", course))
    path.updPathPointSet().insert(2, given(conditional_point(model, "ground", vec3(-0.05, 0.0, 0.05))))
    path.addPathWrap(surface)
    for end, number in enumerate(points):
        path.updWrapSet().get(0).set_range(end, number)
    assert difference(model, tmp_path).is_nought()


@pytest.mark.parametrize("active", [(True, True), (False, True), (True, False), (False, False)])
def test_a_surface_that_is_not_active_is_passed_through(active: tuple[bool, bool], tmp_path: Path) -> None:
    model = model_with(opensim.UniversalJoint)
    path = path_of(add_muscle(model, "wrapper", ENDS))
    for index, is_active in enumerate(active):
        size = {"set_radius": 0.08 + 0.04 * index, "set_translation": vec3(0.05, -0.05, 0.1 * index)}
        surface = made("WrapCylinder", f"bump_{index}", set_active=is_active, **size)
        frame_of(model, "upper").addWrapObject(given(surface))
        path.addPathWrap(surface)
    assert difference(model, tmp_path).is_nought()


def is_touched(ours: Model) -> bool:
    """Whether the surface makes the last muscle's path longer than the straight line, in several postures."""
    start, end = (np.array(place) for _, place in ENDS)
    values = solvers_values(ours, *random_states(ours))
    poses = values["pose"][:, 1]
    straight = np.linalg.norm(poses[..., :3] @ end + poses[..., 3] - start, axis=-1)
    return bool((values["length"][:, -1] - straight > 1e-4).sum() > 3)


def put_between(model: Any, point: Any) -> None:
    """A muscle whose path goes through the point."""
    path_of(add_muscle(model, "wanderer", ENDS)).updPathPointSet().insert(1, given(point))

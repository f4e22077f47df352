"""The skeleton of the bundled model: what is drawn of each body, and that it moves with it.

Muscle paths as lines: the nodes are those of the lengths that OpenSim certifies, and arcs lie on their surfaces.
"""

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from solver.bundled import bundled_model, simulate_arm_raise
from solver.drawing import ARC_POINTS, bone_lines, path_lines, skeleton
from solver.model import Array, Path, PathPoint, PathWrap, Placement, WrapSurface
from solver.motion import differentiate
from solver.multibody.postures import Postures, points_in_ground, postures
from solver.muscle import evaluate_paths

Kind = Literal["ellipsoid", "sphere", "cylinder", "torus"]
MODEL = bundled_model()
Q = differentiate(simulate_arm_raise(MODEL)).positions[::90]
RAISED = postures(MODEL, Q, np.zeros_like(Q))
SIZES = {
    "ellipsoid": (0.05, 0.08, 0.06),
    "sphere": (0.05, 0.05, 0.05),
    "cylinder": (0.05, 0.05, 0.3),
    "torus": (0.02, 0.1, 0.0),
}


def test_each_body_has_its_kind_of_bone() -> None:
    kinds = {MODEL.bodies[bone.body].name: bone.kind for bone in skeleton(MODEL)}
    shafts = dict.fromkeys(("clavicle", "humerus", "ulna", "radius", "hand"), "shaft")
    assert kinds == {"thorax": "cage", "scapula": "plate", **shafts}


def test_bones_that_a_joint_connects_meet_there() -> None:
    bones = skeleton(MODEL)
    q = MODEL.default_coordinates[None].repeat(2, axis=0)
    q[1, MODEL.coordinate_index("shoulder_elv")] += 1.0
    state = postures(MODEL, q, np.zeros_like(q))
    lines = {MODEL.bodies[bone.body].name: line for bone, line in zip(bones, bone_lines(bones, state), strict=True)}
    assert lines["humerus"][:, -1] == pytest.approx(lines["ulna"][:, 0], abs=1e-12)
    shoulder = MODEL.joint("GlenoHumeral")
    in_scapula = points_in_ground(state, shoulder.parent, shoulder.frame_in_parent.translation)
    assert lines["humerus"][:, 0] == pytest.approx(in_scapula, abs=1e-12)
    assert np.linalg.norm(lines["humerus"][1, -1] - lines["humerus"][0, -1]) > 0.2, "the arm has moved"


def length(line: Array) -> float:
    return float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())


def test_a_line_is_as_long_as_the_path() -> None:
    """Paths without surfaces exactly; wrapped ones within the difference of an arc and its chords."""
    lengths = evaluate_paths(MODEL, RAISED).lengths
    drawn = np.array([[length(line) for line in frame] for frame in path_lines(MODEL, RAISED)])
    is_straight = np.array([not muscle.path.wraps for muscle in MODEL.muscles])
    assert is_straight.any() and not is_straight.all()
    assert drawn[:, is_straight] == pytest.approx(lengths[:, is_straight], abs=1e-12)
    assert drawn == pytest.approx(lengths, abs=4e-3)
    assert np.median(np.abs(drawn - lengths)) < 1e-4


def test_a_line_begins_and_ends_at_the_attachments() -> None:
    for frame, lines in enumerate(path_lines(MODEL, RAISED)):
        for muscle, line in zip(MODEL.muscles, lines, strict=True):
            for point, end in ((muscle.path.points[0], line[0]), (muscle.path.points[-1], line[-1])):
                assert isinstance(point, PathPoint)
                assert end == pytest.approx(points_in_ground(RAISED, point.body, point.location)[frame], abs=1e-12)


@pytest.mark.parametrize("kind", ["ellipsoid", "sphere", "cylinder", "torus"])
def test_an_arc_lies_on_its_surface(kind: Kind) -> None:
    size = SIZES[kind]
    pose = Placement(np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), np.array([0.1, 0.0, 0.02]))
    surface = WrapSurface("made", MODEL.body_index("humerus"), pose, kind, np.array(size), "all")
    ends = ((0.08, 0.01, 0.0), (-0.07, 0.02, 0.01))
    if kind == "torus":
        ends = ((0.115, 0.0, 0.2), (0.115, 0.0, -0.2))  # round the inside of the tube
    points = tuple(PathPoint(surface.body, pose.rotation @ np.array(end) + pose.translation) for end in ends)
    muscle = replace(MODEL.muscles[0], path=Path(points, (PathWrap(0, "hybrid"),)))
    line = path_lines(replace(MODEL, surfaces=(surface,), muscles=(muscle,)), RAISED)[0][0]
    level = levels(surface, RAISED, line)
    assert len(line) == 4 + ARC_POINTS
    assert level[1:-1] == pytest.approx(1.0, abs=1e-4), "OpenSim's tangent points of an ellipsoid are not exact"
    assert level[2:-2] == pytest.approx(1.0, abs=1e-9)


def levels(surface: WrapSurface, state: Postures, line: Array) -> Array:
    """1 on the surface, less inside."""
    in_its_body = (line - state.origin_in_ground[0, surface.body]) @ state.rotation_to_ground[0, surface.body]
    own = (in_its_body - surface.placement.translation) @ surface.placement.rotation
    size = np.array(surface.dimensions)
    if surface.kind == "torus":
        from_tube = np.stack([np.linalg.norm(own[:, :2], axis=1) - size[1], own[:, 2]], axis=1)
        return np.asarray(np.linalg.norm(from_tube, axis=1) / size[0])
    across = 2 if surface.kind == "cylinder" else 3
    level: Array = np.linalg.norm(own[:, :across] / size[:across], axis=1)
    return level

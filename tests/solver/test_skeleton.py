"""The skeleton of the bundled model: what is drawn of each body, and that it moves with it."""

from __future__ import annotations

import numpy as np
import pytest

from solver.bundled import bundled_model
from solver.multibody.postures import points_in_ground, postures
from solver.skeleton import bone_lines, skeleton


def test_each_body_has_its_kind_of_bone() -> None:
    model = bundled_model()
    kinds = {model.bodies[bone.body].name: bone.kind for bone in skeleton(model)}
    shafts = dict.fromkeys(("clavicle", "humerus", "ulna", "radius", "hand"), "shaft")
    assert kinds == {"thorax": "cage", "scapula": "plate", **shafts}


def test_bones_that_a_joint_connects_meet_there() -> None:
    model = bundled_model()
    bones = skeleton(model)
    q = model.default_coordinates[None].repeat(2, axis=0)
    q[1, model.coordinate_index("shoulder_elv")] += 1.0
    state = postures(model, q, np.zeros_like(q))
    lines = {model.bodies[bone.body].name: line for bone, line in zip(bones, bone_lines(bones, state), strict=True)}
    assert lines["humerus"][:, -1] == pytest.approx(lines["ulna"][:, 0], abs=1e-12)
    shoulder = model.joint("GlenoHumeral")
    in_scapula = points_in_ground(state, shoulder.parent, shoulder.frame_in_parent.translation)
    assert lines["humerus"][:, 0] == pytest.approx(in_scapula, abs=1e-12)
    assert np.linalg.norm(lines["humerus"][1, -1] - lines["humerus"][0, -1]) > 0.2, "the arm has moved"

"""Forces and actuators of a model that OpenSim scales, beside the same model scaled by us."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solver.osim.model_reader import read_osim
from solver.scaling import Scaling, scale_model
from tests.solver.oracle.test_actuators import ADDED
from tests.solver.oracle.test_closed_form_forces import between_tilted_frames
from tests.solver.oracle.test_force_elements import lay
from tests.solver.oracle.test_scaling import scaled_by_opensim
from tests.solver.oracle.two_bodies import frame_of, given, model_with, opensim, vec3

pytestmark = pytest.mark.oracle

FACTORS = {
    "ground": np.array([1.1, 0.95, 1.2]),
    "upper": np.array([1.2, 0.9, 1.1]),
    "lower": np.array([0.8, 1.3, 1.05]),
}


def blankevoort() -> Any:
    ligament = opensim.Blankevoort1991Ligament()
    ligament.set_slack_length(0.4)
    return ligament


def ligament() -> Any:
    made = opensim.Ligament()
    made.setRestingLength(0.5)
    made.setMaxIsometricForce(120.0)
    return made


ALONG_PATHS = {
    "PathSpring": lambda: opensim.PathSpring("spring", 0.5, 800.0, 0.3),
    "ExpressionBasedPathForce": lambda: opensim.ExpressionBasedPathForce("band", 0.5, "300*s", True),
    "Ligament": ligament,
    "Blankevoort1991Ligament": blankevoort,
}


@pytest.mark.parametrize("kind", ALONG_PATHS)
def test_a_resting_length_grows_with_the_path(kind: str, tmp_path: Path) -> None:
    model = model_with(opensim.UniversalJoint)
    force = ALONG_PATHS[kind]()
    force.setName("scaled")
    model.addForce(given(force))
    lay(model, force)
    before, ours, theirs = scaled_by_both(model, tmp_path)
    assert abs(ours.forces[0].resting_length / before.forces[0].resting_length - 1.0) > 0.01
    assert_alike(ours.forces, theirs.forces)


@pytest.mark.parametrize("kind", ["BushingForce", "FunctionBasedBushingForce", "ExpressionBasedBushingForce"])
def test_frames_of_a_bushing_move(kind: str, tmp_path: Path) -> None:
    model = model_with(opensim.UniversalJoint)
    bushing = getattr(opensim, kind)()
    bushing.setName("scaled")
    bushing.set_rotational_damping(vec3(2, 3, 4))
    between_tilted_frames(model, bushing)
    before, ours, theirs = scaled_by_both(model, tmp_path)
    assert not np.allclose(ours.forces[0].frame_1.translation, before.forces[0].frame_1.translation)
    assert_alike(ours.forces, theirs.forces)


def test_points_springs_of_coordinates_and_contact_stay_in_opensim(tmp_path: Path) -> None:
    model = model_with(opensim.UniversalJoint)
    ends = (frame_of(model, "upper"), vec3(0.2, 0.1, 0), frame_of(model, "lower"), vec3(0, -0.1, 0.3))
    spring = opensim.PointToPointSpring(*ends, 200.0, 0.5)
    weight = opensim.PrescribedForce("weight", frame_of(model, "lower"))
    weight.setForceFunctions(opensim.Constant(1.0), opensim.Constant(2.0), opensim.Constant(3.0))
    for force in (spring, weight, opensim.CoordinateLimitForce("second_coord_0", 20.0, 0.2, -15.0, 0.3, 0.01, 30.0)):
        model.addForce(given(force))
    floor = opensim.ContactHalfSpace(vec3(0.1, -0.3, 0), vec3(0.1, 0.2, -1.4), model.getGround(), "floor")
    heel = opensim.ContactSphere(0.1, vec3(0.02, -0.15, 0.01), frame_of(model, "lower"), "heel")
    for shape in (floor, heel):
        model.addContactGeometry(given(shape))
    model.addForce(given(opensim.SmoothSphereHalfSpaceForce("smooth", heel, floor)))
    _, ours, theirs = scaled_by_both(model, tmp_path)
    assert len(ours.forces) == 3
    assert_alike(ours.forces, theirs.forces)
    assert_alike(ours.coordinate_forces, theirs.coordinate_forces)


def test_actuators_keep_their_forces_and_points_and_stretch_their_paths(tmp_path: Path) -> None:
    model = model_with(opensim.UniversalJoint)
    for index, (kind, add) in enumerate(ADDED.items()):
        if "offset" not in kind:
            add(model).setName(f"added_{index}")
    before, ours, theirs = scaled_by_both(model, tmp_path)
    assert not np.allclose(ours.actuators[0].path.points[1].location, before.actuators[0].path.points[1].location)
    assert_alike(ours.actuators, theirs.actuators)


def scaled_by_both(model: Any, folder: Path) -> tuple[Any, Any, Any]:
    model.finalizeConnections()
    model.initSystem()
    model.printToXML(str(folder / "generic.osim"))
    before = read_osim(folder / "generic.osim")
    ours = scale_model(before, Scaling(FACTORS, scales_joined_points=False))
    return before, ours, scaled_by_opensim(folder, FACTORS, None, False)


def assert_alike(ours: Any, theirs: Any) -> None:
    """Within the digits that OpenSim prints."""
    assert type(ours) is type(theirs)
    if is_dataclass(ours):
        for field in fields(ours):
            assert_alike(getattr(ours, field.name), getattr(theirs, field.name))
    elif isinstance(ours, tuple):
        assert len(ours) == len(theirs)
        for one, other in zip(ours, theirs, strict=True):
            assert_alike(one, other)
    elif isinstance(ours, np.ndarray | float):
        np.testing.assert_allclose(ours, theirs, rtol=1e-12, atol=1e-14)
    else:
        assert ours == theirs

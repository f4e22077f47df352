"""Scaling against OpenSim's own Model.scale, at random factors."""

from __future__ import annotations

import xml.etree.ElementTree as Xml
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solver.bundled import bundled_model
from solver.constraint import Constraint, CoordinateCoupler, WeldConstraint
from solver.errors import SolverCode
from solver.model import AnyPathPoint, AxisMotion, Model, MovingPathPoint, ScapulothoracicMotion
from solver.osim.model_reader import read_osim
from solver.osim.model_writer import osim_document
from solver.scaling import Scaling, scale_model, scale_skeleton
from tests.solver.oracle.test_constraints import coupler
from tests.solver.oracle.two_bodies import frame_of, given, model_with, opensim, read_back, vec3
from tests.solver.refusals import raises_refusal

pytestmark = pytest.mark.oracle


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("mass", [None, 35.0])
@pytest.mark.parametrize("keeps_masses", [False, True])
def test_a_scaled_model_is_opensims(seed: int, mass: float | None, keeps_masses: bool, tmp_path: Path) -> None:
    Xml.ElementTree(osim_document(bundled_model())).write(tmp_path / "generic.osim")
    generic = read_osim(tmp_path / "generic.osim")
    chance = np.random.default_rng(seed)
    factors = {body.name: chance.uniform(0.85, 1.2, 3) for body in generic.bodies[1:]}
    theirs = scaled_by_opensim(tmp_path, factors, mass, keeps_masses)
    ours = scale_model(generic, Scaling(factors, mass, keeps_masses, scales_joined_points=False))
    for one, other in zip(ours.bodies, theirs.bodies, strict=True):
        assert one.mass == pytest.approx(other.mass, rel=1e-12)
        np.testing.assert_allclose(one.mass_center, other.mass_center, atol=1e-12)
        np.testing.assert_allclose(one.inertia, other.inertia, rtol=1e-12, atol=1e-12)
    for one, other in zip(ours.joints, theirs.joints, strict=True):
        for side in ("frame_in_parent", "frame_in_child"):
            np.testing.assert_allclose(getattr(one, side).translation, getattr(other, side).translation, atol=1e-12)
        if isinstance(one.motion, ScapulothoracicMotion) and isinstance(other.motion, ScapulothoracicMotion):
            np.testing.assert_allclose(one.motion.radii, other.motion.radii, atol=1e-12)
            np.testing.assert_allclose(one.motion.winging_origin, other.motion.winging_origin, atol=1e-12)
    for one, other in zip(ours.surfaces, theirs.surfaces, strict=True):
        np.testing.assert_allclose(one.dimensions, other.dimensions, atol=1e-12)
        np.testing.assert_allclose(one.placement.translation, other.placement.translation, atol=1e-12)
    for one, other in zip(ours.constraints, theirs.constraints, strict=True):
        for side in ("location_1", "location_2"):  # OpenSim leaves joined points where they were
            np.testing.assert_allclose(getattr(one, side), getattr(other, side), atol=1e-12)
    for one, other in zip(ours.markers, theirs.markers, strict=True):
        np.testing.assert_allclose(one.location, other.location, atol=1e-12)
    for one, other in zip(ours.muscles, theirs.muscles, strict=True):
        assert one.optimal_fiber_length == pytest.approx(other.optimal_fiber_length, rel=1e-6)
        assert one.tendon_slack_length == pytest.approx(other.tendon_slack_length, rel=1e-6)
        for point, same in zip(one.path.points, other.path.points, strict=True):
            is_printed = isinstance(point, MovingPathPoint)  # OpenSim prints coefficients with six digits
            np.testing.assert_allclose(places_of(point), places_of(same), atol=1e-6 if is_printed else 1e-12)


def test_the_frames_of_a_weld_are_scaled(tmp_path: Path) -> None:
    model = model_with(opensim.FreeJoint)
    ends = [(frame_of(model, "ground"), vec3(0.1, 0.2, -0.1)), (frame_of(model, "lower"), vec3(0.05, -0.1, 0.2))]
    weld = opensim.WeldConstraint("weld", *ends[0], vec3(0.3, -0.2, 0.4), *ends[1], vec3(0.0, 0.0, 0.0))
    model.addConstraint(given(weld))
    found, theirs = scaled_constraints(model, "lower", (1.1, 0.9, 1.2), tmp_path)
    assert isinstance(theirs, WeldConstraint)
    assert isinstance(found, WeldConstraint)
    for name in ("location_1", "location_2", "rotation_1", "rotation_2"):
        np.testing.assert_allclose(getattr(found, name), getattr(theirs, name), atol=1e-15)
    assert not np.allclose(found.location_2, [0.05, -0.1, 0.2])


@pytest.mark.parametrize("dependent", ["first_coord_1", "second_coord_0"])  # a distance, an angle
def test_a_coupled_distance_is_scaled(dependent: str, tmp_path: Path) -> None:
    model = model_with(opensim.PlanarJoint)
    model.addConstraint(coupler(["first_coord_0"], dependent, opensim.Sine(0.3, 1.5, 0.2)))
    found, theirs = scaled_constraints(model, "ground", (1.2, 1.2, 1.2), tmp_path)
    assert isinstance(theirs, CoordinateCoupler)
    assert isinstance(found, CoordinateCoupler)
    x = np.linspace(-1.0, 1.0, 5)
    for one, other in zip(found.functions[0].derivatives(x), theirs.functions[0].derivatives(x), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-14)
    if dependent == "first_coord_1":
        with raises_refusal(SolverCode.UNSUPPORTED, naming="couples a distance"):
            scaled_constraints(model, "ground", (1.2, 1.1, 1.2), tmp_path)


def scaled_constraints(
    model: Any, body: str, factors: tuple[float, float, float], folder: Path
) -> tuple[Constraint, Constraint]:
    """The only constraint of the model as scaled by the solver, and by OpenSim, where one body is scaled."""
    ours = read_back(model, folder)
    found = scale_skeleton(ours, Scaling({body: factors})).constraints[0]
    scales, scale = opensim.ScaleSet(), opensim.Scale()
    scale.setSegmentName(body)
    scale.setScaleFactors(vec3(*factors))
    scale.setApply(True)
    scales.cloneAndAppend(scale)
    model.scale(model.initSystem(), scales, True)
    return found, read_back(model, folder).constraints[0]


def places_of(point: AnyPathPoint) -> np.ndarray:
    """(places, 3) of a path point in its body, at five values of the coordinate that moves it."""
    if not isinstance(point, MovingPathPoint):
        return point.location[None]
    values = np.linspace(0.1, 0.5, 5)
    local = np.stack([function.derivatives(values)[0] for function in point.functions], axis=1)
    return point.placement.translation + local @ point.placement.rotation.T


def test_a_joint_that_slides_by_a_function_slides_by_as_much_as_opensims(tmp_path: Path) -> None:
    """Functions of translations are scaled along their axes; a plain degree of freedom has no size."""
    model = model_with(sliding)
    model.initSystem()
    model.printToXML(str(tmp_path / "generic.osim"))
    factors = {"ground": np.array([1.1, 0.95, 1.2]), "upper": np.array([1.2, 0.9, 1.1])}
    ours = scale_model(read_osim(tmp_path / "generic.osim"), Scaling(factors, scales_joined_points=False))
    theirs = scaled_by_opensim(tmp_path, factors, None, False)
    q = np.array([-0.7, 0.2, 1.1])
    for one, other in zip(ours.joints, theirs.joints, strict=True):
        assert isinstance(one.motion, AxisMotion)
        assert isinstance(other.motion, AxisMotion)
        for function, same in zip(one.motion.functions, other.motion.functions, strict=True):
            np.testing.assert_allclose(function.derivatives(q)[0], same.derivatives(q)[0], atol=1e-12)


def sliding(*sides: Any) -> Any:
    """A custom joint: `turn` turns about x and slides along an oblique axis, `lift` slides along y."""
    transform = opensim.SpatialTransform()
    oblique = opensim.Vec3(0.6, 0.0, -0.8)
    for index, driver, slope, axis in ((0, "turn", 1.0, None), (3, "turn", 0.4, oblique), (4, "lift", 1.0, None)):
        moved = transform.updTransformAxis(index)
        moved.setCoordinateNames(opensim.ArrayStr(driver, 1))
        moved.set_function(opensim.LinearFunction(slope, 0.0 if slope == 1.0 else 0.1))
        if axis is not None:
            moved.setAxis(axis)
    return opensim.CustomJoint(*sides, transform)


def scaled_by_opensim(folder: Path, factors: dict[str, np.ndarray], mass: float | None, keeps_masses: bool) -> Model:
    model = opensim.Model(str(folder / "generic.osim"))
    state = model.initSystem()
    scales = opensim.ScaleSet()
    for name, factor in factors.items():
        scale = opensim.Scale()
        scale.setSegmentName(name)
        scale.setScaleFactors(opensim.Vec3(*factor.tolist()))
        scale.setApply(True)
        scales.cloneAndAppend(scale)
    assert model.scale(state, scales, keeps_masses, -1.0 if mass is None else mass)
    model.printToXML(str(folder / "scaled.osim"))
    return read_osim(folder / "scaled.osim")

"""Scaling against OpenSim's own Model.scale, at random factors."""

from __future__ import annotations

import xml.etree.ElementTree as Xml
from pathlib import Path

import numpy as np
import pytest

from solver.bundled import bundled_model
from solver.model import Model, ScapulothoracicMotion
from solver.osim.reader import read_osim
from solver.osim.writer import osim_document
from solver.scaling import Scaling, scale_model
from tests.solver.oracle.two_bodies import opensim

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
    for one, other in zip(ours.markers, theirs.markers, strict=True):
        np.testing.assert_allclose(one.location, other.location, atol=1e-12)
    for one, other in zip(ours.muscles, theirs.muscles, strict=True):
        assert one.optimal_fiber_length == pytest.approx(other.optimal_fiber_length, rel=1e-6)
        assert one.tendon_slack_length == pytest.approx(other.tendon_slack_length, rel=1e-6)


def scaled_by_opensim(folder: Path, factors: dict[str, np.ndarray], mass: float | None, keeps_masses: bool) -> Model:
    model = opensim.Model(str(folder / "generic.osim"))
    state = model.initSystem()
    scales = opensim.ScaleSet()
    for name, given in factors.items():
        scale = opensim.Scale()
        scale.setSegmentName(name)
        scale.setScaleFactors(opensim.Vec3(*given.tolist()))
        scale.setApply(True)
        scales.cloneAndAppend(scale)
    assert model.scale(state, scales, keeps_masses, -1.0 if mass is None else mass)
    model.printToXML(str(folder / "scaled.osim"))
    return read_osim(folder / "scaled.osim")

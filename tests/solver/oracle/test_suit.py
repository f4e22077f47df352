"""The suit against OpenSim's PathSpring and BushingForce, on the bundled model built through OpenSim's API."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from solver.bundled import bundled_model
from solver.cuff import CuffParameters
from solver.model import Model
from solver.multibody.postures import Postures, postures
from solver.multibody.rotations import rotate
from solver.suit.cord import SuitForces, cord_line, suit_forces, with_migration
from solver.suit.suit import SuitPoint, read_suit

opensim: Any = pytest.importorskip("opensim", reason="needs OpenSim: install the extra oracle")
certify: Any = pytest.importorskip("tests.solver.certify")

pytestmark = pytest.mark.oracle

Array = NDArray[np.float64]

ARM = CuffParameters("hand", "arm", stiffness=8520.0, damping=210.0, migration=0.012)
WAIST = CuffParameters("waist", "waist", stiffness=2140.0, damping=124.0, migration=0.02)
SUIT = replace(read_suit(), migration_direction="bone")  # a rest that OpenSim can hold still in its body
REST_LENGTH, INTERVAL = 0.6, 0.1


def test_cord_and_cuffs_pull_as_path_spring_and_bushing_forces_do() -> None:
    model = replace(bundled_model(), muscles=(), actuators=(), gravity=np.zeros(3))
    q, u = certify.chosen_states(model)
    state = postures(model, q, u)
    line = cord_line(SUIT, model, state, INTERVAL)
    worn = suit_forces(SUIT, line, np.array([REST_LENGTH]), (WAIST, ARM), is_shifted=True, yields=True)
    displacement = rotate(np.swapaxes(line.anchors_to_ground, -1, -2), worn.displacement)[0]
    velocity = np.diff(displacement, axis=0, prepend=displacement[:1]) / INTERVAL
    rest = with_migration(SUIT, line, (WAIST, ARM)).anchors
    oracle = SuitedOracle(model, _rest_in_body(line.anchors_to_ground, state, model, rest))
    found = [oracle.at(*each) for each in zip(q, u, displacement, velocity, strict=True)]
    assert worn.tension.min() > 10
    np.testing.assert_allclose(worn.tension[0], [tension for tension, _ in found], rtol=1e-10)
    expected = np.array([wrenches for _, wrenches in found])
    largest = np.abs(expected).max(axis=(0, 1))
    assert (np.abs(_wrenches(model, state, worn) - expected) < 1e-10 * largest).all()


class SuitedOracle:
    """The model in OpenSim with two cuffs as bodies of their own on bushings, and a path spring between them."""

    def __init__(self, model: Model, rests: Array) -> None:
        opensim.Logger.setLevelString("error")
        self.model, self.osim = model, certify.build(model)
        self.cuffs = [
            self._add_cuff(cuff, point, rest)
            for cuff, point, rest in zip((WAIST, ARM), (SUIT.waist, SUIT.arm), rests, strict=True)
        ]
        self.spring = opensim.PathSpring("cord", REST_LENGTH, SUIT.stiffness, 0.0)
        thorax = self.osim.getBodySet().get(SUIT.shoulder.body)
        places = [(self.cuffs[0], np.zeros(3)), (thorax, SUIT.shoulder.location), (self.cuffs[1], np.zeros(3))]
        for name, (body, location) in zip(("waist", "shoulder", "arm"), places, strict=True):
            self.spring.updGeometryPath().appendNewPathPoint(name, body, _vec3(location))
        self.osim.addForce(_given(self.spring))
        self.osim.finalizeConnections()
        self.state = self.osim.initSystem()

    def at(self, q: Array, u: Array, displacement: Array, velocity: Array) -> tuple[float, Array]:
        """Tension, and what suit and cuffs do to the model's bodies (bodies without ground, 6) about their origins."""
        coordinates = self.osim.getCoordinateSet()
        for name, value, speed in zip(self.model.coordinate_names, q, u, strict=True):
            self._set(coordinates.get(name), value, speed)
        for cuff, x, v in zip((WAIST, ARM), displacement, velocity, strict=True):
            joint = self.osim.getJointSet().get(f"{cuff.name}_joint")
            for axis in range(3):
                self._set(joint.get_coordinates(3 + axis), x[axis], v[axis])
        self.osim.realizeDynamics(self.state)
        wrenches = np.zeros((len(self.model.bodies), 6))
        for cuff, point in ((WAIST, SUIT.waist), (ARM, SUIT.arm)):
            record = opensim.BushingForce.safeDownCast(self.osim.getForceSet().get(f"{cuff.name}_bushing"))
            values = record.getRecordValues(self.state)
            force, moment = (np.array([values.get(first + axis) for axis in range(3)]) for first in (0, 3))
            wrenches[self.model.body_index(point.body)] += [*moment, *force]
        wrenches[self.model.body_index(SUIT.shoulder.body)] += self._pull_at_shoulder()
        return self.spring.getTension(self.state), wrenches[1:]

    def _pull_at_shoulder(self) -> list[float]:
        """Moment about the origin of the body that the cord passes, and force on it."""
        none = opensim.SpatialVec(opensim.Vec3(0), opensim.Vec3(0))
        bodies = self.osim.getBodySet()
        mobilized = [int(bodies.get(i).getMobilizedBodyIndex()) for i in range(bodies.getSize())]
        wrenches = opensim.VectorOfSpatialVec(1 + max(mobilized), none)
        mobility = opensim.Vector(self.state.getNU(), 0.0)
        path = opensim.GeometryPath.safeDownCast(self.spring.updPath())
        path.addInEquivalentForces(self.state, self.spring.getTension(self.state), wrenches, mobility)
        body = self.osim.getBodySet().get(SUIT.shoulder.body)
        wrench = wrenches.get(int(body.getMobilizedBodyIndex()))
        return [wrench.get(part).get(axis) for part in range(2) for axis in range(3)]

    def _set(self, coordinate: Any, value: float, speed: float) -> None:
        coordinate.setValue(self.state, float(value), False)
        coordinate.setSpeedValue(self.state, float(speed))

    def _add_cuff(self, cuff: CuffParameters, point: SuitPoint, rest: Array) -> Any:
        body = opensim.Body(cuff.name, 0.2, _vec3(np.zeros(3)), opensim.Inertia(1e-3, 1e-3, 1e-3))
        self.osim.addBody(_given(body))
        holder, zero = self.osim.getBodySet().get(point.body), _vec3(np.zeros(3))
        free = opensim.FreeJoint(f"{cuff.name}_joint", holder, _vec3(rest), zero, body, zero, zero)
        self.osim.addJoint(_given(free))
        frame = opensim.PhysicalOffsetFrame(f"{cuff.name}_rest", holder, opensim.Transform(_vec3(rest)))
        holder.addComponent(_given(frame))
        k, c = (_vec3(np.full(3, value)) for value in (cuff.stiffness, cuff.damping))
        bushing = opensim.BushingForce(f"{cuff.name}_bushing", frame, body, k, zero, c, zero)
        self.osim.addForce(_given(bushing))
        return body


def _rest_in_body(to_ground: Array, state: Postures, model: Model, rest: Array) -> Array:
    """(2, 3) where the shifted cuffs rest in their bodies; along the bone that is the same in all postures."""
    origins = state.origin_in_ground[:, [model.body_index(point.body) for point in (SUIT.waist, SUIT.arm)]]
    in_body = rotate(np.swapaxes(to_ground, -1, -2), rest - origins)
    np.testing.assert_allclose(in_body, in_body[:1].repeat(len(rest), axis=0), atol=1e-12)
    return in_body[0]


def _wrenches(model: Model, state: Postures, worn: SuitForces) -> Array:
    """(states, bodies without ground, 6) moment about each body's origin and force on it, in ground."""
    wrenches = np.zeros((len(state.coordinates), len(model.bodies), 6))
    for place, point in enumerate((SUIT.waist, SUIT.arm, SUIT.shoulder)):
        body, force = model.body_index(point.body), worn.forces[0, :, place]
        wrenches[:, body, 3:] += force
        wrenches[:, body, :3] += np.cross(worn.points[0, :, place] - state.origin_in_ground[:, body], force)
    return wrenches[:, 1:]


def _vec3(values: Array) -> Any:
    return opensim.Vec3(*(float(value) for value in values))


def _given(component: Any) -> Any:
    """Hands the component's memory to OpenSim, which deletes what is added to it."""
    component.thisown = False
    return component

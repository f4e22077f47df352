"""The suit against OpenSim: built through its API, as exported, and with a straight cord on a leg."""

from __future__ import annotations

import xml.etree.ElementTree as Xml
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from solver.bundled import bundled_model
from solver.cuff import CuffParameters
from solver.errors import SolverCode
from solver.model import Model
from solver.motion import Kinematics
from solver.multibody.dynamics import equations_of_motion, inverse_dynamics
from solver.multibody.postures import Postures, postures, rotate
from solver.osim.document import read_document
from solver.osim.model_reader import read_osim
from solver.osim.model_writer import osim_document
from solver.osim.suited import SuitedModel, add_suit, read_suited
from solver.suit.cord import Condition, SuitForces, SuitScenario, cord_line, suit_forces, with_migration
from solver.suit.suit import Suit, SuitMass, SuitPoint, read_suit, with_suit_masses
from tests.refusals import raises_refusal
from tests.solver.legs import leg
from tests.solver.oracle.two_bodies import given, opensim, vec3

certify: Any = pytest.importorskip("tests.solver.certify")


Array = NDArray[np.float64]

ARM = CuffParameters("hand", "arm", stiffness=8520.0, damping=210.0, migration=0.012)
WAIST = CuffParameters("waist", "waist", stiffness=2140.0, damping=124.0, migration=0.02)
SUIT = replace(read_suit(), migration_direction="bone")  # a rest that OpenSim can hold still in its body
REST_LENGTH, INTERVAL = 0.6, 0.1
MODEL = bundled_model()
EXPORTED_SUIT = read_suit()
EXPORTED_WAIST = CuffParameters("waist", "waist", 2140.0, 124.0, 0.012)
EXPORTED_ARM = CuffParameters("elbow", "arm", 2530.0, 139.0, 0.022)
LENGTH = np.array([0.55])  # taut in every posture
HEEL, THIGH = SuitPoint("foot", np.array([-0.07, -0.04, 0.01])), SuitPoint("thigh", np.array([-0.09, -0.2, -0.02]))
NOTHING = SuitMass("foot", 0.0, HEEL.location, np.zeros(3))
BAND = SuitMass("thigh", 0.3, np.array([0.0, -0.2, 0.0]), np.array([7e-4, 6e-4, 8e-4]))
LENGTHS = np.array([0.45])
STRAIGHT_SUIT = Suit(HEEL, HEEL, THIGH, 900.0, 0.0, (NOTHING, NOTHING, BAND), LENGTHS, 0.45, is_straight=True)
NAMES = {"waist": "heel", "shoulder": "shoulder", "arm": "left thigh"}
CUFF = CuffParameters("thigh", "arm", 2530.0, 139.0, 0.022)


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
            self.spring.updGeometryPath().appendNewPathPoint(name, body, vec3(*location))
        self.osim.addForce(given(self.spring))
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
        body = opensim.Body(cuff.name, 0.2, vec3(*np.zeros(3)), opensim.Inertia(1e-3, 1e-3, 1e-3))
        self.osim.addBody(given(body))
        holder, zero = self.osim.getBodySet().get(point.body), vec3(*np.zeros(3))
        free = opensim.FreeJoint(f"{cuff.name}_joint", holder, vec3(*rest), zero, body, zero, zero)
        self.osim.addJoint(given(free))
        frame = opensim.PhysicalOffsetFrame(f"{cuff.name}_rest", holder, opensim.Transform(vec3(*rest)))
        holder.addComponent(given(frame))
        k, c = (vec3(*np.full(3, value)) for value in (cuff.stiffness, cuff.damping))
        bushing = opensim.BushingForce(f"{cuff.name}_bushing", frame, body, k, zero, c, zero)
        self.osim.addForce(given(bushing))
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


class Loaded:
    """The written file in OpenSim, put into one posture after the other."""

    def __init__(self, suit: Suit, condition: Condition, folder: Path) -> None:
        opensim.Logger.setLevelString("error")
        worn = (None, None) if condition == "rigid" else (EXPORTED_WAIST, EXPORTED_ARM)
        self.wearing = SuitScenario(condition, *worn, LENGTH)
        root = osim_document(MODEL)
        add_suit(root, MODEL, suit, self.wearing)
        path = folder / "suited.osim"
        Xml.ElementTree(root).write(path, encoding="utf-8")
        self.osim = opensim.Model(str(path))
        self.state = self.osim.initSystem()
        self.spring = opensim.PathSpring.safeDownCast(self.osim.getForceSet().get("exotendon"))

    def put(self, q: Array, displacement: Array) -> None:
        """Coordinates of the model, and (2, 3) how far waist and arm cuff are from their rest, in their bodies."""
        coordinates = self.osim.getCoordinateSet()
        for name, value in zip(MODEL.coordinate_names, q, strict=True):
            coordinates.get(name).setValue(self.state, float(value), False)
        if self.wearing.yields:
            for part, shifts in zip(("waist", "arm"), displacement, strict=True):
                for axis, shift in zip("xyz", shifts, strict=True):
                    coordinates.get(f"{part}_cuff_{axis}").setValue(self.state, float(shift), False)
        self.osim.realizeVelocity(self.state)

    def bushing_force(self, part: str) -> Array:
        """On the cuff, in ground."""
        self.osim.realizeDynamics(self.state)
        force = opensim.BushingForce.safeDownCast(self.osim.getForceSet().get(f"{part}_cuff_bushing"))
        values = force.getRecordValues(self.state)
        return np.array([values.get(6 + axis) for axis in range(3)])


@pytest.fixture(scope="module")
def states() -> tuple[Array, Array]:
    q, _ = certify.chosen_states(MODEL)
    return q, np.zeros_like(q)


@pytest.mark.parametrize("condition", ["rigid", "shift", "visco_elastic", "both"])
@pytest.mark.parametrize("direction", ["cord", "bone"])
def test_the_cord_pulls_as_ours_with_the_cuffs_at_rest(
    condition: Condition, direction: Any, states: tuple[Array, Array], tmp_path: Path
) -> None:
    suit = replace(EXPORTED_SUIT, migration_direction=direction)
    state = postures(MODEL, *states)
    loaded = Loaded(suit, condition, tmp_path)
    line = cord_line(suit, MODEL, state, 0.01)
    ours = worn_forces(suit, loaded.wearing, states)
    in_bodies = rotate(np.swapaxes(line.anchors_to_ground, -1, -2), ours.displacement)[0]
    assert ours.tension.min() > 5
    for frame, (q, displacement) in enumerate(zip(states[0], in_bodies, strict=True)):
        loaded.put(q, displacement)
        assert loaded.spring.getTension(loaded.state) == pytest.approx(ours.tension[0, frame], rel=1e-10)
        if loaded.wearing.yields:  # the bushings hold the cuffs against the cord: what they do to the bodies is ours
            for place, part in enumerate(("waist", "arm")):
                np.testing.assert_allclose(-loaded.bushing_force(part), ours.forces[0, frame, place], atol=1e-8)


def worn_forces(suit: Suit, wearing: SuitScenario, states: tuple[Array, Array]) -> SuitForces:
    """Ours, each posture held still."""
    line = cord_line(suit, MODEL, postures(MODEL, *states), 0.01)
    still = [cuff and replace(cuff, damping=0.0) for cuff in wearing.cuffs]
    return suit_forces(suit, line, wearing.rest_lengths, still, is_shifted=wearing.is_shifted, yields=wearing.yields)


def test_rigid_cuffs_weigh_on_the_bodies_as_ours_do(states: tuple[Array, Array], tmp_path: Path) -> None:
    loaded = Loaded(EXPORTED_SUIT, "rigid", tmp_path)
    worn = with_suit_masses(MODEL, EXPORTED_SUIT)
    ours = equations_of_motion(worn, postures(worn, *states)).mass_matrix
    matter, mass = loaded.osim.getMatterSubsystem(), opensim.Matrix()
    for q, expected in zip(states[0], ours, strict=True):
        loaded.put(q, np.zeros((2, 3)))
        matter.calcM(loaded.state, mass)
        np.testing.assert_allclose(mass.to_numpy(), expected, atol=1e-12 * np.abs(expected).max())


def test_the_written_model_is_in_opensim_what_its_own_interface_builds(
    states: tuple[Array, Array], tmp_path: Path
) -> None:
    path = tmp_path / "bare.osim"
    Xml.ElementTree(osim_document(MODEL)).write(path, encoding="utf-8")
    q, u = certify.chosen_states(MODEL)
    written, built = (certify.Oracle(MODEL, *file).evaluate(q[-1], u[-1]) for file in ((path,), ()))
    at_rest = ("origin", "mass_matrix", "length", "speed", "factors", "acceleration_at_rest")
    for quantity in (*at_rest, "reaction_per_control"):
        expected = np.array(built[quantity])
        np.testing.assert_allclose(written[quantity], expected, atol=1e-10 * np.abs(expected).max(), err_msg=quantity)


def suited_file(folder: Path, suit: Suit, condition: Condition) -> tuple[Model, Path]:
    """The bare leg, and the file of the leg with the suit."""
    bare, path = folder / "bare.osim", folder / "suited.osim"
    bare.write_text(leg(), encoding="utf-8")
    root = Xml.parse(bare).getroot()  # noqa: S314  (our own text)
    add_suit(root, read_osim(bare), suit, SuitScenario(condition, None, CUFF, LENGTHS))
    Xml.ElementTree(root).write(path, encoding="utf-8")
    return read_osim(bare), path


def random_postures(model: Model) -> Kinematics:
    q = np.random.default_rng(8).uniform(-0.5, 0.5, size=(12, len(model.coordinates)))
    still = np.zeros_like(q)
    return Kinematics(np.arange(12) / 100, 0.01, q, still, still, None)


@pytest.mark.parametrize("condition", ["rigid", "shift", "visco_elastic", "both"])
def test_generalised_forces_of_the_cord_are_those_of_opensim(condition: Condition, tmp_path: Path) -> None:
    bare, path = suited_file(tmp_path, STRAIGHT_SUIT, condition)
    suited = read_suited(read_document(path))
    assert suited is not None
    motion = random_postures(bare)
    yields = condition in ("visco_elastic", "both")
    still = replace(suited, arm=replace(CUFF, damping=0.0) if yields else None)
    ours = inverse_dynamics(bare, motion) - inverse_dynamics(bare, motion, still.loads(motion))
    theirs = opensim_forces(path, bare, motion, cuff_shifts(suited, motion) if yields else None)
    assert np.abs(ours[:, bare.coordinate_index("knee_angle")]).min() > 1.0, "the cord is taut in every posture"
    np.testing.assert_allclose(ours, theirs, atol=1e-8 * np.abs(ours).max())


def cuff_shifts(suited: SuitedModel, motion: Kinematics) -> Array:
    """(frames, 3) of the cuff at the thigh from its rest, in the thigh's axes, at the equilibrium of an assessment."""
    line = cord_line(suited.suit, suited.bare, postures(suited.bare, motion.positions, motion.speeds), motion.interval)
    forces = suit_forces(suited.suit, line, suited.suit.rest_lengths, (None, replace(CUFF, damping=0.0)), yields=True)
    return np.asarray(rotate(np.swapaxes(line.anchors_to_ground, -1, -2), forces.displacement[0])[:, 1])


def opensim_forces(path: Path, bare: Model, motion: Kinematics, shifts: Array | None) -> Array:
    """(frames, coordinates of the bare leg) of cord and bushing; at the cuff's own coordinates they are in balance."""
    opensim.Logger.setLevelString("error")
    model = opensim.Model(str(path))
    state = model.initSystem()
    solver, names = opensim.InverseDynamicsSolver(model), names_of_mobilities(model, state)
    suit = [model.getForceSet().get(i) for i in range(model.getForceSet().getSize())]
    suit = [force for force in suit if force.getName() in ("exotendon", "arm_cuff_bushing")]
    found = []
    for frame, q in enumerate(motion.positions):
        values = dict(zip(bare.coordinate_names, q, strict=True))
        if shifts is not None:
            values |= dict(zip((f"arm_cuff_{axis}" for axis in "xyz"), shifts[frame], strict=True))
        for name, value in values.items():
            model.getCoordinateSet().get(name).setValue(state, float(value), False)
        with_and_without = []
        for is_on in (True, False):
            for force in suit:
                force.setAppliesForce(state, is_on)
            still = opensim.Vector(state.getNU(), 0.0)
            with_and_without.append(solver.solve(state, still).to_numpy())
        forces = dict(zip(names, with_and_without[1] - with_and_without[0], strict=True))
        if shifts is not None:
            np.testing.assert_allclose([forces.pop(f"arm_cuff_{axis}") for axis in "xyz"], 0.0, atol=1e-8)
        found.append([forces[name] for name in bare.coordinate_names])
    return np.array(found)


def names_of_mobilities(model: Any, state: Any) -> list[str]:
    """The coordinates in the order of the generalised forces: each is moved alone."""
    places = {}
    for coordinate in (model.getCoordinateSet().get(i) for i in range(model.getNumCoordinates())):
        coordinate.setLocked(state, False)
        coordinate.setSpeedValue(state, 1.0)
        places[int(state.getU().to_numpy().argmax())] = coordinate.getName()
        coordinate.setSpeedValue(state, 0.0)
    return [places[place] for place in range(len(places))]


@pytest.mark.parametrize("condition", ["rigid", "visco_elastic"])
def test_what_is_written_is_read_again(condition: Condition, tmp_path: Path) -> None:
    bare, path = suited_file(tmp_path, replace(STRAIGHT_SUIT, names=NAMES), condition)
    opensim.Model(str(path)).printToXML(str(path))
    suited = read_suited(read_document(path))
    assert suited is not None and suited.suit.is_straight and suited.waist is None
    for found, expected in zip(suited.suit.line, STRAIGHT_SUIT.line, strict=True):
        assert found.body == expected.body
        np.testing.assert_allclose(found.location, expected.location, atol=1e-12)
    assert [mass.mass for mass in suited.suit.masses] == [0.0, 0.0, 0.3]
    assert (suited.suit.stiffness, suited.suit.reference_rest_length) == (900.0, 0.45)
    assert suited.suit.names == NAMES | {"arm": "left_thigh"}, "OpenSim has no spaces in names"
    assert (suited.arm is None) == (condition == "rigid")
    assert [body.name for body in suited.bare.bodies] == [body.name for body in bare.bodies]


@pytest.mark.parametrize(
    ("place", "mass", "naming"),
    [(1, replace(NOTHING, mass=0.1), "masses.shoulder"), (2, replace(BAND, mass=0.0), "masses.arm")],
)
def test_a_mass_that_opensim_cannot_have_is_refused(place: int, mass: SuitMass, naming: str, tmp_path: Path) -> None:
    masses = list(STRAIGHT_SUIT.masses)
    masses[place] = mass
    with raises_refusal(SolverCode.SUIT_NOT_WRITABLE, naming):
        suited_file(tmp_path, replace(STRAIGHT_SUIT, masses=tuple(masses)), "both")

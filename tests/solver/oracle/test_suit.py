"""The suit against OpenSim: built through its API, as exported, and with a straight cord on a leg."""

import xml.etree.ElementTree as Xml
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solver.bundled import bundled_model
from solver.cuff import CuffParameters
from solver.errors import SolverCode
from solver.model import Array, Model
from solver.motion import Kinematics
from solver.multibody.dynamics import equations_of_motion, inverse_dynamics
from solver.multibody.postures import postures, rotate
from solver.osim.document import read_document
from solver.osim.model_reader import read_osim
from solver.osim.model_writer import osim_document
from solver.osim.suited import SuitedModel, add_suit, read_suited
from solver.suit.cord import Condition, SuitScenario, cord_line, suit_forces
from solver.suit.suit import Suit, SuitMass, SuitPoint, read_suit, with_suit_masses
from tests.refusals import raises_refusal
from tests.solver.legs import leg
from tests.solver.oracle.two_bodies import opensim, path_of, set_state, written

certify: Any = pytest.importorskip("tests.solver.certify")


INTERVAL = 0.1
MODEL = bundled_model()
STATES = certify.chosen_states(MODEL)
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


class Loaded:
    """The written file in OpenSim, put into one state after the other."""

    def __init__(self, suit: Suit, condition: Condition, folder: Path) -> None:
        worn = (None, None) if condition == "rigid" else (EXPORTED_WAIST, EXPORTED_ARM)
        self.wearing = SuitScenario(condition, *worn, LENGTH)
        root = osim_document(MODEL)
        add_suit(root, MODEL, suit, self.wearing)
        path = folder / "suited.osim"
        Xml.ElementTree(root).write(path, encoding="utf-8")
        self.osim = opensim.Model(str(path))
        self.state = self.osim.initSystem()
        self.spring = opensim.PathSpring.safeDownCast(self.osim.getForceSet().get("exotendon"))

    def put(self, q: Array, u: Array, displacement: Array, rates: Array) -> None:
        """Coordinates of the model, and (2, 3) how far waist and arm cuff are from their rest, in their bodies."""
        names, values, speeds = list(MODEL.coordinate_names), [q], [u]
        if self.wearing.yields:
            names += [f"{part}_cuff_{axis}" for part in ("waist", "arm") for axis in "xyz"]
            values, speeds = [q, displacement.ravel()], [u, rates.ravel()]
        coordinates = [self.osim.getCoordinateSet().get(name) for name in names]
        set_state(self.state, coordinates, np.concatenate(values), np.concatenate(speeds))
        self.osim.realizeDynamics(self.state)

    def points(self) -> list[Array]:
        """Where the cord begins, bends and ends, in ground."""
        points = path_of(self.spring).getPathPointSet()
        return [points.get(k).getLocationInGround(self.state).to_numpy() for k in range(3)]

    def wrench_of_bushing(self, part: str) -> Array:
        """Force on the body that the cuff is on, and its moment about the body's origin, in ground."""
        force = opensim.BushingForce.safeDownCast(self.osim.getForceSet().get(f"{part}_cuff_bushing"))
        return np.array([force.getRecordValues(self.state).get(k) for k in range(6)])


@pytest.mark.parametrize("condition", ["rigid", "shift", "visco_elastic", "both"])
@pytest.mark.parametrize("direction", ["cord", "bone"])
def test_cord_and_cuffs_pull_as_ours(condition: Condition, direction: Any, tmp_path: Path) -> None:
    """The cuffs are where ours are and move as they do: along the cord, only the cord of OpenSim's is longer."""
    suit, state = replace(EXPORTED_SUIT, migration_direction=direction), postures(MODEL, *STATES)
    loaded = Loaded(suit, condition, tmp_path)
    wearing, line = loaded.wearing, cord_line(suit, MODEL, state, INTERVAL)
    options = {"is_shifted": wearing.is_shifted, "yields": wearing.yields}
    ours = suit_forces(suit, line, wearing.rest_lengths, wearing.cuffs, **options)
    displacement = rotate(np.swapaxes(line.anchors_to_ground, -1, -2), ours.displacement)[0]
    rates = np.diff(displacement, axis=0, prepend=displacement[:1]) / INTERVAL
    assert ours.tension.min() > 5
    for frame, states in enumerate(zip(*STATES, displacement, rates, strict=True)):
        loaded.put(*states)
        tension, (waist, shoulder, arm) = loaded.spring.getTension(loaded.state), loaded.points()
        assert tension == pytest.approx(ours.tension[0, frame], rel=1e-10)
        pulls = np.array([tension * (shoulder - end) / np.linalg.norm(shoulder - end) for end in (waist, arm)])
        wrenches = [loaded.wrench_of_bushing(part) for part in ("waist", "arm")] if wearing.yields else []
        cuffs = [wrench[:3] for wrench in wrenches] or pulls
        np.testing.assert_allclose(ours.forces[0, frame], [*cuffs, -pulls.sum(axis=0)], atol=1e-8)
        if direction == "bone" or not wearing.is_shifted:
            np.testing.assert_allclose(ours.points[0, frame], [waist, arm, shoulder], atol=1e-12)
            for wrench, point, place in zip(wrenches, (suit.waist, suit.arm), (waist, arm), strict=False):
                lever = place - state.origin_in_ground[frame, MODEL.body_index(point.body)]
                np.testing.assert_allclose(wrench[3:], np.cross(lever, wrench[:3]), atol=1e-8)


def test_rigid_cuffs_weigh_on_the_bodies_as_ours_do(tmp_path: Path) -> None:
    loaded, worn = Loaded(EXPORTED_SUIT, "rigid", tmp_path), with_suit_masses(MODEL, EXPORTED_SUIT)
    ours = equations_of_motion(worn, postures(worn, *STATES)).mass_matrix
    matter, mass = loaded.osim.getMatterSubsystem(), opensim.Matrix()
    for q, u, expected in zip(*STATES, ours, strict=True):
        loaded.put(q, u, np.zeros((2, 3)), np.zeros((2, 3)))
        matter.calcM(loaded.state, mass)
        np.testing.assert_allclose(mass.to_numpy(), expected, atol=1e-12 * np.abs(expected).max())


def test_the_written_model_is_in_opensim_what_its_own_interface_builds(tmp_path: Path) -> None:
    path, (q, u) = written(MODEL, tmp_path / "bare.osim"), STATES
    found, built = (certify.Oracle(MODEL, *file).evaluate(q[-1], u[-1]) for file in ((path,), ()))
    at_rest = ("origin", "mass_matrix", "length", "speed", "factors", "acceleration_at_rest")
    for quantity in (*at_rest, "reaction_per_control"):
        expected = np.array(built[quantity])
        np.testing.assert_allclose(found[quantity], expected, atol=1e-10 * np.abs(expected).max(), err_msg=quantity)


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
    model = opensim.Model(str(path))
    state = model.initSystem()
    solver, names = opensim.InverseDynamicsSolver(model), names_of_mobilities(model, state)
    suit = [force for force in model.getForceSet() if force.getName() in ("exotendon", "arm_cuff_bushing")]
    cuff = [f"arm_cuff_{axis}" for axis in "xyz"] if shifts is not None else []
    coordinates = [model.getCoordinateSet().get(name) for name in (*bare.coordinate_names, *cuff)]
    positions = motion.positions if shifts is None else np.hstack([motion.positions, shifts])
    found = []
    for q in positions:
        for coordinate, value in zip(coordinates, q, strict=True):
            coordinate.setValue(state, float(value), False)
        with_and_without = []
        for is_on in (True, False):
            for force in suit:
                force.setAppliesForce(state, is_on)
            still = opensim.Vector(state.getNU(), 0.0)
            with_and_without.append(solver.solve(state, still).to_numpy())
        forces = dict(zip(names, with_and_without[1] - with_and_without[0], strict=True))
        np.testing.assert_allclose([forces[name] for name in cuff], 0.0, atol=1e-8)
        found.append([forces[name] for name in bare.coordinate_names])
    return np.array(found)


def names_of_mobilities(model: Any, state: Any) -> list[str]:
    """The coordinates in the order of the generalised forces: each is moved alone."""
    places = {}
    for coordinate in model.getCoordinateSet():
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

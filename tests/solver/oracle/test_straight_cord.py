"""A straight cord on a leg exported: OpenSim's generalised forces are ours, and the suit can be read again."""

from __future__ import annotations

import xml.etree.ElementTree as Xml
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from solver.cuff import CuffParameters
from solver.errors import SolverCode
from solver.model import Model
from solver.motion import Kinematics
from solver.multibody.dynamics import inverse_dynamics
from solver.multibody.postures import postures
from solver.multibody.rotations import rotate
from solver.osim.document import read_document
from solver.osim.model_reader import read_osim
from solver.osim.suited import add_suit, read_suited
from solver.suit.cord import cord_line, suit_forces
from solver.suit.scenarios import Condition, SuitScenario
from solver.suit.suit import Suit, SuitMass, SuitPoint
from solver.suit.suited_model import SuitedModel
from tests.solver.legs import leg
from tests.solver.refusals import raises_refusal

opensim: Any = pytest.importorskip("opensim", reason="needs OpenSim: install the extra oracle")

pytestmark = pytest.mark.oracle

Array = NDArray[np.float64]
HEEL, THIGH = SuitPoint("foot", np.array([-0.07, -0.04, 0.01])), SuitPoint("thigh", np.array([-0.09, -0.2, -0.02]))
NOTHING = SuitMass("foot", 0.0, HEEL.location, np.zeros(3))
BAND = SuitMass("thigh", 0.3, np.array([0.0, -0.2, 0.0]), np.array([7e-4, 6e-4, 8e-4]))
LENGTHS = np.array([0.45])
SUIT = Suit(HEEL, HEEL, THIGH, 900.0, 0.0, (NOTHING, NOTHING, BAND), LENGTHS, 0.45, is_straight=True)
NAMES = {"waist": "heel", "shoulder": "shoulder", "arm": "left thigh"}
CUFF = CuffParameters("thigh", "arm", 2530.0, 139.0, 0.022)


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
    bare, path = suited_file(tmp_path, SUIT, condition)
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
    bare, path = suited_file(tmp_path, replace(SUIT, names=NAMES), condition)
    opensim.Model(str(path)).printToXML(str(path))
    suited = read_suited(read_document(path))
    assert suited is not None and suited.suit.is_straight and suited.waist is None
    for found, expected in zip(suited.suit.line, SUIT.line, strict=True):
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
    masses = list(SUIT.masses)
    masses[place] = mass
    with raises_refusal(SolverCode.SUIT_NOT_WRITABLE, naming):
        suited_file(tmp_path, replace(SUIT, masses=tuple(masses)), "both")

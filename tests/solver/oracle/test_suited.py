"""The exported suit as OpenSim has it: the same cord, the same equilibrium of the cuffs, the same masses."""

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
from solver.multibody.dynamics import equations_of_motion
from solver.multibody.postures import postures
from solver.multibody.rotations import rotate
from solver.osim.model_writer import osim_document
from solver.osim.suited import add_suit
from solver.suit.cord import SuitForces, cord_line, suit_forces
from solver.suit.scenarios import Condition, SuitScenario
from solver.suit.suit import Suit, read_suit, with_suit_masses

opensim: Any = pytest.importorskip("opensim", reason="needs OpenSim: install the extra oracle")
certify: Any = pytest.importorskip("tests.solver.certify")

pytestmark = pytest.mark.oracle

Array = NDArray[np.float64]

MODEL = bundled_model()
SUIT = read_suit()
WAIST = CuffParameters("waist", "waist", 2140.0, 124.0, 0.012)
ARM = CuffParameters("elbow", "arm", 2530.0, 139.0, 0.022)
LENGTH = np.array([0.55])  # taut in every posture


class Loaded:
    """The written file in OpenSim, put into one posture after the other."""

    def __init__(self, suit: Suit, condition: Condition, folder: Path) -> None:
        opensim.Logger.setLevelString("error")
        worn = (None, None) if condition == "rigid" else (WAIST, ARM)
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
    suit = replace(SUIT, migration_direction=direction)
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
    loaded = Loaded(SUIT, "rigid", tmp_path)
    worn = with_suit_masses(MODEL, SUIT)
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
    for quantity in (
        "origin",
        "mass_matrix",
        "length",
        "speed",
        "factors",
        "acceleration_at_rest",
        "reaction_per_control",
    ):
        expected = np.array(built[quantity])
        np.testing.assert_allclose(written[quantity], expected, atol=1e-10 * np.abs(expected).max(), err_msg=quantity)

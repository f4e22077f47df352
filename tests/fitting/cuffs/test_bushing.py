"""A fitted cuff as OpenSim's BushingForce."""

from __future__ import annotations

from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from fitting.cuffs.cuff_fit import CuffFit
from fitting.cuffs.wearable_cuff import bushing_force
from fitting.results.codes import FitErrorCode, Verdict
from fitting.uncertainty import normal_estimate
from tests.fitting.refusals import raises_refusal

FIT = CuffFit(
    name="hand",
    site="arm",
    donning="1",
    stiffness=normal_estimate(8520.5, 10.0),
    damping=normal_estimate(210.25, 6.0),
    migration=normal_estimate(0.012, 1e-5),
    verdicts=(Verdict.IDENTIFIED,),
    covariance=np.zeros((3, 3)),
)


def test_its_translational_terms_are_the_cuffs_figures() -> None:
    element = ElementTree.fromstring(bushing_force(FIT.wearable()))  # noqa: S314
    assert element.tag == "BushingForce"
    assert element.get("name") == "hand_cuff"
    texts = {child.tag: child.text for child in element if isinstance(child.tag, str)}
    assert texts["translational_stiffness"] == "8520.5 8520.5 8520.5"
    assert texts["translational_damping"] == "210.25 210.25 210.25"
    assert texts["rotational_stiffness"] == "0 0 0"


def test_a_cuff_without_damping_has_no_bushing() -> None:
    with raises_refusal(FitErrorCode.NOT_IDENTIFIED, cuff="hand", missing="damping"):
        bushing_force(replace(FIT, damping=None).wearable())


@pytest.mark.oracle
def test_opensim_knows_every_element_of_it() -> None:
    simulation = pytest.importorskip("opensim.simulation", reason="OpenSim is not installed")
    force = simulation.BushingForce()
    element = ElementTree.fromstring(bushing_force(FIT.wearable()))  # noqa: S314
    known = {force.getPropertyByIndex(i).getName() for i in range(force.getNumProperties())}
    assert {child.tag for child in element if isinstance(child.tag, str) and "socket" not in child.tag} <= known

"""`station rmr` without some forces of its model: the results and a sentence have what that changes."""

from __future__ import annotations

import json
import xml.etree.ElementTree as Xml
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from solver.bundled import bundled_model
from solver.forces.passive_forces import PathSpring
from solver.osim.model_writer import osim_document
from solver.redundancy.redundancy_options import RedundancyOptions
from station.assessment.given_motion import MotionCut, MuscleInputs
from station.assessment.rmr import SolvedMotion, left_out_findings, solve_muscles
from tests.station.command import Ran

MODEL = bundled_model()
CUT = MotionCut(every=60)


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The bundled model with a spring, and with contact that the solver does not have."""
    path = MODEL.muscles[MODEL.muscle_names.index("DeltoideusScapula_M")].path
    spring = PathSpring("band", path, 0.05, 300.0, 0.0)
    text = Xml.tostring(osim_document(replace(MODEL, forces=(spring,))), encoding="unicode")
    written = tmp_path_factory.mktemp("model") / "own.osim"
    lost = "<ElasticFoundationForce name='sole'/></objects></ForceSet>"
    written.write_text(text.replace("</objects></ForceSet>", lost), encoding="utf-8")
    return written


def solved(file: Path, *left_out: str) -> SolvedMotion:
    return solve_muscles(MuscleInputs(None, str(file), None, None, True, left_out), CUT, RedundancyOptions())


def test_a_force_left_out_by_name_does_not_act_and_its_load_is_reported(file: Path) -> None:
    found, bare = solved(file, "band"), solve_muscles(MuscleInputs(), CUT, RedundancyOptions())
    np.testing.assert_allclose(found.solution.activations, bare.solution.activations, atol=1e-9)
    assert np.abs(solved(file).solution.activations - bare.solution.activations).max() > 0.01
    load = json.loads(found.notes["left_out_effect"])["loads"]["band"]
    assert next(iter(load)) in ("shoulder_elv", "scapula_upward_rot", "plane_elv")
    (sentence,) = map(str, left_out_findings(found.model, found.left_out))
    assert f"band would give {next(iter(load.values())):.3g} N m at {next(iter(load))}" in sentence


def test_the_share_of_reserves_is_reported_where_the_solver_lacks_a_force(file: Path) -> None:
    found = solved(file)
    assert found.model.lacking == ("sole",)
    given, needed = json.loads(found.notes["left_out_effect"])["reserve_and_needed"]["ground_thorax_ty"]
    vertical = MODEL.coordinate_index("ground_thorax_ty")
    assert needed == pytest.approx(9.80665 * sum(body.mass for body in MODEL.bodies), rel=0.02)
    assert given == pytest.approx(np.sqrt((found.solution.reserves[:, 4] ** 2).mean()), rel=1e-12)
    assert MODEL.actuators[4].coordinate == vertical
    (sentence,) = map(str, left_out_findings(found.model, found.left_out))
    assert f"carry the loads of sole; reserves give {given:.3g} of {needed:.3g} N at ground_thorax_ty" in sentence


def test_the_options_reach_the_table(file: Path, station, tmp_path: Path) -> None:
    table = tmp_path / "a.csv"
    ran: Ran = station(
        "rmr", "--model", file, "--ignore-forces", "--leave-out", "band", "--to", "0.02", "--output", table
    )
    assert ran.code == 0, ran.err
    assert "Left out of the model: ElasticFoundationForce sole, band. band would give" in ran.err
    assert "left_out_effect" in table.read_text(encoding="utf-8")


def test_an_unknown_force_to_leave_out_is_refused_with_those_there(file: Path, station, tmp_path: Path) -> None:
    ran: Ran = station("rmr", "--model", file, "--ignore-forces", "--leave-out", "rope", "--output", tmp_path / "a.csv")
    assert ran.code == 1
    assert "rope to leave out; it has band" in ran.err

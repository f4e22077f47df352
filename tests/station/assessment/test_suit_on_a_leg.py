"""A suit on a leg: the files of examples/leg, from the command line to the report."""

from __future__ import annotations

import json
import runpy
import sys
import xml.etree.ElementTree as Xml
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from solver.cuff import CuffParameters
from solver.errors import SolverCode
from solver.model import Model
from solver.motion import decimate, differentiate, read_motion, read_table
from solver.multibody.postures import Postures, jacobians, postures
from solver.multibody.rotations import wrench_about_origin
from solver.osim.reader import read_osim
from solver.suit.cord import cord_line, suit_forces
from solver.suit.optimise import optimise_suit
from solver.suit.scenarios import LoadedMotion
from solver.suit.suit import Suit, SuitError, read_suit, suit_toml
from tests.solver.refusals import raises_refusal

LEG = Path(__file__).parents[3] / "examples" / "leg"
FILES = ("--model", LEG / "leg.osim", "--motion", LEG / "stride.mot", "--external-loads", LEG / "ground.xml")
SUIT_FILES = ("--suit", LEG / "shank_suit.toml", "--cuffs", LEG / "shank.json", "--effort", LEG / "effort.toml")


@pytest.fixture(scope="module")
def leg() -> Model:
    return read_osim(LEG / "leg.osim")


@pytest.fixture(scope="module")
def suit() -> Suit:
    return read_suit(LEG / "shank_suit.toml")


def test_the_files_are_those_that_their_script_writes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["make_leg.py", str(tmp_path)])
    runpy.run_path(str(LEG / "make_leg.py"), run_name="__main__")
    written = {path.name for path in tmp_path.iterdir()}
    assert written == {path.name for path in LEG.iterdir() if path.suffix not in (".py", "")}
    for name in written:
        if name.endswith(".mot"):
            tables = [read_table(folder / name) for folder in (LEG, tmp_path)]
            assert tables[0][0] == tables[1][0]
            np.testing.assert_allclose(tables[0][1], tables[1][1], atol=1e-6)
        else:
            assert (tmp_path / name).read_text() == (LEG / name).read_text()


def test_the_files_give_a_report_with_the_words_of_the_leg(station, tmp_path: Path) -> None:
    ran = station("assess", *FILES, *SUIT_FILES, "--cutoff-hz", 6, "--output", tmp_path)
    assert ran.code in (0, 3)
    plain = json.loads((tmp_path / "assessment.json").read_text())
    assert "model.no_glenoid" in {finding["code"] for finding in plain["finding_codes"]}
    assert plain["suit_names"] == {"waist": "heel", "shoulder": "shoulder", "arm": "shank"}
    assert plain["inputs"]["cutoff_hz"] == "6" and plain["inputs"]["effort"].startswith("effort.toml ")
    assert plain.get("beside") is None
    lengths = [posture["cord_length_m"]["value"] for posture in plain["postures"]]
    assert lengths == sorted(lengths) and {posture["chosen_by"] for posture in plain["postures"]} == {"cord_length"}
    assert set(plain["postures"][0]["cuffs_m"]) == {"arm"}, "the heel has no mass, and so no ring"
    rigid, yielding = plain["optimum"]["rigid"], plain["optimum"]["shank"]["visco_elastic"]
    assert rigid["normalised_cost"]["value"] < yielding["normalised_cost"]["value"] - 0.05 < 0.9
    page = (tmp_path / "report.html").read_text()
    for word in ("shank cuff", "heel is rigid", "shortest cord", "longest cord"):
        assert word in page, word
    for word in ("arm cuff", "lowest arm", "bundled suit", "Another motion is shown"):
        assert word not in page, word


def test_the_muscles_do_what_the_ground_demands_of_the_ankle(station, tmp_path: Path) -> None:
    words = (
        "rmr",
        *FILES,
        "--effort",
        LEG / "effort.toml",
        "--cutoff-hz",
        6,
        "--joint",
        "ankle",
        "--reaction-in",
        "child",
    )
    assert station(*words, "--output", tmp_path / "leg.csv").code == 0
    found = pd.read_csv(tmp_path / "leg.csv", comment="#")
    names, values, _ = read_table(LEG / "ground.mot")
    forces = dict(zip(names, values.T, strict=True))
    late = found["time"] > 0.4 * 1.3
    late &= found["time"] < 0.5 * 1.3
    # the muscles of the calf hold the moment of the ground's force about the ankle, and press the ankle by as much
    calf = found["force_n.soleus"] + found["force_n.gastrocnemius"]
    moment = forces["force_y"] * forces["point_x"] - forces["force_x"] * forces["point_y"]  # the foot is nearly level
    lever = moment[late] / calf[late]
    assert 0.03 < lever.min() < lever.max() < 0.07
    pressed = np.hypot(
        found["reaction_force_n.ankle_on_foot_in_foot.x"], found["reaction_force_n.ankle_on_foot_in_foot.y"]
    )
    np.testing.assert_allclose(pressed[late], (calf + forces["force_y"])[late], rtol=0.1)


@pytest.mark.parametrize("condition", ["rigid", "shifted", "along the bone", "yielding at both ends"])
def test_a_straight_cord_pulls_with_the_slope_of_its_energy(leg: Model, suit: Suit, condition: str) -> None:
    state, length = stride_of(leg), np.array([0.316])
    direction = "bone" if condition == "along the bone" else "cord"
    suit = replace(suit, migration_direction=direction)
    cuff = CuffParameters("shank", "arm", 8520.0, 0.0, 0.012 if condition in ("shifted", "along the bone") else 0.0)
    other = replace(cuff, name="heel", site="waist", stiffness=5000.0, migration=0.0)
    cuffs = (other, cuff) if condition == "yielding at both ends" else (None, cuff)
    options = {"is_shifted": condition in ("shifted", "along the bone"), "yields": condition == "yielding at both ends"}
    springs = [suit.stiffness, 5000.0, 8520.0] if options["yields"] else [suit.stiffness]
    series = 1.0 / sum(1.0 / spring for spring in springs)

    def pulled(moved: Postures) -> tuple[np.ndarray, np.ndarray]:
        found = suit_forces(suit, cord_line(suit, leg, moved, 0.01), length, cuffs, **options)
        wrenches = np.zeros((len(moved.coordinates), len(leg.bodies), 6))
        for place, point in enumerate((suit.waist, suit.arm, suit.shoulder)):
            wrenches[:, leg.body_index(point.body)] += wrench_about_origin(
                found.points[0, :, place], found.forces[0, :, place]
            )
        np.testing.assert_allclose(wrenches.sum(axis=1), 0.0, atol=1e-9)
        return np.einsum("fbi,fbij->fj", wrenches, jacobians(leg, moved)), found.tension[0] ** 2 / (2 * series)

    force, _ = pulled(state)
    assert np.abs(force).max() > 2.0
    step = 1e-6
    for coordinate in range(len(leg.coordinates)):
        ends = []
        for sign in (1.0, -1.0):
            q = state.coordinates.copy()
            q[:, coordinate] += sign * step
            ends.append(pulled(postures(leg, q, np.zeros_like(q)))[1])
        np.testing.assert_allclose(force[:, coordinate], -(ends[0] - ends[1]) / (2 * step), atol=1e-4)


def stride_of(leg: Model) -> Postures:
    motion = decimate(differentiate(read_motion(LEG / "stride.mot", leg), None), 10)
    return postures(leg, motion.positions, np.zeros_like(motion.positions))


def test_a_suit_file_is_written_and_read_the_same(suit: Suit, tmp_path: Path) -> None:
    (tmp_path / "again.toml").write_text(suit_toml(suit))
    again = read_suit(tmp_path / "again.toml")
    assert again.is_straight and again.names == suit.names and again.groups == suit.groups
    assert [mass.mass for mass in again.masses] == [mass.mass for mass in suit.masses] == [0.0, 0.0, 0.2]
    assert [point.body for point in again.line] == ["foot", "shank"]


def test_a_straight_cord_is_not_exported_and_has_no_guide_to_move(leg: Model, suit: Suit) -> None:
    from solver.osim.suited import add_suit
    from solver.suit.scenarios import SuitScenario

    motion = differentiate(read_motion(LEG / "stride.mot", leg), None)
    scenario = SuitScenario("rigid", None, None, np.array([0.33]))
    with raises_refusal(SolverCode.SUIT_NOT_WRITABLE, naming="exotendon.shoulder"):
        add_suit(Xml.parse(LEG / "leg.osim").getroot(), leg, suit, scenario)  # noqa: S314
    cuff = CuffParameters("shank", "arm", 8520.0, 210.0, 0.012)
    with pytest.raises(SuitError):
        optimise_suit(LoadedMotion(leg, motion), suit, (None, cuff), free=("shoulder",))

"""A suit on a leg: the files of examples/leg, from the command line to the report."""

import json
import runpy
import sys
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import cuffstation as cs
from fitting.results.codes import FitErrorCode
from solver.cuff import CuffParameters
from solver.model import Model
from solver.motion import decimate, differentiate, read_motion
from solver.multibody.postures import Postures, jacobians, postures, wrench_about_origin
from solver.osim.loads_document import read_external_loads
from solver.osim.model_reader import read_osim
from solver.redundancy.effort import RedundancyOptions, options_for
from solver.redundancy.motion_solution import LoadedMotion
from solver.suit.cord import SuitScenario, cord_line, suit_forces
from solver.suit.optimise import optimise_suit
from solver.suit.scenarios import prepare_suited_motion, solve_scenarios
from solver.suit.suit import Suit, SuitError, read_suit, suit_toml
from solver.time_series_table import read_table, write_table
from station.exit_code import FAILED
from tests.refusals import raises_refusal
from tests.solver.legs import PELVIS, step_in
from tests.station.command import assert_refused

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
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert 'id="given"' in page and 'id="doubts"' not in page, "figures by hand are no change of a file"
    assert plain["reference_rest_length_m"]["value"] == 0.328  # in a range of 34 mm, millimetres matter
    for word in ("shank cuff", "heel is rigid", "shortest, middle and longest cord", "0.328 m"):
        assert word in page, word
    for word in ("arm cuff", "lowest arm", "bundled suit", "Another motion is shown"):
        assert word not in page, word


def test_the_results_of_the_library_have_the_findings_of_the_command_line(leg: Model, station, tmp_path: Path) -> None:
    assert station("assess", *FILES, *SUIT_FILES[:4], "--people", 0, "--output", tmp_path).code in (0, 3)
    plain = json.loads((tmp_path / "assessment.json").read_text())
    motion = cs.load_motion(leg, LEG / "stride.mot")
    cuffs, loads = cs.read_cuffs(LEG / "shank.json"), LEG / "ground.xml"
    assessment = cs.assess(cuffs, leg, motion, LEG / "shank_suit.toml", people=0, external_loads=loads)
    assert [found.code for found in assessment.findings] == [found["code"] for found in plain["finding_codes"]]
    assert list(map(str, assessment.findings)) == plain["findings"]
    assert [found.code for found in motion.findings] == ["motion.low_cutoff"]
    assert "findings: motion.low_cutoff" in repr(motion) and "model.no_glenoid" in repr(assessment)


def test_migration_against_the_pull_is_a_finding_and_negative_damping_refused(
    leg: Model, station, tmp_path: Path
) -> None:
    cuffs = tmp_path / "shank.json"
    suit, options = LEG / "shank_suit.toml", ("--cuffs", cuffs, "--output", tmp_path / "out")
    for damping, migration, is_refused in ((210, -0.012, False), (-210, 0.012, True)):
        figures = {"stiffness_n_per_m": 8520, "damping_n_s_per_m": damping, "migration_m": migration}
        cuffs.write_text(json.dumps({"cuffs": {"shank": figures}}))
        for verb, undrawn in (("assess", "--people"), ("optimise", "--draws")):
            ran = station(verb, *FILES, "--suit", suit, *options, undrawn, 0)
            if is_refused:
                assert_refused(ran, FAILED, FitErrorCode.CUFFS_INVALID)
            else:
                assert "The migration of shank is −12.0 mm" in ran.err
        with raises_refusal(FitErrorCode.CUFFS_INVALID) if is_refused else nullcontext():
            motion = cs.load_motion(leg, LEG / "stride.mot", every=20)
            found = cs.assess(cs.read_cuffs(cuffs), leg, motion, suit, people=0, external_loads=LEG / "ground.xml")
            assert "cuffs.negative_migration" in [finding.code for finding in found.findings]


def test_a_solution_of_the_library_says_that_reserves_give_what_muscles_should(tmp_path: Path) -> None:
    step = step_in(tmp_path)
    actuators = "".join(
        f'<CoordinateActuator name="{name}_r"><coordinate>{name}</coordinate><optimal_force>500</optimal_force>'
        "</CoordinateActuator>"
        for name in (*PELVIS, "hip_flexion", "hip_adduction", "hip_rotation", "knee_angle", "ankle_angle")
    )
    text = step.model.read_text()
    (tmp_path / "strong.osim").write_text(text.replace("<ForceSet><objects>", f"<ForceSet><objects>{actuators}"))
    model = cs.load_model(tmp_path / "strong.osim")
    motion = cs.load_motion(model, step.motion, every=8)
    solution = cs.solve_motion(model, motion, external_loads=step.loads)
    codes = ["motion.without_data", "reserves.large.at_coordinates", "residuals.large"]
    assert [found.code for found in solution.findings] == codes  # the ground reaction is not that of the step
    assert "knee_angle" in str(solution.findings[1]) and "pelvis" not in str(solution.findings[1])


@pytest.mark.parametrize("wrong", [("--people", 100), ("--indices", 8), ("--donnings", LEG)])
def test_elastic_tendons_are_refused_with_people(station, tmp_path: Path, wrong: tuple[object, ...]) -> None:
    refused = station("assess", *FILES, *SUIT_FILES, "--tendons", "elastic", *wrong, "--output", tmp_path / "out")
    assert refused.code == 2 and not (tmp_path / "out").exists()


def test_the_muscles_do_what_the_ground_demands_of_the_ankle(station, tmp_path: Path) -> None:
    words = ("--effort", LEG / "effort.toml", "--cutoff-hz", 6, "--joint", "ankle", "--reaction-in", "child")
    assert station("rmr", *FILES, *words, "--output", tmp_path / "leg.csv").code == 0
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


def test_what_is_wrong_with_motion_and_loads_is_a_finding_of_assessment_and_optimum(station, tmp_path: Path) -> None:
    step = step_in(tmp_path)
    names, values, _ = read_table(step.motion)
    values[:, names.index("patella_angle")] += 0.1
    uneven = values[:, 0] + np.where(np.arange(len(values)) % 2, 2e-3, 0.0)
    write_table(step.motion, names[1:], uneven, values[:, 1:])
    step.motion.write_text(step.motion.read_text().replace("nRows=81", "nRows=500"))
    text = step.loads.read_text()
    step.loads.write_text(text.replace("</ExternalForce>", "<appliesForce>false</appliesForce></ExternalForce>"))
    suit = (LEG / "shank_suit.toml").read_text().split("[groups]")[0]
    (tmp_path / "suit.toml").write_text(suit.replace("first = 0.31", "first = 0.24"))
    reserves = [f"{name} = {{ optimal_force = 100.0 }}" for name in (*PELVIS, "hip_adduction", "hip_rotation")]
    (tmp_path / "effort.toml").write_text("[reserves]\n" + "\n".join(reserves))
    files = ("--model", step.model, "--motion", step.motion, "--external-loads", step.loads, "--cutoff-hz", 6)
    files += ("--suit", tmp_path / "suit.toml", "--cuffs", LEG / "shank.json", "--effort", tmp_path / "effort.toml")
    ran = station("assess", *files, "--people", 0, "--output", tmp_path / "assessed")
    assert ran.code in (0, 3) and "patella_angle 0.1 rad" in ran.err
    plain = json.loads((tmp_path / "assessed" / "assessment.json").read_text())
    codes = {finding["code"]: finding["figures"] for finding in plain["finding_codes"]}
    assert codes["motion.without_data"] == {"coordinates": "toe_angle"}, "which is locked"
    assert codes["motion.violates_constraint"] == {"coordinates": "patella_angle 0.1 rad"}
    assert codes["motion.row_counts"] == {"rows": "nRows 500, found 81"}
    assert codes["motion.resampled"] == {"steps": "0.008 to 0.012"}
    assert codes["loads.none_applied"] == {"file": "loads.xml"}
    assert "patella_angle 0.1 rad" in (tmp_path / "assessed" / "report.html").read_text(encoding="utf-8")
    ran = station("optimise", *files, "--draws", 0, "--output", tmp_path / "optimum")
    assert "patella_angle 0.1 rad" in ran.err
    remarks = " ".join(json.loads((tmp_path / "optimum" / "optimum.json").read_text())["remarks"])
    assert "patella_angle 0.1 rad" in remarks and "toe_angle" in remarks
    assert "nRows 500, found 81" in remarks
    assert "0.008 to 0.012 s" in remarks and "No external load is applied: loads.xml" in remarks


def test_people_with_other_legs_have_the_masses_of_the_model(station, tmp_path: Path) -> None:
    ran = station("assess", *FILES, *SUIT_FILES, "--people", 40, "--output", tmp_path)
    assert ran.code in (0, 3)
    plain = json.loads((tmp_path / "assessment.json").read_text())
    assert "model.no_arm_segments" in {finding["code"] for finding in plain["finding_codes"]}


def test_an_exported_cord_is_worn_by_inverse_dynamics(station, tmp_path: Path) -> None:
    """In late stance the cord behind the ankle gives a part of its moment, and nothing of that of hip and knee."""
    suited = tmp_path / "suited.osim"
    given = ("--suit", LEG / "shank_suit.toml", "--cuffs", LEG / "shank.json", "--condition", "rigid")
    ran = station("export", "--osim", "--model", LEG / "leg.osim", *given, "--output", suited)
    assert ran.code == 0, ran.err
    found = []
    for model in (LEG / "leg.osim", suited):
        out = tmp_path / f"{model.stem}.sto"
        assert station("id", "--model", model, *FILES[2:], "--output", out).code == 0
        names, values, _ = read_table(out)
        found.append(dict(zip(names, values.T, strict=True)))
    worn = "suit=cord 15000 N/m, resting length with migration 0.328 m, heel cuff rigid, shank cuff rigid"
    assert worn in out.read_text()
    less = found[0]["ankle_angle_moment"] - found[1]["ankle_angle_moment"]
    assert 5.0 < np.abs(less).max() < 0.5 * np.abs(found[0]["ankle_angle_moment"]).max()
    weight = 0.2 * 9.81 + 2.0  # N, of the cuff, and what its acceleration takes
    assert np.abs(found[0]["knee_angle_moment"] - found[1]["knee_angle_moment"]).max() < 0.2 * weight


def test_the_best_rest_length_of_a_stride_is_that_of_all_its_frames(leg: Model, suit: Suit) -> None:
    """A stride has 131 frames; every 20th of them alone would be 7, with a cord 1.4 mm too long as the best."""
    kinematics = differentiate(read_motion(LEG / "stride.mot", leg), 6.0)
    loads = read_external_loads(LEG / "ground.xml", leg, kinematics.time)
    carried = ("thigh_angle", "hip_x", "hip_y", "knee_angle")
    options = options_for(leg, RedundancyOptions(unweighted_coordinates=carried))
    motion, cuff = LoadedMotion(leg, kinematics, loads, options), CuffParameters("shank", "arm", 8520.0, 210.0, 0.012)
    found = optimise_suit(motion, suit, (None, cuff)).fitted
    lengths = np.linspace(0.3124, 0.3144, 11)
    scenario = SuitScenario("both", None, cuff, lengths)
    costs = solve_scenarios(prepare_suited_motion(motion, suit), [scenario])[1][0].muscles
    assert found.suit.reference_rest_length == pytest.approx(lengths[costs.argmin()], abs=7e-4)
    assert found.cost == pytest.approx(costs.min(), abs=1e-3)


def test_a_straight_cord_has_no_guide_to_move(leg: Model, suit: Suit) -> None:
    motion = differentiate(read_motion(LEG / "stride.mot", leg), None)
    cuff = CuffParameters("shank", "arm", 8520.0, 210.0, 0.012)
    with pytest.raises(SuitError):
        optimise_suit(LoadedMotion(leg, motion), suit, (None, cuff), free=("shoulder",))

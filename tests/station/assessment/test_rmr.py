"""rmr and static optimisation from files to files: formats with the same numbers, what is stored, and faults."""

import json
import re
from dataclasses import replace
from pathlib import Path

import matplotlib.image
import numpy as np
import pandas as pd
import pytest
from pyarrow import parquet

from solver.bundled import bundled_model, simulate_arm_raise
from solver.errors import SolverCode
from solver.model import CoordinateActuator
from solver.muscle import MuscleOutcome
from solver.osim.model_reader import read_osim
from solver.redundancy.effort import RedundancyOptions, static_optimisation
from solver.time_series_table import read_table, write_table
from station import sources
from station.assessment.assessment_json import describe_unconverged, describe_unsolved
from station.assessment.given_motion import MotionCut, MuscleInputs, motion_findings, read_given_motion
from station.assessment.reserves import coordinate_unit, reserve_findings
from station.assessment.rmr import (
    SolvedMotion,
    left_out_findings,
    reserve_unit,
    solve_muscles,
    solved_columns,
    write_solved,
)
from station.messages.assessment_messages import AssessmentCode, InputCode
from station.report.rmr_figures import draw_solved
from tests.refusals import raises_refusal
from tests.solver.legs import LEG, PELVIS, Step, actuators, step_in, write_motion
from tests.solver.redundancy.test_problem import with_a_singular_elbow, with_locks
from tests.solver.references import SHARED
from tests.station.command import Station, assert_one_sentence, assert_refused

MODEL = bundled_model()
CUT = MotionCut(every=50)
FIFTH = MotionCut(6.0, 0.2, 0.6, 5, "splines")
AXES = {"X": "1 0 0", "Y": "0 1 0", "Z": "0 0 1"}
OPTIONS = static_optimisation(RedundancyOptions(joint="thigh_joint"))


@pytest.fixture(scope="module")
def motion(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("motion") / "raise.mot"
    raised = simulate_arm_raise(MODEL)
    write_table(path, raised.names, raised.time, raised.coordinates)
    return path


@pytest.fixture(scope="module")
def solved(motion: Path) -> SolvedMotion:
    return solve_muscles(MuscleInputs(motion), CUT, RedundancyOptions())


@pytest.fixture(scope="module")
def infeasible(motion: Path, tmp_path_factory: pytest.TempPathFactory) -> SolvedMotion:
    """A large force pulls the arm down for the second half, and reserves are limited to almost nothing."""
    folder = tmp_path_factory.mktemp("pulled")
    inputs = MuscleInputs(motion, external_loads=pulled(folder, 2000.0), effort=weak_reserves(folder))
    return solve_muscles(inputs, CUT, RedundancyOptions())


def pulled(folder: Path, force: float) -> Path:
    """External loads: down on the hand from the middle of the motion on."""
    time = simulate_arm_raise(MODEL).time
    pull = np.zeros((len(time), 3))
    pull[len(time) // 2 :, 1] = -force
    write_table(folder / "pull.sto", ["pull_x", "pull_y", "pull_z"], time, pull)
    file = folder / "pull.xml"
    file.write_text(
        '<OpenSimDocument Version="40000"><ExternalLoads><objects><ExternalForce name="pull">'
        "<applied_to_body>hand</applied_to_body><force_expressed_in_body>ground</force_expressed_in_body>"
        "<force_identifier>pull_</force_identifier></ExternalForce></objects>"
        "<datafile>pull.sto</datafile></ExternalLoads></OpenSimDocument>"
    )
    return file


def weak_reserves(folder: Path) -> Path:
    """On the coordinates whose actuators have a weight."""
    names = [MODEL.coordinate_names[actuator.coordinate] for actuator in MODEL.actuators[8:]]
    rows = [f"{name} = {{ optimal_force = 0.1, min_control = -1, max_control = 1 }}" for name in names]
    file = folder / "effort.toml"
    file.write_text("\n".join(["reserve_weight = 5.0", "[weights]", "TRIlong = 2.0", "[reserves]", *rows]))
    return file


def values(solved: SolvedMotion) -> dict[str, np.ndarray]:
    return {column.name: column.values for column in solved_columns(solved)}


def test_a_table_carries_everything_that_was_found(solved: SolvedMotion) -> None:
    found, columns = solved.solution, values(solved)
    np.testing.assert_array_equal(columns["TeresMajor"], found.activations[:, MODEL.muscle_names.index("TeresMajor")])
    np.testing.assert_array_equal(columns["force_n.TRIlong"], found.muscle_forces[:, 30])
    np.testing.assert_array_equal(columns["passive_force_n.TRIlong"], found.passive_forces[:, 30])
    np.testing.assert_array_equal(columns["reserve_n_m.elbow_actuator"], found.reserves[:, 6])
    np.testing.assert_array_equal(columns["reserve_n.ground_thorax_ty_actuator"], found.reserves[:, 4])
    np.testing.assert_array_equal(columns["reaction_moment_n_m.z"], found.reaction[:, 2])
    np.testing.assert_array_equal(columns["reaction_force_n.x"], found.reaction[:, 3])
    np.testing.assert_array_equal(columns["contact_m.across"], found.contact[:, 1])
    assert not columns["status"].any()
    assert {"effort", "equality_residual", "cone_slack_n", "contact_m.along_edge"} < set(columns)


def test_frames_with_a_path_that_did_not_converge_are_reported_by_their_code() -> None:
    cut = MotionCut(start=1.3, end=1.4)
    solved = solve_muscles(MuscleInputs(), cut, RedundancyOptions())
    assert solved.notes["muscle_outcomes"] == "path_not_converged in 2 frames of Subscapularis_M"
    assert solved.solution.time[values(solved)["muscles_not_converged"] == 1].tolist() == [1.35, 1.36]
    assert not solved.solution.unsolved
    (sentence,) = describe_unconverged(solved.solution)
    assert "Subscapularis_M" in sentence and MuscleOutcome.PATH_NOT_CONVERGED in sentence
    exact = solve_muscles(MuscleInputs(), cut, RedundancyOptions(path_mode="geodesic"))
    assert exact.notes["muscle_outcomes"] == "converged"
    assert describe_unconverged(exact.solution) == []


def test_the_formats_hold_equal_numbers_and_what_made_them(solved: SolvedMotion, tmp_path: Path, motion: Path) -> None:
    for suffix in (".csv", ".sto", ".parquet"):
        write_solved(tmp_path / f"raise{suffix}", solved)
    plain = pd.read_csv(tmp_path / "raise.csv", comment="#")
    head = (tmp_path / "raise.sto").read_text().splitlines().index("endheader")
    sto = pd.read_csv(tmp_path / "raise.sto", sep="\t", skiprows=head + 1)
    exact = pd.read_parquet(tmp_path / "raise.parquet")
    assert list(plain) == list(sto) == list(exact) == ["time", *values(solved)]
    np.testing.assert_allclose(plain, exact, rtol=1e-9)
    np.testing.assert_array_equal(plain, sto)
    schema = parquet.read_schema(tmp_path / "raise.parquet")
    notes = {key.decode(): value.decode() for key, value in schema.metadata.items()}
    assert notes["filter"] == "Butterworth low-pass at 3 Hz, order 4, forwards and backwards"
    assert notes["motion"].startswith("raise.mot ") and len(notes["motion"].split()[1]) == 64
    assert notes["model"] == "bundled thoracoscapular model"
    assert "numpy " in notes["versions"]
    assert json.loads(notes["weights"])["reserves"] == 10.0
    assert schema.field("force_n.TRIlong").metadata == {b"unit": b"N"}
    assert f"# filter={notes['filter']}" in (tmp_path / "raise.csv").read_text().splitlines()


def with_option(station: Station, folder: Path, option: str, values: str, *words: object) -> list[pd.DataFrame]:
    """The results with these values of an option, which is stored; the last value is wrong usage."""
    *right, wrong = values.split()
    tables = []
    for value in right:
        out = folder / f"{value}.csv"
        assert station("rmr", *words, f"--{option}", value, "--output", out).code == 0
        assert f"# {option}={value}" in [line.split(" in ")[0] for line in out.read_text().splitlines()]
        tables.append(pd.read_csv(out, comment="#"))
    assert station("rmr", f"--{option}", wrong, "--output", folder / "none.csv").code == 2
    return tables


def test_the_exponent_of_the_effort_is_chosen_and_stored(station: Station, tmp_path: Path) -> None:
    found = with_option(station, tmp_path, "exponent", "2 3 4", "--every", 50)
    efforts = [[(table[list(MODEL.muscle_names)].to_numpy() ** power).sum() for power in (2, 3)] for table in found]
    assert efforts[0][0] < efforts[1][0] and efforts[1][1] < efforts[0][1]


def test_paths_may_be_geodesics(station: Station, motion: Path, tmp_path: Path) -> None:
    found = with_option(station, tmp_path, "paths", "opensim geodesic straight", "--motion", motion, "--every", 200)
    difference = np.abs(found[0] - found[1])[list(MODEL.muscle_names)].to_numpy()
    assert 1e-6 < difference.max() < 0.1


def test_elastic_tendons_are_chosen_and_stored_with_their_fibres(station: Station, tmp_path: Path) -> None:
    rigid, elastic = with_option(station, tmp_path, "tendons", "rigid elastic loose", "--from", 1, "--to", 1.05)
    assert "# tendons=elastic in 19 of 33 muscles, strain" in (tmp_path / "elastic.csv").read_text()
    further = sorted(set(elastic) - set(rigid))
    assert len(further) == 2 * 19 and {"fiber_length_m.BIC_long", "tendon_strain.BIC_long"} < set(further)
    assert 0.001 < elastic["tendon_strain.BIC_long"].max() < 0.049


@pytest.mark.oracle
def test_opensim_reads_every_row_of_the_sto(station, motion: Path, infeasible: SolvedMotion, tmp_path: Path) -> None:
    opensim = pytest.importorskip("opensim", reason="needs OpenSim: install the extra oracle")
    lost = int(np.isnan(infeasible.solution.effort).sum())
    sentence = write_solved(tmp_path / "raise.sto", infeasible)
    assert sentence is not None and f"{lost} of 13 frames, the first at" in sentence
    assert opensim.Storage(str(tmp_path / "raise.sto")).getSize() == 13 - lost
    table = opensim.TimeSeriesTable(str(tmp_path / "raise.sto"))
    assert list(table.getColumnLabels()) == list(values(infeasible))
    is_solved = np.isfinite(infeasible.solution.effort)
    np.testing.assert_allclose(table.getIndependentColumn(), infeasible.solution.time[is_solved], atol=1e-9)
    for name, column in values(infeasible).items():
        np.testing.assert_allclose(table.getDependentColumn(name).to_numpy(), column[is_solved], rtol=1e-9)
    assert table.getTableMetaDataString("filter") == infeasible.notes["filter"]
    out = tmp_path / "loose.sto"
    ran = station("rmr", "--motion", motion, "--every", 100, "--no-glenoid", "--output", out)
    assert ran.code == 0
    assert "leaves out" not in ran.err and "cone_slack_n" not in out.read_text(encoding="utf-8")
    assert opensim.Storage(str(out)).getSize() == 7


def test_infeasible_frames_are_reported_with_the_smallest_violation(infeasible: SolvedMotion) -> None:
    found = infeasible.solution
    lost = values(infeasible)["status"] == 2
    assert 2 < lost.sum() < len(lost)
    assert np.isnan(found.activations[lost]).all() and np.isfinite(found.activations[~lost]).all()
    assert np.isfinite(found.cone_slack).all() and np.isfinite(found.equality_residual).all()
    (sentence,) = (text for text in describe_unsolved(found) if "misses accelerations" in text)
    first = found.time[np.argmax(lost)]
    assert sentence.startswith(f"{lost.sum()} of {len(lost)} frames, the first at {first:g} s: ")
    missed = found.equality_residual[lost].max()
    assert f"misses accelerations by up to {missed:.3g} rad/s²" in sentence
    worst = np.nanargmax(np.where(lost, found.equality_residual, np.nan))
    assert sentence.endswith(f"the most that of {found.residual_coordinates[worst]}")


def test_infeasible_frames_without_a_residual_do_not_hide_those_that_have_one(infeasible: SolvedMotion) -> None:
    found = infeasible.solution
    lost = np.flatnonzero(values(infeasible)["status"] == 2)
    for unknown in (lost[:1], lost):
        residual, slack = found.equality_residual.copy(), found.cone_slack.copy()
        residual[unknown] = slack[unknown] = np.nan
        sentences = describe_unsolved(replace(found, equality_residual=residual, cone_slack=slack))
        assert not any("nan" in sentence for sentence in sentences)
        assert any("misses accelerations" in sentence for sentence in sentences) == (len(unknown) == 1)


def test_an_effort_file_changes_weights_and_reserves(infeasible: SolvedMotion) -> None:
    weights = json.loads(infeasible.notes["weights"])
    assert (weights["reserves"], weights["single"]) == (5.0, {"TRIlong": 2.0})
    assert "effort" in infeasible.notes and "external_loads_data" in infeasible.notes
    own = values(infeasible)["reserve_n_m.plane_elv_reserve"]
    assert np.nanmax(np.abs(own)) <= 0.1 + 1e-9


@pytest.mark.parametrize("which", [pytest.param("solved", marks=pytest.mark.slow), "infeasible"])
def test_a_page_and_its_parts_are_drawn(which: str, request: pytest.FixtureRequest, tmp_path: Path) -> None:
    drawn = request.getfixturevalue(which)
    draw_solved(tmp_path / "page.png", drawn)
    draw_solved(tmp_path / "parts", drawn)
    pages = [tmp_path / "page.png", *(tmp_path / "parts").iterdir()]
    assert {page.name for page in pages} == {"page.png", "activations.png", "reserves.png", "glenoid.png"}
    for page in pages:
        picture = matplotlib.image.imread(page)
        assert picture.shape[0] > 400
        assert len(np.unique(picture[::3, ::3].sum(axis=2))) > 50  # not an empty sheet


@pytest.mark.parametrize("lacking", ["markers", "actuators"])
def test_a_model_with_a_missing_component_is_reported_and_drawn(lacking: str, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(sources, "bundled_model", lambda: replace(MODEL, **{lacking: ()}))
    thorax = tuple(
        name for name in MODEL.coordinate_names if name.startswith("ground_thorax") and lacking == "actuators"
    )
    solved = solve_muscles(MuscleInputs(), CUT, RedundancyOptions(has_glenoid_cone=False, free_coordinates=thorax))
    assert np.isnan(solved.solution.contact).all() == (lacking == "markers")
    assert bool(describe_unsolved(solved.solution)) == (lacking == "actuators")
    draw_solved(tmp_path / "page.png", solved)
    assert (tmp_path / "page.png").stat().st_size > 10_000


def test_reactions_of_several_joints_are_columns_beside_the_glenoid_s(station, motion: Path, tmp_path: Path) -> None:
    words = ("rmr", "--motion", motion, "--every", 100, "--output", tmp_path / "out.csv", "--joint", "elbow,rc")
    assert station(*words, "--reaction-on", "parent", "--reaction-in", "child").code == 0
    table = pd.read_csv(tmp_path / "out.csv", comment="#")
    assert {"reaction_force_n.x", "contact_m.across"} <= set(table.columns)
    for label in ("elbow_on_humerus_in_ulna", "rc_on_radius_in_hand"):
        names = [f"reaction_{part}.{label}.{axis}" for part in ("moment_n_m", "force_n", "point_m") for axis in "xyz"]
        assert np.isfinite(table[names]).all(axis=None)
    text = (tmp_path / "out.csv").read_text()
    assert "reactions=elbow, rc on parent in child" in text and "joint=GlenoHumeral" in text


def test_a_model_without_a_shoulder_is_solved(station, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    renamed = tuple(replace(joint, name=f"{joint.name}_r") for joint in MODEL.joints)
    monkeypatch.setattr(sources, "bundled_model", lambda: replace(MODEL, joints=renamed, markers=()))
    words = ("rmr", "--every", 100, "--output", tmp_path / "out.csv", "--joint", "elbow_r")
    assert station(*words, "--plot", tmp_path / "out.png").code == 0
    text = (tmp_path / "out.csv").read_text()
    assert "glenoid=not constrained" in text and "joint=none" in text
    columns = pd.read_csv(tmp_path / "out.csv", comment="#").columns
    assert "reaction_force_n.x" not in columns and "reaction_force_n.elbow_r_on_ulna_in_ground.y" in columns
    assert len(np.unique(matplotlib.image.imread(tmp_path / "out.png")[::3, ::3].sum(axis=2))) > 50


def test_the_verb_prints_its_filter_and_counts_what_it_could_not_solve(station, motion: Path, tmp_path: Path) -> None:
    words = ("rmr", "--motion", motion, "--every", 100, "--output", tmp_path / "out.sto")
    ran = station(*words, "--plot", tmp_path / "out.png", "--glenoid-aspect", 0.8)
    assert ran.code == 0
    assert ran.out.split() == [str(tmp_path / "out.sto"), str(tmp_path / "out.png")]
    assert "filter: Butterworth low-pass at 3 Hz" in ran.err
    assert "glenoid=reaction kept inside, aspect 0.8" in (tmp_path / "out.sto").read_text()
    lost = station(*words, "--external-loads", pulled(tmp_path, 2000.0), "--effort", weak_reserves(tmp_path))
    assert lost.code == 3
    assert "the smallest violation leaves it by up to" in lost.err


def test_what_comes_with_the_station_is_solved_without_any_file(station, tmp_path: Path) -> None:
    ran = station("rmr", "--every", 200, "--cutoff-hz", 0, "--output", tmp_path / "out.csv")
    notes = (tmp_path / "out.csv").read_text()
    assert ran.code == 0
    assert "# motion=bundled raise of the arm\n" in notes
    assert "# filter=none\n" in notes


def test_reserves_of_locked_coordinates_are_zero(station, motion: Path, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(sources, "bundled_model", lambda: with_locks(MODEL, "elbow_flexion", "pro_sup"))
    ran = station("rmr", "--motion", motion, "--every", 50, "--output", tmp_path / "out.csv")
    assert ran.code == 0
    table = pd.read_csv(tmp_path / "out.csv", comment="#")
    assert (table.status == 0).all()
    reserves = table.filter(regex="^reserve_n_m").abs().max()
    assert (reserves[["reserve_n_m.elbow_actuator", "reserve_n_m.pro_sup_actuator"]] == 0.0).all()


@pytest.mark.shared
@pytest.mark.skipif(not (SHARED / "subject").is_dir(), reason="needs the public data of a lift with locked coordinates")
def test_a_published_lift_with_locked_coordinates_moves_its_joint_force_smoothly(station, tmp_path: Path) -> None:
    files = ("--model", SHARED / "subject" / "S8R_side_as_solved.osim", "--motion", SHARED / "subject" / "S8R_side.mot")
    assert station("rmr", *files, "--output", tmp_path / "out.csv").code == 0
    table = pd.read_csv(tmp_path / "out.csv", comment="#")
    assert table.filter(regex="^reserve_").abs().max().max() < 1e3
    assert table.equality_residual.max() < 1.0
    force = table[[f"reaction_force_n.{axis}" for axis in "xyz"]].to_numpy()
    assert np.linalg.norm(np.diff(force, axis=0), axis=1).max() < 60.0  # N in 20 ms; the lift's peak is 1.7 kN


def test_a_posture_without_finite_accelerations_is_a_row(station, motion: Path, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(sources, "bundled_model", lambda: with_a_singular_elbow(MODEL))
    raised, elbow = simulate_arm_raise(MODEL), MODEL.coordinate_index("elbow_flexion")
    bent = raised.coordinates.copy()
    bent[100, elbow] = 1.0
    write_table(motion.with_name("bent.mot"), raised.names, raised.time, bent)
    words = ("--motion", motion.with_name("bent.mot"), "--every", 50, "--cutoff-hz", 0)
    ran = station("rmr", *words, "--output", tmp_path / "out.csv")
    assert ran.code == 3
    assert f"1 of 13 frames, the first at {raised.time[100]:g} s: the model has no finite accelerations" in ran.err
    table = pd.read_csv(tmp_path / "out.csv", comment="#")
    assert list(table.status) == [0, 0, 4, *[0] * 10]
    assert np.isfinite(table.drop(index=2).effort).all()


def test_bad_input_is_one_sentence(station, motion: Path, tmp_path: Path) -> None:
    words, effort = ("rmr", "--motion", motion, "--output"), tmp_path / "bad.toml"
    assert_one_sentence(station(*words, tmp_path / "out.xlsx"), 2, "out.xlsx", ".csv, .sto, .parquet")
    assert station(*words, tmp_path / "out.csv", "--plot", tmp_path / "out.pdf").code == 2
    out = tmp_path / "out.csv"
    assert_one_sentence(station(*words, out, "--effort", tmp_path / "none.toml"), 1, "none.toml", "[input.effort]")
    for text, fault in (
        ("muscle_wait = 1", "unknown key muscle_wait"),
        ("muscle_weight = -1", "muscle_weight is -1"),
        ("[reserves]\nplane_elv = 3", "reserves.plane_elv is 3"),
        ("[reserves]\nplane_elv = { optimal_force = 0 }", "reserves.plane_elv.optimal_force is 0"),
    ):
        effort.write_text(text)
        ran = station(*words, out, "--effort", effort)
        assert_refused(ran, 1, InputCode.EFFORT)
        assert fault in ran.err
    for text, name in (("[weights]\nbiceps = 2", "biceps"), ('unweighted_coordinates = ["hip"]', "hip")):
        effort.write_text(text)
        ran = station(*words, out, "--effort", effort)
        assert ran.code == 1 and name in ran.err and "Traceback" not in ran.err
    ran = station(*words, out, "--external-loads", tmp_path / "none.xml")
    assert ran.code == 1 and "none.xml" in ran.err and "Traceback" not in ran.err
    assert not out.exists()


@pytest.fixture(scope="module")
def step(tmp_path_factory: pytest.TempPathFactory) -> Step:
    return step_in(tmp_path_factory.mktemp("step"))


def files(step: Step) -> tuple[object, ...]:
    return ("--model", step.model, "--motion", step.motion, "--external-loads", step.loads)


def solve(
    step: Step, options: RedundancyOptions = OPTIONS, effort: Path | None = None, *, ignores_forces: bool = False
) -> SolvedMotion:
    added = () if effort else (step.actuators,)
    inputs = MuscleInputs(step.motion, str(step.model), step.loads, effort, ignores_forces, actuators=added)
    return solve_muscles(inputs, FIFTH, options)


def test_a_pelvis_that_nothing_balances_is_refused_by_the_names_of_its_coordinates(step: Step, tmp_path: Path) -> None:
    inputs = MuscleInputs(step.motion, str(step.model), step.loads)
    with raises_refusal(SolverCode.NOT_BALANCED, naming=f"{', '.join(PELVIS)}; add") as refusal:
        solve_muscles(inputs, FIFTH, OPTIONS)
    assert "toe_angle" not in str(refusal.value)  # locked
    few = tmp_path / "few.xml"
    few.write_text(actuators(dict.fromkeys(PELVIS[1:], 500.0)))
    with raises_refusal(SolverCode.NOT_BALANCED, naming="balance the coordinates pelvis_tilt; add"):
        solve_muscles(replace(inputs, actuators=(few,)), FIFTH, OPTIONS)


def test_free_pelvis_coordinates_need_no_actuators(step: Step, tmp_path: Path) -> None:
    reserves = tmp_path / "reserves.xml"
    reserves.write_text(actuators(dict.fromkeys(LEG, 5.0)))
    solved = solve(replace(step, actuators=reserves), replace(OPTIONS, free_coordinates=PELVIS))
    assert solved.solution.unsolved == 0
    assert solved.solution.equality_residual.max() < 1e-8


def test_reserves_by_name_are_those_of_a_file_and_a_patella_follows_the_knee(step: Step, tmp_path: Path) -> None:
    effort = tmp_path / "effort.toml"
    forces = dict.fromkeys(PELVIS, 500.0) | dict.fromkeys(LEG, 5.0)
    lines = [f"{name} = {{ optimal_force = {force} }}" for name, force in forces.items()]
    effort.write_text("\n".join(["[reserves]", *lines]))
    by_name, by_file = solve(step, effort=effort), solve(step)
    np.testing.assert_allclose(by_name.solution.activations, by_file.solution.activations, atol=1e-7)
    assert by_name.options.reserve_weight == 1.0  # that of static optimisation, because the file has none
    motion = tmp_path / "step.sto"
    write_motion(motion, (*PELVIS, *LEG))
    found, expected = solve(replace(step, motion=motion)), solve(step)
    assert found.notes["without_data"] == "toe_angle, patella_angle"
    np.testing.assert_allclose(found.solution.activations, expected.solution.activations, atol=1e-6)


def test_with_activation_dynamics_the_leg_costs_no_less(step: Step) -> None:
    free = solve(step, replace(OPTIONS, has_activation_dynamics=False)).solution
    bound = solve(step, replace(OPTIONS, has_activation_dynamics=True)).solution
    assert bound.unsolved == 0
    assert (bound.effort >= free.effort - 1e-9).all()
    assert np.abs(bound.activations - free.activations).max() > 1e-3


def test_other_documents_and_files_without_actuators_are_refused(step: Step, tmp_path: Path) -> None:
    empty = tmp_path / "empty.xml"
    empty.write_text(actuators({}), encoding="utf-8")
    for file, cause in ((step.loads, "ForceSet"), (empty, "ForceSet reserves has no forces")):
        with raises_refusal(SolverCode.WRONG_DOCUMENT, naming=cause):
            solve(replace(step, actuators=file))


@pytest.mark.parametrize("version", ["40000", "30000"])
def test_elements_of_actuators_that_are_not_used_are_named(step: Step, tmp_path: Path, version: str) -> None:
    """Misspelt, repeated, and beside the ForceSet; OpenSim ignores them without a message."""
    text = step.actuators.read_text()
    text = text.replace("<optimal_force>", "<optimalforce>7</optimalforce><optimal_force>", 1).replace("40000", version)
    text = text.replace("</max_control>", "</max_control><max_control>1</max_control>", 1)
    text = text.replace("</ForceSet>", "</ForceSet><ForceSet/><ControllerSet name='all'/><note>1</note>")
    (tmp_path / "odd.xml").write_text(text)
    inputs = MuscleInputs(step.motion, str(step.model), step.loads, actuators=(tmp_path / "odd.xml",))
    notes = read_given_motion(inputs, FIFTH).notes
    named = ["<max_control> 1", "<optimalforce> 7", "<note> 1"]
    assert notes["actuators_unused"] == ", ".join(f"{element} (line 1)" for element in named)
    assert AssessmentCode.ACTUATORS_UNUSED in [finding.code for finding in motion_findings(notes)]


def test_a_force_set_that_is_the_root_of_its_file_is_read(step: Step, tmp_path: Path) -> None:
    """OpenSim reads it as of an earlier version."""
    text = re.sub("</?OpenSimDocument.*?>", "", step.actuators.read_text())
    (tmp_path / "root.xml").write_text(text)
    models = [read_osim(step.model, actuators=[file]) for file in (step.actuators, tmp_path / "root.xml")]
    assert models[0].actuators == models[1].actuators


def test_actuators_that_share_a_name_are_refused_by_it(step: Step, tmp_path: Path) -> None:
    inputs = MuscleInputs(step.motion, str(step.model), step.loads)
    with raises_refusal(SolverCode.UNSUPPORTED, naming="pelvis_tilt") as refusal:
        solve_muscles(replace(inputs, actuators=(step.actuators, step.actuators)), FIFTH, OPTIONS)
    assert "calf" not in str(refusal.value)
    as_muscle = tmp_path / "as_muscle.xml"
    name = re.search(r'CoordinateActuator name="(.*?)"', step.actuators.read_text())
    as_muscle.write_text(step.actuators.read_text().replace(f'name="{name[1]}"', 'name="calf"', 1))
    with raises_refusal(SolverCode.UNSUPPORTED, naming="of the name calf;"):
        solve_muscles(replace(inputs, actuators=(as_muscle,)), FIFTH, OPTIONS)


def test_the_verbs_write_moments_and_activations(station: Station, step: Step, tmp_path: Path) -> None:
    common = (*files(step), "--from", 0.2, "--to", 0.4)
    joint = ["--joint", "thigh_joint"]
    output, moments = tmp_path / "so.sto", tmp_path / "id.csv"
    ran = station("rmr", *common, *joint, "--static-optimisation", "--actuators", step.actuators, "--output", output)
    assert ran.code == 0, ran.err
    assert "6 Hz, order 3" in ran.err
    assert "Coordinates without data: toe_angle" in ran.err
    assert read_table(output)[1].shape[0] == 21
    assert "muscle_forces=opensim_static" in output.read_text()
    assert station("id", *common, "--output", moments).code == 0
    assert "hip_flexion_moment" in read_table(moments)[0]
    assert station("rmr", "--actuators", step.actuators, "--output", output).code == 2
    assert station("id", *common, "--output", tmp_path / "id.parquet").code == 2
    unbalanced = station("rmr", *common, *joint, "--no-glenoid", "--output", output)
    assert_refused(unbalanced, 1, SolverCode.NOT_BALANCED)


def test_a_paralysed_muscle_rests_and_every_frame_is_solved(step: Step, tmp_path: Path) -> None:
    model = tmp_path / "paralysed.osim"
    force = "<max_isometric_force>"
    model.write_text(step.model.read_text().replace(force, "<max_control>0</max_control>" + force, 1))
    solved, able = solve(replace(step, model=model)).solution, solve(step).solution
    assert solved.unsolved == 0
    assert solved.activations[:, 0].max() < 1e-5
    assert able.activations[:, 0].max() > 0.01


def test_infinite_generalised_forces_are_refused(station: Station, step: Step, tmp_path: Path) -> None:
    text, output, model = step.model.read_text(encoding="utf-8"), tmp_path / "id.csv", tmp_path / "heavy.osim"
    assert "<gravity>0 -9.81 0</gravity>" in text
    model.write_text(text.replace("0 -9.81 0", "0 -1e308 0"), encoding="utf-8")
    ran = station("id", "--model", model, "--motion", step.motion, "--output", output)
    assert_refused(ran, 1, SolverCode.NOT_FINITE)
    assert not output.exists()


# Where reserves give the force that a motion needs: residuals on bodies, and reserves in place of muscles.


def with_residuals_on_the_pelvis(step: Step, folder: Path) -> Step:
    """Forces at a point and torques in place of the pelvis's CoordinateActuators, and a contact that is lacking."""
    forces = "".join(
        f'<PointActuator name="F{name}"><body>pelvis</body><point>-0.05 0.15 0</point><direction>{axis}</direction>'
        "<force_is_global>true</force_is_global><optimal_force>500</optimal_force></PointActuator>"
        f'<TorqueActuator name="M{name}"><bodyA>pelvis</bodyA><bodyB>ground</bodyB><axis>{axis}</axis>'
        "<optimal_force>500</optimal_force></TorqueActuator>"
        for name, axis in AXES.items()
    )
    found = replace(step, model=folder / "own.osim", actuators=folder / "residuals.xml")
    text = actuators(dict.fromkeys(LEG, 5.0)).replace("</objects>", f"{forces}</objects>")
    found.actuators.write_text(text, encoding="utf-8")
    model = step.model.read_text(encoding="utf-8")
    lacking = "<ElasticFoundationForce name='sole'/></objects></ForceSet>"
    found.model.write_text(model.replace("</objects></ForceSet>", lacking), encoding="utf-8")
    return found


def test_residuals_on_bodies_give_what_the_pelvis_needs(step: Step, tmp_path: Path) -> None:
    """No muscle crosses the joint of the pelvis, so that actuators give all that inverse dynamics finds there."""
    solved = solve(with_residuals_on_the_pelvis(step, tmp_path), ignores_forces=True)
    shares = json.loads(solved.notes["left_out_effect"])["reserve_and_needed"]
    assert {"pelvis_tx", "pelvis_ty", "pelvis_tilt", "pelvis_list"} < set(shares)
    for name in set(PELVIS) & set(shares):
        given, needed = shares[name]
        assert given == pytest.approx(needed, rel=1e-6)
    (found,) = left_out_findings(solved.model, solved.left_out)
    assert f"reserves give {shares['pelvis_ty'][0]:.3g} of {shares['pelvis_ty'][1]:.3g} N at pelvis_ty" in str(found)


def test_reserves_in_place_of_muscles_are_reported_and_residuals_are_not(step: Step, station, tmp_path: Path) -> None:
    strong = replace(step, actuators=tmp_path / "strong.xml")
    strong.actuators.write_text(actuators(dict.fromkeys((*PELVIS, *LEG), 500.0)), encoding="utf-8")
    solved = solve(strong)
    assert "knee_angle" in solved.large_reserves and set(solved.large_reserves) <= set(LEG)
    knee = solved.model.actuated_names.index("knee_angle")
    rms = np.sqrt((solved.solution.reserves[:, knee] ** 2).mean())
    assert solved.large_reserves["knee_angle"][0] == pytest.approx(rms, rel=1e-12)
    assert json.loads(solved.notes["large_reserves"])["knee_angle"][0] == pytest.approx(rms, rel=1e-12)
    cut = ("--actuators", strong.actuators, "--static-optimisation", "--from", 0.2, "--to", 0.6, "--every", 5)
    ran = station("rmr", *files(strong), *cut, "--output", tmp_path / "a.csv")
    assert ran.code == 0
    (printed,) = [line for line in ran.err.splitlines() if "reserves.large" in line]
    assert "N m at knee_angle" in printed and "pelvis" not in printed


def test_residuals_that_carry_the_body_are_reported_with_its_weight(step: Step, tmp_path: Path) -> None:
    inputs = MuscleInputs(step.motion, str(step.model), None, None, True, actuators=(step.actuators,))
    solved = solve_muscles(inputs, FIFTH, OPTIONS)
    given, weight = solved.large_residuals["pelvis_ty"]
    assert weight == pytest.approx(58.6 * 9.81)
    assert given == pytest.approx(weight, rel=0.1)  # no foot carries it
    assert json.loads(solved.notes["large_residuals"])["pelvis_ty"] == [given, weight]
    codes = [found.code for found in reserve_findings(solved.model, {}, solved.large_residuals)]
    assert codes == [AssessmentCode.RESIDUALS_LARGE]
    supported = solve(step).large_residuals
    assert supported.get("pelvis_ty", (0.0, weight))[0] < 0.6 * given


@pytest.mark.parametrize(("has_loads", "residuals"), [(False, {"pelvis_tx", "pelvis_ty"}), (True, set())])
def test_unweighted_actuators_that_carry_the_body_are_named(step: Step, has_loads: bool, residuals: set[str]) -> None:
    """As of a leg without a trunk, whose weights hide that the ground reaction was forgotten."""
    inputs = MuscleInputs(step.motion, str(step.model), step.loads, actuators=(step.actuators,))
    options = replace(OPTIONS, weights=dict.fromkeys(PELVIS, 0.0))
    solved = solve_muscles(inputs if has_loads else replace(inputs, external_loads=None), FIFTH, options)
    assert set(solved.large_residuals) == residuals


@pytest.mark.parametrize(("is_static", "largest"), [(True, 200.0), (False, 10.0)])
def test_the_actuators_that_carry_thorax_and_forearm_are_not_reported(is_static: bool, largest: float) -> None:
    options = static_optimisation(RedundancyOptions()) if is_static else RedundancyOptions()
    solved = solve_muscles(MuscleInputs(), MotionCut(every=60), options)
    assert np.abs(solved.solution.reserves).max() > largest
    assert (solved.large_residuals if is_static else solved.large_reserves) == {}


def test_small_reserves_free_coordinates_and_actuators_without_weight_are_not_reported(step: Step) -> None:
    """The calf has an activation of 1 in this step, so that the ankle needs its reserve; the knee does not."""
    found = solve(step)
    assert set(found.large_reserves) == {"ankle_angle", "hip_rotation"}
    knee = found.model.actuated_names.index("knee_angle")
    assert np.abs(found.solution.reserves[:, knee]).max() > 0.0
    carried = solve(step, replace(OPTIONS, free_coordinates=("hip_rotation",), weights={"ankle_angle": 0.0}))
    assert (carried.large_reserves, carried.notes["large_reserves"]) == ({}, "none")


def test_the_unit_is_that_of_the_axes_that_a_coordinate_drives(step: Step) -> None:
    """Also where OpenSim calls the motion coupled, as of the distances of gait2392, which have a scaled function."""
    model = read_osim(step.model)
    model = replace(model, coordinates=tuple(replace(one, motion="coupled") for one in model.coordinates))
    units = {name: coordinate_unit(model, index) for index, name in enumerate(model.coordinate_names)}
    assert {name for name, unit in units.items() if unit == "N"} == set(PELVIS[3:])
    assert set(units.values()) == {"N", "N m"}
    reserves = (CoordinateActuator("knee", model.coordinate_index(LEG[3]), 5.0),)
    reserves += (CoordinateActuator("FY", model.coordinate_index(PELVIS[4]), 5.0),)
    assert [reserve_unit(model, reserve) for reserve in reserves] == ["N m", "N"]


def test_the_notes_and_columns_of_a_leg_have_nothing_of_a_shoulder(step: Step, station, tmp_path: Path) -> None:
    cut = ("--actuators", step.actuators, "--from", 0.2, "--to", 0.6, "--every", 10)
    out = tmp_path / "leg.sto"
    ran = station("rmr", *files(step), *cut, "--output", out)
    assert "leaves out the columns" not in ran.err
    text = out.read_text(encoding="utf-8")
    assert "cone_slack" not in text and "thorax" not in text and "elbow" not in text
    moved = json.loads(text.split("reserve_coordinates=")[1].splitlines()[0])
    assert set(moved.values()) == {*PELVIS, *LEG}
    assert all(f"\treserve_n_m.{name}\t" in text or f"\treserve_n.{name}\t" in text for name in moved)

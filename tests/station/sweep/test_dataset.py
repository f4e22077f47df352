"""A sweep without a cluster: its plan, its table, its failures, and what it keeps between runs."""

import json
from collections.abc import Iterable, Iterator
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from pyarrow import parquet

from solver.bundled import bundled_model, simulate_arm_raise
from solver.errors import SolverCode, SolverError
from solver.model import ModelError
from solver.motion import differentiate, read_motion
from solver.redundancy.motion_solution import LoadedMotion
from solver.suit.assessment import assess
from solver.suit.optimise import LEAST_FRAMES
from solver.suit.suit import SuitError, read_suit
from solver.time_series_table import write_table
from station import sources
from station.assessment.assessment_inputs import InputError, read_cuffs_to_wear, worn_cuffs
from station.messages.assessment_messages import InputCode
from station.messages.study_messages import SweepCode
from station.sweep.dataset import Outcome, SweepResult, Task, run_sweep, solve_task
from station.sweep.sweep_plan import PlanError, read_plan
from tests.refusals import raises_refusal
from tests.station.assessment.test_assess import CUFFS, KEYS
from tests.station.command import assert_refused
from tests.station.loads import write_weight

CUFF = 'cuff = ["hand", "elbow"]\n'


def here(tasks: Iterable[Task]) -> Iterator[tuple[dict[str, Outcome], bool]]:
    """In this process, one task after the other."""
    return ((solve_task(task), True) for task in tasks)


def nowhere(tasks: Iterable[Task]) -> Iterator[tuple[dict[str, Outcome], bool]]:
    """Nothing is left to solve."""
    assert list(tasks) == []
    return iter(())


def swept(folder: Path, vary: str, **more: Any) -> tuple[SweepResult, pd.DataFrame]:
    found = run_sweep(read_plan(write_plan(folder, vary)), folder / "out", more.get("solve", here))
    return found, pd.read_parquet(found.table)


def test_the_cost_of_every_case_is_that_of_the_assessment_and_the_plan_s_hash_is_stored(tmp_path: Path) -> None:
    found, table = swept(tmp_path, 'condition = ["rigid", "both"]')
    model = bundled_model()
    worn = worn_cuffs(read_cuffs_to_wear(tmp_path / "cuffs.json"), ())
    motion = LoadedMotion(model, differentiate(simulate_arm_raise(model)))
    whole = assess(motion, read_suit(), worn, every=60)
    assert (found.cases, found.failed, found.unsolved) == (4, 0, 0)
    digest = read_plan(tmp_path / "plan.toml").digest
    assert json.loads((tmp_path / "out" / "sweep.json").read_text("utf-8"))["plan_sha256"] == digest
    assert parquet.read_schema(found.table).metadata[b"plan_sha256"].decode() == digest
    for row in table.to_dict("records"):
        (curve,) = [c for c in whole.curves if (c.condition, c.cuff or row["cuff"]) == (row["condition"], row["cuff"])]
        assert row["normalised_cost"] == pytest.approx(curve.figures["at_reference"].value, rel=1e-9)
        assert row["optimum_rest_length_m"] == pytest.approx(curve.figures["rest_length"].value, rel=1e-9)
        assert row["largest_cord_force_n"] == pytest.approx(curve.figures["cord_force"].value, rel=1e-9)
        assert row["bare_body_cost"] == pytest.approx(whole.bare_body_cost, rel=1e-9)
        assert row["frames"] == len(whole.time)


def test_uneven_steps_and_loads_that_are_off_are_remarks_of_their_cases(tmp_path: Path) -> None:
    raised = simulate_arm_raise(bundled_model())
    time = raised.time + np.where(np.arange(len(raised.time)) % 2, 0.2, 0.0) * (raised.time[1] - raised.time[0])
    write_table(tmp_path / "uneven.sto", raised.names, time, raised.coordinates)
    write_weight(tmp_path / "off.xml", 1.0)
    text = (tmp_path / "off.xml").read_text()
    (tmp_path / "off.xml").write_text(text.replace("</ExternalForce>", "<isDisabled>true</isDisabled></ExternalForce>"))
    vary = 'motion = ["bundled", "uneven.sto"]\nexternal_loads = ["none", "off.xml"]\nrest_length_m = 0.74'
    found, table = swept(tmp_path, f'cuff = "hand"\ncondition = "rigid"\n{vary}')
    assert (found.cases, found.failed) == (4, 0)
    for row in table.to_dict("records"):
        assert ("interpolated" in row["remarks"]) == (row["motion"] == "uneven.sto")
        assert ("off.xml" in row["remarks"]) == (row["external_loads"] == "off.xml")


def test_a_motion_without_a_column_has_its_default(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    model, raised = bundled_model(), simulate_arm_raise(bundled_model())
    place = model.coordinate_index("elbow_flexion")
    coordinates = raised.coordinates.copy()
    coordinates[:, place] = model.default_coordinates[place]
    write_table(tmp_path / "whole.sto", raised.names, raised.time, coordinates)
    kept = [index for index in range(len(raised.names)) if index != place]
    write_table(tmp_path / "part.sto", [raised.names[index] for index in kept], raised.time, coordinates[:, kept])
    read: list[str] = []
    monkeypatch.setattr(
        sources, "read_motion", lambda path, *a, **k: (read.append(path.name), read_motion(path, *a, **k))[1]
    )
    vary = 'motion = ["whole.sto", "part.sto"]\nhand_mass_kg = [0, 2]\nrest_length_m = 0.74'
    found, table = swept(tmp_path, f'cuff = "hand"\ncondition = "rigid"\n{vary}')
    assert (found.cases, found.failed, sorted(read)) == (4, 0, ["part.sto", "whole.sto"])
    whole, part = (table[table["motion"] == name] for name in ("whole.sto", "part.sto"))
    np.testing.assert_allclose(part["normalised_cost"], whole["normalised_cost"], rtol=1e-12)
    assert (
        part["remarks"].str.contains("elbow_flexion").all() and not whole["remarks"].str.contains("elbow_flexion").any()
    )


def test_the_cutoff_of_the_plan_filters_its_motions(tmp_path: Path) -> None:
    raised = simulate_arm_raise(bundled_model())
    shaken = raised.coordinates.copy()
    shaken[:, raised.names.index("shoulder_elv")] += 2e-3 * np.sin(2 * np.pi * 8.0 * raised.time)
    write_table(tmp_path / "shaken.sto", raised.names, raised.time, shaken)
    vary = 'motion = ["bundled", "shaken.sto"]\ncuff = "hand"\ncondition = "rigid"\nrest_length_m = 0.74'
    difference = []
    for cutoff in (3.0, 20.0):
        plan = read_plan(write_plan(tmp_path, vary, f"every = 60\ncutoff_hz = {cutoff}\n"))
        table = pd.read_parquet(run_sweep(plan, tmp_path / "out", here).table)
        difference.append(abs(np.diff(table["normalised_cost"].to_numpy())[0]))
    assert difference[0] < 0.05 * difference[1]


@pytest.mark.parametrize(("every", "is_few"), [(60, True), (1, False), (20, False)])
def test_a_plan_that_keeps_few_frames_is_reported(tmp_path: Path, every: int, is_few: bool) -> None:
    """The bundled motion has 601 frames; of its first 20 alone, none can be left out."""
    raised, start = simulate_arm_raise(bundled_model()), slice(0, 20 if every == 1 else None)
    write_table(tmp_path / "part.sto", raised.names, raised.time[start], raised.coordinates[start])
    vary = 'motion = "part.sto"\ncuff = "hand"\ncondition = ["rigid", "both"]\nrest_length_m = 0.74'
    found = run_sweep(read_plan(write_plan(tmp_path, vary, f"every = {every}\n")), tmp_path / "out", here)
    (kept,) = set(pd.read_parquet(found.table)["frames"])
    figures = {"every": every, "cases": 2, "fewest": kept, "least": LEAST_FRAMES}
    assert [(one.code, one.figures) for one in found.findings] == [(SweepCode.FEW_FRAMES, figures)] * is_few


def test_rows_are_in_the_order_of_the_plan_with_the_parameters_of_the_suit(tmp_path: Path) -> None:
    vary = (
        'condition = "rigid"\nstiffness_n_per_m = [300, 600]\narm_point_m = [-0.01, -0.1, -0.06]\nrest_length_m = 0.7'
    )
    _, table = swept(tmp_path, vary)
    assert table["case"].tolist() == [0, 1, 2, 3]
    assert table["stiffness_n_per_m"].tolist() == [300.0, 300.0, 600.0, 600.0]
    assert table[["arm_x_m", "arm_y_m", "arm_z_m"]].to_numpy().tolist() == [[-0.01, -0.1, -0.06]] * 4
    assert table["optimum_rest_length_m"].isna().all()  # one rest length shows no optimum
    rigid_whatever_the_cuff = table.groupby("stiffness_n_per_m")["normalised_cost"].nunique()
    assert rigid_whatever_the_cuff.tolist() == [1, 1]
    forces = table.groupby("stiffness_n_per_m")["largest_cord_force_n"].first()
    assert forces.loc[600.0] == pytest.approx(2 * forces.loc[300.0])


def test_an_external_load_acts_as_the_equivalent_mass(tmp_path: Path) -> None:
    write_weight(tmp_path / "weight.xml", 2.0)
    vary = 'condition = "rigid"\ncuff = "hand"\nrest_length_m = 0.74\n'
    _, pulled = swept(tmp_path, vary + 'external_loads = ["none", "weight.xml"]')
    _, held = swept(tmp_path, vary + "hand_mass_kg = 2")
    free, loaded, mass = (*pulled["normalised_cost"], held["normalised_cost"].iloc[0])
    assert free < mass, "with a mass in the hand, the suit saves a smaller share of the effort"
    assert abs(loaded - mass) < 0.3 * abs(free - mass)  # they differ by the inertia of a mass
    write_weight(tmp_path / "weight.xml", 1.0)  # in the data file alone
    found, _ = swept(tmp_path, vary + 'external_loads = ["none", "weight.xml"]')
    assert found.found_finished == 1


def test_a_failed_case_is_a_row_with_the_reason(tmp_path: Path) -> None:
    (tmp_path / "short.mot").write_text("short\nnRows=1\nnColumns=1\ninDegrees=no\nendheader\ntime\n0\n", "utf-8")
    vary = 'condition = "rigid"\nrest_length_m = [0.74, 1.2]\nmotion = ["bundled", "short.mot"]'
    found, table = swept(tmp_path, vary)
    assert (found.cases, found.failed, len(table)) == (8, 6, 8)
    slack = table[(table["rest_length_m"] == 1.2) & (table["motion"] == "bundled")]["error_code"]
    assert set(slack) == {SolverCode.CORD_SLACK}
    assert table[table["motion"] == "short.mot"]["error"].str.contains("short.mot").all()
    assert set(table[table["motion"] == "short.mot"]["error_code"]) == {SolverCode.NO_FRAMES}
    assert table[table["error"].isna()]["normalised_cost"].notna().all()
    assert found.first_error == table["error"].dropna().iloc[0]


def test_only_what_is_unfinished_or_damaged_is_solved_again_and_the_table_is_the_same(tmp_path: Path) -> None:
    vary = 'condition = "both"\nrest_length_m = [0.7, 0.74]'
    first, _ = swept(tmp_path, vary)
    once = first.table.read_bytes()
    again, _ = swept(tmp_path, vary, solve=nowhere)
    assert (first.found_finished, again.found_finished) == (0, 4)
    assert again.table.read_bytes() == once
    part, *_ = (tmp_path / "out" / "parts").rglob("*.json")
    part.write_text('{"normalised', "utf-8")
    repaired, _ = swept(tmp_path, vary)
    assert 0 < repaired.found_finished < 4
    assert repaired.table.read_bytes() == once


def test_a_larger_plan_keeps_its_cases_and_a_changed_cuff_does_not(tmp_path: Path) -> None:
    swept(tmp_path, 'condition = "both"\nrest_length_m = [0.7, 0.74]')
    grown, _ = swept(tmp_path, 'condition = ["rigid", "both"]\nrest_length_m = [0.7, 0.74]')
    assert (grown.cases, grown.found_finished) == (8, 4)
    plan = read_plan(write_plan(tmp_path, 'condition = "both"\nrest_length_m = [0.7, 0.74]'))
    cuffs = json.loads((tmp_path / "cuffs.json").read_text("utf-8"))
    cuffs["cuffs"]["hand"]["stiffness_n_per_m"] = 4000
    (tmp_path / "cuffs.json").write_text(json.dumps(cuffs), "utf-8")
    assert run_sweep(plan, tmp_path / "out", here).found_finished == 2  # the elbow's


def test_a_changed_solver_of_the_same_version_solves_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    vary = 'condition = "rigid"\nrest_length_m = 0.74'
    first, _ = swept(tmp_path, vary)
    (tmp_path / "solver").mkdir()
    (tmp_path / "solver" / "model.py").write_text("A = 1", "utf-8")
    monkeypatch.setattr("station.versions.resources.files", lambda _: tmp_path / "solver")
    changed, _ = swept(tmp_path, vary)
    (tmp_path / "solver" / "model.py").write_text("A = 2", "utf-8")
    again, _ = swept(tmp_path, vary)
    assert (first.found_finished, changed.found_finished, again.found_finished) == (0, 0, 0)
    assert swept(tmp_path, vary, solve=nowhere)[0].found_finished == again.cases


@pytest.mark.parametrize(
    ("vary", "error", "code", "file"),
    [
        ('model = "none.osim"', ModelError, SolverCode.UNREADABLE_FILE, "none.osim"),
        ('motion = "none.mot"', PlanError, SweepCode.FILE_UNREADABLE, "none.mot"),
        ('suit = "none.toml"', SuitError, SolverCode.SUIT_FILE, "none.toml"),
    ],
)
def test_a_missing_file_is_refused(
    tmp_path: Path, vary: str, error: type[SolverError | PlanError], code: StrEnum, file: str
) -> None:
    with pytest.raises(error) as caught:
        swept(tmp_path, vary, solve=nowhere)
    assert caught.value.code == code and file in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_a_cuff_that_is_missing_or_at_the_waist_is_refused(tmp_path: Path) -> None:
    plan = write_plan(tmp_path)
    for cuff, error, code in (("knee", InputError, InputCode.UNKNOWN_CUFF), ("waist", PlanError, SweepCode.WORN_CUFFS)):
        plan.write_text(f'[vary]\ncuffs = "cuffs.json"\ncuff = "{cuff}"\n', "utf-8")
        with raises_refusal(code, kind=error):
            run_sweep(read_plan(plan), tmp_path / "out", nowhere)


def test_a_grid_has_every_combination_in_the_order_of_the_axes_and_bundled_defaults(tmp_path: Path) -> None:
    plan = read_plan(write_plan(tmp_path, 'rest_length_m = [0.7, 0.74]\ncondition = ["rigid", "both"]'))
    points = [(p["rest_length_m"], p["cuff"], p["condition"]) for p in plan.points()]
    assert points == [(r, c, k) for r in (0.7, 0.74) for c in ("hand", "elbow") for k in ("rigid", "both")]
    first, *others = read_plan(write_plan(tmp_path)).points()
    files = [first[name] for name in ("model", "motion", "external_loads", "suit")]
    assert files == ["bundled", "bundled", "none", "bundled"]
    assert [p["condition"] for p in (first, *others)] == ["rigid", "shift", "visco_elastic", "both"] * 2
    assert "rest_length_m" not in first


@pytest.mark.parametrize("method", ["latin_hypercube", "random"])
def test_a_sample_is_drawn_from_its_spans_and_its_seed_alone(tmp_path: Path, method: str) -> None:
    vary = (
        "rest_length_m = { first = 0.6, last = 0.8 }\nstiffness_n_per_m = 500\n"
        "arm_point_m = { first = [0, -0.2, 0], last = [0, -0.1, 0.01] }"
    )
    head = f'method = "{method}"\ncount = 50\nseed = {{}}\n'
    drawn = list(read_plan(write_plan(tmp_path, vary, head.format(3))).points())
    lengths = np.array([p["rest_length_m"] for p in drawn])
    places = np.array([p["arm_point_m"] for p in drawn])
    assert len(drawn) == 50
    assert 0.6 <= lengths.min() < 0.62 and 0.78 < lengths.max() <= 0.8
    is_even = sorted((50 * (lengths - 0.6) / 0.2).astype(int)) == list(range(50))
    assert is_even == (method == "latin_hypercube"), "one point in every part of the span"
    assert (places >= [0, -0.2, 0]).all() and (places <= [0, -0.1, 0.01]).all()
    assert {p["cuff"] for p in drawn} == {"hand", "elbow"}
    assert {p["stiffness_n_per_m"] for p in drawn} == {500.0}
    assert drawn == list(read_plan(write_plan(tmp_path, vary, head.format(3))).points())
    assert drawn != list(read_plan(write_plan(tmp_path, vary, head.format(4))).points())


@pytest.mark.parametrize(
    ("vary", "head", "code", "key"),
    [
        ("rest_length = 0.7", "", SweepCode.WRONG_TABLE, "vary.rest_length"),
        ("", "evry = 3\n", SweepCode.WRONG_TABLE, "evry"),
        ("", "every = 0\n", SweepCode.WRONG_TABLE, "every"),
        ("", 'method = "sobol"\n', SweepCode.WRONG_TABLE, "method"),
        ("", 'method = "random"\n', SweepCode.WRONG_TABLE, "count"),
        ("rest_length_m = -0.7", "", SweepCode.WRONG_VALUE, "vary.rest_length_m"),
        ('rest_length_m = "long"', "", SweepCode.WRONG_VALUE, "vary.rest_length_m"),
        ("stiffness_n_per_m = 0", "", SweepCode.WRONG_VALUE, "vary.stiffness_n_per_m"),
        ("hand_mass_kg = -1", "", SweepCode.WRONG_VALUE, "vary.hand_mass_kg"),
        ("arm_point_m = [0.0, 0.1, nan]", "", SweepCode.WRONG_VALUE, "vary.arm_point_m.2"),
        ("rest_length_m = []", "", SweepCode.EMPTY_AXIS, "vary.rest_length_m"),
        ("rest_length_m = { first = 0.6, last = 0.8 }", "", SweepCode.SPAN_OF_GRID, "vary.rest_length_m"),
        ("arm_point_m = [0.0, 0.1]", "", SweepCode.WRONG_VALUE, "vary.arm_point_m.2"),
        ('condition = "loose"', "", SweepCode.WRONG_VALUE, "vary.condition"),
        ("model = 3", "", SweepCode.WRONG_VALUE, "vary.model"),
        ("model = ", "", SweepCode.UNREADABLE, "plan.toml"),
    ],
)
def test_a_wrong_plan_is_refused_by_its_key(tmp_path: Path, vary: str, head: str, code: SweepCode, key: str) -> None:
    with raises_refusal(code, key, kind=PlanError):
        read_plan(write_plan(tmp_path, vary, head))


def test_unusable_plans_are_refused_and_those_of_the_docs_are_not(tmp_path: Path, station) -> None:
    for text, key in (("[vary]\n", "vary.cuffs"), ("", "vary")):
        (tmp_path / "bare.toml").write_text(text, encoding="utf-8")
        with raises_refusal(SweepCode.WRONG_TABLE, key, kind=PlanError):
            read_plan(tmp_path / "bare.toml")
    with raises_refusal(SweepCode.UNREADABLE, kind=PlanError):
        read_plan(tmp_path / "none.toml")
    docs = (Path(__file__).parents[3] / "docs" / "sweep.md").read_text(encoding="utf-8")
    grid, sample = (block.split("```")[0] for block in docs.split("```toml\n")[1:])
    points = []
    for text in (grid, sample):
        (tmp_path / "plan.toml").write_text(text, encoding="utf-8")
        points.append(list(read_plan(tmp_path / "plan.toml").points()))
    assert [len(design) for design in points] == [2 * 2 * 2 * 3 * 2 * 2 * 2 * 2, 500]
    plan = write_plan(tmp_path, "rest_length_m = -1")
    assert_refused(station("sweep", plan, "--output", tmp_path / "out"), 1, SweepCode.WRONG_VALUE)
    assert not (tmp_path / "out").exists()


# Small plans for tests: a few frames of the bundled motion, published cuffs.


def write_plan(folder: Path, vary: str = "", head: str = "every = 60\n") -> Path:
    """plan.toml beside a cuffs.json; vary goes into its table of that name."""
    cuffs = {name: dict(zip(KEYS, values, strict=True)) for name, values in CUFFS.items()}
    (folder / "cuffs.json").write_text(json.dumps({"cuffs": cuffs}), encoding="utf-8")
    path = folder / "plan.toml"
    cuff = "" if "cuff = " in vary else CUFF
    path.write_text(f'{head}[vary]\ncuffs = "cuffs.json"\n{cuff}{vary}', encoding="utf-8")
    return path

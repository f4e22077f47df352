"""A sweep without a cluster: its table, its failures, and what it keeps between runs."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from solver.bundled import bundled_model
from solver.errors import SolverCode, SolverError
from solver.model import ModelError
from solver.motion import differentiate, read_motion
from solver.raise_arm import simulate_arm_raise
from solver.suit.optimise import LEAST_FRAMES
from solver.suit.scenarios import LoadedMotion
from solver.suit.suit import SuitError, read_suit
from solver.time_series_table import write_table
from station import sources
from station.assessment.assessment_inputs import InputError, read_cuffs_to_wear, worn_cuffs
from station.messages.codes import InputCode
from station.messages.study_messages import SweepCode
from station.sweep.dataset import SweepResult, run_sweep
from station.sweep.solving import Outcome, Task, solve_task
from station.sweep.sweep_plan import PlanError, read_plan
from tests.refusals import raises_refusal
from tests.station.loads import write_weight
from tests.station.sweep.test_sweep_plan import write_plan


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


def test_the_cost_of_every_case_is_that_of_the_assessment(tmp_path: Path) -> None:
    from solver.suit.assessment import assess

    found, table = swept(tmp_path, 'condition = ["rigid", "both"]')
    model = bundled_model()
    worn = worn_cuffs(read_cuffs_to_wear(tmp_path / "cuffs.json"), ())
    motion = LoadedMotion(model, differentiate(simulate_arm_raise(model)))
    whole = assess(motion, read_suit(), worn, every=60)
    assert (found.cases, found.failed, found.unsolved) == (4, 0, 0)
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


def test_a_motion_without_a_column_is_that_with_the_default_and_is_read_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
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
def test_a_plan_that_keeps_few_frames_is_told(tmp_path: Path, every: int, is_few: bool) -> None:
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


def test_the_suit_saves_a_smaller_share_of_the_effort_with_a_mass_in_the_hand(tmp_path: Path) -> None:
    _, table = swept(tmp_path, 'condition = "rigid"\nrest_length_m = 0.74\nhand_mass_kg = [0, 2]')
    light, heavy = (table[table["hand_mass_kg"] == mass]["normalised_cost"].iloc[0] for mass in (0.0, 2.0))
    assert light < heavy


def test_an_external_load_acts_as_the_equivalent_mass(tmp_path: Path) -> None:
    write_weight(tmp_path / "weight.xml", 2.0)
    vary = 'condition = "rigid"\ncuff = "hand"\nrest_length_m = 0.74\n'
    _, pulled = swept(tmp_path, vary + 'external_loads = ["none", "weight.xml"]')
    _, held = swept(tmp_path, vary + "hand_mass_kg = 2")
    free, loaded, mass = (*pulled["normalised_cost"], held["normalised_cost"].iloc[0])
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


def test_finished_cases_are_not_solved_again_and_the_table_is_the_same(tmp_path: Path) -> None:
    first, _ = swept(tmp_path, 'condition = "both"\nrest_length_m = [0.7, 0.74]')
    once = first.table.read_bytes()
    again, _ = swept(tmp_path, 'condition = "both"\nrest_length_m = [0.7, 0.74]', solve=nowhere)
    assert (first.found_finished, again.found_finished) == (0, 4)
    assert again.table.read_bytes() == once


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


def test_a_damaged_part_is_solved_again(tmp_path: Path) -> None:
    first, _ = swept(tmp_path, 'condition = "both"\nrest_length_m = 0.7')
    once = first.table.read_bytes()
    part, *_ = (tmp_path / "out" / "parts").rglob("*.json")
    part.write_text('{"normalised', "utf-8")
    again, _ = swept(tmp_path, 'condition = "both"\nrest_length_m = 0.7')
    assert again.found_finished == 1
    assert again.table.read_bytes() == once


def test_the_plans_hash_is_stored_with_the_table(tmp_path: Path) -> None:
    from pyarrow import parquet

    found, _ = swept(tmp_path, 'condition = "rigid"\nrest_length_m = 0.7')
    digest = read_plan(tmp_path / "plan.toml").digest
    assert json.loads((tmp_path / "out" / "sweep.json").read_text("utf-8"))["plan_sha256"] == digest
    assert parquet.read_schema(found.table).metadata[b"plan_sha256"].decode() == digest


@pytest.mark.parametrize(
    ("vary", "error", "code", "file"),
    [
        ('model = "none.osim"', ModelError, SolverCode.UNREADABLE_FILE, "none.osim"),
        ('motion = "none.mot"', PlanError, SweepCode.FILE_UNREADABLE, "none.mot"),
        ('suit = "none.toml"', SuitError, SolverCode.SUIT_FILE, "none.toml"),
    ],
)
def test_a_missing_file_ends_the_sweep_before_it_begins(
    tmp_path: Path, vary: str, error: type[SolverError | PlanError], code: StrEnum, file: str
) -> None:
    with pytest.raises(error) as caught:
        swept(tmp_path, vary, solve=nowhere)
    assert caught.value.code == code and file in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_a_cuff_that_is_missing_or_at_the_waist_is_refused(tmp_path: Path) -> None:
    plan = write_plan(tmp_path)
    for cuff, error, code in (
        ("knee", InputError, InputCode.UNKNOWN_CUFF),
        ("waist", PlanError, SweepCode.WORN_CUFFS),
    ):
        plan.write_text(f'[vary]\ncuffs = "cuffs.json"\ncuff = "{cuff}"\n', "utf-8")
        with raises_refusal(code, kind=error):
            run_sweep(read_plan(plan), tmp_path / "out", nowhere)

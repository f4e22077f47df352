"""People from the command line to assessment.json: intervals, decision, table; tasks are kept and continued."""

from __future__ import annotations

import copy
import csv
import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fitting.results.standing import Standing
from solver.uncertainty.factors import normal_scores, unit_sample
from solver.uncertainty.sources import BodySpread
from station.assessment.assess import assess_cuffs, decision_sentences, write_assessment
from station.assessment.assessment_file import AssessmentFileError, read_assessment
from station.assessment.assessment_inputs import AssessmentInputs, read_cuffs_to_wear
from station.assessment.budget_file import read_budget
from station.assessment.people_run import (
    PeopleOptions,
    PeopleRun,
    PeopleTask,
    Readouts,
    people_run,
    run_people,
    solve_here,
)
from station.errors import UnusedOption
from station.messages.assessment_file_codes import AssessmentFileCode
from station.messages.codes import AssessmentCode, DecisionCode, InputCode
from station.report.page import write_report
from station.report.report_file import read_numbers
from station.report.verification import number_links
from tests.solver.uncertainty.test_people import CASE
from tests.station.assessment.test_assess import numbers_in, write_cuffs
from tests.station.refusals import raises_refusal
from tests.station.report.unmarked import unmarked_numbers

BUDGET = "[sample]\npeople = 29\nframes = 8\npeople_with_cubes = 3\n[donning]\nmigration = 0.3\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("people")
    (folder / "uncertainty.toml").write_text(BUDGET, encoding="utf-8")
    write_cuffs(folder / "cuffs.json")
    return folder


def assessed(folder: Path, run: PeopleRun, output: Path) -> dict[str, Any]:
    inputs = AssessmentInputs(folder / "cuffs.json")
    found = assess_cuffs(
        read_cuffs_to_wear(inputs.cuffs), inputs, most_frames=8, most_rest_lengths=9, draws=3, people=run
    )
    write_assessment(found, output)
    plain = read_assessment(output / "assessment.json")
    assert decision_sentences(found)[:2] == [plain["decision"][basis]["text"] for basis in ("at_reference", "at_best")]
    return plain


@pytest.fixture(scope="module")
def plain(folder: Path) -> dict[str, Any]:
    with people_run(folder, PeopleOptions(folder / "uncertainty.toml", index_blocks=8)) as run:
        assert run is not None
        return assessed(folder, run, folder)


def test_intervals_of_total_uncertainty_hold_those_of_the_fit(plain: dict[str, Any]) -> None:
    total = plain["total_uncertainty"]
    assert (total["people"]["value"], total["solved"]["value"]) == (29, 29)
    for key in ("at_rigid_optimum", "optimum", "largest_cord_force_n", "muscle_reduction"):
        assert total[key].keys() == plain[key].keys()
    for cuff in ("hand", "elbow"):
        wide, narrow = total["at_rigid_optimum"][cuff]["both"], plain["at_rigid_optimum"][cuff]["both"]
        assert wide["value"] == narrow["value"]
        assert np.ptp(wide["ci95"]) > 3 * np.ptp(narrow["ci95"])
    assert np.ptp(total["at_rigid_optimum"]["rigid"]["ci95"]) > 0.05, "rigid cuffs have the doubt of body and motion"
    assert list(numbers_in(plain)) == []


def test_the_band_over_the_rest_length_holds_the_curve_and_the_interval_at_the_reference(plain: dict[str, Any]) -> None:
    total, lengths = plain["total_uncertainty"], np.array(plain["rest_lengths_m"]["value"])
    assert set(total["cost"]) == {"hand", "elbow"}
    for cuff, bands in total["cost"].items():
        assert bands["both"]["value"] == plain["cost"][cuff]["both"]["value"]
        low, high = np.array([ends or (np.nan, np.nan) for ends in bands["both"]["ci95"]]).T
        cost, is_known = np.array(bands["both"]["value"]), np.isfinite(low)
        assert is_known.sum() >= 7 and (low <= cost)[is_known].all() and (cost <= high)[is_known].all()
        reference = plain["reference_rest_length_m"]["value"]
        ends = [np.interp(reference, lengths[is_known], edge[is_known]) for edge in (low, high)]
        assert ends == pytest.approx(total["at_rigid_optimum"][cuff]["both"]["ci95"], abs=0.03)


@pytest.mark.parametrize(
    ("place", "broken", "code"),
    [
        (("total_uncertainty", "cost", "hand", "both", "ci95"), [None], AssessmentFileCode.INTERVAL_MISSING),
        (("total_uncertainty", "cost", "hand"), {}, AssessmentFileCode.INTERVAL_MISSING),
        (("total_uncertainty", "at_rigid_optimum", "hand"), {}, AssessmentFileCode.OTHER_CONDITIONS),
        (("postures",), [], AssessmentFileCode.WRONG_POSTURES),
        (("postures", 0, "cord_m", "value"), [[0.0, 1.0]], AssessmentFileCode.INVALID_ENTRY),
        (("postures", 0, "bones", 0, "kind"), "feather", AssessmentFileCode.INVALID_ENTRY),
    ],
)
def test_a_file_whose_bands_or_postures_do_not_fit_is_refused(
    plain: dict[str, Any], tmp_path: Path, place: tuple[Any, ...], broken: Any, code: AssessmentFileCode
) -> None:
    changed = copy.deepcopy(plain)
    *steps, last = place
    parent: Any = changed
    for step in steps:
        parent = parent[step]
    parent[last] = broken if place != ("postures",) else parent[last][:2]
    path = tmp_path / "assessment.json"
    path.write_text(json.dumps(changed), encoding="utf-8")
    with raises_refusal(AssessmentFileError, code) as caught:
        read_assessment(path)
    assert str(place[0]) in str(caught.value)


def test_the_numbers_of_a_report_on_drawn_people_name_the_people_and_their_seed(
    plain: dict[str, Any], folder: Path
) -> None:
    path = write_report(folder)
    listed = read_numbers(path.with_name("report.json")).numbers
    effort = listed["assessment.total_uncertainty.at_rigid_optimum.hand.both"]
    total = plain["total_uncertainty"]
    assert (effort.draws, effort.seed) == (total["people"]["value"], total["seed"]["value"])
    assert unmarked_numbers(path, folder.name) == []
    assert {link.standing for link in number_links(folder)} == {Standing.AS_RECORDED}


def test_every_group_has_indices_of_effort_rest_length_and_difference(plain: dict[str, Any]) -> None:
    found = {(entry["figure"], *entry["cuffs"]): entry["groups"] for entry in plain["total_uncertainty"]["indices"]}
    assert set(found) == {
        *((figure, cuff) for figure in ("effort_at_reference", "best_rest_length") for cuff in ("hand", "elbow")),
        ("difference_at_reference", "hand", "elbow"),
        ("difference_at_best", "hand", "elbow"),
    }
    assert set(found["best_rest_length", "hand"]) == {"fit", "donning", "body", "muscles", "motion"}
    assert found["effort_at_reference", "hand"]["fit"]["total"]["value"] < 0.1, "the fit is the least of the doubts"


def test_the_findings_compare_the_cuffs_with_the_total_uncertainty(plain: dict[str, Any]) -> None:
    found = {entry["code"]: entry["figures"] for entry in plain["finding_codes"]}
    assert found[AssessmentCode.INTERVALS_TOTAL]["people"] == 29
    low, high = plain["decision"]["at_reference"]["pairs"][0]["difference"]["ci95"]
    (comparison,) = [entry["figures"] for entry in plain["finding_codes"] if entry["code"].startswith("comparison.")]
    assert float(comparison["low_percent"]) == pytest.approx(100 * low, abs=0.1)
    assert float(comparison["high_percent"]) == pytest.approx(100 * high, abs=0.1)


def test_some_people_are_solved_again_with_cubes(plain: dict[str, Any]) -> None:
    cubes, decided = plain["total_uncertainty"]["cubes"], plain["decision"]["cubes"]
    assert (cubes["people"]["value"], cubes["solved"]["value"]) == (3, 3)
    assert decided["code"] in {DecisionCode.CUBES_AGREE, DecisionCode.CUBES_DIFFER}
    assert decided["at_reference"]["pairs"][0]["cuffs"] == ["hand", "elbow"]
    assert cubes["at_rigid_optimum"].keys() == plain["at_rigid_optimum"].keys()
    changes = {(entry["figure"], *entry["cuffs"]): entry["change"]["value"] for entry in cubes["changes"]}
    assert changes["effort_at_reference", "hand"] < 0 < changes["effort_at_reference", "hand"] + 0.2
    assert -0.05 < changes["best_rest_length", "hand"] < 0


def test_the_decision_is_that_of_the_table_of_people(plain: dict[str, Any], folder: Path) -> None:
    rows = list(csv.DictReader((folder / "people.csv").read_text(encoding="utf-8").splitlines()))
    efforts = {
        cuff: np.array([float(r["effort_at_reference"]) for r in rows if (r["condition"], r["cuff"]) == ("both", cuff)])
        for cuff in ("hand", "elbow")
    }
    own = {cuff: plain["at_rigid_optimum"][cuff]["both"]["value"] for cuff in efforts}
    difference = np.subtract(*(drawn[1:] - drawn[0] + own[cuff] for cuff, drawn in efforts.items()))
    (pair,) = plain["decision"]["at_reference"]["pairs"]
    assert pair["cuffs"] == ["hand", "elbow"]
    assert pair["first_saves_more"]["value"] == pytest.approx((difference <= -0.02).mean())
    assert plain["decision"]["at_best"]["code"] in set(DecisionCode)
    assert plain["inputs"]["budget"].startswith("uncertainty.toml ")


def test_an_interrupted_run_continues_with_the_same_result(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("station.assessment.people_run.PEOPLE_PER_TASK", 2)
    scores = normal_scores(unit_sample(CASE.factors, 4, "latin_hypercube", seed=1))
    left: list[int] = []

    def interrupted(tasks: Sequence[PeopleTask]) -> Iterator[tuple[str, Readouts]]:
        yield next(solve_here(tasks))
        raise KeyboardInterrupt

    def counted(tasks: Sequence[PeopleTask]) -> Iterator[tuple[str, Readouts]]:
        left.append(len(tasks))
        return solve_here(tasks)

    with pytest.raises(KeyboardInterrupt):
        run_people(CASE, scores, PeopleRun(read_budget(), tmp_path, interrupted))
    (first,) = tmp_path.glob("*.npz")
    once = run_people(CASE, scores, PeopleRun(read_budget(), tmp_path, counted))
    first.write_bytes(b"damaged")
    again = run_people(CASE, scores, PeopleRun(read_budget(), tmp_path, counted))
    assert left == [1, 1], "one of two tasks was left, then the damaged one"
    for place, reading in once.items():
        np.testing.assert_array_equal(reading.at_reference, again[place].at_reference)
    assert len(once["both", "hand"].rest_length) == 4


def test_other_sources_or_another_motion_are_other_tasks(tmp_path: Path) -> None:
    keys: list[str] = []

    def noted(tasks: Sequence[PeopleTask]) -> Iterator[tuple[str, Readouts]]:
        keys.extend(task.key for task in tasks)
        return solve_here(tasks)

    scores = np.zeros((1, sum(factor.size for factor in CASE.factors)))
    slower = replace(CASE.motion.kinematics, time=1.1 * CASE.motion.kinematics.time)
    for case in (
        CASE,
        replace(CASE, sources=replace(CASE.sources, body=BodySpread(size=0.1))),
        replace(CASE, motion=replace(CASE.motion, kinematics=slower)),
        replace(CASE, suit=replace(CASE.suit, stiffness=499.0)),
        CASE,
    ):
        run_people(case, scores, PeopleRun(read_budget(), tmp_path, noted))
    assert len(set(keys)) == len(keys) == 4, "the last is the first, which is kept"


def test_without_a_budget_or_a_number_no_people_are_drawn(tmp_path: Path) -> None:
    with people_run(tmp_path, PeopleOptions()) as run:
        assert run is None
    with raises_refusal(UnusedOption, InputCode.NO_PEOPLE), people_run(tmp_path, PeopleOptions(workers=2)):
        pass

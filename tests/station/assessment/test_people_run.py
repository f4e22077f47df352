"""People from the command line to assessment.json: intervals, decision, table; tasks are kept and continued."""

import copy
import csv
import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from documents.message import Message
from fitting.results.codes import Standing
from solver.bundled import bundled_model, simulate_arm_raise
from solver.motion import differentiate
from solver.multibody.postures import points_in_ground, postures
from solver.suit.decision import compare
from solver.suit.suit import read_suit
from solver.uncertainty.factors import normal_scores, unit_sample
from solver.uncertainty.sources import BodySpread
from station.assessment.assess import assess_cuffs, decision_sentences, write_assessment
from station.assessment.assessment_file import AssessmentFileError, read_assessment
from station.assessment.assessment_inputs import AssessmentInputs, read_cuffs_to_wear
from station.assessment.budget_file import read_budget
from station.assessment.drawn_postures import PostureEntry, drawn_postures
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
from station.messages.assessment_messages import AssessmentCode, AssessmentFileCode, DecisionCode, InputCode
from station.report.page import write_report
from station.report.report_file import read_numbers
from station.report.verification import number_links
from tests.refusals import raises_refusal
from tests.solver.uncertainty.test_people import CASE
from tests.station.assessment.test_assess import numbers_in, write_cuffs
from tests.station.reported import few_people, unmarked_numbers

BUDGET = "[sample]\npeople = 40\nframes = 8\n[donning]\nmigration = 0.3\n"
MODEL, SUIT = bundled_model(), read_suit()
MOTION = differentiate(simulate_arm_raise(MODEL))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("people")
    (folder / "uncertainty.toml").write_text(BUDGET, encoding="utf-8")
    write_cuffs(folder / "cuffs.json")
    return folder


def assessed(folder: Path, run: PeopleRun, output: Path) -> dict[str, Any]:
    inputs = AssessmentInputs(folder / "cuffs.json")
    found = assess_cuffs(read_cuffs_to_wear(inputs.cuffs), inputs, most_frames=8, most_rest_lengths=9, people=run)
    write_assessment(found, output)
    decision = read_assessment(output / "assessment.json").decision
    assert decision and decision_sentences(found)[:2] == [decision.at_reference.text, decision.at_best.text]
    plain: dict[str, Any] = json.loads((output / "assessment.json").read_text(encoding="utf-8"))
    return plain


@pytest.fixture(scope="module")
def plain(folder: Path) -> dict[str, Any]:
    with people_run(folder, PeopleOptions(budget=folder / "uncertainty.toml", index_blocks=8)) as run:
        assert run is not None
        return assessed(folder, run, folder)


def test_every_figure_and_the_band_of_the_curve_have_the_interval_of_the_people(plain: dict[str, Any]) -> None:
    summary = plain["uncertainty"]
    assert (summary["people"]["value"], summary["solved"]["value"]) == (40, 40)
    assert summary["sources"] == ["fit", "donning", "body", "muscles", "motion"]
    least, most = summary["content"]["ci95"]
    assert 0.8 < least < summary["content"]["value"] == 0.95 < most < 1.0
    for cuff in ("hand", "elbow"):
        assert np.ptp(plain["at_rigid_optimum"][cuff]["both"]["ci95"]) > 0.05
    assert np.ptp(plain["at_rigid_optimum"]["rigid"]["ci95"]) > 0.05, "body and motion vary with rigid cuffs, too"
    assert list(numbers_in(plain)) == []
    lengths = np.array(plain["rest_lengths_m"]["value"])
    for cuff in ("hand", "elbow"):
        band = plain["cost"][cuff]["both"]
        low, high = np.array([ends or (np.nan, np.nan) for ends in band["ci95"]]).T
        cost, is_known = np.array(band["value"]), np.isfinite(low)
        assert is_known.sum() >= 7 and (low <= cost)[is_known].all() and (cost <= high)[is_known].all()
        reference = plain["reference_rest_length_m"]["value"]
        ends = [np.interp(reference, lengths[is_known], edge[is_known]) for edge in (low, high)]
        assert ends == pytest.approx(plain["at_rigid_optimum"][cuff]["both"]["ci95"], abs=0.03)


def test_the_noise_of_the_fit_alone_is_narrow_and_decides_nothing(folder: Path, plain: dict[str, Any]) -> None:
    inputs = AssessmentInputs(folder / "cuffs.json")
    run = few_people(20, sources="cuffs")
    found = assess_cuffs(read_cuffs_to_wear(inputs.cuffs), inputs, most_frames=8, most_rest_lengths=9, people=run)
    (curve,) = (one for one in found.assessment.curves if (one.condition, one.cuff) == ("both", "hand"))
    assert found.assessment.uncertainty is not None and found.assessment.uncertainty.sources == ("fit",)
    narrow, wide = curve.figures["at_reference"].ci95, plain["at_rigid_optimum"]["hand"]["both"]["ci95"]
    assert narrow is not None and 0 < 3 * np.ptp(narrow) < np.ptp(wide)
    assert decision_sentences(found) == [str(Message(DecisionCode.FIT_ONLY))]


@pytest.mark.parametrize(
    ("place", "broken", "code"),
    [
        (("cost", "hand", "both", "ci95"), [None], AssessmentFileCode.INTERVAL_MISSING),
        (("uncertainty", "sources"), [], AssessmentFileCode.INVALID_ENTRY),
        (("uncertainty", "sources"), ["moods"], AssessmentFileCode.INVALID_ENTRY),
        (("postures",), [], AssessmentFileCode.WRONG_POSTURES),
        (("postures", 0, "cord_m", "value"), [[0.0, 1.0]], AssessmentFileCode.INVALID_ENTRY),
        (("postures", 0, "bones", 0, "kind"), "feather", AssessmentFileCode.INVALID_ENTRY),
        (("inputs", "tendons"), "soft", AssessmentFileCode.INVALID_ENTRY),
        (("inputs", "paths"), "straight", AssessmentFileCode.INVALID_ENTRY),
        *((("frames", "value"), number, AssessmentFileCode.INVALID_ENTRY) for number in (-1, 0.5, "8")),
        (("uncertainty", "people", "value"), -40, AssessmentFileCode.INVALID_ENTRY),
        (("uncertainty", "index_blocks", "value"), 0.5, AssessmentFileCode.INVALID_ENTRY),
        *(
            (("inputs", "cutoff_hz"), text, AssessmentFileCode.INVALID_ENTRY)
            for text in ("six", "0", "0.0", "-3", "nan", "inf", "1e400", "")
        ),
    ],
)
def test_a_file_whose_bands_postures_or_options_do_not_fit_is_refused(
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
    with raises_refusal(code, str(place[0]), kind=AssessmentFileError):
        read_assessment(path)


def test_the_numbers_of_a_report_on_people_name_count_and_seed(plain: dict[str, Any], folder: Path) -> None:
    path = write_report(folder)
    listed = read_numbers(path.with_name("report.json")).numbers
    effort, summary = listed["assessment.at_rigid_optimum.hand.both"], plain["uncertainty"]
    assert (effort.draws, effort.seed) == (summary["people"]["value"], summary["seed"]["value"])
    assert unmarked_numbers(path, folder.name) == []
    assert {link.standing for link in number_links(folder)} == {Standing.AS_RECORDED}


def test_every_group_has_indices_and_the_cuffs_are_compared_with_the_intervals_of_people(plain: dict[str, Any]) -> None:
    found = {(entry["figure"], *entry["cuffs"]): entry["groups"] for entry in plain["uncertainty"]["indices"]}
    assert set(found) == {
        *((figure, cuff) for figure in ("effort_at_reference", "best_rest_length") for cuff in ("hand", "elbow")),
        ("difference_at_reference", "hand", "elbow"),
        ("difference_at_best", "hand", "elbow"),
    }
    assert set(found["best_rest_length", "hand"]) == {"fit", "donning", "body", "muscles", "motion"}
    assert found["effort_at_reference", "hand"]["fit"]["total"]["value"] < 0.1, "the fit is the least of the doubts"
    found = {entry["code"]: entry["figures"] for entry in plain["finding_codes"]}
    assert found[AssessmentCode.INTERVALS]["people"] == 40
    low, high = plain["decision"]["at_reference"]["pairs"][0]["difference"]["ci95"]
    (comparison,) = [entry["figures"] for entry in plain["finding_codes"] if entry["code"].startswith("comparison.")]
    assert float(comparison["low_percent"]) == pytest.approx(100 * low, abs=0.1)
    assert float(comparison["high_percent"]) == pytest.approx(100 * high, abs=0.1)


def test_the_decision_is_that_of_the_table_of_people(plain: dict[str, Any], folder: Path) -> None:
    rows = list(csv.DictReader((folder / "people.csv").read_text(encoding="utf-8").splitlines()))
    efforts = {
        cuff: np.array([float(r["effort_at_reference"]) for r in rows if (r["condition"], r["cuff"]) == ("both", cuff)])
        for cuff in ("hand", "elbow")
    }
    own = {cuff: plain["at_rigid_optimum"][cuff]["both"]["value"] for cuff in efforts}
    drawn = {cuff: effort[1:] - effort[0] + own[cuff] for cuff, effort in efforts.items()}
    (pair,) = plain["decision"]["at_reference"]["pairs"]
    assert pair["cuffs"] == ["hand", "elbow"]
    expected = compare(drawn, ("hand", "elbow"), 0.02).first_saves_more
    assert pair["first_saves_more"]["value"] == pytest.approx(expected)
    assert expected == pytest.approx(np.mean(drawn["hand"] - drawn["elbow"] <= -0.02), abs=0.05)
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


def test_people_are_drawn_by_default_and_kept_where_they_are_asked_for(tmp_path: Path) -> None:
    for options, people, is_kept in ((PeopleOptions(), 100, False), (PeopleOptions(people=300), 300, True)):
        with people_run(tmp_path, options) as run:
            assert run is not None and run.budget.sample.people == people and (run.folder is not None) == is_kept
    with people_run(tmp_path, PeopleOptions(people=0)) as run:
        assert run is None
    for options in (PeopleOptions(people=0, workers=2), PeopleOptions(people=0, index_blocks=8)):
        with raises_refusal(InputCode.NO_PEOPLE, kind=UnusedOption), people_run(tmp_path, options):
            pass


@pytest.fixture(scope="module")
def drawn() -> list[PostureEntry]:
    return drawn_postures(MODEL, MOTION, SUIT, MOTION.time[::20])


def test_the_arm_is_at_its_lowest_in_the_middle_and_at_its_highest(drawn: list[PostureEntry]) -> None:
    elevations = [posture.elevation_deg.value for posture in drawn]
    state = postures(MODEL, MOTION.positions[::20], MOTION.speeds[::20])
    of = {marker.name: marker for marker in MODEL.markers}
    epicondyles = np.mean(
        [points_in_ground(state, of[name].body, of[name].location) for name in ("EpL", "EpM")], axis=0
    )
    along = epicondyles - state.origin_in_ground[:, MODEL.body_index("humerus")]
    by_markers = np.degrees(np.arccos(-along[:, 1] / np.linalg.norm(along, axis=1)))
    middle = (by_markers.min() + by_markers.max()) / 2
    assert elevations == pytest.approx([by_markers.min(), middle, by_markers.max()], abs=4.0)
    assert elevations == sorted(elevations)


def test_lines_are_those_of_the_model_and_the_suit_at_that_time(drawn: list[PostureEntry]) -> None:
    for posture in drawn:
        frame = int(np.argmin(np.abs(MOTION.time - posture.time_s.value)))
        state = postures(MODEL, MOTION.positions[[frame]], MOTION.speeds[[frame]])
        for muscle in MODEL.muscles:
            line = np.array(posture.muscles_m[muscle.name].value)
            for end, point in ((line[0], muscle.path.points[0]), (line[-1], muscle.path.points[-1])):
                np.testing.assert_allclose(end, points_in_ground(state, point.body, point.location)[0], atol=6e-4)
        arm = points_in_ground(state, MODEL.body_index(SUIT.arm.body), SUIT.arm.location)[0]
        np.testing.assert_allclose(posture.cord_m.value[-1], arm, atol=6e-4)
        ring = np.array(posture.cuffs_m["arm"].value)
        assert np.linalg.norm(ring - arm, axis=1).min() < 0.01, "the cord ends on the cuff"

"""From cuffs.json to optimum.json, for one arm cuff at a time."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from documents.message import Message
from station.assessment.assess import assess_cuffs, assess_file, decision_sentences, write_assessment
from station.assessment.assessment_inputs import AssessmentInputs, InputError, read_cuffs_to_wear
from station.assessment.optimum import optimise_file
from station.exit_code import WRONG_USAGE
from station.folders import NotAFolder
from station.messages.assessment_messages import AssessmentCode, DecisionCode, InputCode
from station.report.page import write_report
from tests.refusals import raises_refusal
from tests.station.assessment.test_assess import write_cuffs
from tests.station.reported import few_people

NO_COVARIANCE = str(Message(AssessmentCode.NO_COVARIANCE))


def test_the_optimum_is_written_beside_the_suit_as_it_was(tmp_path: Path) -> None:
    inputs = AssessmentInputs(write_cuffs(tmp_path / "cuffs.json"), chosen=("hand",))
    found = optimise_file(inputs, tmp_path / "out", "both", draws=2)
    plain = json.loads((tmp_path / "out" / "optimum.json").read_text(encoding="utf-8"))
    assert (plain["cuff"], plain["condition"], plain["free"]) == ("hand", "both", ["rest_length"])
    assert plain["start"]["rest_length_m"] == {"value": 0.74, "ci95": None}
    assert plain["optimum"]["rest_length_m"]["value"] == found.optimum.rest_length_m.value
    assert plain["optimum"]["normalised_cost"]["value"] < plain["start"]["normalised_cost"]["value"]
    low, high = plain["robust_optimum"]["normalised_cost_of_draws"]["ci95"]
    assert low <= plain["robust_optimum"]["normalised_cost_of_draws"]["value"] <= high
    assert plain["suits_tried"] == {"value": found.suits_tried.value, "ci95": None}
    assert plain["inputs"]["cuffs"].startswith("cuffs.json ")
    assert NO_COVARIANCE not in found.remarks


def test_the_suits_found_are_worn_by_the_next_assessment_at_the_cost_that_was_found(tmp_path: Path) -> None:
    cuffs = write_cuffs(tmp_path / "cuffs.json")
    inputs = AssessmentInputs(cuffs, chosen=("elbow",))
    found = optimise_file(inputs, tmp_path, "both", ("stiffness",), draws=2)
    for name, tried in (("suit.toml", found.optimum), ("robust_suit.toml", found.robust_optimum)):
        worn = replace(inputs, suit=tmp_path / name)
        assessment = assess_cuffs(read_cuffs_to_wear(cuffs), worn, most_rest_lengths=5).assessment
        (curve,) = [curve for curve in assessment.curves if curve.condition == "both"]
        assert assessment.reference_rest_length == tried.rest_length_m.value
        assert worn.read_suit().stiffness == tried.stiffness_n_per_m.value
        assert curve.figures["at_reference"].value == pytest.approx(tried.normalised_cost.value, rel=1e-9)


def test_without_draws_there_is_no_robust_suit(tmp_path: Path) -> None:
    inputs = AssessmentInputs(write_cuffs(tmp_path / "cuffs.json"), chosen=("hand",))
    optimise_file(inputs, tmp_path, "rigid", draws=2)
    assert {path.name for path in tmp_path.glob("*.toml")} == {"suit.toml"}


def test_cuffs_without_a_covariance_have_no_intervals_and_a_remark_says_so(tmp_path: Path) -> None:
    path = write_cuffs(tmp_path / "cuffs.json")
    inputs = AssessmentInputs(path, chosen=("hand",))
    given = json.loads(path.read_text(encoding="utf-8"))
    for cuff in given["cuffs"].values():
        for estimate in cuff.values():
            del estimate["standard_error"]
    path.write_text(json.dumps(given), encoding="utf-8")
    assert NO_COVARIANCE in optimise_file(inputs, tmp_path, draws=2).remarks
    assert NO_COVARIANCE not in optimise_file(inputs, tmp_path, draws=0).remarks
    run = few_people(2, sources="cuffs")
    assessed = assess_cuffs(read_cuffs_to_wear(path), inputs, most_frames=3, most_rest_lengths=3, people=run)
    assert AssessmentCode.NO_COVARIANCE in [finding.code for finding in assessed.findings]
    assert assessed.assessment.uncertainty is None


def test_an_assessment_with_elastic_tendons_suggests_nothing_that_is_refused(tmp_path: Path) -> None:
    inputs = AssessmentInputs(write_cuffs(tmp_path / "cuffs.json"), chosen=("hand",))
    found = assess_cuffs(read_cuffs_to_wear(inputs.cuffs), inputs, most_frames=3, most_rest_lengths=3)
    assert AssessmentCode.NO_INTERVALS in [finding.code for finding in found.findings]
    elastic = replace(found, inputs=replace(inputs, tendons="elastic").hashes())
    (sentence,) = decision_sentences(elastic)
    assert sentence == str(Message(DecisionCode.NO_PEOPLE))
    write_assessment(elastic, tmp_path)
    assert "--people" not in write_report(tmp_path).read_text(encoding="utf-8")


def test_an_output_that_is_a_file_is_refused_before_anything_is_solved(tmp_path: Path) -> None:
    inputs = AssessmentInputs(write_cuffs(tmp_path / "cuffs.json"), chosen=("hand",))
    for solve in (optimise_file, assess_file):
        with raises_refusal(InputCode.OUTPUT_IS_FILE, kind=NotAFolder) as caught:
            solve(inputs, inputs.cuffs)
        assert caught.value.exit_code == WRONG_USAGE


@pytest.mark.parametrize(
    ("chosen", "code"),
    [((), InputCode.ONE_ARM_CUFF), (("waist",), InputCode.ONE_ARM_CUFF), (("nope",), InputCode.UNKNOWN_CUFF)],
)
def test_a_cuff_that_is_not_the_one_arm_cuff_is_wrong_usage(
    tmp_path: Path, chosen: tuple[str, ...], code: InputCode
) -> None:
    with raises_refusal(code, kind=InputError) as caught:
        optimise_file(AssessmentInputs(write_cuffs(tmp_path / "cuffs.json"), chosen=chosen), tmp_path)
    assert caught.value.exit_code == WRONG_USAGE
    assert chosen == () or chosen[0] in str(caught.value)

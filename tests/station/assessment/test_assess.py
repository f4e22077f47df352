"""From cuffs.json to assessment.json, its decision, the activations, and the report's section on the suit."""

import json
import shutil
from collections.abc import Iterator, Mapping
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from markupsafe import escape

from documents.message import Message
from solver.errors import SolverCode
from solver.suit.assessment import UncertaintySummary
from solver.suit.decision import Basis, CuffDecision, DecisionRule, decide
from solver.suit.suit import BUNDLED_SUIT
from solver.uncertainty.indices import SobolIndices
from station.assessment.assess import AssessedSuit, assess_cuffs, assess_file, decision_sentences, write_assessment
from station.assessment.assessment_file import AssessmentFileError, read_assessment
from station.assessment.assessment_inputs import (
    AssessmentInputs,
    EmgError,
    InputError,
    cuff_findings,
    read_cuffs_to_wear,
    read_emg,
    wearable,
    worn_cuffs,
)
from station.assessment.optimum import optimise_file
from station.assessment.uncertainty_json import decision_entry, percent, without_decision
from station.checksums import file_sha256
from station.exit_code import WRONG_USAGE
from station.folders import NotAFolder
from station.messages.assessment_messages import AssessmentCode, AssessmentFileCode, DecisionCode, InputCode
from station.report.first_page import IN_TABLES
from station.report.page import write_report
from tests.refusals import raises_refusal
from tests.station.loads import write_weight
from tests.station.reported import few_people, unmarked_numbers

CUFFS = {"waist": (2140.0, 124.0, 0.012), "hand": (8520.0, 210.0, 0.012), "elbow": (2530.0, 139.0, 0.022)}
KEYS = ("stiffness_n_per_m", "damping_n_s_per_m", "migration_m")
RULE = DecisionRule()
SPREAD = np.linspace(-0.02, 0.02, 1001)
LOW = np.full(1001, 0.8)
SHARES = np.array([0.2, 0.7])
INDICES = {
    (f"difference_{basis}", ("hand", "tube")): SobolIndices(
        ("fit", "donning"), SHARES, SHARES / 2, SHARES, SHARES, 1.0, 64
    )
    for basis in ("at_reference", "at_best")
}


def fitted(value: float, error: float) -> dict[str, float]:
    return {"value": value, "standard_error": error}


def write_cuffs(path: Path, **more: Any) -> Path:
    cuffs = {
        name: {key: fitted(value, 0.03 * value) for key, value in zip(KEYS, values, strict=True)}
        for name, values in CUFFS.items()
    }
    cuffs["hand"] |= more
    path.write_text(json.dumps({"cuffs": cuffs}), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("assessed")


@pytest.fixture(scope="module")
def assessed(folder: Path) -> AssessedSuit:
    emg = folder / "emg.csv"
    emg.write_text("muscle,reduction_percent,sd\nDeltoideusScapula_M,18,9\nupper_trapezius,-4,15\n", encoding="utf-8")
    inputs = AssessmentInputs(write_cuffs(folder / "cuffs.json"), emg=emg)
    found = assess_cuffs(
        read_cuffs_to_wear(inputs.cuffs),
        inputs,
        most_frames=8,
        most_rest_lengths=9,
        people=few_people(3, sources="cuffs"),
    )
    write_assessment(found, folder)
    return found


@pytest.fixture(scope="module")
def plain(assessed: AssessedSuit, folder: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((folder / "assessment.json").read_text(encoding="utf-8"))
    return content


def numbers_in(plain: Any, where: str = "") -> Iterator[tuple[str, Any]]:
    """Every bare number with its place, except the format, values with their intervals, and figures of a finding."""
    if isinstance(plain, dict):
        for key, entry in plain.items():
            if key not in {"value", "ci95", "format", "figures"}:
                yield from numbers_in(entry, f"{where}.{key}")
    elif isinstance(plain, list):
        for entry in plain:
            yield from numbers_in(entry, where)
    elif isinstance(plain, int | float) and not isinstance(plain, bool):
        yield where, plain


def test_the_entries_have_intervals_and_the_inputs_hashes(plain: dict[str, Any]) -> None:
    assert list(numbers_in(plain)) == []
    assert plain["frames"]["value"] > 1
    assert plain["reference_rest_length_m"] == {"value": 0.74, "ci95": None}
    for table in (plain["at_rigid_optimum"], plain["optimum"]):
        assert set(table) == {"rigid", "hand", "elbow"}
        assert set(table["hand"]) == {"shift", "visco_elastic", "both"}
    assert set(plain["optimum"]["rigid"]) == {"rest_length_m", "normalised_cost", "permissible_error_m"}
    low, high = plain["at_rigid_optimum"]["elbow"]["both"]["ci95"]
    assert low < high
    assert plain["at_rigid_optimum"]["rigid"]["ci95"] is None
    for role, name in (("cuffs", "cuffs.json"), ("emg", "emg.csv")):
        found, digest = plain["inputs"][role].split(" ")
        assert (found, len(digest)) == (name, 64)
    assert (plain["inputs"]["motion"], plain["inputs"]["suit"]) == ("bundled raise of the arm", "bundled suit")
    assert "cuffstation" in plain["versions"]


def test_the_report_lists_the_cuffs_with_their_intervals(plain: dict[str, Any], folder: Path, tmp_path: Path) -> None:
    low, high = plain["cuffs"]["hand"]["stiffness_n_per_m"]["ci95"]
    assert (plain["cuffs"]["waist"]["site"], low) == ("waist", pytest.approx(8520 * (1 - 0.03 * 1.96), rel=1e-3))
    shutil.copy(folder / "assessment.json", tmp_path)  # without its cuffs.json
    figure = f">8520 ({low:.0f}\u00a0to\u00a0{high:.0f}) (given by hand)</data></td>"
    assert figure in write_report(tmp_path).read_text(encoding="utf-8")


def test_a_file_of_a_later_format_is_refused(plain: dict[str, Any], tmp_path: Path) -> None:
    assert plain["format"] == 1
    path = tmp_path / "assessment.json"
    path.write_text(json.dumps({**plain, "format": 2}), encoding="utf-8")
    with raises_refusal(AssessmentFileCode.INVALID_ENTRY, "format is 2, expected 1", kind=AssessmentFileError):
        read_assessment(path)


def test_activations_are_a_table_of_every_condition(assessed: AssessedSuit, folder: Path) -> None:
    lines = (folder / "activations.csv").read_text(encoding="utf-8").splitlines()
    assert lines[0].split(",")[:4] == ["condition", "cuff", "time_s", assessed.assessment.muscles[0]]
    assert len(lines) == 1 + (2 + 2 * 3) * len(assessed.assessment.time)  # slack and rigid, two cuffs in three


def test_the_report_says_which_cuff_to_choose(assessed: AssessedSuit, plain: dict[str, Any], folder: Path) -> None:
    path = write_report(folder)
    page = path.read_text(encoding="utf-8").replace("\u00a0", " ")  # no line ends before a percent sign
    choice, comparison, best, *_ = plain["finding_codes"]
    assert (choice["code"], choice["figures"]["cuff"]) == (AssessmentCode.LEAST_EFFORT, "hand")
    assert (comparison["code"], comparison["figures"]["first"]) == (AssessmentCode.DIFFERENT, "hand")
    assert (best["code"], best["figures"]["cuff"]) == (AssessmentCode.BEST_REST_LENGTH, "hand")
    assert [str(Message(AssessmentCode(entry["code"]), entry["figures"])) for entry in plain["finding_codes"]] == plain[
        "findings"
    ]
    for entry, sentence in zip(plain["finding_codes"], plain["findings"], strict=True):
        assert (str(escape(sentence)) in page) is not entry["code"].startswith(IN_TABLES), entry["code"]
    assert "our own calibration" in page
    assert unmarked_numbers(path, folder.name) == []
    assert "bundled raise of the arm with 2 kg in the hand" in page
    assert page.count("<figcaption>") == 6, "effort, the same in every condition, body, change, activations, EMG"


def test_the_difference_from_the_source_study_is_given_by_exchanging_one_part_at_a_time(plain: dict[str, Any]) -> None:
    """The assessed motion is the bundled one: with rigid cuffs, nothing else is left to exchange."""
    study = plain["against_study"]
    by_part = {answer["exchanged"]: answer for answer in study["answers"]}
    assert list(by_part) == ["nothing", "cuffs", "all"] and study["cuff"] in plain["cuffs"]
    for key in ("rest_length_m", "effort"):
        assert by_part["cuffs"][key]["value"] == pytest.approx(by_part["all"][key]["value"], rel=1e-9)
    assert by_part["cuffs"]["rest_length_m"]["value"] - by_part["nothing"]["rest_length_m"]["value"] > 0.02


def test_a_chosen_cuff_is_worn_with_the_waist_and_unknown_or_reserved_names_are_refused(folder: Path) -> None:
    cuffs = read_cuffs_to_wear(write_cuffs(folder / "again.json"))
    assert [cuff.name for cuff in worn_cuffs(cuffs, ("elbow",))] == ["waist", "elbow"]
    with raises_refusal(InputCode.UNKNOWN_CUFF, kind=InputError):
        worn_cuffs(cuffs, ("knee", "hand"))
    with raises_refusal(InputCode.CUFF_NAMED_RIGID, kind=InputError):
        worn_cuffs({"rigid": replace(cuffs["hand"], name="rigid")}, ())


@pytest.mark.parametrize(
    ("key", "value", "is_refused"),
    [
        ("stiffness", -8520, True),
        ("stiffness", 0, True),
        ("damping", -210, True),
        ("damping", 0, False),
        ("migration", -0.012, False),
    ],
)
def test_a_cuff_that_gives_energy_is_refused(tmp_path: Path, key: str, value: float, is_refused: bool) -> None:
    read = read_cuffs_to_wear(write_cuffs(tmp_path / "cuffs.json"))
    figure = replace(getattr(read["hand"], key), value=float(value))
    cuffs = read | {"hand": replace(read["hand"], **{key: figure})}
    with raises_refusal(SolverCode.WRONG_CUFF, "hand") if is_refused else nullcontext():
        assert len(worn_cuffs(cuffs, ("hand",))) == 2
    _, left_out = wearable(cuffs)
    assert list(left_out) == ["hand"] * is_refused


@pytest.mark.parametrize(
    ("migration", "is_named"),
    [
        (-0.012, True),
        ({"value": -0.012, "ci95": [-0.013, -0.011]}, True),
        ({"value": -0.001, "ci95": [-0.003, 0.001]}, False),
        (0.012, False),
        (0.0, False),
    ],
    ids=["against", "interval below 0", "interval about 0", "along", "none"],
)
def test_a_cuff_that_migrated_against_the_pull_is_a_finding(tmp_path: Path, migration: Any, is_named: bool) -> None:
    cuffs = read_cuffs_to_wear(write_cuffs(tmp_path / "cuffs.json", migration_m=migration))
    found = cuff_findings(cuffs.values())
    assert [finding.code for finding in found] == [AssessmentCode.NEGATIVE_MIGRATION] * is_named
    assert not is_named or found[0].figures == {"cuff": "hand", "migration_mm": -12.0}


def test_the_draws_of_a_cuff_are_as_wide_as_its_intervals(tmp_path: Path) -> None:
    # three repeats that differ: Student's 4.3 standard errors to each side, with the covariance alone 1.96
    stiffness = {"value": 8520, "standard_error": 100, "ci95": [8090, 8950], "parts": {"between_repeats": 100}}
    covariance = [[100.0**2, 300.0, 0.0], [300.0, 6.0**2, 0.0], [0.0, 0.0, 0.0]]
    given = {"value": 0.012, "ci95": [0.011, 0.013]}
    path = write_cuffs(tmp_path / "cuffs.json", stiffness_n_per_m=stiffness, migration_m=given, covariance=covariance)
    (_, hand) = worn_cuffs(read_cuffs_to_wear(path), ("hand",))
    errors = np.sqrt(np.diag(hand.covariance))
    assert 1.96 * errors[0] == pytest.approx(430, rel=1e-3)
    assert 1.96 * errors[2] == pytest.approx(0.001, rel=1e-3)
    assert hand.covariance[0, 1] / (errors[0] * errors[1]) == pytest.approx(0.5)  # the correlation stays
    assert np.linalg.eigvalsh(hand.covariance).min() >= 0


@pytest.mark.parametrize(
    ("more", "law"),
    [
        ({"law": "exponential"}, "exponential"),
        ({"law": "tensor"}, "tensor"),
        ({"model_class": {"chosen": "slip + stiffening", "extensions": ["slip", "stiffening"]}}, "slip + stiffening"),
        ({"model_class": {"chosen": "creep", "extensions": ["creep"]}}, "creep"),
        ({"damping_tensor_n_s_per_m": {"value": [[1, 0, 0], [0, 2, 0], [0, 0, 3]]}}, "tensor"),
        ({"law": "kelvin_voigt", "model_class": {"chosen": "Kelvin-Voigt", "extensions": []}}, None),
        ({"law": "kelvin_voigt", "model_class": {"chosen": "slip", "extensions": ["slip"]}}, None),
    ],
    ids=["exponential", "tensor", "slip and stiffening", "creep", "damping tensor", "Kelvin-Voigt", "slip"],
)
def test_a_richer_law_is_refused_where_its_cuff_is_worn(tmp_path: Path, more: dict[str, Any], law: str | None) -> None:
    path = write_cuffs(tmp_path / "cuffs.json", **more)
    with raises_refusal(InputCode.RICHER_LAW, kind=InputError, law=law) if law else nullcontext():
        assert set(read_cuffs_to_wear(path)) == {"waist", "hand", "elbow"}
    assert [cuff.name for cuff in worn_cuffs(read_cuffs_to_wear(path, ("elbow",)), ("elbow",))] == ["waist", "elbow"]


@pytest.mark.parametrize(
    ("chosen", "is_refused"),
    [((), False), (("slip",), False), (("slip", "creep"), True), (("tensor",), True)],
    ids=["Kelvin-Voigt", "slip", "slip and creep", "tensor"],
)
def test_no_cuff_of_a_richer_law_is_worn(tmp_path: Path, chosen: tuple[str, ...], is_refused: bool) -> None:
    cuffs = read_cuffs_to_wear(write_cuffs(tmp_path / "cuffs.json"))
    cuffs["hand"] = replace(cuffs["hand"], law=chosen)
    with raises_refusal(InputCode.RICHER_LAW, kind=InputError) if is_refused else nullcontext():
        assert len(worn_cuffs(cuffs, ())) == 3


def test_an_external_load_acts_in_every_scenario(tmp_path: Path) -> None:
    write_weight(tmp_path / "weight.xml", 2.0)
    free = of_the_hand(tmp_path)
    loaded = replace(free, external_loads=tmp_path / "weight.xml")
    costs = []
    for inputs in (free, loaded):
        cuffs = read_cuffs_to_wear(inputs.cuffs)
        found = assess_cuffs(cuffs, inputs, most_frames=8, most_rest_lengths=5)
        costs.append([curve.figures["at_reference"].value for curve in found.assessment.curves])
        assert found.assessment.longest_cord == pytest.approx(0.86, abs=0.02)
    assert (np.array(costs[1]) > np.array(costs[0])).all()  # of a greater effort the suit saves a smaller share
    assert {"external_loads", "external_loads_data"} == set(loaded.hashes()) - set(free.hashes())


def test_a_suit_has_its_rest_lengths_and_a_copy_of_the_bundled_one_its_name(tmp_path: Path) -> None:
    inputs = AssessmentInputs(tmp_path / "cuffs.json")
    whole, few = inputs.read_suit(), inputs.read_suit(16)
    assert (len(whole.rest_lengths), len(few.rest_lengths)) == (31, 16)
    assert [few.rest_lengths[i] for i in (0, -1)] == [whole.rest_lengths[i] for i in (0, -1)]
    assert inputs.suit == BUNDLED_SUIT
    (tmp_path / "cuffs.json").touch()
    copy = Path(shutil.copy(BUNDLED_SUIT, tmp_path / "mine.toml"))
    inputs = AssessmentInputs(tmp_path / "cuffs.json", suit=copy)
    assert inputs.hashes()["suit"] == "bundled suit"
    copy.write_text(copy.read_text(encoding="utf-8") + "# ours\n", encoding="utf-8")
    assert inputs.hashes()["suit"] == f"mine.toml {file_sha256(copy)}"


@pytest.mark.parametrize(
    ("text", "code", "line"),
    [
        ("muscle,reduction\nbiceps,3\n", InputCode.EMG_COLUMNS, None),
        ("", InputCode.EMG_COLUMNS, None),
        ("muscle,reduction_percent,sd\ncalf,3,1\n", InputCode.EMG_MUSCLE, 2),
        ("muscle,reduction_percent,sd\nbiceps,3,1\nbiceps,much,1\n", InputCode.EMG_NUMBER, 3),
        ("muscle,reduction_percent,sd\nbiceps,3,-1\n", InputCode.EMG_NUMBER, 2),
        ("muscle,reduction_percent,sd\nbiceps,3\n", InputCode.EMG_NUMBER, 2),
        (None, InputCode.EMG_UNREADABLE, None),
    ],
)
def test_a_wrong_emg_file_is_refused(tmp_path: Path, text: str | None, code: InputCode, line: int | None) -> None:
    path = tmp_path / "emg.csv"
    if text is not None:
        path.write_text(text, encoding="utf-8")
    with raises_refusal(code, kind=EmgError, **({"line": line} if line else {})):
        read_emg(path, ("biceps", "triceps"))


def summary(decisions: Mapping[Basis, CuffDecision]) -> UncertaintySummary:
    return UncertaintySummary(1001, 1001, 1, {}, ("fit", "body"), (0.9, 0.99), {}, decisions, RULE)


@pytest.mark.parametrize(
    ("efforts", "code", "sentence"),
    [
        (
            {"hand": LOW + 0.001, "tube": LOW},
            DecisionCode.EQUIVALENT,
            "At 0.740 m, tube and hand: equivalent within 2 points of effort (probability > 99 %); choose by comfort "
            "or migration.",
        ),
        (
            {"hand": LOW + 0.001, "tube": LOW, "elbow": LOW + 0.1},
            DecisionCode.EQUIVALENT_AND_WORSE,
            "At 0.740 m, tube and hand: equivalent within 2 points of effort (probability > 99 %), and each saves "
            "at least 2 points more than elbow; choose by comfort or migration.",
        ),
        (
            {"hand": LOW + 0.0385 + SPREAD, "tube": LOW},
            DecisionCode.CHOOSE,
            "At 0.740 m, choose tube: it saves at least 2 points of effort more than hand (probability 96 %).",
        ),
        (
            {"hand": LOW + 0.02 + SPREAD, "tube": LOW},
            DecisionCode.UNDECIDED,
            "At 0.740 m, undecided: tube has the least mean effort. It saves at least 2 points more than hand with a "
            "probability of 50 %, is equivalent to it with 50 %, and saves at least 2 points less with < 1 %.",
        ),
        ({"hand": LOW}, DecisionCode.ONLY_CUFF, "At 0.740 m, hand is the only cuff; there is no other to compare"),
        (
            {"hand": LOW * np.nan, "tube": LOW},
            DecisionCode.UNKNOWN,
            "At 0.740 m, no decision: only 0 of 1001 drawn people have a solution for every cuff.",
        ),
    ],
    ids=lambda value: value.value if isinstance(value, DecisionCode) else "",
)
def test_every_decision_has_its_sentence(efforts: dict[str, np.ndarray], code: DecisionCode, sentence: str) -> None:
    decision = decide(efforts, RULE)
    decisions: Any = {"at_reference": decision, "at_best": decision}
    entry = decision_entry(summary(decisions), INDICES, 0.74)
    assert entry.at_reference.code is code
    assert entry.at_reference.text.startswith(sentence)
    settle = entry.at_reference.settle
    assert (settle is not None) == (code is DecisionCode.UNDECIDED)
    assert settle is None or settle.text == (
        "donning explains 70 % of the variance of hand − tube, the largest share; to reduce it, measure more donnings "
        "of each cuff."
    )
    assert entry.at_best.text.startswith("Each at its own best rest length, ")
    unknown = decision_entry(summary(decisions), {}, 0.74).at_reference.settle  # asks for the indices
    assert unknown is None or (unknown.code, unknown.figures) == (
        DecisionCode.SETTLE_UNKNOWN,
        {"first": "tube", "second": "hand"},
    )
    assert (unknown is None) == (settle is None)


@pytest.mark.parametrize(("can_draw_people", "code"), [(True, DecisionCode.FIT_ONLY), (False, DecisionCode.NO_PEOPLE)])
def test_without_people_there_is_no_decision(*, can_draw_people: bool, code: DecisionCode) -> None:
    entry = without_decision(can_draw_people=can_draw_people)
    assert (entry.contains, entry.people.value, entry.at_reference.code, entry.at_best.code) == ("fit", 0, code, code)


@pytest.mark.parametrize(("probability", "text"), [(1.0, "> 99"), (0.972, "97"), (0.004, "< 1"), (0.0, "< 1")])
def test_draws_do_not_resolve_certainty(probability: float, text: str) -> None:
    assert percent(probability) == text


# From cuffs.json to optimum.json, for one arm cuff at a time.


def of_the_hand(folder: Path) -> AssessmentInputs:
    return AssessmentInputs(write_cuffs(folder / "cuffs.json"), chosen=("hand",))


NO_COVARIANCE = str(Message(AssessmentCode.NO_COVARIANCE))


def test_the_optimum_is_written_beside_the_suit_as_it_was(tmp_path: Path) -> None:
    inputs = of_the_hand(tmp_path)
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
    inputs = of_the_hand(tmp_path)
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
    inputs = of_the_hand(tmp_path)
    found = assess_cuffs(read_cuffs_to_wear(inputs.cuffs), inputs, most_frames=3, most_rest_lengths=3)
    assert AssessmentCode.NO_INTERVALS in [finding.code for finding in found.findings]
    elastic = replace(found, inputs=replace(inputs, tendons="elastic").hashes())
    (sentence,) = decision_sentences(elastic)
    assert sentence == str(Message(DecisionCode.NO_PEOPLE))
    write_assessment(elastic, tmp_path)
    assert "--people" not in write_report(tmp_path).read_text(encoding="utf-8")


def test_an_output_that_is_a_file_is_refused_before_anything_is_solved(tmp_path: Path) -> None:
    inputs = of_the_hand(tmp_path)
    for solve in (optimise_file, assess_file):
        with raises_refusal(InputCode.OUTPUT_IS_FILE, kind=NotAFolder) as caught:
            solve(inputs, inputs.cuffs)
        assert caught.value.exit_code == WRONG_USAGE


@pytest.mark.parametrize(
    ("chosen", "code"),
    [((), InputCode.ONE_ARM_CUFF), (("waist",), InputCode.ONE_ARM_CUFF), (("nope",), InputCode.UNKNOWN_CUFF)],
    ids=["all", "waist", "unknown"],
)
def test_another_than_the_one_arm_cuff_is_wrong_usage(tmp_path: Path, chosen: tuple[str, ...], code: InputCode) -> None:
    with raises_refusal(code, *chosen, kind=InputError) as caught:
        optimise_file(AssessmentInputs(write_cuffs(tmp_path / "cuffs.json"), chosen=chosen), tmp_path)
    assert caught.value.exit_code == WRONG_USAGE

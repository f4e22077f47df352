"""The first page: effect of every cuff in words, the decision as assessed, and limits by their codes."""

from typing import Any

import pytest

from documents.interval import UNBROKEN
from fitting.results.cuffs_schema import ClassEntry
from station.assessment.assessment_file import AssessmentDocument
from station.assessment.assessment_json import CURVE_KEYS, CountEntry, NumberEntry
from station.assessment.uncertainty_json import BasisEntry, DecisionEntry, UncertaintyEntry
from station.charts.marks import Band
from station.charts.svg import with_commands
from station.messages.assessment_messages import AssessmentCode, DecisionCode
from station.report.assessment_section import assessment_section, effort_figures
from station.report.first_page import BUNDLED_SUIT, first_page, other_findings
from station.report.muscle_figures import cuffs_figure
from station.report.numbers import figure, located, saving, saving_in_words
from station.report.report_file import Source
from station.subject.subject_document import MarkerResidual, SubjectDocument

CHOSEN = {"code": DecisionCode.CHOOSE, "leading": ["hand"], "text": "choose hand", "pairs": []}
EQUIVALENT = {"code": DecisionCode.EQUIVALENT, "leading": ["hand", "tube"], "text": "equivalent", "pairs": []}
UNDECIDED = {"code": DecisionCode.UNDECIDED, "leading": ["tube"], "text": "undecided", "pairs": []}
FIT_ONLY = {"code": DecisionCode.FIT_ONLY, "text": "run `station assess --people 1000`"}
TRIAL = MarkerResidual(file="a.mcap", rms_m=0.003, frames=10, unsolved_frames=0)
FOUND = ("LEAST_EFFORT", "INTERVALS", "CORD_FORCE", "DIFFERENT")
SAVED = "13.5 % less effort than with a slack cord at a rest length of 0.650 m"


def _optimum(effort: float | None) -> dict[str, Any]:
    return {"rest_length_m": _number(0.65), "normalised_cost": _number(effort), "permissible_error_m": _number(0.05)}


def _of_cuffs(*arms: str) -> dict[str, Any]:
    return {
        "cost": _by_curve({"value": [1.0]}, *arms),
        "at_rigid_optimum": {"rigid": _number(0.88), **{arm: {"both": _number(0.906)} for arm in arms}},
        "optimum": {"rigid": _optimum(0.87), **{arm: {"both": _optimum(0.865)} for arm in arms}},
    }


def _by_curve(entry: Any, *arms: str) -> dict[str, Any]:
    return {"rigid": entry, **{arm: {"both": entry} for arm in arms}}


def _decision(at_best: dict[str, Any]) -> DecisionEntry:
    entry = BasisEntry.model_validate(at_best)
    return DecisionEntry.model_construct(at_best=entry, at_reference=entry)


def _assessment(**more: Any) -> AssessmentDocument:
    known = ("reference_rest_length_m", "bare_body_cost", "longest_cord_m")
    plain = {
        "format": 1,
        **dict.fromkeys(known, _number(1.0)),
        **{key: _by_curve(_number(1.0), "hand") for key in CURVE_KEYS.values()},
        **dict.fromkeys(("frames", "scenarios"), _number(1)),
        "waist_cuff": None,
        "rest_lengths_m": {"value": [0.6]},
        "unsolved": {"count": _number(0)},
        "muscle_reduction": _by_curve({}, "hand"),
        "emg": [],
        "cost": _by_curve({"value": [1.0]}, "hand"),
        "at_rigid_optimum": {"rigid": _number(0.88), "hand": {"both": _number(0.906, 0.83, 0.98)}},
        "optimum": {"rigid": _optimum(0.87), "hand": {"both": _optimum(0.865)}},
        "inputs": {"model": "own.osim", "motion": "bundled raise", "suit": "bundled suit", "cuffs": "cuffs.json"},
        "findings": ["tube has the least effort", "50 draws", "the cord pulls", "hand differs"],
        "finding_codes": [{"code": AssessmentCode[name], "figures": {}} for name in FOUND],
        **more,
    }
    return located(AssessmentDocument.model_validate(plain), Source.of("assessment.json"))


def _drawn(people: int, sources: list[str]) -> UncertaintyEntry:
    return UncertaintyEntry.model_construct(people=CountEntry(value=people), sources=sources)


def _number(value: float | None, *ci95: float) -> dict[str, Any]:
    return {"value": value, "ci95": list(ci95) or None}


@pytest.mark.parametrize(
    ("number", "text", "words"),
    [
        (_number(0.906), "9.4", "9.4 % less{}"),
        (_number(0.906, 0.83, 0.98), "9.4 (2.0~to~17.0)", "9.4 % less{} (95 % interval 2.0~to~17.0 %)"),
        (_number(1.034, 1.01, 1.06), "−3.4 (−6.0~to~−1.0)", "3.4 % more{} (95 % interval 1.0~to~6.0 %)"),
        (
            _number(0.906, 0.83, 0.98) | {"censored": "low"},
            "9.4 (2.0~or~more)",
            "9.4 % less{} (95 % interval 2.0 %~or~more)",
        ),
        (_number(None), "–", "effort not known"),
    ],
)
def test_an_effort_is_stated_as_what_it_saves_or_as_a_bound(number: dict[str, Any], text: str, words: str) -> None:
    entry = located(NumberEntry.model_validate(number), Source.of("assessment.json"))
    shown = [str(form(entry)).replace(UNBROKEN, "~") for form in (saving, saving_in_words)]
    assert shown == [text, words.format(" effort than with a slack cord")], "~ is a no-break space"


def test_a_number_has_the_place_of_its_key_and_commands_are_code() -> None:
    entry = ClassEntry.model_validate({"class": "linear", "left_over_n": 0.2, "gain": 0.0})
    name: Any = located(entry, Source.of("cuffs.json")).name
    assert name.source.pointer == "/class"
    assert str(with_commands("a < b: run `station fit`")) == "a &lt; b: run <code>station fit</code>"


@pytest.mark.parametrize(
    ("cuffs", "decision", "beginning"),
    [
        (("hand",), FIT_ONLY, f"The hand cuff: {SAVED}."),
        (("hand", "tube"), CHOSEN, f"Choose the hand cuff: {SAVED}."),
        (
            ("hand", "tube"),
            EQUIVALENT,
            f"Choose hand or tube by comfort; their savings differ by less than matters in practice: {SAVED}.",
        ),
        (("hand", "tube"), UNDECIDED, f"Not decided between hand and tube; tube has the least effort so far: {SAVED}."),
        (("hand", "tube"), FIT_ONLY, f"Not decided between hand and tube; hand has the least effort so far: {SAVED}."),
    ],
)
def test_the_answer_names_cuff_and_saving(cuffs: tuple[str, ...], decision: dict[str, Any], beginning: str) -> None:
    plain = _assessment(decision=_decision(decision), **_of_cuffs(*cuffs))
    page = first_page(plain, {})
    assert "".join(map(str, page.answer)).replace(UNBROKEN, " ") == beginning
    assert not any("`" in sentence for sentence in (*page.decision, *page.limits))
    assert page.decision == (() if decision is FIT_ONLY else (decision["text"],))


def test_best_rest_lengths_that_differ_or_are_unknown_are_stated() -> None:
    of_cuffs = _of_cuffs("hand", "tube")
    of_cuffs["optimum"]["tube"]["both"]["rest_length_m"] = _number(0.7)
    page = first_page(_assessment(decision=_decision(EQUIVALENT), **of_cuffs), {})
    text = "".join(map(str, page.answer)).replace(UNBROKEN, " ")
    assert text.endswith("at a rest length of 0.650 m with hand, 0.700 m with tube.")
    page = first_page(_assessment(optimum={"rigid": _optimum(None), "hand": {"both": _optimum(None)}}), {})
    assert "not known" in "".join(map(str, page.answer))


def test_limits_are_listed_by_their_codes_and_apart_from_the_findings() -> None:
    assessment = _assessment()
    assert first_page(assessment, {}).limits == ("50 draws", BUNDLED_SUIT)
    assert other_findings(assessment) == ["hand differs"]


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (
            {"subject": SubjectDocument.model_construct(mass_kg=75.0, trials=[TRIAL, TRIAL], condition="tight")},
            "the wearer's: 75 kg, estimated from 2",
        ),
        (
            {"findings": ["no mass"], "finding_codes": [{"code": AssessmentCode.WEARER_NOT_ASSESSED, "figures": {}}]},
            "no mass",
        ),
        ({}, "Body: own.osim; motion: bundled raise; they are not the wearer's"),
    ],
)
def test_the_page_says_whose_body_and_motion_it_is(more: dict[str, Any], words: str) -> None:
    assert words in "".join(map(str, first_page(_assessment(**more), {}).basis))


@pytest.mark.parametrize(
    ("number", "digits", "text"),
    [
        (_number(0.7077431, 0.707691, 0.707822), 3, "0.708"),
        (_number(0.7077431, 0.7041, 0.7122), 3, "0.708 (0.704\u00a0to\u00a00.712)"),
        (_number(0.8534, 0.7142, 0.9913), 3, "0.85 (0.71\u00a0to\u00a00.99)"),
        (_number(None), 3, "–"),
    ],
)
def test_a_narrow_interval_has_the_decimals_of_its_table(number: dict[str, Any], digits: int, text: str) -> None:
    entry = located(NumberEntry.model_validate(number), Source.of("assessment.json"))
    assert str(figure(entry, digits=digits)) == text


def test_with_drawn_people_the_effort_has_their_band_and_the_caption_their_number() -> None:
    curve: dict[str, Any] = {"value": [1.2, 0.87, 0.95], "ci95": [None, [0.7, 1.0], [0.8, 1.1]]}
    assessment = _assessment(
        uncertainty=_drawn(100, ["fit"]),
        cost={"rigid": {**curve, "ci95": None}, "hand": {"both": curve}},
        rest_lengths_m={"value": [0.6, 0.65, 0.7]},
        reference_rest_length_m=_number(0.7),
    )
    assert "100 drawn people" in str(effort_figures(assessment)[0].caption)
    ((panel,),) = cuffs_figure(assessment).columns
    (band,) = (mark for mark in panel.marks if isinstance(mark, Band))
    assert band.high.tolist()[1:] == [1.0, 1.1] and panel.y_limits[0] is not None and panel.y_limits[0] < 0.7
    curve = {**curve, "ci95": None}
    without = _assessment(cost=_by_curve(curve, "hand"), rest_lengths_m={"value": [0.6, 0.65, 0.7]})
    ((panel,),) = cuffs_figure(without).columns
    assert not any(isinstance(mark, Band) for mark in panel.marks)
    assert "people" not in str(effort_figures(without)[0].caption)


@pytest.mark.parametrize("sources", [["fit"], ["fit", "motion"], []])
def test_the_section_on_the_suit_names_what_its_intervals_contain(sources: list[str]) -> None:
    section = assessment_section(_assessment(uncertainty=_drawn(50, sources) if sources else None), ())
    assert [word for word in ("fit", "motion") if word in section.intervals] == sources

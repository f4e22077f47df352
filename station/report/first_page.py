"""The first page of the report, readable alone: the answer, what it rests on, and its limits."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from documents.interval import UNBROKEN
from fitting.cuffs.wearable_cuff import QUANTITIES
from station.assessment.assessment_file import AssessmentDocument
from station.assessment.assessment_json import RIGID
from station.assessment.uncertainty_json import listed
from station.messages.assessment_messages import AssessmentCode, DecisionCode, sources_text
from station.report.cuff_section import Cuffs, suit_effect
from station.report.numbers import Shown, figure, fixed, length, saving_in_words
from station.sources import without_hash

Parts = tuple[Shown, ...]

LIMITING = frozenset(
    {
        AssessmentCode.OUTSIDE_RANGE,
        AssessmentCode.NO_INTERVALS,
        AssessmentCode.NO_COVARIANCE,
        AssessmentCode.INTERVALS,
        AssessmentCode.INTERVALS_UNVERIFIED,
        AssessmentCode.PEOPLE_INFEASIBLE,
        AssessmentCode.PEOPLE_UNSOLVED,
        AssessmentCode.RESERVES_LARGE,
        AssessmentCode.RATE_EXCEEDED,
        AssessmentCode.INFEASIBLE,
        AssessmentCode.INFEASIBLE_WITHOUT_CONE,
        AssessmentCode.NOT_CONVERGED,
        AssessmentCode.NOT_FINITE,
        AssessmentCode.PATH_NOT_CONVERGED,
        AssessmentCode.CURVE_NOT_CONVERGED,
        AssessmentCode.FIBER_NOT_CONVERGED,
    }
)
"""Findings that limit the result."""
WEARER = (AssessmentCode.WEARER_NOT_RECORDED, AssessmentCode.WEARER_NOT_ASSESSED)
"""Findings that say why body and motion are not the wearer's."""
IN_TABLES = ("choice.", "rest_length.best", "intervals.total", "cord.", "reserves.small")
"""Beginnings of the codes of findings whose figures are in the answer and in the tables."""
ADVICE = (DecisionCode.FIT_ONLY, DecisionCode.NO_PEOPLE)
"""Outcomes without a decision; their sentence names a command."""
RECORDED_AS = {
    "unsuited": "without the suit",
    "slack": "in the suit with its cord slack",
    "tight": "in the suit with its cord tight",
}
BUNDLED_SUIT = (
    "The bundled suit's attachment points, stiffness and rest length are our own calibration on published tables with "
    "one public motion, not published values."
)


@dataclass(frozen=True)
class FirstPage:
    """answer, basis: sentences in parts, numbers apart;  decision, limits: sentences;  rigid: effect of rigid cuffs."""

    answer: Parts
    basis: Parts
    decision: tuple[str, ...]
    rigid: Sequence[Shown]
    limits: tuple[str, ...]


def first_page(assessment: AssessmentDocument | None, cuffs: Cuffs) -> FirstPage:
    """Content of the first page; without an assessment only what was fitted and the limits of the fits."""
    if assessment is None:
        return FirstPage(tuple(_fitted(cuffs)), (), (), (), tuple(_limits_of_cuffs(cuffs)))
    return FirstPage(
        tuple(answer(assessment)),
        tuple(_basis(assessment)),
        _decision(assessment),
        suit_effect(assessment, RIGID),
        (*_limits_of_cuffs(cuffs), *list_limits(assessment)),
    )


def answer(assessment: AssessmentDocument) -> Iterator[Shown]:
    """The cuff to choose, the effort saved against a slack cord with its interval, and the rest length."""
    arms, optimum, decision = list(assessment.cost.arms), assessment.optimum, assessment.decision
    efforts = {cuff: optimum.of(cuff).normalised_cost.value for cuff in arms}
    known = {cuff: effort for cuff, effort in efforts.items() if effort is not None}
    if not known:
        yield "The best rest length is not known: the least effort is at the end of the range that was tried."
        return
    chosen = decision.at_best.leading if decision else []
    leading = [cuff for cuff in chosen if cuff in known] or [min(known, key=known.__getitem__)]
    code = decision.at_best.code if decision else None
    if len(arms) == 1:
        yield f"The {arms[0]} cuff: "
    elif code == DecisionCode.CHOOSE:
        yield f"Choose the {leading[0]} cuff: "
    elif code in (DecisionCode.EQUIVALENT, DecisionCode.EQUIVALENT_AND_WORSE):
        yield f"Choose {', '.join(leading[:-1])} or {leading[-1]} by comfort; "
        yield "their savings differ by less than matters in practice: "
    else:
        yield f"Not decided between {listed(list(known))}; {leading[0]} has the least effort so far: "
    yield saving_in_words(optimum.of(leading[0]).normalised_cost)
    yield " at a rest length of "
    yield from _rest_lengths({cuff: figure(optimum.of(cuff).rest_length_m) for cuff in leading})
    yield "."


def _rest_lengths(by_cuff: Mapping[str, Shown]) -> Iterator[Shown]:
    """Those of several cuffs with their names, unless they are the same in the digits shown."""
    shown = {cuff: at if isinstance(at, str) else at.alone for cuff, at in by_cuff.items()}
    texts = {at if isinstance(at, str) else at.text for at in shown.values()}
    for number, (cuff, at) in enumerate(shown.items()):
        if number and len(texts) == 1:
            return
        yield from (", " if number else "", at, f"{UNBROKEN}m", f" with {cuff}" if len(texts) > 1 else "")


def other_findings(assessment: AssessmentDocument) -> list[str]:
    """Sentences for the section on the muscles: those that are neither on the first page nor in a table."""
    return [
        text
        for code, text in _coded(assessment)
        if code not in LIMITING and code not in WEARER and not code.startswith(IN_TABLES)
    ]


def _fitted(cuffs: Cuffs) -> Iterator[Shown]:
    identified = [name for name, fit in cuffs.items() if not fit.missing]
    if identified:
        yield f"Stiffness, damping and migration are identified of {', '.join(identified)}."


def _basis(assessment: AssessmentDocument) -> Iterator[Shown]:
    """Origin of body and motion, and sources in the intervals."""
    subject = assessment.subject
    why = [text for code, text in _coded(assessment) if code in WEARER]
    if subject:
        trials, noun = length(subject.trials), "trial" if len(subject.trials) == 1 else "trials"
        yield from ("Body and motion are the wearer's: ", fixed(subject.mass_kg), " kg, estimated from ")
        yield from (trials, f" {noun}; the motion was recorded {RECORDED_AS[subject.condition]}. ")
    elif why:
        yield from (why[0], " ")
    else:
        model, motion = (without_hash(assessment.inputs[role]) for role in ("model", "motion"))
        yield f"Body: {model}; motion: {motion}; they are not the wearer's. "
    contained = interval_contents(assessment)
    if contained:
        yield f"Effort is the sum of squared activations; 95 % intervals contain {contained}."


def interval_contents(assessment: AssessmentDocument) -> str:
    """Sources of uncertainty in the intervals; empty without intervals."""
    return sources_text([*assessment.uncertainty.sources]) if assessment.uncertainty else ""


def _decision(assessment: AssessmentDocument) -> tuple[str, ...]:
    """Of the best rest lengths and of the reference one."""
    entries = (assessment.decision.at_best, assessment.decision.at_reference) if assessment.decision else ()
    texts = [entry.text for entry in entries if entry.code not in (*ADVICE, DecisionCode.ONLY_CUFF)]
    return tuple(dict.fromkeys(texts))


def _limits_of_cuffs(cuffs: Cuffs) -> Iterator[str]:
    for name, fit in cuffs.items():
        missing = [quantity for quantity in QUANTITIES if quantity in fit.missing]
        if missing:
            yield f"Cuff {name}: {' and '.join(missing)} not identified."


def list_limits(assessment: AssessmentDocument) -> Iterator[str]:
    """Limitations of the result, in sentences."""
    yield from (text for code, text in _coded(assessment) if code in LIMITING)
    if assessment.decision and assessment.decision.at_reference.code in ADVICE:
        yield (
            "The intervals do not contain the variation of donnings, bodies and muscles, so that no decision between "
            "the cuffs rests on them."
        )
    suit = assessment.inputs["suit"]
    if not assessment.subject and suit == without_hash(suit):
        yield BUNDLED_SUIT


def _coded(assessment: AssessmentDocument) -> list[tuple[str, str]]:
    """Code and sentence of every finding; a document without a code for each of them has none."""
    texts, codes = assessment.findings, [str(finding.code) for finding in assessment.finding_codes]
    return list(zip(codes if len(codes) == len(texts) else [""] * len(texts), texts, strict=True))

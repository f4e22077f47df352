"""The first page of the report, readable alone: the effect of every cuff, the decision, and the limits of both."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from fitting.cuffs.wearable_cuff import QUANTITIES
from solver.suit.suit import BUNDLED_SUIT as BUNDLED
from station.messages.codes import AssessmentCode
from station.report.cuff_section import Cuffs
from station.report.located import LocatedFloat
from station.report.number_texts import Shown, saving
from station.sources import named_hash

Plain = Mapping[str, Any]

LIMITING = frozenset(
    {
        AssessmentCode.OUTSIDE_RANGE,
        AssessmentCode.NO_INTERVALS,
        AssessmentCode.NO_COVARIANCE,
        AssessmentCode.INTERVALS,
        AssessmentCode.INTERVALS_UNVERIFIED,
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
"""Findings that limit the result; the others describe it."""
BUNDLED_SUIT = (
    "The bundled suit's attachment points, stiffness and rest length are our own calibration on published tables with "
    "one public motion, not published values."
)


@dataclass(frozen=True)
class CuffEffect:
    """Effort with one arm cuff, migration and compliance, against the slack cord.

    at_reference  at the suit's reference rest length;  at_best  at the cuff's own best rest length [m]
    """

    cuff: str
    at_reference: Shown
    at_best: Shown
    best_rest_length_m: LocatedFloat | None


@dataclass(frozen=True)
class FirstPage:
    """decision: sentences, one if they agree; limits: sentences; rigid: theoretical limit at the reference length."""

    effects: tuple[CuffEffect, ...]
    rigid: Shown
    decision: tuple[str, ...]
    limits: tuple[str, ...]


def summary_of(assessment: Plain | None, cuffs: Cuffs) -> FirstPage:
    """Content of the first page; without an assessment only the limits of the fits."""
    if assessment is None:
        return FirstPage((), "", (), tuple(_limits_of_cuffs(cuffs)))
    arms = [cuff for cuff in assessment["cost"] if cuff != "rigid"]
    return FirstPage(
        tuple(_effect(assessment, cuff) for cuff in arms if "both" in assessment["cost"][cuff]),
        saving(assessment["at_rigid_optimum"]["rigid"]),
        _decision(assessment),
        (*_limits_of_cuffs(cuffs), *_limits_of_assessment(assessment)),
    )


def findings_of(assessment: Plain) -> list[str]:
    """Sentences for the section on the muscles: those that are not among the limits."""
    return [text for code, text in _coded(assessment) if code not in LIMITING]


def _effect(assessment: Plain, cuff: str) -> CuffEffect:
    best = assessment["optimum"][cuff]["both"]
    return CuffEffect(
        cuff,
        saving(assessment["at_rigid_optimum"][cuff]["both"]),
        saving(best["normalised_cost"]),
        best["rest_length_m"]["value"],
    )


def _decision(assessment: Plain) -> tuple[str, ...]:
    """Of the reference rest length and of the best ones; an older assessment has only its first finding."""
    decision = assessment.get("decision")
    if decision is None:
        return tuple(text for code, text in _coded(assessment) if code.startswith("choice."))
    entries = [decision["at_reference"], decision["at_best"], decision.get("cubes")]
    return tuple(dict.fromkeys(entry["text"] for entry in entries if entry))


def _limits_of_cuffs(cuffs: Cuffs) -> Iterator[str]:
    for name, fit in cuffs.items():
        missing = [quantity for quantity in QUANTITIES if quantity in fit.missing]
        if missing:
            yield f"Cuff {name}: {' and '.join(missing)} not identified."


def _limits_of_assessment(assessment: Plain) -> Iterator[str]:
    yield from (text for code, text in _coded(assessment) if code in LIMITING)
    suit = assessment.get("inputs", {}).get("suit")
    if not assessment.get("subject") and suit in (None, named_hash(BUNDLED)):
        yield BUNDLED_SUIT


def _coded(assessment: Plain) -> list[tuple[str, str]]:
    """Code and sentence of every finding; an older assessment has no codes, and its first finding is the choice."""
    sentences = assessment["findings"]
    codes = [finding["code"] for finding in assessment.get("finding_codes") or ()]
    if len(codes) != len(sentences):
        codes = [AssessmentCode.LEAST_EFFORT.value, *[""] * (len(sentences) - 1)]
    return list(zip(codes, sentences, strict=False))

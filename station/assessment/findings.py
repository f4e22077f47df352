"""Findings of an assessment: which cuff to choose, how the cuffs compare, and how certain the figures are."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from documents.interval import rounded, significant_decimals
from documents.message import Figures, Message
from solver.muscle import MuscleOutcome
from solver.redundancy.problem import FrameOutcome
from solver.suit.assessment import Assessment, Comparison, UncertaintySummary
from solver.suit.scenarios import LARGE_RESERVES
from station.messages.assessment_messages import AssessmentCode, sources_text

RELEVANT_DIFFERENCE = 0.02
"""Smallest difference of the effort, relative to that with a slack cord, that is taken to matter."""
OUTCOMES = {
    FrameOutcome.BEYOND_ACTIVATION_RATE: AssessmentCode.RATE_EXCEEDED,
    FrameOutcome.INFEASIBLE: AssessmentCode.INFEASIBLE,
    FrameOutcome.NOT_CONVERGED: AssessmentCode.NOT_CONVERGED,
    FrameOutcome.NOT_FINITE: AssessmentCode.NOT_FINITE,
}
MUSCLE_OUTCOMES = {
    MuscleOutcome.PATH_NOT_CONVERGED: AssessmentCode.PATH_NOT_CONVERGED,
    MuscleOutcome.CURVE_NOT_CONVERGED: AssessmentCode.CURVE_NOT_CONVERGED,
    MuscleOutcome.FIBER_NOT_CONVERGED: AssessmentCode.FIBER_NOT_CONVERGED,
}

Finding = Message[AssessmentCode]


def findings(assessment: Assessment, *, are_people_drawn: bool = False) -> list[Finding]:
    """The findings for terminal and report, the least effort first.

    are_people_drawn: whether intervals were asked for; without any, there was nothing to draw
    """
    return [
        _choice(assessment),
        *(_comparison(comparison, assessment.reference_rest_length) for comparison in assessment.comparisons),
        *_best_rest_lengths(assessment),
        *_rest_lengths_outside_range(assessment),
        _intervals(assessment.uncertainty, are_people_drawn=are_people_drawn),
        *_unsolved_people(assessment.uncertainty),
        *_cord_force(assessment),
        *_migration(assessment),
        *_reserves(assessment),
        *_unsolved_frames(assessment),
        *_unconverged_muscles(assessment),
        *([] if assessment.has_glenoid_cone else [Message(AssessmentCode.NO_GLENOID)]),
    ]


def _unsolved_people(summary: UncertaintySummary | None) -> Iterator[Finding]:
    """Named, because people without a solution need not be a random part of the sample, and intervals omit them."""
    if summary is not None and summary.unsolved:
        outcomes = ", ".join(f"{outcome} {count}" for outcome, count in summary.unsolved.items())
        unsolved = sum(summary.unsolved.values())
        figures: Figures = {"unsolved": unsolved, "people": summary.people, "outcomes": outcomes}
        yield Message(AssessmentCode.PEOPLE_UNSOLVED, figures)
    if summary is not None and summary.infeasible:
        left_out: Figures = {
            "infeasible": summary.infeasible,
            "people": summary.people,
            "percent": 100 * summary.infeasible / summary.people,
            "reserves_percent": 100 * LARGE_RESERVES,
        }
        yield Message(AssessmentCode.PEOPLE_INFEASIBLE, left_out)


def arm_efforts(assessment: Assessment, figure: str) -> dict[str, float]:
    """The figure of every arm cuff, with migration and compliance, that is known."""
    curves = {curve.cuff: curve.figures[figure].value for curve in assessment.curves if curve.condition == "both"}
    return {cuff: effort for cuff, effort in curves.items() if cuff and effort is not None}


def _choice(assessment: Assessment) -> Finding:
    """The arm cuff with the least effort, with migration and compliance."""
    known = arm_efforts(assessment, "at_reference")
    if not known:
        return Message(AssessmentCode.NO_CHOICE)
    best = min(known, key=lambda cuff: known[cuff])
    figures: Figures = {"cuff": best, "effort": known[best], "at_m": assessment.reference_rest_length}
    if len(known) == 1:
        return Message(AssessmentCode.ONLY_CUFF, figures)
    equivalent = [
        next(name for name in comparison.cuffs if name != best)
        for comparison in assessment.comparisons
        if best in comparison.cuffs and _is_equivalent(comparison)
    ]
    if equivalent:
        rivals: Figures = {"equivalent": " and ".join(equivalent), "relevant_percent": 100 * RELEVANT_DIFFERENCE}
        return Message(AssessmentCode.EQUIVALENT, {**figures, **rivals})
    return Message(AssessmentCode.LEAST_EFFORT, {**figures, "cuffs": ", ".join(known)})


def _is_equivalent(comparison: Comparison) -> bool:
    """Whether the difference is known, and not significant or too small to matter."""
    value = comparison.cost_difference.value
    return comparison.differ is False or (
        comparison.differ is True and value is not None and abs(value) < RELEVANT_DIFFERENCE
    )


def _comparison(comparison: Comparison, rest_length: float) -> Finding:
    (first, second), difference = comparison.cuffs, comparison.cost_difference
    if difference.value is None:
        return Message(AssessmentCode.NOT_COMPARED, {"first": first, "second": second})
    digits = significant_decimals(difference.ci95, 100.0, otherwise=1)
    figures: Figures = {
        "first": first,
        "second": second,
        "at_m": rest_length,
        "difference_percent": _signed(100 * difference.value, digits),
    }
    if difference.ci95 is None:
        return Message(AssessmentCode.WITHOUT_INTERVAL, figures)
    low, high = (_signed(100 * end, digits) for end in difference.ci95)
    figures = {**figures, "low_percent": low, "high_percent": high}
    if not comparison.differ:
        return Message(AssessmentCode.NOT_DISTINGUISHED, figures)
    if abs(difference.value) < RELEVANT_DIFFERENCE:
        return Message(AssessmentCode.NOT_RELEVANT, {**figures, "relevant_percent": 100 * RELEVANT_DIFFERENCE})
    return Message(AssessmentCode.DIFFERENT, figures)


def _signed(number: float, digits: int) -> str:
    text = rounded(number, digits)
    return text if text.startswith("-") or not number else f"+{text}"


def _best_rest_lengths(assessment: Assessment) -> Iterator[Finding]:
    """The effort with the best rest length of every cuff."""
    for curve in assessment.curves:
        effort, rest_length = curve.figures["lowest_cost"].value, curve.figures["rest_length"].value
        if curve.condition == "both" and curve.cuff and effort is not None and rest_length is not None:
            figures: Figures = {"cuff": curve.cuff, "effort": effort, "at_m": rest_length}
            yield Message(AssessmentCode.BEST_REST_LENGTH, figures)


def _rest_lengths_outside_range(assessment: Assessment) -> Iterator[Finding]:
    """Explains a dash in the tables although every frame was solved."""
    solved = [curve.figures for curve in assessment.curves if not np.isnan(curve.cost).any()]
    if any(figures[name].value is None for figures in solved for name in ("rest_length", "permissible_error")):
        first, last = assessment.rest_lengths[[0, -1]]
        yield Message(AssessmentCode.OUTSIDE_RANGE, {"first_m": float(first), "last_m": float(last)})


def _intervals(summary: UncertaintySummary | None, *, are_people_drawn: bool) -> Finding:
    if summary is None:
        return Message(AssessmentCode.NO_COVARIANCE if are_people_drawn else AssessmentCode.NO_INTERVALS)
    change, (least, most) = summary.largest_difference, summary.content
    figures: Figures = {
        "people": summary.people,
        "solved": summary.solved,
        "every": summary.every,
        "sources": sources_text(summary.sources),
        "least_percent": 100 * least,
        "most_percent": 100 * most,
    }
    if np.isnan(list(change.values())).any():
        return Message(AssessmentCode.INTERVALS_UNVERIFIED, figures)
    changes: Figures = {
        "effort": max(change["at_reference"], change["lowest_cost"]),
        "rest_length_mm": 1e3 * change["rest_length"],
        "permissible_error_mm": 1e3 * change["permissible_error"],
    }
    return Message(AssessmentCode.INTERVALS, {**figures, **changes})


def _cord_force(assessment: Assessment) -> Iterator[Finding]:
    """Force of the cord with rigid cuffs."""
    rigid = assessment.curves[0]
    to_slack, force = rigid.figures["to_slack"].value, rigid.figures["cord_force"].value
    if to_slack is not None and force is not None:
        yield Message(
            AssessmentCode.CORD_FORCE,
            {"force_n": force, "slack_cm": 100 * to_slack, "slack_m": assessment.longest_cord},
        )


def _migration(assessment: Assessment) -> Iterator[Finding]:
    """The cost of migration with every cuff that also yields, the condition of the comparisons."""
    waist = f" and the {assessment.waist_cuff} cuff" if assessment.waist_cuff else ""
    for curve in assessment.curves:
        found = curve.figures
        lost, cost = found["cord_force_lost"].value, found["cost_per_arm_migration"]
        if curve.condition == "both" and lost is not None and cost.value is not None:
            digits = significant_decimals(cost.ci95, otherwise=1)
            figures: Figures = {
                "cuff": str(curve.cuff),
                "cuffs": f"{curve.cuff}{waist}",
                "lost_percent": 100 * lost,
                "percent_per_cm": _signed(cost.value, digits),
            }
            yield _migration_cost(figures, cost.ci95, digits)
            of_waist = found["cost_per_waist_migration"].value
            if of_waist is not None:
                figures = {"cuff": str(curve.cuff), "waist": str(assessment.waist_cuff)}
                yield Message(
                    AssessmentCode.MIGRATION_COST_OF_WAIST, {**figures, "percent_per_cm": _signed(of_waist, digits)}
                )


def _migration_cost(figures: Figures, ci95: tuple[float, float] | None, digits: int) -> Finding:
    if ci95 is None:
        return Message(AssessmentCode.MIGRATION_COST_ALONE, figures)
    low, high = ci95
    code = AssessmentCode.MIGRATION_COST_OPEN if low <= 0 <= high else AssessmentCode.MIGRATION_COST
    return Message(code, {**figures, "low_per_cm": _signed(low, digits), "high_per_cm": _signed(high, digits)})


def _reserves(assessment: Assessment) -> Iterator[Finding]:
    """The effort of the reserve actuators, which replace muscles; it should be small."""
    nearest = int(np.argmin(np.abs(assessment.rest_lengths - assessment.reference_rest_length)))
    efforts = [float(curve.reserve_cost[nearest]) for curve in assessment.curves]
    if np.isnan(efforts).any():
        return
    code = AssessmentCode.RESERVES_LARGE if max(efforts) > LARGE_RESERVES else AssessmentCode.RESERVES_SMALL
    yield Message(code, {"effort": max(efforts), "at_m": float(assessment.rest_lengths[nearest])})


def _unsolved_frames(assessment: Assessment) -> Iterator[Finding]:
    all_frames = len(assessment.time) * assessment.scenarios
    for outcome, code in OUTCOMES.items():
        if outcome in assessment.outcomes:
            is_without_cone = code is AssessmentCode.INFEASIBLE and not assessment.has_glenoid_cone
            figures: Figures = {"frames": assessment.outcomes[outcome], "all_frames": all_frames}
            yield Message(AssessmentCode.INFEASIBLE_WITHOUT_CONE if is_without_cone else code, figures)


def _unconverged_muscles(assessment: Assessment) -> Iterator[Finding]:
    for outcome, code in MUSCLE_OUTCOMES.items():
        if outcome in assessment.muscle_outcomes:
            yield Message(code, {"frames": assessment.muscle_outcomes[outcome], "all_frames": len(assessment.time)})

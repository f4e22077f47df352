"""What an assessment found, in sentences: how cuffs compare, which to choose, and how sure all of it is."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from solver.redundancy.motion import FrameOutcome
from solver.suit.assessment import Assessment, Comparison, UncertaintySummary
from station.interval import between, digits_of, rounded

MOST_FOR_RESERVES = 0.1  # of the slack suit's cost; the published motions need less than 0.01
CONSEQUENCE = {
    FrameOutcome.INFEASIBLE: (
        "; their cost is unknown, and so is every number that would need it: take a lighter load, or leave that part "
        "of the motion out"
    ),
    FrameOutcome.NOT_CONVERGED: "; costs hold it, and are not to be believed",
    FrameOutcome.NOT_FINITE: "; no cost includes them",
}


def findings(assessment: Assessment) -> list[str]:
    """Sentences for the terminal and the report, the advice first."""
    return [
        _choice(assessment),
        *(_compared(each, assessment.reference_rest_length) for each in assessment.comparisons),
        *_at_their_best(assessment),
        *_beyond_what_was_tried(assessment),
        _uncertainty(assessment.uncertainty),
        *_lost_and_gained(assessment),
        *_reserves(assessment),
        *(_unsolved(assessment, outcome) for outcome in FrameOutcome if outcome.value in assessment.outcomes),
    ]


def _choice(assessment: Assessment) -> str:
    """The arm cuff that leaves most of the saving once it has slipped and while it yields."""
    cost = {curve.cuff: curve.figures["at_reference"].value for curve in assessment.curves if curve.condition == "both"}
    known = {cuff: value for cuff, value in cost.items() if cuff and value is not None}
    if not known:
        return "No cuff can be chosen: frames of every one stayed unsolved."
    best = min(known, key=lambda cuff: known[cuff])
    words = (
        f"Choose {best}: shifted and yielding it costs the muscles {known[best]:.3f} of what the slack suit does, at "
        f"{assessment.reference_rest_length:.2f} m"
    )
    if len(known) == 1:
        return f"{words}; there is no other cuff to compare it with."
    rivals = [
        next(name for name in each.cuffs if name != best)
        for each in assessment.comparisons
        if best in each.cuffs and each.differ is False
    ]
    if rivals:
        return f"{words}; but {' and '.join(rivals)} cannot be told apart from it."
    return f"{words}, the least of {', '.join(known)}."


def _compared(each: Comparison, rest_length: float) -> str:
    (a, b), value = each.cuffs, each.cost_difference.value
    if value is None:
        return f"{a} and {b} cannot be compared: frames stayed unsolved."
    digits = digits_of(each.cost_difference.ci95, otherwise=3)
    words = f"{a} costs {rounded(abs(value), digits)} {'more' if value > 0 else 'less'} than {b} at {rest_length:.2f} m"
    if each.cost_difference.ci95 is None:
        return f"{words}; how sure that is was not determined."
    interval = f"95 % interval {between(each.cost_difference.ci95, 1.0 if value > 0 else -1.0, digits)}"
    return f"{words} ({interval}): the two {'differ' if each.differ else 'cannot be told apart'}."


def _at_their_best(assessment: Assessment) -> Iterator[str]:
    """What a cuff loses at one rest length, a cord of its own may bring back."""
    figures = {curve.cuff: curve.figures for curve in assessment.curves if curve.condition == "both"}
    best = [
        f"{cuff} {each['lowest_cost'].value:.3f} at {each['rest_length'].value:.3f} m"
        for cuff, each in figures.items()
        if each["lowest_cost"].value is not None and each["rest_length"].value is not None
    ]
    if best:
        yield f"With a cord of its own best rest length, shifted and yielding, it is {', '.join(best)}."


def _beyond_what_was_tried(assessment: Assessment) -> Iterator[str]:
    """What a dash means where every frame was solved."""
    solved = [curve.figures for curve in assessment.curves if not np.isnan(curve.cost).any()]
    if any(each[name].value is None for each in solved for name in ("rest_length", "permissible_error")):
        first, last = assessment.rest_lengths[[0, -1]]
        yield (
            "A dash in place of a best rest length, or of its width, says that it lies beyond those tried, "
            f"{first:.2f} to {last:.2f} m."
        )


def _uncertainty(uncertainty: UncertaintySummary | None) -> str:
    if uncertainty is None:
        return "Intervals were not determined: no cuff carries an uncertainty, or no draws were asked for."
    off = uncertainty.largest_difference
    words = f"Intervals come from {uncertainty.draws} draws of the cuffs on every {uncertainty.every}th frame"
    if np.isnan(list(off.values())).any():
        return f"{words}; what that thinning alone changes is not known of all figures."
    return (
        f"{words}; that thinning alone changes costs by up to {max(off['at_reference'], off['lowest_cost']):.4f}, best "
        f"rest lengths by up to {1e3 * off['rest_length']:.1f} mm and permissible errors by up to "
        f"{1e3 * off['permissible_error']:.1f} mm."
    )


def _lost_and_gained(assessment: Assessment) -> Iterator[str]:
    """What migration takes, cuff by cuff, and how far from its optimum the rigid suit stops helping."""
    rigid, *others = assessment.curves
    waist = " and the waist" if assessment.waist_cuff else ""
    to_slack, force = rigid.figures["to_slack"].value, rigid.figures["cord_force"].value
    if to_slack is not None and force is not None:
        yield (
            f"With rigid cuffs the cord pulls with up to {force:.0f} N, and is slack throughout at a rest length "
            f"{100 * to_slack:.1f} cm above the best one."
        )
    for curve in others:
        lost, per_metre = curve.figures["cord_force_lost"].value, curve.figures["cost_per_migration"].value
        if curve.condition == "shift" and lost is not None and per_metre is not None:
            yield (
                f"The migration of {curve.cuff}{waist} takes {100 * lost:.0f} % of the cord's largest force and "
                f"{per_metre:.1f} percentage points of cost per centimetre that {curve.cuff} slips."
            )


def _reserves(assessment: Assessment) -> Iterator[str]:
    """What stands in for muscles is not in the costs; it should be little."""
    nearest = int(np.argmin(np.abs(assessment.rest_lengths - assessment.reference_rest_length)))
    parts = [float(curve.reserve_cost[nearest]) for curve in assessment.curves]
    if np.isnan(parts).any():
        return
    added = f"at {assessment.rest_lengths[nearest]:.2f} m"
    if max(parts) > MOST_FOR_RESERVES:
        yield (
            f"The muscles do not do this work: reserve actuators, which are in none of these costs, would add up to "
            f"{max(parts):.3g} {added}; take a lighter load or another motion."
        )
    else:
        yield f"Reserve actuators, which are in none of these costs, would add at most {max(parts):.4f} {added}."


def _unsolved(assessment: Assessment, outcome: FrameOutcome) -> str:
    frames = len(assessment.time) * assessment.scenarios
    return (
        f"{assessment.outcomes[outcome.value]} of {frames} frames of all scenarios together did not come out as they "
        f"should: {outcome.value}{CONSEQUENCE.get(outcome, '')}."
    )

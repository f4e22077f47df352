"""The sentences: what they claim follows from the intervals, and they say when nothing is known."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from solver.redundancy.motion import FrameOutcome
from solver.suit.assessment import Assessment, Comparison, EffortCurve, Quantity, UncertaintySummary
from solver.suit.readouts import CurveReadouts
from station.assessment.findings import findings


def curve(cuff: str | None, cost: float | None, condition: str = "both") -> EffortCurve:
    names = [field.name for field in fields(CurveReadouts)]
    values = {name: Quantity(None) for name in names} | {"at_reference": Quantity(cost)}
    nothing = np.zeros((0, 0))
    return EffortCurve(condition, cuff, nothing, np.array([0.5, 0.0012]), nothing, 0, values, {})  # type: ignore[arg-type]


def assessment(*curves: EffortCurve, **more: object) -> Assessment:
    nothing = np.zeros(0)
    plain = Assessment(
        muscles=(),
        time=np.array([0.0, 0.1]),
        rest_lengths=np.array([0.6, 0.75]),
        reference_rest_length=0.74,
        bare_body_cost=0.95,
        longest_cord=0.87,
        waist_cuff=None,
        slack=nothing,
        curves=(curve(None, 0.79, "rigid"), *curves),
        comparisons=(),
        uncertainty=None,
        scenarios=4,
        outcomes={},
    )
    return replace(plain, **more)  # type: ignore[arg-type]


def compared(value: float | None, ci95: tuple[float, float] | None) -> list[str]:
    pair = (curve("hand", 0.85), curve("tube", 0.84))
    return findings(assessment(*pair, comparisons=(Comparison(("hand", "tube"), Quantity(value, ci95)),)))


def test_the_cheapest_is_chosen_and_stands_alone_where_all_others_differ() -> None:
    assert compared(0.01, (0.005, 0.015))[:2] == [
        "Choose tube: shifted and yielding it costs the muscles 0.840 of what the slack suit does, at 0.74 m, the "
        "least of hand, tube.",
        "hand costs 0.0100 more than tube at 0.74 m (95 % interval 0.0050 to 0.0150): the two differ.",
    ]


def test_a_rival_that_cannot_be_told_apart_is_named() -> None:
    choice, comparison, *_ = compared(0.01, (-0.005, 0.025))
    assert choice.endswith("but hand cannot be told apart from it.")
    assert comparison.endswith("(95 % interval -0.005 to 0.025): the two cannot be told apart.")


def test_less_is_said_the_right_way_round() -> None:
    assert (
        "hand costs 0.0100 less than tube at 0.74 m (95 % interval 0.0050 to 0.0150)"
        in compared(-0.01, (-0.015, -0.005))[1]
    )


@pytest.mark.parametrize(
    ("value", "sentence"), [(0.01, "how sure that is was not determined"), (None, "cannot be compared")]
)
def test_what_is_not_known_is_said(value: float | None, sentence: str) -> None:
    assert sentence in compared(value, None)[1]


def test_one_cuff_alone_and_none_that_was_solved() -> None:
    assert "no other cuff to compare" in findings(assessment(curve("hand", 0.85)))[0]
    assert "No cuff can be chosen" in findings(assessment(curve("hand", None)))[0]


def test_what_each_costs_with_a_cord_of_its_own_is_said_where_it_is_known() -> None:
    best = curve("hand", 0.85)
    best = replace(best, figures={**best.figures, "lowest_cost": Quantity(0.7852), "rest_length": Quantity(0.692)})
    told = findings(assessment(best, curve("tube", 0.84)))
    assert "With a cord of its own best rest length, shifted and yielding, it is hand 0.785 at 0.692 m." in told


@pytest.mark.parametrize(("waist", "who"), [(None, "hand"), ("belt", "hand and the waist")])
def test_what_migration_takes_is_said_of_those_that_slip(waist: str | None, who: str) -> None:
    slipped = curve("hand", 0.83, "shift")
    known = {"cord_force_lost": Quantity(0.2), "cost_per_migration": Quantity(3.2)}
    sentences = findings(assessment(replace(slipped, figures={**slipped.figures, **known}), waist_cuff=waist))
    words = f"The migration of {who} takes 20 % of the cord's largest force and 3.2 percentage points of cost"
    assert any(sentence.startswith(words) for sentence in sentences)


def test_a_dash_that_is_no_failure_is_explained() -> None:
    sentence = "A dash in place of a best rest length, or of its width, says that it lies beyond those tried, 0.60 to"
    assert any(said.startswith(sentence) for said in findings(assessment(curve("hand", 0.85))))
    known = {"rest_length": Quantity(0.7), "permissible_error": Quantity(0.04)}
    inside = [
        replace(each, figures={**each.figures, **known}) for each in (curve(None, 0.79, "rigid"), curve("a", 0.8))
    ]
    assert not any("A dash" in said for said in findings(replace(assessment(), curves=tuple(inside))))


def test_what_reserves_add_near_the_reference_is_told() -> None:
    sentence = "Reserve actuators, which are in none of these costs, would add at most 0.0012 at 0.75 m."
    assert sentence in findings(assessment(curve("hand", 0.85)))


def test_what_unsolved_frames_leave_unknown_is_never_a_number() -> None:
    unknown = replace(curve("hand", None), reserve_cost=np.full(2, np.nan))
    names = ("at_reference", "rest_length", "lowest_cost", "permissible_error")
    sentences = findings(assessment(unknown, uncertainty=UncertaintySummary(5, 20, dict.fromkeys(names, np.nan))))
    assert any(sentence.endswith("thinning alone changes is not known of all figures.") for sentence in sentences)
    assert not any("nan" in sentence for sentence in sentences)


def test_thinning_and_unsolved_frames_are_told() -> None:
    names = ("at_reference", "lowest_cost", "rest_length", "permissible_error")
    sure = UncertaintySummary(200, 20, dict(zip(names, (0.001, 0.002, 0.0005, 0.0015), strict=True)))
    told = findings(assessment(curve("hand", 0.85), uncertainty=sure, outcomes={FrameOutcome.NOT_CONVERGED.value: 3}))
    (sure_of,) = (said for said in told if said.startswith("Intervals come from 200 draws of the cuffs on every 20th "))
    assert sure_of.endswith(
        "costs by up to 0.0020, best rest lengths by up to 0.5 mm and permissible errors by up to 1.5 mm."
    )
    assert told[-1] == (
        "3 of 8 frames of all scenarios together did not come out as they should: the solver stopped before its "
        "residuals were small; its last point is given; costs hold it, and are not to be believed."
    )


def test_frames_without_a_solution_are_told_with_what_follows_and_what_to_do() -> None:
    told = findings(assessment(curve("hand", None), outcomes={FrameOutcome.INFEASIBLE.value: 8}))[-1]
    assert told.startswith("8 of 8 frames of all scenarios together did not come out as they should: no activations")
    assert told.endswith("every number that would need it: take a lighter load, or leave that part of the motion out.")


def test_reserves_that_do_the_work_are_no_side_note() -> None:
    heavy = replace(curve("hand", 0.99), reserve_cost=np.array([4.0, 3.0]))
    assert (
        "The muscles do not do this work: reserve actuators, which are in none of these costs, would add up to 3 at "
        "0.75 m; take a lighter load or another motion."
    ) in findings(assessment(heavy))

"""Solving a task of a sweep: geometry laid once, each case on its own. This is what runs on a worker.

A case is never solved together with others, so that its result does not depend, to the last bit, on which others were
left to do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from solver.model import Model, ModelError
from solver.motion import Kinematics, MotionError
from solver.multibody.external_loads import ExternalForce
from solver.suit.curve_minimum import find_minimum
from solver.suit.scenarios import SuitedMotion, SuitScenario, prepare_suited_motion, solve_scenarios, solve_without_suit
from solver.suit.suit import Suit, SuitError

Outcome = dict[str, float | str | None]
"""Column → value: those of RESULTS, and `error`, the sentence of a case that failed."""

RESULTS = (
    "normalised_cost",
    "reserve_cost",
    "largest_cord_force_n",
    "slack_rest_length_m",
    "optimum_rest_length_m",
    "optimum_normalised_cost",
    "permissible_error_m",
    "bare_body_cost",
    "frames",
    "unsolved",
)


@dataclass(frozen=True, eq=False)
class Geometry:
    """A model, with what it holds, its motion, and the loads from outside at all of its frames."""

    model: Model
    kinematics: Kinematics
    loads: tuple[ExternalForce, ...]


@dataclass(frozen=True, eq=False)
class WornCase:
    """What one case wears; the last rest length is the suit's reference, those before are searched for an optimum."""

    key: str
    suit: Suit
    scenario: SuitScenario


@dataclass(frozen=True, eq=False)
class Task:
    """Cases of one geometry, or the sentence why it cannot be laid; their suits differ in the cord only."""

    geometry: Geometry | str
    every: int
    cases: tuple[WornCase, ...]


def solve_task(task: Task) -> dict[str, Outcome]:
    """The key of each case → what came of it."""
    laid = task.geometry
    if isinstance(laid, str):
        return {case.key: failed(laid) for case in task.cases}
    try:
        worn = prepare_suited_motion(laid.model, laid.kinematics, task.cases[0].suit, task.every, loads=laid.loads)
        slack, _ = solve_scenarios(worn, [], workers=1)
    except (ModelError, MotionError, SuitError) as error:
        return {case.key: failed(str(error)) for case in task.cases}
    bare = float(solve_without_suit(worn, slack, workers=1).muscles[0])
    return {case.key: _solved(worn, case, bare) for case in task.cases}


def failed(sentence: str) -> Outcome:
    return {**dict.fromkeys(RESULTS), "error": sentence}


def _solved(worn: SuitedMotion, case: WornCase, bare_body_cost: float) -> Outcome:
    """One thread: there are as many workers as there are cores to use."""
    scenario, suited = case.scenario, worn.with_suit(case.suit)
    try:
        suited.ensure_pulls()
        slack, (effort,) = solve_scenarios(suited, [scenario], workers=1)
    except SuitError as error:
        return failed(str(error))
    tried = scenario.rest_lengths[:-1]
    lowest = find_minimum(tried, effort.muscles[:-1]) if len(tried) else None
    numbers = (
        effort.muscles[-1],
        effort.reserves[-1],
        effort.cord_force[-1],
        suited.slack_rest_length(scenario),
        *((lowest.rest_length, lowest.cost, lowest.width) if lowest else [np.nan] * 3),
        bare_body_cost,
        effort.outcomes.shape[1],
        effort.unsolved + slack.unsolved,
    )
    plain = [None if np.isnan(number) else float(number) for number in numbers]
    return {**dict(zip(RESULTS, plain, strict=True)), "error": None}

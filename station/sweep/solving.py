"""Solve a task of a sweep on a worker: the motion is evaluated once, the cases are solved separately.

Cases are not solved together, so that the last bit of a result does not depend on the other cases of the task.

Workers are processes of this machine, or of a Dask cluster.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from distributed import Client

from solver.errors import MotionError, SolverError
from solver.model import ModelError
from solver.suit.readouts import find_minimum
from solver.suit.scenarios import (
    LoadedMotion,
    SuitedMotion,
    SuitScenario,
    prepare_suited_motion,
    solve_scenarios,
    solve_without_suit,
)
from solver.suit.suit import Suit, SuitError
from station.dask_cluster import completed_tasks
from station.messages.message import Message
from station.messages.study_messages import SweepCode

Outcome = dict[str, float | str | None]
"""Column → value: the columns of RESULTS, and of ERRORS where the case failed."""

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
ERRORS = ("error", "error_code")
"""The reason of a case that failed as a sentence, and as a stable code."""


@dataclass(frozen=True, eq=False)
class WornCase:
    """Suit and cuffs of a case. The last rest length is the reference of the suit; the others are for the optimum."""

    key: str
    suit: Suit
    scenario: SuitScenario


@dataclass(frozen=True)
class Failure:
    """Why a case, or the motion of its task, cannot be solved."""

    sentence: str
    code: str

    @classmethod
    def of(cls, error: SolverError) -> Failure:
        return cls(str(error), error.code)


@dataclass(frozen=True, eq=False)
class Task:
    """Cases of one motion, or the reason why it cannot be evaluated; their suits differ in the cord only."""

    motion: LoadedMotion | Failure
    every: int
    cases: tuple[WornCase, ...]


def solve_task(task: Task) -> dict[str, Outcome]:
    """Solve the cases of a task. Returns the outcomes by key."""
    motion = task.motion
    if isinstance(motion, Failure):
        return {case.key: failed(motion) for case in task.cases}
    try:
        worn = prepare_suited_motion(motion, task.cases[0].suit, task.every)
        slack, _ = solve_scenarios(worn, [], workers=1)
    except (ModelError, MotionError, SuitError) as error:
        return {case.key: failed(Failure.of(error)) for case in task.cases}
    bare = float(solve_without_suit(worn, slack, workers=1).muscles[0])
    return {case.key: _solved(worn, case, bare) for case in task.cases}


def failed(failure: Failure) -> Outcome:
    return {**dict.fromkeys(RESULTS), "error": failure.sentence, "error_code": failure.code}


def _solved(worn: SuitedMotion, case: WornCase, bare_body_cost: float) -> Outcome:
    """Solve with one thread; there is one worker per core."""
    scenario, suited = case.scenario, worn.with_suit(case.suit)
    try:
        suited.ensure_pulls()
        slack, (effort,) = solve_scenarios(suited, [scenario], workers=1)
    except SuitError as error:
        return failed(Failure.of(error))
    searched = scenario.rest_lengths[:-1]
    lowest = find_minimum(searched, effort.muscles[:-1]) if len(searched) else None
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
    return {**dict(zip(RESULTS, plain, strict=True)), **dict.fromkeys(ERRORS)}


def solve_on(client: Client, tasks: Iterable[Task]) -> Iterator[tuple[dict[str, Outcome], bool]]:
    """Outcomes by key of the cases of every task as it ends, and whether they are final.

    A task whose worker dies is repeated on another one. A task that kills three workers in a row, or ends in an
    unexpected error, gives failed cases that are not final: a later run repeats them.
    """
    for task, future in completed_tasks(client, solve_task, tasks):
        error = future.exception()
        if error is None:
            yield future.result(), True
        else:
            reason = Message(SweepCode.CASE_FAILED, {"reason": f"{type(error).__name__}: {error}"})
            failure = Failure(str(reason), reason.code)
            yield {case.key: failed(failure) for case in task.cases}, False

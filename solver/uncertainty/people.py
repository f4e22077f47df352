"""Assess the suit on drawn people: all uncertainty from the cuffs to the muscles in one sample.

A person is one draw of every factor. People who differ in cuffs or cord only share the evaluated motion and the
matrices of the redundancy problem; those who differ in body, muscles or motion have their own.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from solver.cuff import CuffParameters
from solver.errors import SolverCode, SolverError
from solver.redundancy.motion_solution import LoadedMotion
from solver.scaling import scale_model
from solver.suit.cord import CUFF_CONDITIONS, Condition, SuitScenario
from solver.suit.scenarios import (
    UNMIGRATED,
    CurveReadouts,
    Place,
    Solved,
    SuitedMotion,
    edge_of_minimum,
    efforts_at,
    prepare_suited_motion,
    read_off_curves,
    solve_scenarios,
    stacked,
)
from solver.suit.suit import Suit
from solver.uncertainty.factors import RandomFactor, Scores, factor_columns, random_factors, scores_by_factor
from solver.uncertainty.sources import UncertaintySources
from solver.uncertainty.varied_model import MODEL_FACTORS, varied_cuff, varied_model, varied_options, varied_suit
from solver.uncertainty.varied_motion import MOTION_FACTORS, DrawnMotion, MotionDraws, varied_motion

Array = NDArray[np.float64]

NODES = 12  # rest lengths of a person's curve
MORE_NODES, MOST_EXTENSIONS = 4, 3  # below them, where the optimum is not among them
LONGEST_FIRST = 0.9  # of the rest length of a slack cord: the longest that a curve begins with
UNBOUNDED = (-np.inf, np.inf)


@dataclass(frozen=True, eq=False)
class PeopleCase:
    """Common inputs of the drawn people.

    motion  the assessed one;  drawn: bodies and motions of the posterior of a wearer, if any
    every   muscles are solved in every N-th frame
    """

    motion: LoadedMotion
    suit: Suit
    waist: CuffParameters | None
    arms: tuple[CuffParameters, ...]
    sources: UncertaintySources
    every: int
    drawn: tuple[DrawnMotion, ...] = ()

    @property
    def cuffs(self) -> tuple[CuffParameters, ...]:
        return (self.waist, *self.arms) if self.waist else self.arms

    @cached_property
    def factors(self) -> tuple[RandomFactor, ...]:
        return random_factors(self.sources, self.motion.model, self.cuffs, len(self.drawn))

    @cached_property
    def motion_draws(self) -> MotionDraws:
        return MotionDraws(self.motion.model, self.motion.kinematics, self.drawn)


def solve_people(case: PeopleCase, scores: Array, workers: int | None = None) -> dict[Place, CurveReadouts]:
    """Readouts of every condition of every person (people,), NaN where a person cannot be solved, with the outcome.

    scores (people, scores) are standard normal, in the order of case.factors; zeros are the assessed person with the
    fitted cuffs. workers are threads.
    """
    shared = factor_columns(case.factors, (*MODEL_FACTORS, *MOTION_FACTORS))
    groups: dict[bytes, list[int]] = {}
    for person, row in enumerate(scores[:, shared]):
        groups.setdefault(row.tobytes(), []).append(person)
    found: dict[int, dict[Place, CurveReadouts] | SolverCode] = {}
    for people in groups.values():
        for person, readouts in zip(people, _solve_alike(case, scores[people], workers), strict=True):
            found[person] = readouts
    template = next((readouts for readouts in found.values() if isinstance(readouts, dict)), None)
    if template is None:
        raise SolverError(
            "none of the drawn people can be solved; check the sources of uncertainty", SolverCode.NO_PERSON_SOLVED
        )
    people_in_order = [found[person] for person in range(len(scores))]
    return {
        place: stacked(
            [_unknown(reading, one) if isinstance(one, SolverCode) else one[place] for one in people_in_order]
        )
        for place, reading in template.items()
    }


def _solve_alike(
    case: PeopleCase, scores: Array, workers: int | None
) -> Iterator[dict[Place, CurveReadouts] | SolverCode]:
    """People with the same body, muscles and motion, who may differ in cuffs and cord; or the code of a refusal."""
    people = [scores_by_factor(case.factors, row) for row in scores]
    try:
        suited = _prepare(case, people[0])
    except SolverError as error:
        yield from [error.code] * len(people)
        return
    for person in people:
        try:
            yield _solve_person(case, suited, person, workers)
        except SolverError as error:  # as for cuffs that are drawn over the shoulder point
            yield error.code


def _prepare(case: PeopleCase, scores: Scores) -> SuitedMotion:
    motion, sources = case.motion, case.sources
    chosen = case.motion_draws.chosen(scores)
    body = scale_model(motion.model, chosen.scaling) if chosen else motion.model
    model = varied_model(body, sources.body, sources.muscles, scores)
    # The range of a joint limits recorded motions; errors of posture may leave it.
    model = replace(model, coordinates=tuple(replace(one, range=UNBOUNDED) for one in model.coordinates))
    kinematics = varied_motion(case.motion_draws, sources.motion, scores)
    options = varied_options(motion.options, sources.muscles, scores)
    varied = replace(motion, model=model, kinematics=kinematics, options=options)
    return prepare_suited_motion(varied, varied_suit(case.suit, sources.body, scores), case.every)


def _solve_person(
    case: PeopleCase, suited: SuitedMotion, scores: Scores, workers: int | None
) -> dict[Place, CurveReadouts]:
    sources = case.sources
    suited = suited.with_suit(varied_suit(case.suit, sources.body, scores))
    waist = varied_cuff(case.waist, sources.fit, sources.donning, scores) if case.waist else None
    arms = [varied_cuff(arm, sources.fit, sources.donning, scores) for arm in case.arms]
    scenarios = [_scenario(suited, "rigid", None, None)]
    scenarios += [_scenario(suited, condition, waist, arm) for arm in arms for condition in CUFF_CONDITIONS]
    slack, efforts = solve_scenarios(suited, scenarios, workers=workers)
    solved = _with_optima(suited, list(zip(scenarios, efforts, strict=True)), workers)
    rigid, rest = _as_curve(suited, solved[0]), iter(solved[1:])
    found: dict[Place, CurveReadouts] = {
        (condition, None): reading
        for condition, reading in read_off_curves(suited, slack, {"rigid": rigid}, ("rigid",)).items()
    }
    for arm in arms:
        own: dict[Condition, Solved] = {"rigid": rigid}
        for one in islice(rest, len(CUFF_CONDITIONS)):
            own[one[0].condition] = _as_curve(suited, one)
        own |= {
            one: _with_curve(own[one], own[before]) for one, before in UNMIGRATED.items() if _is_shared(suited, one)
        }
        curves = read_off_curves(suited, slack, own)
        curves["both"] = replace(curves["both"], efforts=efforts_at(suited, own["both"])[None])
        found |= {(condition, arm.name): curves[condition] for condition in CUFF_CONDITIONS}
    return found


def _is_shared(suited: SuitedMotion, condition: Condition) -> bool:
    """Whether the curve is that before the migration, shifted by it: migration along the cord slackens it."""
    return condition in UNMIGRATED and suited.suit.migration_direction == "cord"


def _scenario(
    suited: SuitedMotion, condition: Condition, waist: CuffParameters | None, arm: CuffParameters | None
) -> SuitScenario:
    """Rest lengths from the suit's shortest to that of a slack cord, none for a shared curve; then the reference."""
    suit = suited.suit
    scenario = SuitScenario(condition, waist, arm, np.array([suit.reference_rest_length]), condition == "both")
    if _is_shared(suited, condition):
        return scenario
    slack = suited.slack_rest_length(scenario)
    nodes = np.linspace(min(float(suit.rest_lengths[0]), LONGEST_FIRST * slack), slack, NODES, endpoint=False)
    return replace(scenario, rest_lengths=np.append(nodes, scenario.rest_lengths))


def _with_optima(suited: SuitedMotion, solved: list[Solved], workers: int | None) -> list[Solved]:
    """With shorter rest lengths of the curves whose effort is least at the shortest one."""
    for _ in range(MOST_EXTENSIONS):
        shorter = {}
        for index, (scenario, effort) in enumerate(solved):
            lengths = scenario.rest_lengths[:-1]
            if len(lengths) and edge_of_minimum(effort.muscles[:-1]) < 0:
                more = lengths[0] - (lengths[1] - lengths[0]) * np.arange(MORE_NODES, 0, -1)
                if more[0] > 0:
                    shorter[index] = replace(scenario, rest_lengths=more, with_slopes=False)
        if not shorter:
            break
        _, efforts = solve_scenarios(suited, list(shorter.values()), workers=workers)
        for (index, scenario), effort in zip(shorter.items(), efforts, strict=True):
            solved[index] = _with_lengths(solved[index], scenario.rest_lengths, effort.muscles)
    return solved


def _as_curve(suited: SuitedMotion, solved: Solved) -> Solved:
    """With the effort of a slack cord, which is 1, and without the rest lengths below one that has no solution.

    A curve whose longest rest length has none is not known.
    """
    scenario, effort = solved
    lengths, unknown = scenario.rest_lengths[:-1], np.flatnonzero(np.isnan(effort.muscles[:-1]))
    if not len(lengths):
        return solved
    if len(unknown) and unknown[-1] < len(lengths) - 1:
        used = np.append(np.arange(unknown[-1] + 1, len(lengths)), -1)
        scenario = replace(scenario, rest_lengths=scenario.rest_lengths[used])
        effort = replace(effort, muscles=effort.muscles[used])
    return _with_lengths((scenario, effort), np.array([suited.slack_rest_length(scenario)]), np.ones(1), before=-1)


def _with_curve(solved: Solved, unmigrated: Solved) -> Solved:
    """At the reference rest length alone, with the curve of the same cuffs before their migration along the cord."""
    pattern, curve = unmigrated
    return _with_lengths(solved, pattern.rest_lengths[:-1] - solved[0].migration, curve.muscles[:-1])


def _with_lengths(solved: Solved, lengths: Array, muscles: Array, before: int = 0) -> Solved:
    """With the effort of the muscles at more rest lengths, inserted before those of this index."""
    scenario, effort = solved
    at = before % len(scenario.rest_lengths)
    return (
        replace(scenario, rest_lengths=np.insert(scenario.rest_lengths, at, lengths)),
        replace(effort, muscles=np.insert(effort.muscles, at, muscles)),
    )


def _unknown(readouts: CurveReadouts, reason: SolverCode) -> CurveReadouts:
    parts = {field.name: getattr(readouts, field.name) for field in fields(CurveReadouts)}
    numbers = {name: np.full_like(part, np.nan) for name, part in parts.items() if name != "outcome"}
    return CurveReadouts(**numbers, outcome=np.array([str(reason)]))

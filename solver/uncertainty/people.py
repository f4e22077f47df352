"""Assess the suit on drawn people: all uncertainty from the cuffs to the muscles in one sample.

A person is one draw of every factor. People who differ in cuffs or cord only share the evaluated motion and the
matrices of the redundancy problem; those who differ in body, muscles or motion have their own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from solver.cuff import CuffParameters, by_site
from solver.errors import SolverCode, SolverError
from solver.motion import Kinematics
from solver.suit.assessment import Assessment
from solver.suit.curve_minimum import edge_of_minimum
from solver.suit.readouts import CurveReadouts, Place, efforts_at, read_off_curves, stacked
from solver.suit.scenarios import (
    CUFF_CONDITIONS,
    Condition,
    LoadedMotion,
    ScenarioEffort,
    SuitedMotion,
    SuitScenario,
    prepare_suited_motion,
    solve_scenarios,
)
from solver.suit.suit import Suit
from solver.uncertainty.factors import RandomFactor, Scores, columns_of, random_factors, scores_by_factor
from solver.uncertainty.sources import UncertaintySources
from solver.uncertainty.varied_model import MODEL_FACTORS, varied_cuff, varied_model, varied_options, varied_suit
from solver.uncertainty.varied_motion import MOTION_FACTORS, MotionDraws, varied_motion

Array = NDArray[np.float64]

NODES = 8  # rest lengths of a person's curve
SHORTER_NODES = 5  # below them, where the effort is drawn and no optimum expected
MOST_SHIFTS = 3  # of the rest lengths tried, until the optimum is among them
UNBOUNDED = (-np.inf, np.inf)


@dataclass(frozen=True, eq=False)
class PeopleCase:
    """What the drawn people have in common.

    motion  the assessed one;  drawn: motions drawn from the uncertainty of its markers, if any
    spans   of each place: first and last rest length tried [m] plus the migration of the cuffs, as for the fitted ones
    every   muscles are solved in every N-th frame
    """

    motion: LoadedMotion
    suit: Suit
    waist: CuffParameters | None
    arms: tuple[CuffParameters, ...]
    sources: UncertaintySources
    spans: Mapping[Place, tuple[float, float]]
    every: int
    drawn: tuple[Kinematics, ...] = ()

    @property
    def cuffs(self) -> tuple[CuffParameters, ...]:
        return (self.waist, *self.arms) if self.waist else self.arms

    @cached_property
    def factors(self) -> tuple[RandomFactor, ...]:
        return random_factors(self.sources, self.motion.model, self.cuffs, len(self.drawn))

    @cached_property
    def motion_draws(self) -> MotionDraws:
        return MotionDraws(self.motion.model, (self.motion.kinematics, *self.drawn))

    @cached_property
    def longest_cord(self) -> float:
        """Greatest length of the cord's line on the body as assessed [m]; the rest lengths tried follow it."""
        suited = prepare_suited_motion(self.motion, self.suit, self.every)
        return float(suited.line.length.max())


def people_case(
    assessment: Assessment,
    motion: LoadedMotion,
    suit: Suit,
    cuffs: Sequence[CuffParameters],
    sources: UncertaintySources,
    every: int,
    drawn: tuple[Kinematics, ...] = (),
) -> PeopleCase:
    """What the people of an assessment have in common; the names are those of PeopleCase.

    They try rest lengths around the best one of the assessment, over twice its permissible error; all of the suit's
    where either is unknown.
    """
    arms, waists = by_site(cuffs)
    waist = waists[0] if waists else None
    by_name = {arm.name: arm for arm in arms}
    spans: dict[Place, tuple[float, float]] = {}
    for curve in assessment.curves:
        arm = by_name[curve.cuff] if curve.cuff else None
        length, width = curve.figures["rest_length"].value, curve.figures["permissible_error"].value
        first, last = suit.rest_lengths[[0, -1]].tolist()
        low, high = (first, last) if length is None or width is None else (length - width, length + width)
        moved = SuitScenario(curve.condition, waist if arm else None, arm, suit.rest_lengths).migration
        spans[curve.condition, curve.cuff] = low + moved, high + moved
    return PeopleCase(motion, suit, waist, tuple(arms), sources, spans, every, drawn)


def solve_people(
    case: PeopleCase, scores: Array, progress: Callable[[int, int], None] = lambda *_: None, workers: int | None = None
) -> dict[Place, CurveReadouts]:
    """Readouts of every condition of every person (people,), NaN where a person cannot be solved, with the outcome.

    scores (people, scores) are standard normal, in the order of case.factors; zeros are the assessed person with the
    fitted cuffs. workers are threads.
    """
    shared = columns_of(case.factors, (*MODEL_FACTORS, *MOTION_FACTORS))
    groups: dict[bytes, list[int]] = {}
    for person, row in enumerate(scores[:, shared]):
        groups.setdefault(row.tobytes(), []).append(person)
    found: dict[int, dict[Place, CurveReadouts] | SolverCode] = {}
    done = 0
    for people in groups.values():
        for person, readouts in zip(people, _solve_alike(case, scores[people], workers), strict=True):
            found[person] = readouts
        done += len(people)
        progress(done, len(scores))
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
    """People with the same body, muscles and motion, who may differ in cuffs and cord; the code of what refuses one."""
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
    model = varied_model(motion.model, sources.body, sources.muscles, scores)
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
    moved = float(suited.line.length.max()) - case.longest_cord
    pairs: list[tuple[Condition, CuffParameters | None, CuffParameters | None]] = [("rigid", None, None)]
    pairs += [(condition, waist, arm) for arm in arms for condition in CUFF_CONDITIONS]
    scenarios = [_scenario(case, pair, moved) for pair in pairs]
    shorter = [_shorter(case, scenario) for scenario in scenarios if scenario.condition == "both"]
    slack, efforts = solve_scenarios(suited, [*scenarios, *shorter], workers=workers)
    efforts, shorter_efforts = efforts[: len(scenarios)], efforts[len(scenarios) :]
    _bracket_optima(suited, scenarios, efforts, workers)
    rigid, *others = zip(scenarios, efforts, strict=True)
    found: dict[Place, CurveReadouts] = {("rigid", None): read_off_curves(suited, slack, {"rigid": rigid})["rigid"]}
    rest = iter(others)
    for arm, below in zip(arms, zip(shorter, shorter_efforts, strict=True), strict=True):
        own = {scenario.condition: (scenario, effort) for scenario, effort in islice(rest, len(CUFF_CONDITIONS))}
        curves = read_off_curves(suited, slack, {"rigid": rigid, **own})
        curves["both"] = replace(curves["both"], efforts=efforts_at(suited, (own["both"], below))[None])
        found |= {(condition, arm.name): curves[condition] for condition in CUFF_CONDITIONS}
    return found


def _scenario(
    case: PeopleCase,
    pair: tuple[Condition, CuffParameters | None, CuffParameters | None],
    moved: float,
) -> SuitScenario:
    """Rest lengths over the span, which follows the length of the cord and the migration; then the reference."""
    condition, waist, arm = pair
    first, last = case.spans[condition, arm.name if arm else None]
    scenario = SuitScenario(condition, waist, arm, np.linspace(first + moved, last + moved, NODES), condition == "both")
    lengths = np.append(scenario.rest_lengths - scenario.migration, case.suit.reference_rest_length)
    return replace(scenario, rest_lengths=lengths)


def _shorter(case: PeopleCase, scenario: SuitScenario) -> SuitScenario:
    """The rest lengths from the suit's shortest up to those of the scenario."""
    shortest = float(case.suit.rest_lengths[0])
    lengths = np.linspace(min(shortest, scenario.rest_lengths[0]), scenario.rest_lengths[0], SHORTER_NODES + 1)[:-1]
    return replace(scenario, rest_lengths=lengths, with_slopes=False)


def _bracket_optima(
    suited: SuitedMotion, scenarios: list[SuitScenario], efforts: list[ScenarioEffort], workers: int | None
) -> None:
    """Shift the rest lengths of curves whose least effort is at an end, and solve these again, in place."""
    for _ in range(MOST_SHIFTS):
        outside = {}
        for index, (scenario, effort) in enumerate(zip(scenarios, efforts, strict=True)):
            lengths, cost = scenario.rest_lengths[:-1], effort.muscles[:-1]
            if edge := edge_of_minimum(cost):
                moved = np.append(lengths + 0.6 * edge * (lengths[-1] - lengths[0]), scenario.rest_lengths[-1])
                outside[index] = replace(scenario, rest_lengths=moved)
        if not outside or min(scenario.rest_lengths.min() for scenario in outside.values()) <= 0:
            return
        _, again = solve_scenarios(suited, list(outside.values()), workers=workers)
        for index, effort in zip(outside, again, strict=True):
            scenarios[index], efforts[index] = outside[index], effort


def _unknown(readouts: CurveReadouts, reason: SolverCode) -> CurveReadouts:
    parts = {field.name: getattr(readouts, field.name) for field in fields(CurveReadouts)}
    numbers = {name: np.full_like(part, np.nan) for name, part in parts.items() if name != "outcome"}
    return CurveReadouts(**numbers, outcome=np.array([str(reason)]))

"""A model with a suit in a motion: the mechanics that all scenarios share, and the muscle effort of a scenario.

Geometry and response maps are computed once; a scenario (condition, cuffs, rest length) only changes the loads on the
bodies. Cuffs are evaluated in all frames of the motion, also where muscles are solved in every N-th only.

Results of a cost curve: its minimum and permissible error, and the figures of the assessment's tables.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from itertools import chain, islice

import numpy as np
import scipy
from numpy.typing import NDArray

from solver.errors import MotionError, SolverCode
from solver.model import Array, Model, ModelError
from solver.motion import Kinematics, decimate
from solver.multibody.dynamics import Response
from solver.multibody.postures import Postures, postures, wrench_about_origin
from solver.redundancy.effort import RedundancyOptions, options_for
from solver.redundancy.mechanics import Mechanics, evaluate_motion
from solver.redundancy.motion_solution import LoadedMotion
from solver.redundancy.problem import FrameOutcome, LoadResponse, RedundancyProblem, build_redundancy
from solver.redundancy.sequence import ScenarioSolutions, solve_redundancy
from solver.suit.cord import (
    CUFF_CONDITIONS,
    MIGRATION_STEP,
    Condition,
    CordLine,
    SuitForces,
    SuitScenario,
    cord_line,
    per_unit_wrench,
    response_to_wrenches,
    suit_forces,
    with_migration,
)
from solver.suit.suit import Suit, SuitError, ensure_fits, with_suit_masses

RANGE_TOLERANCE = 1e-6  # rad or m


@dataclass(frozen=True, eq=False)
class ScenarioEffort:
    """Effort of a scenario by rest length; costs are relative to the suit with a slack cord.

    muscles, reserves  (rest lengths,) Σ w aᵖ and Σ w r² over all finite frames; NaN where one is infeasible
    cord_force         (rest lengths,) largest tension of the cord [N], over all frames of the motion
    activations        (rest lengths, frames, muscles)
    outcomes           (rest lengths, frames) of FrameOutcome
    migration_slopes   (2,) derivative of muscles at the last rest length with respect to the migration of the waist and
                       the arm cuff alone [1/m]; NaN for a rigid cuff, or where they were not solved
    """

    muscles: Array
    reserves: Array
    cord_force: Array
    activations: Array
    outcomes: NDArray[np.object_]
    migration_slopes: Array = field(default_factory=lambda: np.full(2, np.nan))

    @property
    def unsolved(self) -> int:
        """(rest length, frame) pairs that are not SOLVED."""
        return int((self.outcomes != FrameOutcome.SOLVED).sum())


@dataclass(frozen=True, eq=False)
class SuitedMotion:
    """Everything that no scenario changes: the model with the suit's masses, and the postures of all frames, of which
    the muscles are solved in every N-th; motion is without the suit, mechanics with it, in the solved frames.
    """

    motion: LoadedMotion
    model: Model
    suit: Suit
    postures: Postures
    line: CordLine
    every: int
    mechanics: Mechanics
    problem: RedundancyProblem
    unit_response: Response

    @cached_property
    def bare_mechanics(self) -> Mechanics:
        """Of the body without the suit's masses."""
        motion, suited = self.motion, self.mechanics
        return evaluate_motion(motion.model, suited.kinematics, suited.paths, suited.loads, motion.options.joint)

    @cached_property
    def bare_problem(self) -> RedundancyProblem:
        """The problem of the body without the suit's masses."""
        return build_redundancy(self.motion.model, self.bare_mechanics, self.motion.options)

    @property
    def measured(self) -> tuple[str, ...]:
        """Names for the entries of mean_activation: muscles, then the suit's groups of them."""
        return (*self.model.muscle_names, *self.suit.groups)

    def mean_activation(self, activations: Array) -> Array:
        """(measured,) mean over the finite frames of activations (frames, muscles), groups by their muscles' mean."""
        mean = activations[self.problem.is_finite].mean(axis=0)
        return np.append(mean, self._shares @ mean)

    @cached_property
    def _shares(self) -> Array:
        """(groups, muscles) 1 / number of muscles of a group, for each of them."""
        members = np.array([[name in group for name in self.model.muscle_names] for group in self.suit.groups.values()])
        members = members.reshape(len(self.suit.groups), len(self.model.muscles))
        return np.asarray(members / members.sum(axis=1, keepdims=True))

    def with_suit(self, suit: Suit) -> SuitedMotion:
        """The same motion in a suit that differs in its cord only, not in its bodies or masses."""
        return replace(self, suit=suit, line=cord_line(suit, self.model, self.postures, self.line.interval))

    def ensure_pulls(self) -> None:
        """Raises SuitError where the cord is slack in all frames, at the reference or at every rest length to try."""
        suit = self.suit
        longest = float(self.line.length.max())
        lengths = suit.reference_rest_length, float(suit.rest_lengths.min())
        for key, length in zip(("reference_rest_length_m", "rest_lengths_m.first"), lengths, strict=True):
            if length >= longest:
                raise SuitError(
                    f"the suit's {key} should be below {longest:.4g} m, the longest that the cord's line becomes in "
                    f"this motion, and is {length:g} m, so that the cord is slack in all frames; make it shorter",
                    SolverCode.CORD_SLACK,
                )

    def slack_rest_length(self, scenario: SuitScenario) -> float:
        """The rest length above which the cord is always slack in this motion [m]: the greatest length of its line."""
        line = with_migration(self.suit, self.line, scenario.cuffs) if scenario.is_shifted else self.line
        return float(line.length.max())

    def forces(self, scenario: SuitScenario) -> SuitForces:
        """In the frames that are solved; the largest tension of the cord in all of the motion."""
        return suit_forces(
            self.suit,
            self.line,
            scenario.rest_lengths,
            scenario.cuffs,
            is_shifted=scenario.is_shifted,
            yields=scenario.yields,
            every=self.every,
        )


def prepare_suited_motion(motion: LoadedMotion, suit: Suit, every: int = 1) -> SuitedMotion:
    """Evaluate the motion with the suit on the model; muscles are to be solved in every N-th frame.

    Raises SuitError if the suit does not fit the model, MotionError if the motion leaves the range of a joint;
    ModelError for elastic tendons in some frames only. ensure_pulls raises for a cord that is always slack. A model
    without a shoulder has no glenoid cone.
    """
    motion = replace(motion, options=options_for(motion.model, motion.options))
    model, kinematics, options = motion.model, motion.kinematics, motion.options
    ensure_fits(suit, model)
    ensure_all_frames(options, every)
    _ensure_within_ranges(model, kinematics)
    suited = with_suit_masses(model, suit)
    state = postures(suited, kinematics.positions, kinematics.speeds)
    loads = [load.decimate(every) for load in motion.loads]
    decimated = decimate(kinematics, every)
    mechanics = evaluate_motion(suited, decimated, loads=loads, joint=options.joint, path_mode=options.path_mode)
    return SuitedMotion(
        motion=motion,
        model=suited,
        suit=suit,
        postures=state,
        line=cord_line(suit, suited, state, kinematics.interval),
        every=every,
        mechanics=mechanics,
        problem=build_redundancy(suited, mechanics, options),
        unit_response=per_unit_wrench(suited, suit, mechanics),
    )


def solve_scenarios(
    suited: SuitedMotion,
    scenarios: Sequence[SuitScenario],
    progress: Callable[[int, int], None] = lambda *_: None,
    workers: int | None = None,
) -> tuple[ScenarioEffort, list[ScenarioEffort]]:
    """The effort with a slack cord, then that of the scenarios; all scenarios of a frame are solved together.

    Scenarios are divided among workers (threads), by default as many as processors.
    """
    frames, places = suited.unit_response.acceleration.shape[:2]
    wrenches, cord_forces = [np.zeros((1, frames, places))], [np.zeros(1)]
    migrated = [scenario.migrated for scenario in scenarios]
    for scenario in (*scenarios, *chain.from_iterable(migrated)):
        forces = suited.forces(scenario)
        wrench = wrench_about_origin(forces.points, forces.forces)
        wrenches.append(wrench.reshape(*wrench.shape[:2], places))
        cord_forces.append(forces.largest_tension)
    loads = response_to_wrenches(suited.unit_response, np.concatenate(wrenches))
    if suited.motion.options.tendons == "elastic":
        solution = _solve_elastic(suited, suited.model, suited.mechanics, loads, progress)
    else:
        solution = solve_redundancy(suited.problem, loads, progress, workers)
    slack = float(_effort(suited.problem, solution, slice(0, 1), cord_forces[0], 1.0).muscles[0])
    ends = np.cumsum([len(wrench) for wrench in wrenches])
    first, *others = (
        _effort(suited.problem, solution, slice(begin, end), cord_force, slack)
        for begin, end, cord_force in zip([0, *ends[:-1]], ends, cord_forces, strict=True)
    )
    steps = iter(others[len(scenarios) :])
    return first, [
        replace(effort, migration_slopes=_slopes(scenario, list(islice(steps, len(moved)))))
        for scenario, effort, moved in zip(scenarios, others, migrated, strict=False)
    ]


def _slopes(scenario: SuitScenario, migrated: Sequence[ScenarioEffort]) -> Array:
    """Slopes of the effort (2,) from those of scenario.migrated."""
    slopes = np.full(2, np.nan)
    if migrated:
        less, more = np.array([effort.muscles[0] for effort in migrated]).reshape(2, -1)
        slopes[[cuff is not None for cuff in scenario.cuffs]] = (more - less) / (2 * MIGRATION_STEP)
    return slopes


def solve_without_suit(suited: SuitedMotion, slack: ScenarioEffort, workers: int | None = None) -> ScenarioEffort:
    """The effort of the body without the suit's masses, over that of the slack suit."""
    if suited.motion.options.tendons == "elastic":
        solution = _solve_elastic(suited, suited.motion.model, suited.bare_mechanics)
    else:
        solution = solve_redundancy(suited.bare_problem, workers=workers)
    activations = slack.activations[0, suited.problem.is_finite]
    slack_cost = float(suited.problem.effort.terms(activations).sum())
    return _effort(suited.bare_problem, solution, slice(0, 1), np.zeros(1), slack_cost)


def ensure_all_frames(options: RedundancyOptions, every: int) -> None:
    """Raise ModelError where only every N-th frame is to be solved with elastic tendons."""
    if options.tendons == "elastic" and every > 1:
        raise ModelError(
            "elastic tendons need every frame of the motion, because fibre velocities are differences of frames, and "
            f"every {every}-th should be solved, as for draws; solve all frames without draws, or keep tendons rigid",
            SolverCode.UNSUPPORTED,
        )


def _solve_elastic(
    suited: SuitedMotion,
    model: Model,
    mechanics: Mechanics,
    response: LoadResponse | None = None,
    progress: Callable[[int, int], None] = lambda *_: None,
) -> ScenarioSolutions:
    """With elastic tendons; a frame with a fibre that does not converge is NOT_CONVERGED."""
    from solver.redundancy.elastic import solve_elastic  # the compiler behind it takes long to import

    solution, fibers = solve_elastic(model, mechanics, suited.motion.options, progress, response)
    is_loose = np.array([~one.is_converged.all(axis=1) for one in fibers])
    solution.outcomes[is_loose & (solution.outcomes == FrameOutcome.SOLVED)] = FrameOutcome.NOT_CONVERGED
    return solution


def _ensure_within_ranges(model: Model, kinematics: Kinematics) -> None:
    lowest, highest = np.array([coordinate.range for coordinate in model.coordinates]).T
    beyond = np.maximum(lowest - kinematics.positions, kinematics.positions - highest)
    frame, worst = np.unravel_index(int(np.argmax(beyond)), beyond.shape)
    if beyond[frame, worst] > RANGE_TOLERANCE:
        coordinate = model.coordinates[int(worst)]
        scale, unit = (180 / np.pi, "°") if coordinate.motion == "rotation" else (1.0, " m")
        raise MotionError(
            f"the motion should keep {coordinate.name} between {lowest[worst] * scale:g} and "
            f"{highest[worst] * scale:g}{unit}, its range in the model, and is at "
            f"{kinematics.positions[frame, worst] * scale:g}{unit} at {kinematics.time[frame]:g} s; leave these "
            "frames out, widen the range, or state in the header of a file in degrees that it is (inDegrees=yes)",
            SolverCode.OUT_OF_RANGE,
        )


def _effort(
    problem: RedundancyProblem, solution: ScenarioSolutions, part: slice, cord_force: Array, slack_cost: float
) -> ScenarioEffort:
    controls, muscles = solution.controls[part], problem.time_constants.shape[1]
    cost = problem.effort.terms(controls[:, problem.is_finite]).sum(axis=1) / slack_cost
    return ScenarioEffort(
        muscles=cost[:, :muscles].sum(axis=1),
        reserves=cost[:, muscles:].sum(axis=1),
        cord_force=cord_force,
        activations=controls[:, :, :muscles],
        outcomes=solution.outcomes[part],
    )


Place = tuple[Condition, str | None]
"""Condition and arm cuff's name, None where all cuffs are rigid."""
Solved = tuple[SuitScenario, ScenarioEffort]
"""A scenario and its effort; the last rest length is the reference, the others are those tried."""

LARGE_RESERVES = 0.1
"""Effort of the reserves, over that of the muscles with a slack cord, above which muscles do not explain a motion."""
ROUND_OFF = 1e-9  # m
IDLE = 1e-9  # mean activation below which a muscle counts as inactive and has no reduction
UNMIGRATED: dict[Condition, Condition] = {"shift": "rigid", "both": "visco_elastic"}  # the same cuffs without migration


@dataclass(frozen=True, eq=False)
class CurveReadouts:
    """Results of n versions of one curve, (n,) each, NaN where there is none.

    at_reference       normalised cost at the suit's reference rest length
    rest_length        where the cost is lowest [m];  lowest_cost there
    permissible_error  full width in which 90 % of the best saving is kept [m]
    to_slack           from the best rest length to that at which the cord is always slack [m]
    cord_force         largest tension at the reference rest length [N]
    cord_force_lost    share of it lost by migration, relative to the same cuffs without migration
    cost_per_arm_migration, cost_per_waist_migration
                       derivative of the normalised cost at the reference rest length with respect to the migration of
                       this cuff alone, by central differences of the solved effort [1/m]; NaN for a rigid cuff
    bounds             (n, 4) side of the lengths tried at which the cost is lowest (−1, 1), and what rest_length,
                       lowest_cost and to_slack are there; the optimum lies there or beyond; else (0, NaN, NaN, NaN)
    reduction          (n, measured) 1 − mean activation / that with a slack cord, at the reference; see SuitedMotion
    efforts            (n, rest lengths) normalised cost at the suit's rest lengths, of drawn people with migration and
                       compliance; NaN below those that have a solution. (n, 0) otherwise
    reserves           effort of the reserve actuators at the reference rest length, over that of the muscles with a
                       slack cord
    outcome            FrameOutcome that leaves at_reference unknown, or SOLVED; the SolverCode of a drawn person who
                       cannot be evaluated
    """

    at_reference: Array
    rest_length: Array
    lowest_cost: Array
    permissible_error: Array
    to_slack: Array
    cord_force: Array
    cord_force_lost: Array
    cost_per_arm_migration: Array
    cost_per_waist_migration: Array
    bounds: Array
    reduction: Array
    efforts: Array
    reserves: Array
    outcome: NDArray[np.str_]

    def part(self, versions: NDArray[np.bool_]) -> CurveReadouts:
        """These versions alone."""
        return CurveReadouts(**{field.name: getattr(self, field.name)[versions] for field in fields(self)})


_OTHERS = {"bounds", "reduction", "efforts", "reserves", "outcome"}
FIGURES = tuple(field.name for field in fields(CurveReadouts) if field.name not in _OTHERS)
"""Fields with one number for each version."""


def read_off_curves(
    suited: SuitedMotion,
    slack: ScenarioEffort,
    solved: Mapping[Condition, Solved],
    conditions: Sequence[Condition] = CUFF_CONDITIONS,
) -> dict[Condition, CurveReadouts]:
    """One version of the curves of these conditions, from one set of cuffs in all conditions and rigid ones."""
    idle = suited.mean_activation(slack.activations[0])
    unmigrated = {one: solved[before] for one, before in UNMIGRATED.items() if one in conditions}
    return {one: _read(suited, slack, idle, solved[one], unmigrated.get(one)) for one in conditions}


def stacked(readouts: Sequence[CurveReadouts]) -> CurveReadouts:
    """The versions of several curves, concatenated."""
    return CurveReadouts(
        **{f.name: np.concatenate([getattr(part, f.name) for part in readouts]) for f in fields(CurveReadouts)}
    )


def _read(
    suited: SuitedMotion, slack: ScenarioEffort, mean_slack: Array, solved: Solved, unmigrated: Solved | None
) -> CurveReadouts:
    """mean_slack (measured,) is the mean activation with a slack cord."""
    scenario, effort = solved
    force, cost = effort.cord_force[-1], effort.muscles[-1]
    force_before = unmigrated[1].cord_force[-1] if unmigrated is not None else np.nan
    lowest = find_minimum(scenario.rest_lengths[:-1], effort.muscles[:-1])
    slack_length = suited.slack_rest_length(scenario)
    bounds, lowest_cost = np.array([0.0, np.nan, np.nan, np.nan]), lowest.cost
    if lowest.edge:
        place = -2 if lowest.edge > 0 else 0  # the last is the reference
        length = scenario.rest_lengths[place]
        bounds = np.array([lowest.edge, length, effort.muscles[place], slack_length - length])
        if length >= slack_length - ROUND_OFF:
            lowest_cost = effort.muscles[place]  # a longer cord is as slack
    of_waist, of_arm = effort.migration_slopes
    mean = suited.mean_activation(effort.activations[-1])
    return CurveReadouts(
        at_reference=np.array([cost]),
        rest_length=np.array([lowest.rest_length]),
        lowest_cost=np.array([lowest_cost]),
        permissible_error=np.array([lowest.width]),
        to_slack=np.array([slack_length - lowest.rest_length]),
        cord_force=np.array([force]),
        cord_force_lost=np.array([1 - force / force_before if force_before > 0 else np.nan]),
        cost_per_arm_migration=np.array([of_arm]),
        cost_per_waist_migration=np.array([of_waist]),
        bounds=bounds[None],
        reduction=1 - np.divide(mean, mean_slack, out=np.full_like(mean, np.nan), where=mean_slack > IDLE)[None],
        efforts=np.empty((1, 0)),
        reserves=effort.reserves[-1:],
        outcome=np.array([str(_outcome(cost, (*effort.outcomes[-1], *slack.outcomes[0])))]),
    )


def _outcome(cost: float, of_frames: Sequence[FrameOutcome]) -> FrameOutcome:
    """SOLVED, or the most frequent outcome of frames that leaves the cost unknown: rates do not, nor frames left out,
    unless all of them are.
    """
    if np.isfinite(cost):
        return FrameOutcome.SOLVED
    known = (FrameOutcome.SOLVED, FrameOutcome.BEYOND_ACTIVATION_RATE, FrameOutcome.NOT_FINITE)
    found = Counter(outcome for outcome in of_frames if outcome not in known)
    return found.most_common(1)[0][0] if found else FrameOutcome.NOT_FINITE


def efforts_at(suited: SuitedMotion, solved: Solved) -> Array:
    """Normalised cost (rest lengths,) at those of the suit, from a curve that ends with a slack cord: monotone cubics
    (Fritsch and Carlson 1980, SIAM J. Numer. Anal. 17:238); 1 where the cord is slack throughout, NaN below the
    shortest rest length of the curve.
    """
    scenario, effort = solved
    lengths, cost, wanted = scenario.rest_lengths[:-1], effort.muscles[:-1], suited.suit.rest_lengths
    efforts = np.where(wanted < lengths[-1], np.nan, 1.0)
    if np.isfinite(cost).all():
        curve = scipy.interpolate.PchipInterpolator(lengths, cost, extrapolate=False)
        efforts[wanted < lengths[-1]] = curve(wanted[wanted < lengths[-1]])
    return efforts


KEPT_REDUCTION = 0.9  # of the best one, within the permissible error of the rest length


@dataclass(frozen=True)
class CurveMinimum:
    """The best rest length [m], the normalised cost there, and the full width [m] in which 90 % of the saving is kept.

    All NaN where the best of the lengths tried is the first or the last; the width also where it goes beyond them.
    edge is −1 where it is the first, 1 where it is the last, 0 otherwise.
    """

    rest_length: float
    cost: float
    width: float
    edge: int = 0


def find_minimum(rest_lengths: Array, cost: Array) -> CurveMinimum:
    """The lowest point of a cubic spline through the cost (rest lengths,) at the lengths tried (rest lengths,) [m]."""
    edge = edge_of_minimum(cost)
    if edge or np.isnan(cost).any():
        return CurveMinimum(np.nan, np.nan, np.nan, edge)
    spline = scipy.interpolate.CubicSpline(rest_lengths, cost)
    flat = spline.derivative().roots(extrapolate=False)
    length = float(flat[np.argmin(spline(flat))])
    lowest = float(spline(length))
    edges = spline.solve(1 - KEPT_REDUCTION * (1 - lowest), extrapolate=False)
    before, after = edges[edges < length], edges[edges > length]
    is_kept = before.size and after.size and lowest < 1
    return CurveMinimum(length, lowest, float(after.min() - before.max()) if is_kept else np.nan)


def edge_of_minimum(cost: Array) -> int:
    """−1 if the first cost (rest lengths,) is the least, 1 if the last is, 0 otherwise or if a cost is unknown."""
    best = int(np.argmin(cost))
    if np.isnan(cost[best]):
        return 0
    return -1 if best == 0 else int(best == len(cost) - 1)

"""The redundancy problem with elastic tendons: sequential quadratic programming in each frame.

The lengths of the fibres at the frames before are known, so the implicit step of solver/tendons makes the tension of a
muscle a smooth, rising function F(a) of its activation in the frame. It is linearised at the current activations a₀
(ReducedFrame), and the solution is the next a₀, until the linear force is the true one at the solution. Then it
satisfies the conditions of optimality of the problem with F. They are necessary ones: with F curved, the problem need
not be convex.

The matrices per force do not change with the activations. They are reduced once in a frame, and F(a₀) + F'(a₀) (a − a₀)
only scales columns of the reduced problem (conic.py). Its effort is that of the activations plus the curvature
of F, so that the steps converge fast. With cubes of the activations F'' is neglected.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from solver.errors import SolverCode
from solver.model import Array, Model, ModelError
from solver.muscle import MuscleForces
from solver.redundancy.convex_frames import FIRST_GUESS, UNSOLVED, ClarabelFrame, ForcePoint, FrameStep, reduced_frame
from solver.redundancy.effort import RedundancyOptions
from solver.redundancy.mechanics import Mechanics
from solver.redundancy.problem import FrameOutcome, LoadResponse, Outcomes, RedundancyProblem, build_redundancy
from solver.redundancy.sequence import Progress, ScenarioSolutions, scenario_solutions, solve_in_turn, solve_runs
from solver.tendons.fiber import (
    ElasticForces,
    FiberHistory,
    StepStart,
    allocate_settled,
    fiber_tables,
    fill_frame,
    fill_settled,
    with_rigid_tendons,
)

FORCE_TOLERANCE = 1e-10  # of the greatest isometric force, between linear and true force
SMALL_STEP = 1e-3  # of an activation, below which the forces may agree so
SMALL_STEP_OF_COST = 1e-6  # below which the slopes of an ActivationCost do so, too
CLEAR_STEP = 1e-6  # of an activation, above which two derivatives determine a curvature
ITERATIONS = 40
INFEASIBLE_ITERATIONS = 5  # of linear problems that are infeasible, before the frame is
LEAST_GUESS, LEAST_GAIN = 0.02, 1e-3


def solve_elastic(
    model: Model,
    mechanics: Mechanics,
    options: RedundancyOptions,
    progress: Progress = lambda *_: None,
    response: LoadResponse | None = None,
) -> tuple[ScenarioSolutions, tuple[ElasticForces, ...]]:
    """Activations and controls of all scenarios, and their muscles' forces, NaN in INFEASIBLE and NOT_FINITE frames.

    response is that to the loads of the scenarios; None is one scenario without. A frame whose iteration does not
    converge is NOT_CONVERGED, one in which a muscle has no finite force NOT_FINITE.
    INFEASIBLE holds for the linearised forces, so it is no proof. After these frames, fibres and activations start
    anew. Raises ModelError without an elastic tendon, or with options of static optimisation.
    """
    _ensure_dynamic(model, options)
    problem = build_redundancy(model, replace(mechanics, forces=_forces_as_controls(model, mechanics.forces)), options)
    is_finite, problem = problem.is_finite, problem.with_loads(response) if response else problem
    elastic = [_ElasticFrames(model, mechanics, options) for _ in problem.target]

    def solve_frame(frame: RedundancyProblem, bounds: Array) -> tuple[Array, Outcomes]:
        steps = [one.solve(frame.scenario(i), bounds[i]) for i, one in enumerate(elastic)]
        controls = np.array([np.append(step.activations, step.forces[len(step.activations) :]) for step in steps])
        return controls, np.array([step.outcome for step in steps], dtype=object)

    def solve_run(run: RedundancyProblem, progress: Progress, _workers: int | None) -> tuple[Array, Outcomes]:
        for one in elastic:
            one.restart()
        return solve_in_turn(run, solve_frame, progress)

    controls, outcomes = solve_runs(solve_run, problem, is_finite, progress)
    activations = controls[..., : problem.muscles].copy()
    controls[..., : problem.muscles] = [one.linear_forces for one in elastic]
    solution = scenario_solutions(problem, controls, outcomes)
    is_infeasible, is_missing = outcomes == FrameOutcome.INFEASIBLE, outcomes == FrameOutcome.NOT_FINITE
    solution.controls[..., : problem.muscles] = np.where(is_infeasible[..., None], np.nan, activations)
    for scenario, one in enumerate(elastic):
        one.forces.tension[is_infeasible[scenario] | is_missing[scenario]] = np.nan
        one.forces.passive[is_missing[scenario]] = np.nan
    return solution, tuple(one.forces for one in elastic)


class _ElasticFrames:
    """Fibres of the frames before in one scenario, and the solution of the next frame.

    forces, linear_forces (frames, muscles) are filled; forces but those over the greatest isometric ones.
    """

    def __init__(self, model: Model, mechanics: Mechanics, options: RedundancyOptions) -> None:
        self._time, self._interval = mechanics.kinematics.time, mechanics.kinematics.interval
        self._paths, self._is_reference = mechanics.paths, options.solver == "clarabel"
        self._tables = fiber_tables(model)
        self._strength = _strength(model)
        self._active, self._passive = (
            part / self._strength for part in (mechanics.forces.active, mechanics.forces.passive)
        )
        self._settled = allocate_settled(len(self._tables.muscle))
        self.linear_forces = np.full(self._active.shape, np.nan)
        self.forces = with_rigid_tendons(mechanics.forces, self.linear_forces)
        self.restart()

    def restart(self) -> None:
        """The next frame is a first one: fibres in equilibrium."""
        muscles = len(self._strength)
        self._gain = np.zeros(muscles)
        self._history = FiberHistory(self._tables, self._interval)
        self._guess, self._curvature = np.full(muscles, FIRST_GUESS), np.zeros(muscles)
        self._multipliers = np.zeros(0)

    def solve(self, problem: RedundancyProblem, bounds: Array) -> FrameStep:
        """The solution of a problem of one frame and scenario; NaN where a force is not finite."""
        frame = int(np.searchsorted(self._time, problem.time[0]))
        step = self._solve(problem, frame, bounds)
        if step is None:
            nothing = np.full(len(problem.weights), np.nan)
            step = FrameStep(nothing[: problem.muscles], nothing, FrameOutcome.NOT_FINITE)
        self.linear_forces[frame] = step.forces[: problem.muscles]
        if step.outcome in (*UNSOLVED, FrameOutcome.NOT_FINITE):  # slack fibres need many frames to become taut
            self.restart()
        return step

    def _solve(self, problem: RedundancyProblem, frame: int, bounds: Array) -> FrameStep | None:
        start = self._history.start(self._paths.speeds[frame, self._tables.muscle])
        reduced = None if self._is_reference else reduced_frame(problem, self._multipliers)
        linear = reduced or ClarabelFrame(problem, self._multipliers)
        point = self._first_point(frame, start)
        small_step = SMALL_STEP if problem.cost is None else SMALL_STEP_OF_COST
        change, share, infeasible = np.zeros(len(point.gain)), 1.0, 0
        for _ in range(ITERATIONS):
            if not np.isfinite(point.force + point.gain).all():
                return None
            found = linear.solve(point, bounds)
            infeasible += found.outcome is FrameOutcome.INFEASIBLE
            before, change = change, found.activations - point.activations
            share = 1.0 if problem.effort.has_quadratic_steps else _relaxation(share, before, change)
            expected, is_small = point.force + point.gain * change, np.abs(change).max() <= small_step
            if is_small:
                point = self._point(frame, start, found.activations, point)
                is_found = bool(np.abs(point.force - expected).max() <= FORCE_TOLERANCE)
            if (is_small and is_found) or infeasible == INFEASIBLE_ITERATIONS:
                break
            if not is_small or share != 1.0:
                a = np.clip(found.activations - (1.0 - share) * change, 0.0, 1.0)
                point = self._point(frame, start, a, point)
        else:
            found = found._replace(outcome=FrameOutcome.NOT_CONVERGED)
        self._keep(point, linear.multipliers)
        self.forces.tension[frame] = point.force * self._strength
        fill_frame(self.forces, frame, self._tables, self._paths.lengths[frame, self._tables.muscle], self._settled)
        return found

    def _first_point(self, frame: int, start: StepStart) -> ForcePoint:
        """The activations of the frame before with their forces and derivatives; above zero where a muscle had no
        derivative there, as a slack one.
        """
        a = np.where(self._gain < LEAST_GAIN, np.maximum(self._guess, LEAST_GUESS), self._guess)
        return ForcePoint(a, *self._evaluate(frame, start, a), self._curvature)

    def _point(self, frame: int, start: StepStart, a: Array, before: ForcePoint) -> ForcePoint:
        """The forces at activations a; their curvature follows from the derivatives here and at the point before."""
        force, gain = self._evaluate(frame, start, a)
        change = a - before.activations
        is_clear = np.abs(change) > CLEAR_STEP
        curvature = np.where(is_clear, (gain - before.gain) / np.where(is_clear, change, 1.0), before.curvature)
        return ForcePoint(a, force, gain, curvature)

    def _evaluate(self, frame: int, start: StepStart, a: Array) -> tuple[Array, Array]:
        """Force (muscles,) at activations a, and its derivative."""
        chosen = self._tables.muscle
        force, gain = self._active[frame] * a + self._passive[frame], self._active[frame].copy()
        fill_settled(self._tables, self._paths.lengths[frame, chosen], a[chosen], start, self._settled)
        start.guess[:] = self._settled.length
        force[chosen], gain[chosen] = self._settled.force, self._settled.gain
        return force, gain

    def _keep(self, point: ForcePoint, multipliers: Array) -> None:
        """Store the start of the next frame."""
        self._history.keep(self._settled)
        self._guess, self._gain, self._curvature = point.activations, point.gain, point.curvature
        self._multipliers = multipliers


def _ensure_dynamic(model: Model, options: RedundancyOptions) -> None:
    has_passive_forces = options.muscle_force_model == "rigid_tendon"
    if has_passive_forces and options.has_activation_dynamics and not options.has_muscle_limits:
        return
    raise ModelError(
        f"elastic tendons of {model.name} need activation dynamics, passive muscle forces and activations from 0 to "
        "1, which static optimisation does not have; solve with rigid tendons, or without static optimisation",
        SolverCode.UNSUPPORTED,
    )


def _relaxation(share: float, before: Array, step: Array) -> float:
    """Share of the next step: the problem neglects the curvature of F, so that steps shrink by a factor, which Aitken's
    rule finds from two of them (Irons and Tuck, Int. J. Numer. Methods Eng. 1:275, 1969).
    """
    change = step - before
    if not before.any() or not change.any():
        return 1.0
    return float(np.clip(-share * (before @ change) / (change @ change), 0.2, 1.5))


def _forces_as_controls(model: Model, forces: MuscleForces) -> MuscleForces:
    """Forces of muscles whose controls are tensions over the greatest isometric forces, not activations."""
    strength = np.tile(_strength(model), (len(forces.active), 1))
    return replace(forces, active=strength, passive=np.zeros_like(forces.passive))


def _strength(model: Model) -> Array:
    return np.array([muscle.max_isometric_force for muscle in model.muscles])

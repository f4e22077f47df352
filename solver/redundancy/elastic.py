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

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from solver.errors import SolverCode
from solver.model import Model, ModelError
from solver.multibody.loads import ExternalForce, load_wrenches
from solver.redundancy.convex_frames import FIRST_GUESS, UNSOLVED, ForcePoint, FrameStep, force_frame
from solver.redundancy.effort import RedundancyOptions
from solver.redundancy.mechanics import Mechanics, ResponseMaps, response_maps
from solver.redundancy.problem import (
    SOLVED_OUTCOMES,
    FrameOutcome,
    FrameSequence,
    LoadResponse,
    build_redundancy,
    frame_sequence,
    no_loads,
)
from solver.redundancy.sequence import ScenarioSolutions, scenario_solutions
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

Array = NDArray[np.float64]

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
    progress: Callable[[int, int], None] = lambda *_: None,
    loads: Sequence[ExternalForce] = (),
    response: LoadResponse | None = None,
) -> tuple[ScenarioSolutions, tuple[ElasticForces, ...]]:
    """Activations and controls of all scenarios, and their muscles' forces, NaN in INFEASIBLE and NOT_FINITE frames.

    loads are those of the mechanics, response that to the additional loads of the scenarios; None is one scenario
    without. A frame whose iteration does not converge is NOT_CONVERGED, one in which a muscle has no finite force
    NOT_FINITE. INFEASIBLE holds for the linearised forces, so it is no proof. After these frames, fibres and
    activations start anew. Raises ModelError without an elastic tendon, or with options of static optimisation.
    """
    _ensure_dynamic(model, options)
    problem = build_redundancy(model, replace(mechanics, maps=_maps_per_force(model, mechanics, loads)), options)
    is_finite = problem.is_finite
    response = response or no_loads(problem)
    shape, muscles = response.reaction.shape[:2], len(model.muscles)
    controls, activations = np.full((*shape, problem.weights.size), np.nan), np.full((*shape, muscles), np.nan)
    outcomes = np.empty(shape, dtype=object)
    outcomes.fill(FrameOutcome.NOT_FINITE)  # np.full would leave plain strings
    forces = tuple(with_rigid_tendons(mechanics.forces, one) for one in activations)
    whole = frame_sequence(problem, response)
    progress(0, outcomes.size)
    for scenario, frame in np.ndindex(*shape):
        if frame == 0:
            solver = _ElasticFrames(model, mechanics, whole.scenario(scenario), options)
        step = solver.solve(frame, forces[scenario]) if is_finite[frame] else None
        if step is None:
            forces[scenario].passive[frame] = forces[scenario].tension[frame] = np.nan
        else:
            activations[scenario, frame], controls[scenario, frame], outcomes[scenario, frame] = step
        if step is None or step.outcome in UNSOLVED:  # slack fibres would need many frames to become taut
            solver.restart()
        progress(scenario * shape[1] + frame + 1, outcomes.size)
    return _without_infeasible(scenario_solutions(problem, response, controls, outcomes), activations, forces)


def _without_infeasible(
    solution: ScenarioSolutions, activations: Array, forces: tuple[ElasticForces, ...]
) -> tuple[ScenarioSolutions, tuple[ElasticForces, ...]]:
    """With activations in the place of the forces, and NaN where INFEASIBLE."""
    is_infeasible = solution.outcomes == FrameOutcome.INFEASIBLE
    solution.controls[..., : activations.shape[-1]] = np.where(is_infeasible[..., None], np.nan, activations)
    for one, is_none in zip(forces, is_infeasible, strict=True):
        one.tension[is_none] = np.nan
    return solution, forces


class _ElasticFrames:
    """Fibres and activations of the frames before, and the solution of the next one.

    Forces here are over the greatest isometric ones.
    """

    def __init__(self, model: Model, mechanics: Mechanics, sequence: FrameSequence, options: RedundancyOptions) -> None:
        self._sequence, self._paths = sequence, mechanics.paths
        self._interval, self._is_reference = mechanics.kinematics.interval, options.solver == "clarabel"
        self._tables = fiber_tables(model)
        self._strength = _strength(model)
        self._active, self._passive = (
            part / self._strength for part in (mechanics.forces.active, mechanics.forces.passive)
        )
        self._settled = allocate_settled(len(self._tables.muscle))
        self.restart()

    def restart(self) -> None:
        """The next frame is a first one: fibres in equilibrium, any activation."""
        muscles = len(self._strength)
        self._gain = np.zeros(muscles)
        self._history = FiberHistory(self._tables, self._interval)
        self._bounds = self._sequence.widest_activations
        self._guess, self._curvature = np.full(muscles, FIRST_GUESS), np.zeros(muscles)
        self._multipliers = np.zeros(0)

    def solve(self, frame: int, forces: ElasticForces) -> FrameStep | None:
        """The frame's solution, None where a force is not finite; the row of forces is filled."""
        start = self._history.start(self._paths.speeds[frame, self._tables.muscle])
        linear = force_frame(
            self._sequence.cut(slice(frame, frame + 1)), self._multipliers, is_reference=self._is_reference
        )
        point = self._first_point(frame, start)
        small_step = SMALL_STEP if self._sequence.cost is None else SMALL_STEP_OF_COST
        change, share, infeasible = np.zeros(len(point.gain)), 1.0, 0
        for _ in range(ITERATIONS):
            if not np.isfinite(point.force + point.gain).all():
                return None
            found = linear.solve(point, self._bounds)
            infeasible += found.outcome is FrameOutcome.INFEASIBLE
            before, change = change, found.activations - point.activations
            share = 1.0 if self._sequence.effort.has_quadratic_steps else _relaxation(share, before, change)
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
        self._keep(point, found, linear.multipliers)
        forces.tension[frame] = point.force * self._strength
        fill_frame(forces, frame, self._tables, self._paths.lengths[frame, self._tables.muscle], self._settled)
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

    def _keep(self, point: ForcePoint, found: FrameStep, multipliers: Array) -> None:
        """What the next frame starts from."""
        self._history.keep(self._settled)
        self._guess, self._gain, self._curvature = point.activations, point.gain, point.curvature
        self._multipliers = multipliers
        is_known = np.array([found.outcome in SOLVED_OUTCOMES])
        self._bounds = self._sequence.reachable(found.activations[None], is_known)[0]


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


def _maps_per_force(model: Model, mechanics: Mechanics, loads: Sequence[ExternalForce]) -> ResponseMaps:
    """The maps with controls of the muscles that are tensions over the greatest isometric forces, not activations."""
    tension, state = mechanics.forces, mechanics.state
    per_force = replace(
        tension,
        active=np.tile(_strength(model), (len(tension.active), 1)),
        passive=np.zeros_like(tension.passive),
    )
    wrenches = load_wrenches(loads, state) if loads else None
    maps = response_maps(model, state, mechanics.equations, mechanics.paths, per_force, wrenches)
    return maps.cleared(maps.is_finite)


def _strength(model: Model) -> Array:
    return np.array([muscle.max_isometric_force for muscle in model.muscles])

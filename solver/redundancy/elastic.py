"""The redundancy problem with elastic tendons: sequential quadratic programming in each frame.

The lengths of the fibres at the frames before are known, so the implicit step of solver/tendons makes the tension of a
muscle a smooth, rising function F(a) of its activation in the frame. It is linearised at the current activations,
F(a₀) + F'(a₀) (a − a₀), which has the form of the problem with rigid tendons: an active force F' and a passive force.
Its solution is the next a₀, until the linear force is the true one at the solution. Then it satisfies the conditions of
optimality of the problem with F. They are necessary ones: with F curved, the problem need not be convex.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import fields, replace

import numpy as np
from numpy.typing import NDArray

from solver.errors import SolverCode
from solver.model import Model, ModelError
from solver.multibody.dynamics import response_to_loads
from solver.redundancy.motion import Mechanics, RedundancyProblem, build_redundancy
from solver.redundancy.next_frame import FrameByFrame
from solver.redundancy.options import RedundancyOptions
from solver.redundancy.response_maps import ResponseMaps
from solver.redundancy.scenarios import ScenarioSolutions
from solver.redundancy.sequence import FrameOutcome
from solver.tendons.evaluation import ElasticForces, fill_frame, with_rigid_tendons
from solver.tendons.step import FiberHistory, StepStart, allocate_settled, fill_settled
from solver.tendons.tables import fiber_tables

Array = NDArray[np.float64]

FORCE_TOLERANCE = 1e-8  # of the greatest isometric force, between linear and true force
SMALL_STEP = 1e-3  # of an activation, below which the forces may agree so
ITERATIONS = 40
FIRST_GUESS = 0.1
LEAST_GUESS, LEAST_GAIN = 0.02, 1e-3


def solve_elastic(
    model: Model,
    mechanics: Mechanics,
    options: RedundancyOptions,
    progress: Callable[[int, int], None] = lambda *_: None,
) -> tuple[ScenarioSolutions, ElasticForces]:
    """Activations and controls of one scenario, and the muscles' forces, NaN in INFEASIBLE and NOT_FINITE frames.

    A frame whose iteration does not converge is NOT_CONVERGED. INFEASIBLE holds for the linearised forces, so it is no
    proof. After a frame that is not finite, fibres and activations start anew. Raises ModelError without an elastic
    tendon, or with options of static optimisation.
    """
    _ensure_dynamic(model, options)
    problem = build_redundancy(model, replace(mechanics, maps=_maps_per_force(model, mechanics)), options)
    frames, muscles = len(problem.time), len(model.muscles)
    forces = with_rigid_tendons(mechanics.forces, np.full((frames, muscles), np.nan))
    solution = _empty_solution(frames, problem.weights.size)
    solver = _ElasticFrames(model, mechanics, problem)
    progress(0, frames)
    for frame, is_finite in enumerate(problem.is_finite):
        if is_finite:
            found = solver.solve(frame, forces)
            for field in fields(solution):
                getattr(solution, field.name)[:, frame] = getattr(found, field.name)[:, 0]
        else:
            forces.passive[frame] = np.nan
            solver.restart()
        progress(frame + 1, frames)
    return solution, forces


class _ElasticFrames:
    """Fibres and activations of the frames before, and the solution of the next one.

    Forces here are over the greatest isometric ones.
    """

    def __init__(self, model: Model, mechanics: Mechanics, problem: RedundancyProblem) -> None:
        self._problem, self._paths = problem, mechanics.paths
        self._tables = fiber_tables(model)
        strength = np.array([muscle.max_isometric_force for muscle in model.muscles])
        self._active, self._passive = mechanics.forces.active / strength, mechanics.forces.passive / strength
        self._strength = strength
        self._settled = allocate_settled(len(self._tables.muscle))
        self._activations = FrameByFrame(1, len(model.muscles))
        self.restart()

    def restart(self) -> None:
        """The next frame is a first one: fibres in equilibrium, any activation."""
        self._history = FiberHistory(self._tables, self._problem.interval)
        self._activations.forget(0)
        self._guess = np.full(len(self._strength), FIRST_GUESS)

    def solve(self, frame: int, forces: ElasticForces) -> ScenarioSolutions:
        """The frame's solution; the row of forces is filled."""
        start = self._history.start(self._paths.speeds[frame, self._tables.muscle])
        a, force, gain = self._first_point(frame, start)
        step, share = np.zeros(len(a)), 1.0
        for _ in range(ITERATIONS):
            activations = copy(self._activations)  # every iteration starts from the frame before
            solution = activations.solve(_linearised(self._problem, frame, force - gain * a, gain))
            wanted = solution.controls[0, 0, : len(a)]
            if not np.isfinite(wanted).all():
                break
            before, step = step, wanted - a
            if np.abs(step).max() <= SMALL_STEP:
                expected = force + gain * step
                force, gain = self._evaluate(frame, start, wanted)
                if np.abs(force - expected).max() <= FORCE_TOLERANCE:
                    break
            share = _relaxation(share, before, step)
            a = np.clip(a + share * step, 0.0, 1.0)
            force, gain = self._evaluate(frame, start, a)
        else:
            solution.outcomes[:] = FrameOutcome.NOT_CONVERGED
        self._activations, self._guess = activations, a
        self._history.keep(self._settled)
        forces.tension[frame] = force * self._strength
        fill_frame(forces, frame, self._tables, self._paths.lengths[frame, self._tables.muscle], self._settled)
        if not np.isfinite(wanted).all():
            forces.tension[frame] = np.nan
        return solution

    def _first_point(self, frame: int, start: StepStart) -> tuple[Array, Array, Array]:
        """The activations of the frame before with their forces and derivatives; above zero where a muscle has no
        derivative there, as a slack one.
        """
        a = self._guess
        force, gain = self._evaluate(frame, start, a)
        if (gain < LEAST_GAIN).any():
            a = np.where(gain < LEAST_GAIN, np.maximum(a, LEAST_GUESS), a)
            force, gain = self._evaluate(frame, start, a)
        return a, force, gain

    def _evaluate(self, frame: int, start: StepStart, a: Array) -> tuple[Array, Array]:
        """Force (muscles,) at activations a, and its derivative."""
        chosen = self._tables.muscle
        force, gain = self._active[frame] * a + self._passive[frame], self._active[frame].copy()
        fill_settled(self._tables, self._paths.lengths[frame, chosen], a[chosen], start, self._settled)
        force[chosen], gain[chosen] = self._settled.force, self._settled.gain
        return force, gain


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


def _linearised(problem: RedundancyProblem, frame: int, force_at_rest: Array, gain: Array) -> RedundancyProblem:
    """The problem of one frame with forces (muscles,) force_at_rest + gain a, of one whose controls are forces."""
    muscles, one = len(gain), slice(frame, frame + 1)
    matrix, reaction_matrix = problem.acceleration_matrix[one].copy(), problem.reaction_matrix[one].copy()
    acceleration, reaction = (part[..., :muscles] @ force_at_rest for part in (matrix, reaction_matrix))
    matrix[..., :muscles] *= gain
    reaction_matrix[..., :muscles] *= gain
    return replace(
        problem,
        time=problem.time[one],
        acceleration_matrix=matrix,
        acceleration_target=problem.acceleration_target[one] - acceleration,
        reaction_matrix=reaction_matrix,
        reaction_at_rest=problem.reaction_at_rest[one] + reaction,
        cone=problem.cone[one],
    )


def _maps_per_force(model: Model, mechanics: Mechanics) -> ResponseMaps:
    """The maps with controls of the muscles that are tensions over the greatest isometric forces, not activations."""
    paths, maps, muscles = mechanics.paths, mechanics.maps, len(model.muscles)
    tension = response_to_loads(mechanics.equations, paths.wrench_per_tension, paths.mobility_per_tension)
    passive = mechanics.forces.passive[..., None]
    strength = np.array([muscle.max_isometric_force for muscle in model.muscles])
    acceleration, reaction = (np.swapaxes(part, 1, 2) for part in (tension.acceleration, tension.reaction))
    return replace(
        maps,
        acceleration_at_rest=maps.acceleration_at_rest - (acceleration @ passive)[..., 0],
        acceleration_per_control=np.concatenate(
            [acceleration * strength, maps.acceleration_per_control[..., muscles:]], axis=-1
        ),
        reaction_at_rest=maps.reaction_at_rest - (reaction @ passive)[..., 0],
        reaction_per_control=np.concatenate([reaction * strength, maps.reaction_per_control[..., muscles:]], axis=-1),
    )


def _empty_solution(frames: int, controls: int) -> ScenarioSolutions:
    """Of one scenario, all frames NOT_FINITE."""
    outcomes = np.empty((1, frames), dtype=object)
    outcomes.fill(FrameOutcome.NOT_FINITE)  # np.full would leave plain strings
    scalars = np.full((2, 1, frames), np.nan)
    return ScenarioSolutions(
        controls=np.full((1, frames, controls), np.nan),
        outcomes=outcomes,
        equality_residual=scalars[0],
        residual_coordinate=np.zeros((1, frames), dtype=np.intp),
        reaction=np.full((1, frames, 6), np.nan),
        cone_slack=scalars[1],
    )

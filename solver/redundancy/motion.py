"""Load sharing among the muscles over a whole motion: evaluated, built and solved, in blocks where that is possible."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from solver.errors import SolverError
from solver.model import Model, ModelError
from solver.motion import Kinematics
from solver.multibody.external_loads import ExternalForce
from solver.multibody.joint_reactions import is_bypassed
from solver.multibody.postures import Postures
from solver.muscle import MuscleOutcome
from solver.redundancy.balance import ensure_balanced, has_actuators
from solver.redundancy.blocks import (
    FRAMES_AT_ONCE,
    BlockRun,
    blocks_of,
    ensure_regular,
    keep_freed_memory,
)
from solver.redundancy.glenoid import contact_points, glenoid_cone
from solver.redundancy.mechanics import Mechanics, evaluate_motion
from solver.redundancy.motion_solution import MotionSolution, joined
from solver.redundancy.options import RedundancyOptions, tracked_coordinates
from solver.redundancy.problem import build_redundancy
from solver.redundancy.reactions import SolvedForces, reaction_on_parent, solved_reactions
from solver.redundancy.scenarios import solve_redundancy
from solver.redundancy.sequence import RunSolver

Array = NDArray[np.float64]


def solve_motion(
    model: Model,
    kinematics: Kinematics,
    options: RedundancyOptions | None = None,
    progress: Callable[[int, int], None] = lambda *_: None,
    loads: Sequence[ExternalForce] = (),
) -> MotionSolution:
    """Solve all frames of a motion under loads, sampled at its frames; progress(done, total) counts frames.

    Raises ModelError where a free coordinate, the joint or, with the cone, a glenoid marker is not in the model,
    neither muscles nor actuators can balance a tracked coordinate, or tendons should be elastic and cannot be;
    MotionError where the model cannot be evaluated in any frame.
    """
    options = options or RedundancyOptions()
    motion = _Motion(model, kinematics, options, tuple(loads))
    return _solve_in_blocks(motion, progress) or _solve(motion, _evaluate(motion), progress)


@dataclass(frozen=True, eq=False)
class _Motion:
    """What solve_motion is called with."""

    model: Model
    kinematics: Kinematics
    options: RedundancyOptions
    loads: tuple[ExternalForce, ...]

    @property
    def is_divisible(self) -> bool:
        """Whether blocks of it can be solved in turn: with a state that BlockRun has, and with no decision to take from
        all frames about actuators that may be missing.
        """
        options, frames = self.options, len(self.kinematics.time)
        return (
            options.tendons == "rigid"
            and options.solver == "interior_point"
            and all(len(load.force) == frames for load in self.loads)
            and has_actuators(self.model, tracked_coordinates(self.model, options))
        )

    def cut(self, frames: slice) -> _Motion:
        loads = tuple(load.cut(frames) for load in self.loads)
        return replace(self, kinematics=self.kinematics.cut(frames), loads=loads)


def _solve_in_blocks(motion: _Motion, progress: Callable[[int, int], None]) -> MotionSolution | None:
    """None where the motion has to be solved as a whole, as blocks.py says."""
    frames, run, parts = len(motion.kinematics.time), BlockRun(), []
    blocks = blocks_of(frames, FRAMES_AT_ONCE)
    if len(blocks) < 2 or not motion.is_divisible:
        return None
    keep_freed_memory()
    progress(0, frames)
    try:
        for block in blocks:
            part = motion.cut(block)
            mechanics = _evaluate(part)
            parts.append(_solve(part, mechanics, solve_run=run.solve))
            ensure_regular(mechanics.equations, parts[-1])
            progress(block.stop, frames)
    except SolverError:  # an irregular motion, or an error of this block alone
        return None
    return joined(parts)


def _evaluate(motion: _Motion) -> Mechanics:
    options = motion.options
    return evaluate_motion(
        motion.model,
        motion.kinematics,
        loads=motion.loads,
        joint=options.joint,
        path_mode=options.path_mode,
        muscle_force_model=options.muscle_force_model,
    )


def _solve(
    motion: _Motion,
    mechanics: Mechanics,
    progress: Callable[[int, int], None] = lambda *_: None,
    solve_run: RunSolver | None = None,
) -> MotionSolution:
    model, options = motion.model, motion.options
    problem = build_redundancy(model, mechanics, options)
    ensure_balanced(model, problem.acceleration_matrix, mechanics.equations.mobility, problem.tracked)
    muscle_outcomes = mechanics.muscle_outcomes
    if options.tendons == "elastic":
        from solver.redundancy.elastic import solve_elastic  # the compiler behind it takes long to import

        solution, (fibers,) = solve_elastic(model, mechanics, options, progress, motion.loads)
        muscle_outcomes[~fibers.is_converged] = MuscleOutcome.FIBER_NOT_CONVERGED
    else:
        solution, fibers = solve_redundancy(problem, progress=progress, solve_run=solve_run), None
    activations, controls = np.split(solution.controls[0], [len(model.muscles)], axis=1)
    tensions = fibers.tension if fibers else mechanics.forces.active * activations + mechanics.forces.passive
    reserves = controls * [actuator.optimal_force for actuator in model.actuators]
    solved = SolvedForces(tensions, reserves, motion.loads)
    reaction = solution.reaction[0]
    if is_bypassed(model, model.joint(options.joint)):  # which the affine map of the reaction does not hold
        reaction = reaction_on_parent(model, mechanics, solved, options.joint)
    coordinates = model.coordinate_names
    return MotionSolution(
        muscles=model.muscle_names,
        time=motion.kinematics.time,
        activations=activations,
        muscle_forces=tensions,
        passive_forces=fibers.passive if fibers else mechanics.forces.passive,
        reserves=reserves,
        reaction=reaction,
        contact=_contact(model, mechanics.state, options, reaction),
        effort=problem.effort_of(solution.controls[0]).sum(axis=-1),
        equality_residual=solution.equality_residual[0],
        residual_coordinates=tuple(coordinates[index] for index in solution.residual_coordinate[0]),
        cone_slack=solution.cone_slack[0],
        outcomes=tuple(solution.outcomes[0]),
        muscle_outcomes=muscle_outcomes,
        joint_reactions=solved_reactions(model, mechanics, solved, options.reactions),
        fibers=fibers,
    )


def _contact(model: Model, state: Postures, options: RedundancyOptions, reaction: Array) -> Array:
    try:
        glenoid = glenoid_cone(model, options.glenoid_aspect, options.joint)
    except ModelError:  # a model without glenoid markers, which is solved without the cone
        return np.full((len(reaction), 2), np.nan)
    return contact_points(glenoid, state.rotation_to_ground[:, glenoid.body], reaction[:, 3:])

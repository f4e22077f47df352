"""The muscle-redundancy problem: load sharing among the muscles, frame by frame (Belli et al. 2023, "RMR").

With x = (activations a of the muscles, controls r of the actuators), in each frame

    minimise  Σ w aᵖ + Σ w r²   subject to   A x = q̈ − q̈₀,   lower ≤ x ≤ upper,   F₀ + A_F x in the glenoid's cone

where p is 2 and q̈₀ and F₀ are accelerations and glenohumeral reaction at x = 0. Bounds follow the activation dynamics
from one frame to the next. A has rank 14 in 17 rows: the acromioclavicular constraint determines three combinations of
accelerations, which no muscle changes. The projection of q̈ − q̈₀ onto the column space of A is satisfied; the rest is
reported per frame as the equality residual.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from solver.errors import SolverCode
from solver.model import Model, ModelError
from solver.motion import Kinematics, MotionError
from solver.multibody.constraints import is_held
from solver.multibody.dynamics import EquationsOfMotion, equations_of_motion
from solver.multibody.external_loads import ExternalForce, load_wrenches
from solver.multibody.joint_reactions import JointReactions, is_bypassed
from solver.multibody.postures import Postures, postures
from solver.multibody.rotations import each_frame
from solver.muscle import MuscleForces, MuscleOutcome, join_outcomes
from solver.paths import PathMode, PathState, evaluate_paths
from solver.redundancy.balance import ensure_balanced
from solver.redundancy.glenoid import JOINT, cone_rows, contact_points, glenoid_cone
from solver.redundancy.options import Exponent, Solver, activation_limits, effort_weights
from solver.redundancy.options import RedundancyOptions as RedundancyOptions  # noqa: PLC0414 (as FrameOutcome)
from solver.redundancy.reachability import idle_controls, is_met
from solver.redundancy.reactions import SolvedForces, reaction_on_parent, solved_reactions
from solver.redundancy.response_maps import ResponseMaps, response_maps
from solver.redundancy.scenarios import LoadResponse as LoadResponse  # noqa: PLC0414 (part of the interface)
from solver.redundancy.scenarios import ScenarioSolutions as ScenarioSolutions  # noqa: PLC0414 (as LoadResponse)
from solver.redundancy.sequence import SOLVERS, FrameSequence, RunSolver, solve_runs
from solver.redundancy.sequence import FrameOutcome as FrameOutcome  # noqa: PLC0414 (part of this module's interface)
from solver.static_forces import MuscleForceModel, modelled_forces

if TYPE_CHECKING:
    import pandas as pd

    from solver.tendons.evaluation import ElasticForces

Array = NDArray[np.float64]
CONE_FORCE_SCALE = 1e3  # N; brings the cone's rows to the size of activations


@dataclass(frozen=True, eq=False)
class Mechanics:
    """A model in a motion: everything that does not depend on the activations."""

    kinematics: Kinematics
    state: Postures
    paths: PathState
    forces: MuscleForces
    equations: EquationsOfMotion
    maps: ResponseMaps

    @property
    def muscle_outcomes(self) -> NDArray[np.object_]:
        """(frames, muscles) of MuscleOutcome."""
        return join_outcomes(self.paths, self.forces)


@dataclass(frozen=True, eq=False)
class RedundancyProblem:
    """The matrices of every frame; loads and bounds are left open, so one problem serves many scenarios.

    time            (frames,) [s];  interval [s] over which activations may change
    weights         (controls,);  reserves come after the muscles
    time_constants  (2, muscles) of activation and deactivation [s]
    acceleration_matrix  A (frames, tracked, controls);  acceleration_target  q̈ − q̈₀ (frames, tracked) [rad/s², m/s²]
    tracked         (coordinates,) whether the acceleration is tracked: not of free ones, nor where a lock or a coupler
                    determines it
    reaction_matrix A_F (frames, 6, controls);  reaction_at_rest  F₀ (frames, 6) moment [N m], force [N] in ground
    cone            (frames, k, 3) rows that turn the force into (s, v); k = 3, or 0 without the glenoid
    solver, exponent  as in RedundancyOptions
    control_limits  (2, actuators) least and greatest control; None is no limits
    has_activation_dynamics  False where every frame is solved by itself
    activation_limits  (2, muscles) least and greatest activation; None is 0 and 1
    """

    time: Array
    interval: float
    weights: Array
    time_constants: Array
    acceleration_matrix: Array
    acceleration_target: Array
    tracked: NDArray[np.bool_]
    reaction_matrix: Array
    reaction_at_rest: Array
    cone: Array
    solver: Solver = "interior_point"
    control_limits: Array | None = None
    exponent: Exponent = 2
    has_activation_dynamics: bool = True
    activation_limits: Array | None = None

    def effort_of(self, controls: Array) -> Array:
        """Terms of the effort of x (…, controls), or of its muscles alone: w aᵖ, then w r² of the actuators."""
        terms: Array = self.weights[: controls.shape[-1]] * controls**2
        if self.exponent == 3:
            muscles = self.time_constants.shape[1]
            terms[..., :muscles] *= controls[..., :muscles]
        return terms

    @property
    def is_finite(self) -> NDArray[np.bool_]:
        """(frames,) False where the model has no finite accelerations, and nothing is solved."""
        known = np.concatenate([self.acceleration_target, self.reaction_at_rest], axis=-1)
        is_finite: NDArray[np.bool_] = np.isfinite(known).all(axis=-1)
        return is_finite


@dataclass(frozen=True, eq=False, repr=False)
class MotionSolution:
    """Activations and forces in a motion. In INFEASIBLE frames activations, forces and reserves are NaN, and reaction,
    residual and slack those of the point of least violation; in NOT_FINITE frames all are NaN.

    muscles            their names, in the order of every such axis
    time               (frames,) [s]
    activations        (frames, muscles) 0 to 1
    muscle_forces      (frames, muscles) [N], of which passive_forces (frames, muscles) [N]
    reserves           (frames, actuators) of Model.actuators [N or N m]
    reaction           (frames, 6) moment [N m] and force [N] on the parent of the options' joint, in ground: on the
                       scapula at the glenohumeral joint
    contact            (frames, 2) where it meets the glenoid's plane [m], as glenoid.contact_points; NaN where it does
                       not, or the model has no markers of the glenoid
    effort             (frames,) Σ w aᵖ + Σ w r²
    equality_residual  (frames,) largest acceleration not produced [rad/s² or m/s²], mostly by the constraint, of the
                       coordinate with the name residual_coordinates (frames,)
    cone_slack         (frames,) distance of the reaction inside the cone [N], infinite without the glenoid constraint
    outcomes           (frames,) of FrameOutcome
    muscle_outcomes    (frames, muscles) of MuscleOutcome: whether path and force of each muscle converged
    joint_reactions    of the options' reactions; NaN in frames that are INFEASIBLE or NOT_FINITE
    fibers             their lengths and forces with elastic tendons; None with rigid ones
    """

    muscles: tuple[str, ...]
    time: Array
    activations: Array
    muscle_forces: Array
    passive_forces: Array
    reserves: Array
    reaction: Array
    contact: Array
    effort: Array
    equality_residual: Array
    residual_coordinates: tuple[str, ...]
    cone_slack: Array
    outcomes: tuple[FrameOutcome, ...]
    muscle_outcomes: NDArray[np.object_]
    joint_reactions: JointReactions
    fibers: ElasticForces | None = None

    @property
    def unsolved(self) -> int:
        """Number of frames that are not SOLVED."""
        return sum(outcome is not FrameOutcome.SOLVED for outcome in self.outcomes)

    def frames_with(self, outcome: MuscleOutcome) -> NDArray[np.bool_]:
        """(frames,) whether the path or the force of any muscle ended so."""
        is_ended_so: NDArray[np.bool_] = (self.muscle_outcomes == outcome).any(axis=1)
        return is_ended_so

    def __repr__(self) -> str:
        force = np.linalg.norm(self.reaction[:, 3:], axis=1)
        return (
            f"MotionSolution: {len(self.time)} frames, {self.unsolved} not solved, {len(self.muscles)} muscles\n"
            f"  mean effort {np.nanmean(self.effort):.4g}, joint reaction up to {np.nanmax(force):.0f} N"
        )

    def to_dataframe(self) -> pd.DataFrame:
        """A row per frame: time_s, an activation (0 to 1) per muscle by its name, effort, reaction_n (its size [N]),
        and the size of each of the joint_reactions by its label, as reaction_n.knee_r_on_tibia_r_in_ground.
        """
        import pandas as pd

        table = pd.DataFrame(self.activations, columns=list(self.muscles))
        table.insert(0, "time_s", self.time)
        table["effort"], table["reaction_n"] = self.effort, np.linalg.norm(self.reaction[:, 3:], axis=1)
        for label, force in zip(self.joint_reactions.labels, self.joint_reactions.force.swapaxes(0, 1), strict=True):
            table[f"reaction_n.{label}"] = np.linalg.norm(force, axis=1)
        return table


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
    mechanics = evaluate_motion(
        model,
        kinematics,
        loads=loads,
        joint=options.joint,
        path_mode=options.path_mode,
        muscle_force_model=options.muscle_force_model,
    )
    problem = build_redundancy(model, mechanics, options)
    ensure_balanced(model, problem.acceleration_matrix, mechanics.equations.mobility, problem.tracked)
    muscle_outcomes = mechanics.muscle_outcomes
    if options.tendons == "elastic":
        from solver.redundancy.elastic import solve_elastic  # the compiler behind it takes long to import

        solution, fibers = solve_elastic(model, mechanics, options, progress)
        muscle_outcomes[~fibers.is_converged] = MuscleOutcome.FIBER_NOT_CONVERGED
    else:
        solution, fibers = solve_redundancy(problem, progress=progress), None
    activations, controls = np.split(solution.controls[0], [len(model.muscles)], axis=1)
    tensions = fibers.tension if fibers else mechanics.forces.active * activations + mechanics.forces.passive
    reserves = controls * [actuator.optimal_force for actuator in model.actuators]
    solved = SolvedForces(tensions, reserves, tuple(loads))
    reaction = solution.reaction[0]
    if is_bypassed(model, model.joint(options.joint)):  # which the affine map of the reaction does not hold
        reaction = reaction_on_parent(model, mechanics, solved, options.joint)
    coordinates = model.coordinate_names
    return MotionSolution(
        muscles=model.muscle_names,
        time=kinematics.time,
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


def evaluate_motion(
    model: Model,
    kinematics: Kinematics,
    paths: PathState | None = None,
    loads: Sequence[ExternalForce] = (),
    joint: str = JOINT,
    path_mode: PathMode = "opensim",
    muscle_force_model: MuscleForceModel = "rigid_tendon",
) -> Mechanics:
    """Evaluate a motion; `paths` are those of another model with the same geometry, if already computed.

    Raises MotionError if the model cannot be evaluated in any posture. In a single one its maps are not finite.
    """
    state = postures(model, kinematics.positions, kinematics.speeds, kinematics.time)
    paths = paths or evaluate_paths(model, state, mode=path_mode)
    forces = modelled_forces(model, paths.lengths, paths.speeds, muscle_force_model)
    equations = equations_of_motion(model, state, joint)
    maps = response_maps(model, state, equations, paths, forces, load_wrenches(loads, state) if loads else None)
    is_finite = maps.is_finite
    if not is_finite.any():
        raise MotionError(
            f"the model {model.name} should have finite accelerations and has them in none of {len(is_finite)} "
            f"postures, the first at {kinematics.time[0]:g} s; use another motion",
            SolverCode.NO_ACCELERATIONS,
        )
    return Mechanics(kinematics, state, paths, forces, equations, maps if is_finite.all() else maps.cleared(~is_finite))


def build_redundancy(model: Model, mechanics: Mechanics, options: RedundancyOptions) -> RedundancyProblem:
    """Build the problem of all frames, without loads. ModelError for a model without muscles, or for unknown names.

    Columns of an actuator that are round-off, as on a locked coordinate, are set to zero; its control is 0 there.
    """
    if not model.muscles:
        raise ModelError(f"the model {model.name} should have muscles and has none; use another", SolverCode.NO_MUSCLES)
    kinematics, maps = mechanics.kinematics, mechanics.maps
    tracked = ~is_held(model)
    tracked[[model.coordinate_index(name) for name in options.free_coordinates]] = False
    matrix, reaction_matrix = maps.acceleration_per_control, maps.reaction_per_control
    if not tracked.all():  # else not a copy
        matrix = matrix[:, tracked]
    is_idle = idle_controls(matrix, reaction_matrix)
    is_idle[:, : len(model.muscles)] = False
    if is_idle.any():
        matrix, reaction_matrix = (np.where(is_idle[:, None], 0.0, part) for part in (matrix, reaction_matrix))
    cone = np.zeros((len(kinematics.time), 0, 3))
    if options.has_glenoid_cone:
        glenoid = glenoid_cone(model, options.glenoid_aspect, options.joint)
        cone = cone_rows(glenoid, mechanics.state.rotation_to_ground[:, glenoid.body])
    return RedundancyProblem(
        time=kinematics.time,
        interval=kinematics.interval,
        weights=effort_weights(model, options),
        time_constants=np.array(
            [
                [muscle.activation_time_constant for muscle in model.muscles],
                [muscle.deactivation_time_constant for muscle in model.muscles],
            ]
        ),
        acceleration_matrix=matrix,
        acceleration_target=(kinematics.accelerations - maps.acceleration_at_rest)[:, tracked],
        tracked=tracked,
        reaction_matrix=reaction_matrix,
        reaction_at_rest=maps.reaction_at_rest,
        cone=cone,
        solver=options.solver,
        control_limits=np.array([[actuator.min_control, actuator.max_control] for actuator in model.actuators])
        .reshape(-1, 2)
        .T,
        exponent=options.exponent,
        has_activation_dynamics=options.has_activation_dynamics,
        activation_limits=activation_limits(model) if options.has_muscle_limits else None,
    )


def solve_redundancy(
    problem: RedundancyProblem,
    loads: LoadResponse | None = None,
    progress: Callable[[int, int], None] = lambda *_: None,
    workers: int | None = None,
    solve_run: RunSolver | None = None,
) -> ScenarioSolutions:
    """Solve all frames in order, scenarios independently; progress(done, total) counts frames.

    Scenarios are divided among workers (threads), by default as many as processors; Clarabel uses one. solve_run
    replaces the problem's solver, as for a single frame that starts from the frame before (next_frame.py).
    """
    frames, coordinates = len(problem.time), len(problem.tracked)
    loads = loads or LoadResponse(np.zeros((1, frames, coordinates)), np.zeros((1, frames, 6)))
    target = problem.acceleration_target - loads.acceleration[..., problem.tracked]
    reaction_at_rest = problem.reaction_at_rest + loads.reaction
    cone = problem.cone / CONE_FORCE_SCALE
    rise, fall = problem.interval / problem.time_constants
    if not problem.has_activation_dynamics:
        rise, fall = np.full((2, len(rise)), np.inf)
    sequence = FrameSequence(
        weights=problem.weights,
        matrix=problem.acceleration_matrix,
        target=target,
        cone_matrix=cone @ problem.reaction_matrix[:, 3:],
        cone_offset=each_frame(cone, reaction_at_rest[..., 3:]),
        rise=rise,
        fall=fall,
        limits=problem.control_limits,
        exponent=problem.exponent,
        activation_limits=problem.activation_limits,
    )
    solve_run = solve_run or SOLVERS[problem.solver]
    controls, outcomes = solve_runs(solve_run, sequence, problem.is_finite, progress, workers)
    controls[..., : len(rise)].clip(*sequence.widest_activations, out=controls[..., : len(rise)])
    size = np.linalg.norm(target, axis=-1)
    residual = np.subtract(each_frame(problem.acceleration_matrix, controls), target, out=target)
    reaction = reaction_at_rest + each_frame(problem.reaction_matrix, controls)
    ray = each_frame(problem.cone, reaction[..., 3:])
    has_cone = problem.cone.shape[1] > 0
    slack = ray[..., 0] - np.hypot(ray[..., 1], ray[..., 2]) if has_cone else np.full(ray.shape[:2], np.inf)
    controls[outcomes == FrameOutcome.INFEASIBLE] = np.nan
    is_claimed = (outcomes == FrameOutcome.SOLVED) | (outcomes == FrameOutcome.BEYOND_ACTIVATION_RATE)
    outcomes[is_claimed & ~is_met(problem.acceleration_matrix, residual, size)] = FrameOutcome.NOT_CONVERGED
    greatest = np.abs(residual, out=residual).argmax(axis=-1)
    missed = np.take_along_axis(residual, greatest[..., None], axis=-1)[..., 0]
    return ScenarioSolutions(controls, outcomes, missed, np.flatnonzero(problem.tracked)[greatest], reaction, slack)


def _contact(model: Model, state: Postures, options: RedundancyOptions, reaction: Array) -> Array:
    try:
        glenoid = glenoid_cone(model, options.glenoid_aspect, options.joint)
    except ModelError:  # a model without glenoid markers, which is solved without the cone
        return np.full((len(reaction), 2), np.nan)
    return contact_points(glenoid, state.rotation_to_ground[:, glenoid.body], reaction[:, 3:])

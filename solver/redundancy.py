"""The muscle-redundancy problem: how the muscles share the work, frame by frame (Belli et al. 2023, "RMR").

With x = (activations of the muscles, controls of the actuators), in each frame

    minimise  Σ w x²   subject to   A x = q̈ − q̈₀,   lower ≤ x ≤ upper,   F₀ + A_F x in the glenoid's cone

where q̈₀ and F₀ are accelerations and glenohumeral reaction at x = 0. Bounds follow the activation dynamics from one
frame to the next. A x = b has rank 14 in 17 rows: three combinations of accelerations are bound by the
acromioclavicular constraint and no muscle reaches them. The singular value decomposition A = U S Vᵀ leaves the
reachable part, Vᵀ x = S⁻¹ Uᵀ b; what is left of b is reported per frame as the equality residual.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from solver.conic import ConicProblem, Outcome, solve_conic
from solver.dynamics import EquationsOfMotion, ResponseMaps, equations_of_motion, response_maps
from solver.glenoid import cone_rows, glenoid_cone
from solver.kinematics import Postures, postures
from solver.model import Model
from solver.motion import Kinematics, MotionError
from solver.muscle import MuscleForces, muscle_forces
from solver.paths import PathState, evaluate_paths

Array = NDArray[np.float64]

UNWEIGHTED_COORDINATES = (
    *(f"ground_thorax_{axis}" for axis in ("rot_x", "rot_y", "rot_z", "tx", "ty", "tz")),
    "elbow_flexion",
    "pro_sup",
)
RANK_TOLERANCE = 1e-9
CONE_FORCE_SCALE = 1e3  # N; brings the cone's rows to the size of activations


class FrameOutcome(Enum):
    """What became of a frame; everything but SOLVED is counted and shown."""

    SOLVED = "solved"
    BEYOND_ACTIVATION_RATE = (
        "the muscles cannot change their activation fast enough since the last frame; solved without that limit"
    )
    INFEASIBLE = "no activations between 0 and 1 keep the joint reaction inside the glenoid"
    NOT_CONVERGED = "the solver stopped before its residuals were small; its last point is given"


@dataclass(frozen=True)
class RedundancyOptions:
    """How effort is counted and what is asked for; the defaults are the published ones.

    has_glenoid_cone        keep the reaction inside the glenoid
    free_coordinates        accelerations that need not be tracked (published for shrugs: plane_elv, axial_rot)
    muscle_weight           w of each muscle
    reserve_weight          w of the actuators that stand in for muscles
    unweighted_coordinates  whose actuators cost nothing: what carries the thorax and the forearm
    """

    has_glenoid_cone: bool = True
    free_coordinates: tuple[str, ...] = ()
    muscle_weight: float = 1.0
    reserve_weight: float = 10.0
    unweighted_coordinates: tuple[str, ...] = UNWEIGHTED_COORDINATES


@dataclass(frozen=True, eq=False)
class Mechanics:
    """A model going through a motion: everything that does not depend on who does the work."""

    kinematics: Kinematics
    state: Postures
    paths: PathState
    forces: MuscleForces
    equations: EquationsOfMotion
    maps: ResponseMaps


@dataclass(frozen=True, eq=False)
class RedundancyProblem:
    """The matrices of every frame; loads and bounds are left open, so one problem serves many scenarios.

    time            (frames,) [s];  interval [s] over which activations may change
    weights         (controls,);  reserves come after the muscles
    time_constants  (2, muscles) of activation and deactivation [s]
    acceleration_matrix  A (frames, tracked, controls);  acceleration_target  q̈ − q̈₀ (frames, tracked) [rad/s², m/s²]
    tracked         (coordinates,) which accelerations are asked for
    rows            Vᵀ (frames, rank, controls);  to_rows  S⁻¹ Uᵀ (frames, rank, tracked)
    reaction_matrix A_F (frames, 6, controls);  reaction_at_rest  F₀ (frames, 6) moment [N m], force [N] in ground
    cone            (frames, k, 3) rows that turn the force into (s, v); k = 3, or 0 without the glenoid
    """

    time: Array
    interval: float
    weights: Array
    time_constants: Array
    acceleration_matrix: Array
    acceleration_target: Array
    tracked: NDArray[np.bool_]
    rows: Array
    to_rows: Array
    reaction_matrix: Array
    reaction_at_rest: Array
    cone: Array


@dataclass(frozen=True, eq=False)
class LoadResponse:
    """What extra loads do at x = 0, per scenario and frame.

    acceleration  (scenarios, frames, coordinates) [rad/s², m/s²]
    reaction      (scenarios, frames, 6) moment [N m], force [N] on the scapula in ground
    """

    acceleration: Array
    reaction: Array


@dataclass(frozen=True, eq=False)
class RedundancySolution:
    """x (scenarios, frames, controls), NaN where infeasible, and how far each frame can be believed.

    outcomes           (scenarios, frames) of FrameOutcome
    equality_residual  (scenarios, frames) largest |A x − b| [rad/s² or m/s²], the unreachable part included
    reaction           (scenarios, frames, 6) moment [N m], force [N] on the scapula in ground
    cone_slack         (scenarios, frames) s − |v| [N], negative outside; infinite without the glenoid
    """

    controls: Array
    outcomes: NDArray[np.object_]
    equality_residual: Array
    reaction: Array
    cone_slack: Array


@dataclass(frozen=True, eq=False)
class Redundancy:
    """Who did the work in a motion; NaN in frames that are INFEASIBLE.

    time               (frames,) [s]
    activations        (frames, muscles) of Model.muscles, 0 to 1
    muscle_forces      (frames, muscles) [N], of which passive_forces (frames, muscles) [N]
    reserves           (frames, actuators) of Model.actuators [N or N m]
    reaction           (frames, 6) moment [N m] and force [N] on the scapula at the glenohumeral joint, in ground
    equality_residual  (frames,) largest acceleration not produced [rad/s² or m/s²]; mostly what the constraint forbids
    cone_slack         (frames,) how far the reaction is inside the glenoid [N], infinite where it was not asked for
    outcomes           (frames,) of FrameOutcome
    """

    time: Array
    activations: Array
    muscle_forces: Array
    passive_forces: Array
    reserves: Array
    reaction: Array
    equality_residual: Array
    cone_slack: Array
    outcomes: tuple[FrameOutcome, ...]

    @property
    def unsolved(self) -> int:
        """How many frames did not come out SOLVED."""
        return sum(outcome is not FrameOutcome.SOLVED for outcome in self.outcomes)


def solve_motion(
    model: Model,
    kinematics: Kinematics,
    options: RedundancyOptions | None = None,
    progress: Callable[[int, int], None] = lambda *_: None,
) -> Redundancy:
    """Activations of a whole motion; progress(done, total) counts frames.

    Raises ModelError where a free coordinate or, with the cone, a glenoid marker is not in the model, MotionError where
    the model cannot be evaluated.
    """
    mechanics = go_through(model, kinematics)
    solution = solve_redundancy(build_redundancy(model, mechanics, options or RedundancyOptions()), progress=progress)
    activations, controls = np.split(solution.controls[0], [len(model.muscles)], axis=1)
    return Redundancy(
        time=kinematics.time,
        activations=activations,
        muscle_forces=mechanics.forces.active * activations + mechanics.forces.passive,
        passive_forces=mechanics.forces.passive,
        reserves=controls * [actuator.optimal_force for actuator in model.actuators],
        reaction=solution.reaction[0],
        equality_residual=solution.equality_residual[0],
        cone_slack=solution.cone_slack[0],
        outcomes=tuple(solution.outcomes[0]),
    )


def go_through(model: Model, kinematics: Kinematics, paths: PathState | None = None) -> Mechanics:
    """Evaluate a motion; paths may be given where another model of the same geometry has laid them already.

    Raises MotionError naming the time of a posture in which the model cannot be evaluated.
    """
    state = postures(model, kinematics.positions, kinematics.speeds)
    paths = paths or evaluate_paths(model, state)
    forces = muscle_forces(model, paths.lengths, paths.speeds)
    equations = equations_of_motion(model, state)
    maps = response_maps(model, equations, paths, forces)
    is_finite = np.isfinite(maps.acceleration_at_rest + maps.acceleration_per_control.sum(axis=-1)).all(axis=-1)
    if not is_finite.all():
        time = kinematics.time[int(np.argmin(is_finite))]
        raise MotionError(
            f"the model {model.name} should have finite accelerations in every posture and has not at {time:g} s; "
            "leave that part of the motion out"
        )
    return Mechanics(kinematics, state, paths, forces, equations, maps)


def build_redundancy(model: Model, mechanics: Mechanics, options: RedundancyOptions) -> RedundancyProblem:
    """The problem of every frame, open to loads."""
    kinematics, maps = mechanics.kinematics, mechanics.maps
    tracked = np.ones(len(model.coordinates), dtype=bool)
    tracked[[model.coordinate_index(name) for name in options.free_coordinates]] = False
    matrix = maps.acceleration_per_control[:, tracked]
    rows, to_rows = _reachable_rows(matrix)
    cone = np.zeros((len(kinematics.time), 0, 3))
    if options.has_glenoid_cone:
        glenoid = glenoid_cone(model)
        cone = cone_rows(glenoid, mechanics.state.rotation_to_ground[:, glenoid.body])
    return RedundancyProblem(
        time=kinematics.time,
        interval=kinematics.interval,
        weights=_weights(model, options),
        time_constants=np.array(
            [[muscle.activation_time_constant, muscle.deactivation_time_constant] for muscle in model.muscles]
        ).T,
        acceleration_matrix=matrix,
        acceleration_target=(kinematics.accelerations - maps.acceleration_at_rest)[:, tracked],
        tracked=tracked,
        rows=rows,
        to_rows=to_rows,
        reaction_matrix=maps.reaction_per_control,
        reaction_at_rest=maps.reaction_at_rest,
        cone=cone,
    )


def solve_redundancy(
    problem: RedundancyProblem,
    loads: LoadResponse | None = None,
    progress: Callable[[int, int], None] = lambda *_: None,
) -> RedundancySolution:
    """Solve all frames in order, all scenarios of a frame together; progress(done, total) counts frames."""
    frames, coordinates = len(problem.time), len(problem.tracked)
    loads = loads or LoadResponse(np.zeros((1, frames, coordinates)), np.zeros((1, frames, 6)))
    target = problem.acceleration_target - loads.acceleration[..., problem.tracked]
    reaction_at_rest = problem.reaction_at_rest + loads.reaction
    scenarios, muscles = len(target), problem.time_constants.shape[1]
    controls = np.empty((scenarios, frames, len(problem.weights)))
    outcomes = np.empty((scenarios, frames), dtype=object)
    lower, upper = _widest_bounds(problem, scenarios)
    for frame in range(frames):
        batch = _frame_problem(problem, frame, target[:, frame], reaction_at_rest[:, frame], lower, upper)
        controls[:, frame], outcomes[:, frame] = _solve_frame(batch, _widest_bounds(problem, scenarios))
        controls[:, frame, :muscles] = controls[:, frame, :muscles].clip(0, 1)
        lower, upper = _reachable_bounds(problem, controls[:, frame])
        progress(frame + 1, frames)
    reaction = reaction_at_rest + np.einsum("fij,sfj->sfi", problem.reaction_matrix, controls)
    residual = np.einsum("fij,sfj->sfi", problem.acceleration_matrix, controls) - target
    ray = np.einsum("fki,sfi->sfk", problem.cone, reaction[..., 3:])
    has_cone = problem.cone.shape[1] > 0
    slack = ray[..., 0] - np.linalg.norm(ray[..., 1:], axis=-1) if has_cone else np.full((scenarios, frames), np.inf)
    return RedundancySolution(controls, outcomes, np.abs(residual).max(axis=-1), reaction, slack)


def _weights(model: Model, options: RedundancyOptions) -> Array:
    free = {model.coordinate_index(n) for n in options.unweighted_coordinates if n in model.coordinate_names}
    reserves = [0.0 if actuator.coordinate in free else options.reserve_weight for actuator in model.actuators]
    return np.array([options.muscle_weight] * len(model.muscles) + reserves)


def _reachable_rows(matrix: Array) -> tuple[Array, Array]:
    """Vᵀ (frames, rank, controls) and S⁻¹ Uᵀ (frames, rank, rows) of the smallest rank found in any frame."""
    left, sizes, right = np.linalg.svd(matrix, full_matrices=False)
    rank = int((sizes > RANK_TOLERANCE * sizes[:, :1]).sum(axis=1).min())
    return right[:, :rank], np.swapaxes(left[:, :, :rank] / sizes[:, None, :rank], -1, -2)


def _widest_bounds(problem: RedundancyProblem, scenarios: int) -> tuple[Array, Array]:
    muscles, controls = problem.time_constants.shape[1], len(problem.weights)
    lower, upper = np.full((scenarios, controls), -np.inf), np.full((scenarios, controls), np.inf)
    lower[:, :muscles], upper[:, :muscles] = 0.0, 1.0
    return lower, upper


def _reachable_bounds(problem: RedundancyProblem, controls: Array) -> tuple[Array, Array]:
    """What activations can become in one interval at full or no excitation; the whole range after an unsolved frame."""
    lower, upper = _widest_bounds(problem, len(controls))
    rise, fall = problem.interval / problem.time_constants
    muscles = len(rise)
    a = controls[:, :muscles]
    lowest, highest = a - fall * a * (0.5 + 1.5 * a), a + rise * (1 - a) / (0.5 + 1.5 * a)
    lower[:, :muscles], upper[:, :muscles] = np.fmax(lowest, 0.0), np.fmin(highest, 1.0)
    return lower, upper


def _frame_problem(
    problem: RedundancyProblem, frame: int, target: Array, reaction_at_rest: Array, lower: Array, upper: Array
) -> ConicProblem:
    cone = problem.cone[frame] / CONE_FORCE_SCALE
    return ConicProblem(
        weights=problem.weights,
        equality_matrix=problem.rows[frame],
        equality_target=target @ problem.to_rows[frame].T,
        lower=lower,
        upper=upper,
        cone_matrix=cone @ problem.reaction_matrix[frame, 3:],
        cone_offset=reaction_at_rest[:, 3:] @ cone.T,
    )


def _solve_frame(problem: ConicProblem, widest: tuple[Array, Array]) -> tuple[Array, list[FrameOutcome]]:
    """Solve a frame; where the activation rate alone makes it infeasible, solve without that limit and say so."""
    solution = solve_conic(problem)
    controls, outcomes = solution.x, [_FRAME_OUTCOME[outcome] for outcome in solution.outcomes]
    stuck = [i for i, outcome in enumerate(solution.outcomes) if outcome is Outcome.INFEASIBLE]
    if stuck:
        lower, upper = widest
        again = solve_conic(
            replace(
                problem,
                equality_target=problem.equality_target[stuck],
                lower=lower[stuck],
                upper=upper[stuck],
                cone_offset=problem.cone_offset[stuck],
            )
        )
        controls[stuck] = again.x
        for i, outcome in zip(stuck, again.outcomes, strict=True):
            is_solved = outcome is Outcome.SOLVED
            outcomes[i] = FrameOutcome.BEYOND_ACTIVATION_RATE if is_solved else _FRAME_OUTCOME[outcome]
    return controls, outcomes


_FRAME_OUTCOME = {
    Outcome.SOLVED: FrameOutcome.SOLVED,
    Outcome.INFEASIBLE: FrameOutcome.INFEASIBLE,
    Outcome.NOT_CONVERGED: FrameOutcome.NOT_CONVERGED,
}

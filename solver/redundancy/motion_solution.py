"""Load sharing among the muscles over a whole motion: evaluated, built and solved, in blocks where that is possible.

Each block is solved from the activations at the end of the one before. The arrays of a motion take 45 kB per frame, and
new memory for them as long as half of the arithmetic. The memory of a block is used again for the next one: of a block
only its solution is kept.

In a regular motion the solution is that of all frames at once: all frames are finite, no constraint is redundant, and
all blocks have the same structure. Any other motion is solved as a whole, because then the solution of a frame depends
on all of them.

A motion is refused if no control can accelerate a coordinate as the motion requires, as of a pelvis without residual
actuators. Of the accelerations that the constraints allow, the columns of the mobility P, those of A are produced by
muscles and actuators. A coordinate is unbalanced if an actuator on it would enlarge the range of A.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from itertools import chain, pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from documents.interval import counted
from documents.message import Code, Message
from documents.results import EqualByFields, curves_svg, labelled_dataset, result_html
from solver.errors import SolverCode, SolverError, describe_codes
from solver.model import Array, CoordinateActuator, Model, ModelError
from solver.motion import Kinematics
from solver.multibody.dynamics import EquationsOfMotion, JointReactions, ReactionRequest, is_bypassed, joint_reactions
from solver.multibody.loads import ExternalForce, full_loads, load_wrenches
from solver.multibody.postures import Postures
from solver.muscle import MuscleOutcome
from solver.redundancy.effort import RedundancyOptions, tracked_coordinates
from solver.redundancy.mechanics import Mechanics, contact_points, evaluate_motion, glenoid_cone
from solver.redundancy.problem import FrameOutcome, Outcomes, RedundancyProblem, build_redundancy
from solver.redundancy.sequence import BlockSolver, RunSolver, solve_redundancy

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from solver.tendons.fiber import ElasticForces

FRAMES_AT_ONCE = 256
"""A block takes 1 ms for the calls of its stages, which is 4 µs a frame, and 12 MB with 33 muscles."""
KEPT = 60_000_000  # bytes, at most
OUTSIDE = (
    1e-6  # share of a column beyond the range of A; round-off is 1e-10 on legs, a missing actuator leaves above 1e-3
)
INSPECTED = 5  # frames, because a muscle may have no force or no moment arm in one


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
    motion = LoadedMotion(model, kinematics, loads, options)
    return _solve_in_blocks(motion, progress) or _solve(motion, _evaluate(motion), progress)


@dataclass(frozen=True, eq=False)
class LoadedMotion:
    """A model and its motion under external loads, sampled at all frames, and how its muscles are solved."""

    model: Model
    kinematics: Kinematics
    loads: Sequence[ExternalForce] = ()
    options: RedundancyOptions = field(default_factory=RedundancyOptions)

    @property
    def is_divisible(self) -> bool:
        """Whether blocks of it can be solved in turn: with a state that BlockSolver has, and with no decision from all
        frames about actuators that may be missing.
        """
        options, frames = self.options, len(self.kinematics.time)
        return (
            options.tendons == "rigid"
            and options.solver == "interior_point"
            and options.cost is None
            and all(len(load.force) == frames for load in self.loads)
            and has_actuators(self.model, tracked_coordinates(self.model, options))
        )

    def cut(self, frames: slice) -> LoadedMotion:
        loads = tuple(load.cut(frames) for load in self.loads)
        return replace(self, kinematics=self.kinematics.cut(frames), loads=loads)


def _solve_in_blocks(motion: LoadedMotion, progress: Callable[[int, int], None]) -> MotionSolution | None:
    """None where the motion has to be solved as a whole, as the docstring of this file says."""
    frames, solver, parts = len(motion.kinematics.time), BlockSolver(), []
    blocks = divide_into_blocks(frames, FRAMES_AT_ONCE)
    if len(blocks) < 2 or not motion.is_divisible:
        return None

    def solve_run(block: RedundancyProblem, *_: object) -> tuple[Array, Outcomes]:
        found = solver.solve(block)
        if found is None:
            raise IrregularMotion
        return found

    keep_freed_memory()
    progress(0, frames)
    try:
        for block in blocks:
            part = motion.cut(block)
            mechanics = _evaluate(part)
            parts.append(_solve(part, mechanics, solve_run=solve_run))
            ensure_regular(mechanics.equations, parts[-1])
            progress(block.stop, frames)
    except SolverError:  # an irregular motion, or an error of this block alone
        return None
    return joined(parts)


def _evaluate(motion: LoadedMotion) -> Mechanics:
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
    motion: LoadedMotion,
    mechanics: Mechanics,
    progress: Callable[[int, int], None] = lambda *_: None,
    solve_run: RunSolver | None = None,
) -> MotionSolution:
    model, options = motion.model, motion.options
    problem = build_redundancy(model, mechanics, options)
    ensure_balanced(model, problem.matrix, mechanics.equations.mobility, problem.tracked)
    muscle_outcomes = mechanics.muscle_outcomes
    if options.tendons == "elastic":
        from solver.redundancy.elastic import solve_elastic  # the compiler behind it takes long to import

        solution, (fibers,) = solve_elastic(model, mechanics, options, progress)
        muscle_outcomes[~fibers.is_converged] = MuscleOutcome.FIBER_NOT_CONVERGED
    else:
        solution, fibers = solve_redundancy(problem, progress=progress, solve_run=solve_run), None
    activations, controls = np.split(solution.controls[0], [len(model.muscles)], axis=1)
    tensions = fibers.tension if fibers else mechanics.forces.active * activations + mechanics.forces.passive
    reserves = controls * [actuator.optimal_force for actuator in model.actuators]
    solved = SolvedForces(tensions, reserves)
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
        effort=problem.effort.terms(solution.controls[0]).sum(axis=-1),
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


@dataclass(frozen=True, eq=False, repr=False)
class MotionSolution(EqualByFields):
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
    findings           of cuffstation.solve_motion: on motion and loads, and large reserves
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
    findings: tuple[Message[Code], ...] = ()

    @property
    def unsolved(self) -> int:
        """Number of frames that are not SOLVED."""
        return sum(outcome is not FrameOutcome.SOLVED for outcome in self.outcomes)

    def frames_with(self, outcome: MuscleOutcome) -> NDArray[np.bool_]:
        """(frames,) whether the path or the force of any muscle ended so."""
        return np.asarray((self.muscle_outcomes == outcome).any(axis=1))

    def __repr__(self) -> str:
        has_effort = np.isfinite(self.effort)
        sizes = "no frame with an effort"
        if has_effort.any():
            force = np.linalg.norm(self.reaction[has_effort, 3:], axis=1)
            sizes = f"mean effort {self.effort[has_effort].mean():.4g}, joint reaction up to {force.max():.0f} N"
        return (
            f"MotionSolution: {counted(len(self.time), 'frame')}, {self.unsolved} not solved, "
            f"{counted(len(self.muscles), 'muscle')}\n"
            f"  {sizes}{describe_codes(self.findings)}"
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
        table.attrs["units"] = {"time_s": "s"} | {
            name: "N" for name in map(str, table) if name.startswith("reaction_n")
        }
        return table

    def to_xarray(self) -> xr.Dataset:
        """activations and forces (time, muscle), effort (time), reaction (time, component). Needs the extra xarray."""
        per_muscle = ("time", "muscle")
        variables = {
            "activations": (per_muscle, self.activations, ""),
            "muscle_forces": (per_muscle, self.muscle_forces, "N"),
            "passive_forces": (per_muscle, self.passive_forces, "N"),
            "effort": (("time",), self.effort, ""),
            "reaction_force": (("time", "axis"), self.reaction[:, 3:], "N"),
            "reaction_moment": (("time", "axis"), self.reaction[:, :3], "N m"),
        }
        axes = {"time": (self.time, "s"), "muscle": (self.muscles, ""), "axis": (("x", "y", "z"), "")}
        return labelled_dataset(variables, axes)

    def _repr_html_(self) -> str:
        peaks = np.nanmax(self.activations, axis=0, initial=0.0)
        strongest = np.argsort(peaks)[::-1][:5]
        rows = [(self.muscles[muscle], f"{peaks[muscle]:.2f}") for muscle in strongest]
        drawing = curves_svg([(self.time, self.activations[:, muscle]) for muscle in strongest], "s", "activation")
        title, remark = repr(self).split("\n")
        return result_html(title, ("muscle", "largest activation"), rows, remark.strip(), drawing)


def joined(parts: Sequence[MotionSolution]) -> MotionSolution:
    """One solution of consecutive parts of a motion with rigid tendons."""
    first = parts[0]
    return replace(
        first,
        **_joined_arrays(parts),
        outcomes=tuple(chain.from_iterable(part.outcomes for part in parts)),
        residual_coordinates=tuple(chain.from_iterable(part.residual_coordinates for part in parts)),
        joint_reactions=replace(first.joint_reactions, **_joined_arrays([part.joint_reactions for part in parts])),
    )


def _joined_arrays(parts: Sequence[MotionSolution] | Sequence[JointReactions]) -> dict[str, Any]:
    """By the name of a field; frames are the first axis of all of them."""
    names = [one.name for one in fields(parts[0]) if isinstance(getattr(parts[0], one.name), np.ndarray)]
    return {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}


def divide_into_blocks(frames: int, size: int) -> list[slice]:
    """Blocks of equal length, as near to this size as possible."""
    edges = np.linspace(0, frames, max(round(frames / size), 1) + 1).astype(int).tolist()
    return [slice(start, end) for start, end in pairwise(edges)]


class IrregularMotion(SolverError):
    """Blocks cannot be solved independently; solve_motion catches it and solves all frames at once."""

    def __init__(self) -> None:
        super().__init__("the motion cannot be solved in blocks")


def ensure_regular(equations: EquationsOfMotion, solution: MotionSolution) -> None:
    """Raise IrregularMotion for a block with redundant constraints or with frames that are not finite."""
    if not equations.is_regular or FrameOutcome.NOT_FINITE in solution.outcomes:
        raise IrregularMotion


def keep_freed_memory() -> None:
    """Have this process keep the memory that a block frees for the next one; it costs no more than two system calls.

    The GNU C library gives memory at the end of its heap back where that is more than twice the largest array freed so
    far, and a block has many arrays of similar size. To get a page of 4 kB again takes 2 µs.
    """
    np.empty(KEPT // 2, np.int8)  # freed at once, untouched


def ensure_balanced(model: Model, matrix: Array, mobility: Array, tracked: NDArray[np.bool_]) -> None:
    """Raise ModelError that names unbalanced tracked coordinates, with A (frames, tracked, controls) and P (frames,
    coordinates, coordinates).

    Coordinates in which P has no column beside round-off are held by a constraint and need no actuator. Nothing is
    computed where each coordinate has an actuator, whose column of A is that of P.
    """
    if has_actuators(model, tracked):
        return
    frames = np.flatnonzero(np.isfinite(mobility).all(axis=(1, 2)) & np.isfinite(matrix).all(axis=(1, 2)))
    if not len(frames):
        return
    chosen = frames[np.unique(np.linspace(0, len(frames) - 1, min(INSPECTED, len(frames)), dtype=int))]
    is_out = np.logical_and.reduce(
        [_is_outside(matrix[frame], mobility[frame][tracked][:, tracked]) for frame in chosen]
    )
    names = np.array(model.coordinate_names)[tracked][is_out]
    if len(names):
        raise ModelError(
            f"neither muscles nor actuators of {model.name} can balance the coordinates {', '.join(names)}; add "
            "actuators for them (--actuators FILE, or [reserves] of --effort), or name them in --free-coordinates",
            SolverCode.NOT_BALANCED,
        )


def has_actuators(model: Model, tracked: NDArray[np.bool_]) -> bool:
    """Whether each of the tracked coordinates (coordinates,) has an actuator."""
    actuators = [one for one in model.actuators if isinstance(one, CoordinateActuator) and one.optimal_force]
    return {one.coordinate for one in actuators}.issuperset(np.flatnonzero(tracked).tolist())


def _is_outside(matrix: Array, mobility: Array) -> NDArray[np.bool_]:
    """(tracked,) whether the column of P is outside of the range of A."""
    columns, wanted = _normalised(matrix), _normalised(mobility)
    left, sizes, _ = np.linalg.svd(columns, full_matrices=False)
    basis = left[:, sizes > 1e-9 * sizes[:1]]
    return np.asarray(np.linalg.norm(wanted - basis @ (basis.T @ wanted), axis=0) > OUTSIDE)


def _normalised(matrix: Array) -> Array:
    """Columns of length 1, but for those that are round-off, which become zero."""
    lengths = np.linalg.norm(matrix, axis=0)
    is_kept = lengths > 1e-9 * lengths.max(initial=0.0)
    return matrix[:, :] * np.where(is_kept, 1.0 / np.where(is_kept, lengths, 1.0), 0.0)


@dataclass(frozen=True, eq=False)
class SolvedForces:
    """Forces of muscles (frames, muscles) [N] and actuators (frames, actuators) [N or N m]."""

    muscles: Array
    actuators: Array


def solved_reactions(
    model: Model, mechanics: Mechanics, solved: SolvedForces, request: ReactionRequest
) -> JointReactions:
    """The requested reactions. ModelError for a joint that the model does not have."""
    if not request.joints:
        moment, force, point = np.zeros((3, len(solved.muscles), 0, 3))
        return JointReactions((), moment, force, point)
    paths, state = mechanics.paths, mechanics.state
    forces = np.einsum("fm,fmj->fj", solved.muscles, paths.mobility_per_tension)
    wrenches = paths.wrenches.total(solved.muscles) + load_wrenches(mechanics.loads, state)
    for actuator, force in zip(model.actuators, solved.actuators.T, strict=True):
        if isinstance(actuator, CoordinateActuator):
            forces[:, actuator.coordinate] += force
        else:
            control = force / actuator.optimal_force
            on_bodies, on_coordinates = full_loads([actuator], model, state)
            wrenches += on_bodies[:, 0] * control[:, None, None]
            forces += on_coordinates[:, 0] * control[:, None]
    return joint_reactions(model, state, mechanics.equations, wrenches, forces, request)


def reaction_on_parent(model: Model, mechanics: Mechanics, solved: SolvedForces, joint: str) -> Array:
    """(frames, 6) moment [N m] and force [N] on the parent of a joint, in ground."""
    found = solved_reactions(model, mechanics, solved, ReactionRequest((joint,), "parent"))
    return np.concatenate([found.moment[:, 0], found.force[:, 0]], axis=-1)

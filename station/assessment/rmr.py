"""Solve the muscle-redundancy problem of a motion, from files to a table.

Notes of the results and sentences on stderr state what is left out of a model and what that changes, and muscles that
cannot pull because their tendon is longer than their path in every frame.

The solution is one table, a row per frame: .csv, .sto as OpenSim reads it, or .parquet. Activations have the names of
their muscles, as in OpenSim and the published files; every other column begins with quantity and unit: force_n.TRIlong,
reserve_n_m.elbow_actuator, reaction_force_n.x.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from documents.interval import counted
from documents.message import Message
from solver.errors import SolverCode
from solver.model import Actuator, Array, CoordinateActuator, Model, ModelError
from solver.motion import Kinematics
from solver.multibody.dynamics import JointReactions
from solver.multibody.postures import postures
from solver.muscle import MuscleOutcome, PathMode, evaluate_paths
from solver.redundancy.effort import RedundancyOptions, options_for
from solver.redundancy.mechanics import (
    CENTER_MARKER,
    EDGE_MARKER,
    HEAD_MARKER,
    is_shoulder,
    passive_force_on_coordinates,
    without_forces,
)
from solver.redundancy.motion_solution import LoadedMotion, MotionSolution, solve_motion
from solver.redundancy.problem import FrameOutcome
from solver.time_series_table import write_table
from station.assessment.assessment_inputs import read_effort
from station.assessment.assessment_json import describe_tendons, note_unconverged
from station.assessment.given_motion import MotionCut, MuscleInputs, read_given_motion
from station.assessment.reserves import (
    LEAST_SHARE,
    MOST_NAMED,
    ReserveShares,
    coordinate_unit,
    large_reserves,
    large_residuals,
    listed,
    reserve_findings,
    reserve_shares,
    rms,
    shares_text,
)
from station.checksums import drafted
from station.errors import StationError, UnusedOption
from station.exit_code import WRONG_USAGE
from station.messages.assessment_messages import AssessmentCode, InputCode
from station.progress import Progress, silent
from station.versions import solving_versions

if TYPE_CHECKING:
    from solver.tendons.fiber import ElasticForces  # the compiler behind it takes long to import


@dataclass(frozen=True)
class LeftOutEffect:
    """Root mean squares over the solved frames [N m, N for a translation], by the name of a coordinate.

    loads     of each force that was left out on request and can be computed: its generalised force
    reserves  (of all actuators, needed by inverse dynamics) where the solver lacks forces
    """

    loads: Mapping[str, Mapping[str, float]]
    reserves: ReserveShares

    def note(self) -> str:
        """JSON, in one line; "none" if nothing is known to change."""
        parts = {"loads": self.loads, "reserve_and_needed": self.reserves}
        known = {name: part for name, part in parts.items() if part}
        return json.dumps(known) if known else "none"


NOTHING_LEFT_OUT = LeftOutEffect({}, {})


STATUS = tuple(FrameOutcome)
"""The status of a frame in a table is the index of its outcome."""


@dataclass(frozen=True)
class SolvedMotion:
    """Solution, model and options; `notes` are all settings that are needed to reproduce the numbers.

    left_out  what the forces that were left out change, as far as it is known
    large_reserves  where reserves give much of the force that muscles should give
    large_residuals  where residuals carry much of the weight of the model
    slack_muscles  names of those that cannot pull in any frame
    """

    model: Model
    options: RedundancyOptions
    solution: MotionSolution
    notes: Mapping[str, str] = field(default_factory=dict)
    left_out: LeftOutEffect = NOTHING_LEFT_OUT
    large_reserves: ReserveShares = field(default_factory=dict)
    large_residuals: ReserveShares = field(default_factory=dict)
    slack_muscles: tuple[str, ...] = ()

    @property
    def findings(self) -> list[Message[AssessmentCode]]:
        """On forces that were left out, muscles that cannot pull, and large reserves and residuals."""
        findings = left_out_findings(self.model, self.left_out) + slack_findings(self.slack_muscles)
        return findings + reserve_findings(self.model, self.large_reserves, self.large_residuals)


def solve_muscles(
    inputs: MuscleInputs,
    cut: MotionCut,
    options: RedundancyOptions,
    progress: Progress = silent,
    glenoid_options: Sequence[str] = (),
) -> SolvedMotion:
    """Solve every frame. An effort file overrules the weights of the options.

    The cone belongs to the joint GlenoHumeral or, in a model with the markers of a glenoid and without that joint, to
    the first joint whose reaction is wanted. A model without both has no cone, and glenoid_options, those of the
    command line that ask for it, are refused.
    """
    given = read_given_motion(inputs, cut, is_assembled=cut.derivatives == "splines")
    model = without_forces(given.model, inputs.left_out)
    if inputs.effort is not None:
        model, options = read_effort(inputs.effort).applied(model, options)
    ensure_distinct_controls(model)
    options = _with_cone_joint(model, options)
    if glenoid_options and not options.has_glenoid_cone:
        figures = {"options": " and ".join(glenoid_options), "model": model.name}
        raise UnusedOption(Message(InputCode.NO_GLENOID_TO_KEEP, figures))
    ensure_joints_and_markers(model, options)
    motion = LoadedMotion(model, given.kinematics, given.loads, options)
    has_loads = inputs.external_loads is not None
    solved = solve_and_check(motion, given.model, inputs.left_out, progress, has_external_loads=has_loads)
    return replace(solved, notes=inputs.hashes() | _checked(solved, given.notes) | _notes(solved))


def solve_and_check(
    motion: LoadedMotion,
    full_model: Model,
    left_out: Sequence[str] = (),
    progress: Progress = silent,
    *,
    has_external_loads: bool,
) -> SolvedMotion:
    """Solve every frame, and find what limits the solution; without notes.

    left_out: names of forces of full_model that motion.model lacks
    """
    model, kinematics, options = motion.model, motion.kinematics, motion.options
    solution = solve_motion(
        model, kinematics, options, lambda done, total: progress("solving muscles", done, total), motion.loads
    )
    shares = reserve_shares(model, kinematics, motion.loads, solution)
    return SolvedMotion(
        model,
        options,
        solution,
        left_out=filter_effect(full_model, left_out, kinematics, solution, shares),
        large_reserves=large_reserves(model, options, shares),
        large_residuals=large_residuals(model, options, shares, has_external_loads=has_external_loads),
        slack_muscles=slack_muscles(model, kinematics, options.path_mode),
    )


def _checked(solved: SolvedMotion, of_motion: Mapping[str, str]) -> dict[str, str]:
    """Notes on forces left out, on the motion, tendons, and reserves."""
    names = solved.model.left_out
    left_out = {"left_out": ", ".join(names), "left_out_effect": solved.left_out.note()} if names else {}
    return {
        **left_out,
        **of_motion,
        "tendons": describe_tendons(solved.model, solved.solution.fibers),
        "slack_muscles": ", ".join(solved.slack_muscles) or "none",
        "large_reserves": json.dumps(solved.large_reserves) if solved.large_reserves else "none",
        "large_residuals": json.dumps(solved.large_residuals) if solved.large_residuals else "none",
    }


def ensure_joints_and_markers(model: Model, options: RedundancyOptions) -> None:
    """Raise ModelError, naming the options, for a model without the joints or without the markers of the glenoid."""
    obstacles, joints = [], [joint.name for joint in model.joints]
    unknown = [name for name in dict.fromkeys((options.joint, *options.reactions.joints)) if name not in joints]
    if unknown:
        obstacles.append(f"has no joint {', '.join(unknown)}: name some of its own with --joint ({', '.join(joints)})")
    markers = {marker.name for marker in model.markers}
    lacking = [name for name in (CENTER_MARKER, HEAD_MARKER, EDGE_MARKER) if name not in markers]
    if options.has_glenoid_cone and lacking:
        obstacles.append(f"has no marker {', '.join(lacking)}: add the markers of the glenoid, or give --no-glenoid")
    if obstacles:
        code = SolverCode.UNKNOWN_NAME if unknown else SolverCode.UNSUPPORTED
        raise ModelError(f"the model {model.name} {'; and it '.join(obstacles)}", code)


def ensure_distinct_controls(model: Model) -> None:
    """Raise ModelError where muscles and actuators share a name, because columns are named by them."""
    names = [*model.muscle_names, *(actuator.name for actuator in model.actuators)]
    repeated = [name or "(without a name)" for name, count in Counter(names).items() if count > 1]
    if repeated:
        more = f" and of {len(repeated) - MOST_NAMED} more" if len(repeated) > MOST_NAMED else ""
        raise ModelError(
            f"the model {model.name}, with the actuators added to it, has more than one muscle or actuator of the name "
            f"{', '.join(repeated[:MOST_NAMED])}{more}; rename all but one, and add a file of actuators once",
            SolverCode.UNSUPPORTED,
        )


def _with_cone_joint(model: Model, options: RedundancyOptions) -> RedundancyOptions:
    is_lacking = options.joint not in {joint.name for joint in model.joints}
    if is_lacking and options.reactions.joints and is_shoulder(model):
        return replace(options, joint=options.reactions.joints[0])
    return options_for(model, options)


def _notes(solved: SolvedMotion) -> dict[str, str]:
    """Single lines without an equals sign, which separates key and value in OpenSim files."""
    model, options = solved.model, solved.options
    weights = {
        "muscles": options.muscle_weight,
        "reserves": options.reserve_weight,
        "unweighted": [name for name in options.unweighted_coordinates if name in model.actuated_names],
        "single": dict(options.weights),
    }
    reactions = options.reactions
    described = f"{', '.join(reactions.joints)} on {reactions.on} in {reactions.axes}" if reactions.joints else "none"
    glenoid = (
        f"reaction kept inside, aspect {options.glenoid_aspect:g}" if options.has_glenoid_cone else "not constrained"
    )
    return {
        "made_by": "station rmr",
        "versions": ", ".join(f"{name} {version}" for name, version in solving_versions().items()),
        "activation_dynamics": "yes" if options.has_activation_dynamics else "no",
        "muscle_forces": options.muscle_force_model,
        "exponent": str(options.exponent),
        "weights": json.dumps(weights),
        "joint": options.joint if is_shoulder(model, options.joint) else "none",
        "reactions": described,
        "glenoid": glenoid,
        "paths": options.path_mode,
        "free_coordinates": ", ".join(options.free_coordinates) or "none",
        "reserve_coordinates": json.dumps(_reserve_coordinates(model)),
        "status_codes": ", ".join(f"{code} {outcome}" for code, outcome in enumerate(STATUS)),
        "muscle_outcomes": note_unconverged(solved.solution),
    }


def _reserve_coordinates(model: Model) -> dict[str, str]:
    """Actuator → the coordinate that it moves; their names need not be alike."""
    moving = (actuator for actuator in model.actuators if isinstance(actuator, CoordinateActuator))
    return {actuator.name: model.coordinate_names[actuator.coordinate] for actuator in moving}


def filter_effect(
    model: Model, names: Sequence[str], kinematics: Kinematics, solution: MotionSolution, shares: ReserveShares
) -> LeftOutEffect:
    """The forces `names` of the model were left out of the solved motion; shares are those of its reserves."""
    is_solved = np.isfinite(solution.reserves).all(axis=1)
    known = {name: passive_force_on_coordinates(model, kinematics, name)[is_solved] for name in names}
    return LeftOutEffect(
        {name: _largest(model, forces) for name, forces in known.items()}, shares if model.lacking else {}
    )


def left_out_findings(model: Model, effect: LeftOutEffect | None) -> list[Message[AssessmentCode]]:
    """One that names what is left out and, if it was computed, its effect; none if nothing is."""
    if not model.left_out:
        return []
    described = "" if effect is None else _describe_effect(model, effect)
    return [Message(AssessmentCode.LEFT_OUT, {"parts": ", ".join(model.left_out), "effect": described})]


def _describe_effect(model: Model, effect: LeftOutEffect) -> str:
    """Sentences with a space before each; "" without an effect that is known."""
    sentences = []
    units = {name: coordinate_unit(model, place) for place, name in enumerate(model.coordinate_names)}
    for name, forces in effect.loads.items():
        parts = [f"{size:.3g} {units[coordinate]} at {coordinate}" for coordinate, size in forces.items()]
        sentences.append(f"{name} would give {listed(parts)} (RMS)." if parts else f"{name} gives nothing here.")
    if model.lacking:
        given = f"give {shares_text(model, effect.reserves)}" if effect.reserves else "give nothing"
        sentences.append(f"Muscles and reserves carry the loads of {', '.join(model.lacking)}; reserves {given}.")
    return "".join(f" {sentence}" for sentence in sentences)


def _largest(model: Model, forces: Array) -> dict[str, float]:
    """By coordinate, the greatest first, down to a hundredth of it."""
    sizes = rms(forces)
    kept = [k for k in np.argsort(-sizes) if sizes[k] > LEAST_SHARE * sizes.max(initial=0.0)]
    return {model.coordinate_names[k]: float(sizes[k]) for k in kept}


def slack_muscles(model: Model, kinematics: Kinematics, path_mode: PathMode) -> tuple[str, ...]:
    """Their names. Frames after the first are evaluated only for muscles that are slack in the first."""
    slack = model.muscles
    for frames in (slice(1), slice(None)):
        if not slack:
            break
        part = kinematics.cut(frames)
        state = postures(model, part.positions, part.speeds, part.time)
        longest = evaluate_paths(model, state, [muscle.path for muscle in slack], path_mode).lengths.max(axis=0)
        is_slack = longest < [muscle.tendon_slack_length for muscle in slack]
        slack = tuple(muscle for muscle, is_kept in zip(slack, is_slack, strict=True) if is_kept)
    return tuple(muscle.name for muscle in slack)


def slack_findings(names: Sequence[str]) -> list[Message[AssessmentCode]]:
    """One that names the muscles; none without one."""
    return [Message(AssessmentCode.MUSCLES_SLACK, {"muscles": ", ".join(names)})] if names else []


SUFFIXES = (".csv", ".sto", ".parquet")


class TableError(StationError):
    """The table cannot be written in this format."""

    exit_code = WRONG_USAGE


@dataclass(frozen=True, eq=False)
class Column:
    """A quantity over time; values (frames,) in the unit."""

    name: str
    unit: str
    values: Array


def ensure_table_format(path: Path) -> None:
    """Raise TableError for a name without a known suffix, before anything is computed."""
    if path.suffix not in SUFFIXES:
        raise TableError(
            Message(InputCode.TABLE_FORMAT, {"name": path.name or str(path), "suffixes": ", ".join(SUFFIXES)})
        )


def write_solved(path: Path, solved: SolvedMotion) -> str | None:
    """Write all columns and the notes, in the format of the suffix; a .sto holds finite numbers only.

    Returns a sentence on the columns and frames that a .sto leaves out, None if there are none.
    """
    ensure_table_format(path)
    columns = tuple(solved_columns(solved))
    if path.suffix == ".parquet":
        with drafted(path) as draft:
            _write_parquet(draft, solved, columns)
        return None
    names, values, time = [column.name for column in columns], _stack(columns), solved.solution.time
    is_kept, left_out = np.ones(len(time), dtype=bool), ""
    if path.suffix == ".sto":
        columns, is_kept, left_out = _finite(columns, np.isfinite(solved.solution.effort), time)
        names, values = [column.name for column in columns], _stack(columns)
    notes = {**solved.notes, "left_out": left_out} if left_out else solved.notes
    with drafted(path) as draft:
        write_table(draft, names, time[is_kept], values[is_kept], notes)
    return f"{path.name} leaves out {left_out}: OpenSim reads finite numbers only" if left_out else None


def solved_columns(solved: SolvedMotion) -> Iterator[Column]:
    """Activations, forces, reserves, joint reaction and its contact point on the glenoid, residuals and status."""
    model, solution = solved.model, solved.solution
    muscles = model.muscle_names
    yield from _columns(muscles, "1", solution.activations)
    yield from _columns([f"force_n.{name}" for name in muscles], "N", solution.muscle_forces)
    yield from _columns([f"passive_force_n.{name}" for name in muscles], "N", solution.passive_forces)
    if solution.fibers is not None:
        yield from _fibers(muscles, solution.fibers)
    for actuator, values in zip(model.actuators, solution.reserves.T, strict=True):
        unit = reserve_unit(model, actuator)
        yield Column(f"reserve_{unit.lower().replace(' ', '_')}.{actuator.name}", unit, values)
    if is_shoulder(model, solved.options.joint):
        yield from _columns([f"reaction_moment_n_m.{axis}" for axis in "xyz"], "N m", solution.reaction[:, :3])
        yield from _columns([f"reaction_force_n.{axis}" for axis in "xyz"], "N", solution.reaction[:, 3:])
        yield from _columns(["contact_m.along_edge", "contact_m.across"], "m", solution.contact)
    yield from _joint_columns(solution.joint_reactions)
    yield Column("effort", "1", solution.effort)
    yield Column("equality_residual", "rad/s² or m/s²", solution.equality_residual)
    if solved.options.has_glenoid_cone:
        yield Column("cone_slack_n", "N", solution.cone_slack)
    yield Column("status", "code", np.array([float(STATUS.index(outcome)) for outcome in solution.outcomes]))
    unconverged = (solution.muscle_outcomes != MuscleOutcome.CONVERGED).sum(axis=1)
    yield Column("muscles_not_converged", "1", unconverged.astype(float))


def _joint_columns(reactions: JointReactions) -> Iterator[Column]:
    """Moment, force and point of every joint, by OpenSim's label."""
    parts = (
        ("moment_n_m", "N m", reactions.moment),
        ("force_n", "N", reactions.force),
        ("point_m", "m", reactions.point),
    )
    for place, label in enumerate(reactions.labels):
        for quantity, unit, values in parts:
            names = [f"reaction_{quantity}.{label}.{axis}" for axis in "xyz"]
            yield from _columns(names, unit, values[:, place])


def reserve_unit(model: Model, actuator: Actuator) -> str:
    """Unit of an actuator: N or N m."""
    if not isinstance(actuator, CoordinateActuator):
        return actuator.unit
    return coordinate_unit(model, actuator.coordinate)


def _columns(names: list[str] | tuple[str, ...], unit: str, values: Array) -> Iterator[Column]:
    return (Column(name, unit, column) for name, column in zip(names, values.T, strict=True))


def _fibers(muscles: tuple[str, ...], fibers: ElasticForces) -> Iterator[Column]:
    """Of the muscles with elastic tendons."""
    chosen = fibers.elastic
    yield from _columns([f"fiber_length_m.{muscles[i]}" for i in chosen], "m", fibers.fiber_lengths[:, chosen])
    yield from _columns([f"tendon_strain.{muscles[i]}" for i in chosen], "1", fibers.tendon_strain[:, chosen])


def _stack(columns: tuple[Column, ...]) -> Array:
    return np.column_stack([column.values for column in columns])


def _finite(
    columns: tuple[Column, ...], is_solved: NDArray[np.bool_], time: Array
) -> tuple[tuple[Column, ...], NDArray[np.bool_], str]:
    """The columns that are finite in all solved frames, the frames that are finite in these, and the rest as a text."""
    kept = tuple(column for column in columns if np.isfinite(column.values[is_solved]).all())
    is_kept: NDArray[np.bool_] = np.logical_and.reduce(np.isfinite(_stack(kept)), axis=1)
    dropped = [column.name for column in columns if column not in kept]
    parts = [f"the columns {', '.join(dropped)}"] if dropped else []
    if not is_kept.all():
        parts.append(
            f"{int((~is_kept).sum())} of {counted(len(time), 'frame')}, the first at {time[np.argmin(is_kept)]:g} s"
        )
    return kept, is_kept, " and ".join(parts)


def _write_parquet(path: Path, solved: SolvedMotion, columns: tuple[Column, ...]) -> None:
    import pyarrow as pa
    from pyarrow import parquet

    time = Column("time", "s", solved.solution.time)
    kinds = {"code": pa.int8()}
    fields = [
        pa.field(column.name, kinds.get(column.unit, pa.float64()), metadata={"unit": column.unit})
        for column in (time, *columns)
    ]
    arrays = [pa.array(column.values.astype("int8" if column.unit == "code" else float)) for column in (time, *columns)]
    parquet.write_table(pa.table(arrays, schema=pa.schema(fields, metadata=dict(solved.notes))), path)

"""A motion with its model and loads, from files: what `station rmr` and `station id` start from.

Inverse dynamics is a table with the columns of OpenSim's InverseDynamicsTool.

Model, motion and loads are checked: inertias that no body has, coordinates without data and columns without a
coordinate, limits of time outside the motion, a header with another number of rows, steps that are uneven, a filter
with a low cut-off, coordinates against a coupler, lock or prescription or far out of range, angles that look like
radians in a file in degrees, and loads that are off or far from their body. None is an error: OpenSim's tools take such
files as they are. Notes name the coordinates, the greatest value first.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from documents.message import Message
from solver.errors import MotionError, SolverCode
from solver.model import GROUND, Array, Coordinate, Model
from solver.motion import Derivatives, Kinematics, Motion, decimate, differentiate, limits_outside
from solver.motion_splines import Accelerations, differentiate_by_splines, held_by_constraints
from solver.multibody.constraints import is_held
from solver.multibody.dynamics import inverse_dynamics
from solver.multibody.loads import ExternalForce
from solver.multibody.postures import postures
from solver.osim.loads_document import data_file, read_loads_document
from solver.osim.suited import SuitedModel
from solver.time_series_table import write_table
from station.assessment.reserves import coordinate_unit
from station.checksums import drafted
from station.defaults import CUTOFF_HZ
from station.messages.assessment_messages import AssessmentCode
from station.sources import named_hash, named_hashes, resolve_loads, resolve_model_and_suit, resolve_motion
from station.versions import solving_versions

ANGLE_TOLERANCE = np.radians(1.0)
"""Of data against a coupler, lock or prescription: above what rounding and a filter change, below what matters."""
DISTANCE_TOLERANCE = 5e-3  # m
FULL_TURN = 2 * np.pi
RANGES_OUTSIDE, LEAST_OUTSIDE, MOST_OUTSIDE = 10.0, 1.0, 20.0
"""A translation is beyond its range by more than 10 times its width, but at least 1 m and at most 20 m, the length of a
large laboratory. Ranges without a limit, ±99999.9 in OpenSim's files, count as ±20 m."""
LEAST_CUTOFF = 4.0
"""Cut-off in mean frequencies of the angles. Walking, of about 1.2 Hz, is filtered at 6 Hz (Winter, Biomechanics and
Motor Control of Human Movement), the arm lifts of the published study, of 0.2 to 0.6 Hz, at 3 Hz."""
AT_REST = 0.1
"""Of the greatest speed; a frame below it is at rest."""
LARGEST_RADIANS = np.pi
"""A motion in degrees without a larger number looks like one in radians."""
FAR_FROM_BODY, SHARE_OF_FORCE = 1.0, 0.05
"""A load is far from its body if its point is more than 1 m from the body's origin, longer than any segment, while its
force is above 5 % of its greatest: a centre of pressure has no meaning without a force."""
SIMILAR, MOST_NAMED = 0.7, 8
"""Least similarity of a column to the name that is suggested for it, and the columns that a note names."""
LARGEST_MOMENT = 100.0
"""Of inertia, over the sum of the other two principal ones: at most 1 for any body. Published models have up to 33
(WalkerModel of opensim-models; the bundled radius has 3.5), or a single moment where the motion is planar."""
FINDINGS = {
    "impossible_inertia": (AssessmentCode.IMPOSSIBLE_INERTIA, "bodies"),
    "without_data": (AssessmentCode.WITHOUT_DATA, "coordinates"),
    "unused_columns": (AssessmentCode.UNUSED_COLUMNS, "columns"),
    "range_not_covered": (AssessmentCode.RANGE_NOT_COVERED, "range"),
    "row_counts": (AssessmentCode.ROW_COUNTS, "rows"),
    "repeated_rows": (AssessmentCode.REPEATED_ROWS, "count"),
    "resampled_from_s": (AssessmentCode.RESAMPLED, "steps"),
    "low_cutoff": (AssessmentCode.LOW_CUTOFF, "frequencies"),
    "violates_constraint": (AssessmentCode.VIOLATES_CONSTRAINT, "coordinates"),
    "beyond_range": (AssessmentCode.BEYOND_RANGE, "coordinates"),
    "translation_beyond_range": (AssessmentCode.TRANSLATION_BEYOND_RANGE, "coordinates"),
    "radians_as_degrees": (AssessmentCode.RADIANS_AS_DEGREES, "angle"),
    "no_load_applied": (AssessmentCode.NO_LOAD_APPLIED, "file"),
    "load_far_from_body": (AssessmentCode.LOAD_FAR_FROM_BODY, "loads"),
    "load_on_ground": (AssessmentCode.LOAD_ON_GROUND, "loads"),
    "loads_data_elsewhere": (AssessmentCode.LOADS_DATA_ELSEWHERE, "files"),
    "loads_unused": (AssessmentCode.LOADS_UNUSED, "elements"),
    "actuators_unused": (AssessmentCode.ACTUATORS_UNUSED, "elements"),
}
"""Code of the finding of a note, and the figure that the note is in its sentence."""
UNITS = {"rotation": "rad", "translation": "m", "coupled": "rad or m"}


@dataclass(frozen=True)
class MotionCut:
    """The part of a motion that is solved, times in seconds; cutoff_hz of the low-pass filter, None for no filter."""

    cutoff_hz: float | None = CUTOFF_HZ
    start: float | None = None
    end: float | None = None
    every: int = 1
    derivatives: Derivatives = "differences"


@dataclass(frozen=True)
class MuscleInputs:
    """The files of the problem; a motion of None and the model "bundled" are those of the solver.

    ignore_forces leaves out forces and controllers of the model that the solver does not have, and left_out passive
    forces by name that it has. actuators are files with a ForceSet, which are added to the model of an .osim file.
    """

    motion: Path | None = None
    model: str = "bundled"
    external_loads: Path | None = None
    effort: Path | None = None
    ignore_forces: bool = False
    left_out: tuple[str, ...] = ()
    actuators: tuple[Path, ...] = ()

    def files(self) -> tuple[Path | str | None, ...]:
        """All that is read."""
        data = None if self.external_loads is None else data_file(self.external_loads)
        return self.motion, self.model, self.external_loads, data, self.effort, *self.actuators

    def hashes(self) -> dict[str, str]:
        """Role → "name SHA-256", or a name alone for what comes with the station."""
        added = {} if self.effort is None else {"effort": named_hash(self.effort)}
        if self.actuators:
            added["actuators"] = ", ".join(named_hash(path) for path in self.actuators)
        return named_hashes(self.model, self.motion, self.external_loads) | added


@dataclass(frozen=True)
class GivenMotion:
    """The model, with its suit if it has one, and motion and loads in the frames that are solved.

    on_inputs  notes of all checks on the motion with all its frames, on the limits, and on the file of external loads
    """

    model: Model
    suited: SuitedModel | None
    kinematics: Kinematics
    loads: tuple[ExternalForce, ...]
    on_inputs: dict[str, str]

    @property
    def notes(self) -> dict[str, str]:
        """Suit, filter, frames and the notes of all checks, for the header of a result."""
        suit = {} if self.suited is None else {"suit": _describe_suit(self.suited)}
        return {
            **suit,
            **self.on_inputs,
            "filter": self.kinematics.filter,
            "derivatives": self.kinematics.derivatives,
            "interval_s": f"{self.kinematics.interval:.10g}",
        }


def read_given_motion(
    inputs: MuscleInputs, cut: MotionCut, *, is_assembled: bool = False, needs_paths: bool = True
) -> GivenMotion:
    """Read all files but the effort's. is_assembled: constraints hold all coordinates, not those without data alone.
    needs_paths as in solver.osim.model_reader.read_osim_model.
    """
    model, suited = resolve_model_and_suit(
        inputs.model, ignore_forces=inputs.ignore_forces, actuators=inputs.actuators, needs_paths=needs_paths
    )
    motion = resolve_motion(inputs.motion, model)
    held = model.coordinate_names if is_assembled else motion.missing
    whole = held_by_constraints(model, _differentiate(motion, cut, is_assembled=is_assembled), held)
    kinematics = decimate(whole, cut.every)
    loads = resolve_loads(inputs.external_loads, model, kinematics.time)
    on_inputs = motion_checks(model, whole) | range_checks(motion, cut.start, cut.end)
    on_inputs |= load_checks(inputs.external_loads, loads, model, kinematics)
    on_inputs |= {"actuators_unused": ", ".join(model.unused)} if model.unused else {}
    if suited is not None:
        loads += suited.loads(whole, cut.every)
    return GivenMotion(model, suited, kinematics, loads, on_inputs)


def _differentiate(motion: Motion, cut: MotionCut, *, is_assembled: bool) -> Kinematics:
    """By splines as OpenSim's tools, whose accelerations differ: AnalyzeTool fits splines to the speeds."""
    if cut.derivatives == "differences":
        return differentiate(motion, cut.cutoff_hz, cut.start, cut.end)
    accelerations: Accelerations = "slopes_of_speeds" if is_assembled else "curvatures"
    return differentiate_by_splines(motion, cut.cutoff_hz, cut.start, cut.end, accelerations)


def _describe_suit(suited: SuitedModel) -> str:
    """The file has one resting length, to which `station export --osim` adds migration along the cord."""
    suit, cuffs = suited.suit, {"waist": suited.waist, "arm": suited.arm}
    described = (
        f"{suit.names[part]} cuff {'rigid' if cuff is None else f'{cuff.stiffness:g} N/m, {cuff.damping:g} N s/m'}"
        for part, cuff in cuffs.items()
    )
    length = f"resting length with migration {suit.reference_rest_length:g} m"
    return f"cord {suit.stiffness:g} N/m, {length}, {', '.join(described)}"


@dataclass(frozen=True, eq=False)
class GeneralisedForces:
    """Time (frames,) [s] and values (frames, columns) [N m, N]; `notes` reproduce them."""

    time: Array
    columns: tuple[str, ...]
    values: Array
    notes: Mapping[str, str]


def solve_inverse_dynamics(inputs: MuscleInputs, cut: MotionCut) -> GeneralisedForces:
    """Solve every frame. Raises ModelError or MotionError for files that cannot be used."""
    given = read_given_motion(inputs, cut, needs_paths=False)
    with np.errstate(over="ignore", invalid="ignore"):
        values = inverse_dynamics(given.model, given.kinematics, given.loads)
    is_finite = np.isfinite(values).all(axis=1)
    if not is_finite.all():
        raise MotionError(
            f"the generalised forces should be finite and are not at {given.kinematics.time[~is_finite][0]:g} s; check "
            "the motion and the loads there",
            SolverCode.NOT_FINITE,
        )
    made_by = {"made_by": "station id"}
    versions = {"versions": ", ".join(f"{name} {version}" for name, version in solving_versions().items())}
    left_out = {"left_out": ", ".join(given.model.left_out)} if given.model.left_out else {}
    columns = tuple(_column(coordinate) for coordinate in given.model.coordinates)
    notes = inputs.hashes() | made_by | versions | left_out | given.notes
    return GeneralisedForces(given.kinematics.time, columns, values, notes)


def write_inverse_dynamics(path: Path, found: GeneralisedForces) -> None:
    """Write a .csv, or a .sto for OpenSim."""
    with drafted(path) as draft:
        write_table(draft, found.columns, found.time, found.values, found.notes)


def _column(coordinate: Coordinate) -> str:
    """Name in OpenSim's results: a coordinate that is not an angle has a force."""
    return f"{coordinate.name}_{'moment' if coordinate.motion == 'rotation' else 'force'}"


def motion_checks(model: Model, kinematics: Kinematics) -> dict[str, str]:
    """Notes by name, those of FINDINGS: steps, frequencies, or "coordinate value unit, …"; none without findings.

    The kinematics have all frames: a mean frequency needs the beginning and the end of the motion.

    A coordinate violates its constraint by the largest difference from what the constraint gives. An angle is beyond
    its range [rad] if it is more than a full turn outside, as degrees that were read as radians are; a translation [m]
    if it is as far outside as millimetres that were read as metres are. Radians as degrees: the largest angle.
    """
    held, kinds = is_held(model), _kinds(model)
    expected = held_by_constraints(model, kinematics).positions
    differences = np.abs(kinematics.positions - expected).max(axis=0)
    is_distance = kinds == "translation"
    tolerance = np.where(is_distance, DISTANCE_TOLERANCE, ANGLE_TOLERANCE)
    steps, degrees, rows = kinematics.steps, kinematics.largest_degrees or 0.0, kinematics.row_counts
    notes = {
        "impossible_inertia": _impossible_inertia(model),
        "without_data": ", ".join(kinematics.missing),
        "unused_columns": _unused_columns(kinematics),
        "row_counts": "" if rows is None else f"nRows {rows[0]}, found {rows[1]}",
        "repeated_rows": str(kinematics.repeated_rows or ""),
        "resampled_from_s": "" if steps is None else f"{steps[0]:.6g} to {steps[1]:.6g}",
        "low_cutoff": _low_cutoff(model, kinematics),
        "violates_constraint": _listed(model, differences, held & (differences > tolerance)),
        "beyond_range": _beyond_range(model, kinematics.positions, ~held & (kinds == "rotation")),
        "translation_beyond_range": _beyond_range(model, kinematics.positions, ~held & is_distance),
        "radians_as_degrees": f"{degrees:.3g}" if 0.0 < degrees <= LARGEST_RADIANS else "",
    }
    return {name: note for name, note in notes.items() if note}


def range_checks(motion: Motion, start: float | None, end: float | None) -> dict[str, str]:
    """A note range_not_covered where a limit [s] lies outside the motion: that limit, and the times of the motion."""
    outside = limits_outside(motion.time, start, end)
    covered = f"the motion lasts from {motion.time[0]:g} to {motion.time[-1]:g} s"
    return {"range_not_covered": f"{outside}, {covered}"} if outside else {}


def load_checks(
    path: Path | None, loads: Sequence[ExternalForce], model: Model, kinematics: Kinematics
) -> dict[str, str]:
    """Notes on the loads of a file.

    no_load_applied has the name of the file if it applies none, load_far_from_body "load distance m from body, …",
    load_on_ground the names of the loads, loads_data_elsewhere the file that is named and read beside,
    loads_unused what the file has and is not used.
    """
    if path is None:
        return {}
    document = read_loads_document(path)
    notes = {
        "no_load_applied": "" if loads else path.name,
        "load_far_from_body": _far_from_body(loads, model, kinematics) if loads else "",
        "load_on_ground": ", ".join(document.on_ground),
        "loads_data_elsewhere": ", ".join(document.moved),
        "loads_unused": ", ".join(document.unused),
    }
    return {name: note for name, note in notes.items() if note}


def motion_findings(notes: Mapping[str, str]) -> list[Message[AssessmentCode]]:
    """A finding for each of the notes of motion_checks, range_checks and load_checks."""
    return [Message(code, {figure: notes[name]}) for name, (code, figure) in FINDINGS.items() if name in notes]


def _unused_columns(kinematics: Kinematics) -> str:
    """Columns without a coordinate, those first that have nearly the name of a coordinate without data."""
    lower = {name.lower(): name for name in kinematics.missing}
    near = {column: get_close_matches(column.lower(), lower, n=1, cutoff=SIMILAR) for column in kinematics.unused}
    named = [f"{column} ({lower[names[0]]}?)" for column, names in near.items() if names]
    named += [column for column, names in near.items() if not names]
    others = len(named) - MOST_NAMED
    return ", ".join(named[:MOST_NAMED]) + (f" and {others} more" if others > 0 else "")


def _impossible_inertia(model: Model) -> str:
    """Bodies that would need negative mass, with their principal moments [kg m²]."""
    named = []
    for body in model.bodies:
        moments = np.linalg.eigvalsh(body.inertia)
        others = moments[0] + moments[1]
        if others and moments[2] > LARGEST_MOMENT * others:
            named.append(f"{body.name} {', '.join(f'{moment:.3g}' for moment in moments)} kg m²")
    return "; ".join(named)


def _low_cutoff(model: Model, kinematics: Kinematics) -> str:
    """Cut-off and mean frequency where the filter removes a part of the motion; "" where no angle changes by more than
    ANGLE_TOLERANCE, or the motion has no frequency.

    The mean frequency is the RMS of the speeds of all rotations over that of their angles about the mean, after the
    filter: noise does not raise it. It is that of the frames that move, so that a rest before and after a reach does
    not lower it. A reach from rest to rest is half a period. Any other part of one has no frequency: of a ramp it would
    be any.
    """
    is_angle = np.array([coordinate.motion == "rotation" for coordinate in model.coordinates])
    angles, speeds = kinematics.positions[:, is_angle], kinematics.speeds[:, is_angle]
    speed = np.linalg.norm(speeds, axis=1)
    moving = np.flatnonzero(speed > AT_REST * speed.max())
    if kinematics.cutoff is None or len(moving) < 2:
        return ""
    first, last = int(moving[0]), int(moving[-1])
    angles, speeds = angles[first : last + 1], speeds[first : last + 1]
    if np.ptp(angles, axis=0).max() < ANGLE_TOLERANCE:
        return ""
    amplitude = np.sqrt(((angles - angles.mean(axis=0)) ** 2).sum())
    frequency = float(np.sqrt((speeds**2).sum()) / amplitude / (2 * np.pi))
    is_reach = first > 0 and last < len(speed) - 1
    has_frequency = is_reach or frequency * (kinematics.time[last] - kinematics.time[first]) >= 1
    is_low = has_frequency and kinematics.cutoff < LEAST_CUTOFF * frequency
    return f"cut-off {kinematics.cutoff:g} Hz, mean frequency of the angles {frequency:.2g} Hz" if is_low else ""


def _far_from_body(loads: Sequence[ExternalForce], model: Model, kinematics: Kinematics) -> str:
    state = postures(model, kinematics.positions, kinematics.speeds, kinematics.time)
    far = []
    for load in loads:
        if load.body == GROUND:  # load_on_ground
            continue
        force = np.linalg.norm(load.force, axis=1)
        distance = np.linalg.norm(load.points_in_ground(state) - state.origin_in_ground[:, load.body], axis=1)
        farthest = distance[force > SHARE_OF_FORCE * force.max()].max(initial=0.0)
        if farthest > FAR_FROM_BODY:
            far.append(f"{load.name} {farthest:.3g} m from {model.bodies[load.body].name}")
    return ", ".join(far)


def _kinds(model: Model) -> NDArray[np.str_]:
    """(coordinates,) "rotation", "translation", or "coupled", which has no unit.

    OpenSim's ScaleTool puts a MultiplierFunction around translations, which OpenSim then calls coupled, too.
    """
    return np.array(
        [
            "translation" if one.motion == "coupled" and coordinate_unit(model, index) == "N" else one.motion
            for index, one in enumerate(model.coordinates)
        ]
    )


def _beyond_range(model: Model, positions: Array, is_checked: NDArray[np.bool_]) -> str:
    low, high = np.array([coordinate.range for coordinate in model.coordinates]).T
    is_distance = _kinds(model) == "translation"
    low, high = (np.where(is_distance, limit.clip(-MOST_OUTSIDE, MOST_OUTSIDE), limit) for limit in (low, high))
    farthest = np.clip(RANGES_OUTSIDE * (high - low), LEAST_OUTSIDE, MOST_OUTSIDE)
    tolerance = np.where(is_distance, farthest, FULL_TURN)
    least, greatest = positions.min(axis=0), positions.max(axis=0)
    below, above = low - least, greatest - high
    is_outside = np.maximum(below, above) > tolerance
    return _listed(model, np.where(below > above, least, greatest), is_checked & is_outside)


def _listed(model: Model, values: Array, is_listed: NDArray[np.bool_]) -> str:
    found, kinds = sorted(np.flatnonzero(is_listed), key=lambda index: -abs(values[index])), _kinds(model)
    return ", ".join(f"{model.coordinate_names[index]} {values[index]:.3g} {UNITS[kinds[index]]}" for index in found)

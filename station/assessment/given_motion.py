"""A motion with its model and loads, from files: what `station rmr` and `station id` start from.

Inverse dynamics is a table with the columns of OpenSim's InverseDynamicsTool.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from solver.errors import MotionError, SolverCode
from solver.model import Coordinate, Model
from solver.motion import Derivatives, Kinematics, Motion, decimate, differentiate
from solver.motion_splines import Accelerations, differentiate_by_splines, held_by_constraints
from solver.multibody.dynamics import inverse_dynamics
from solver.multibody.loads import ExternalForce
from solver.osim.loads_document import data_file
from solver.osim.suited import SuitedModel
from solver.time_series_table import write_table
from station.assessment.motion_checks import load_checks, motion_checks, range_checks
from station.defaults import CUTOFF_HZ
from station.sources import loads_of, model_and_suit_of, motion_of, named_hash, named_hashes
from station.versions import solving_versions
from station.whole_file import drafted


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
    model, suited = model_and_suit_of(
        inputs.model, ignore_forces=inputs.ignore_forces, actuators=inputs.actuators, needs_paths=needs_paths
    )
    motion = motion_of(inputs.motion, model)
    held = model.coordinate_names if is_assembled else motion.missing
    whole = held_by_constraints(model, _differentiate(motion, cut, is_assembled=is_assembled), held)
    kinematics = decimate(whole, cut.every)
    loads = loads_of(inputs.external_loads, model, kinematics.time)
    on_inputs = motion_checks(model, whole) | range_checks(motion, cut.start, cut.end)
    on_inputs |= load_checks(inputs.external_loads, loads, model, kinematics)
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


Array = NDArray[np.float64]


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

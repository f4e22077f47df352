"""Input files of an assessment: read, checked against each other, and named with their hashes.

effort.toml has weights of muscles and actuators, and reserve actuators:

    reserve_weight = 10.0
    unweighted_coordinates = ["elbow_flexion", "pro_sup"]     # whose actuators have no weight
    [weights]                                                 # single muscles, or coordinates for their actuators
    DeltoideusScapula_M = 2.0
    [reserves]                                                # replaces the actuator of the coordinate, if it has one
    shoulder_elv = { optimal_force = 20.0, min_control = -1.0, max_control = 1.0 }

Weights multiply squares of activations and controls, or cubes of activations with `--exponent 3`; a control of 1 gives
the optimal force, in N m or N.

Measured reductions of muscle activity, which the model's are compared with, are a CSV: muscle,reduction_percent,sd.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from documents.message import Figures, Message, because
from documents.plain_data import read_toml
from documents.regular_file import LARGEST_TABLE, read_regular
from documents.validation import Section, refused_as
from fitting.cuffs.cuffs_file import read_cuffs
from fitting.cuffs.wearable_cuff import KNOWN_LAW, Cuff, NotIdentified, with_interval_covariance
from fitting.laws.model_class import SLIP
from fitting.results.codes import Standing
from solver.cuff import CuffParameters, by_site
from solver.errors import MotionError
from solver.model import Model, ModelError, with_point_mass
from solver.motion import Kinematics
from solver.multibody.loads import ExternalForce
from solver.muscle import PathMode
from solver.redundancy.effort import UNWEIGHTED_COORDINATES, RedundancyOptions, Reserve, Tendons, with_reserves
from solver.suit.cord import ensure_possible
from solver.suit.suit import BUNDLED_SUIT, Suit, SuitError, read_suit
from station.assessment.assessment_json import MeasuredReductionEntry, NumberEntry
from station.checksums import changed_files, check_hash, file_sha256
from station.defaults import CUTOFF_HZ
from station.errors import StationError
from station.exit_code import WRONG_USAGE
from station.messages.assessment_messages import AssessmentCode, InputCode
from station.sources import named_hash, named_hashes, resolve_kinematics, resolve_loads, resolve_model

RIGID = "rigid"
HELD_MASS = 2.0  # kg in the hand, if both the assessed and the other motion are the bundled one
Weight = Annotated[float, Field(ge=0, allow_inf_nan=False)]
REDUCTION_COLUMNS = ("muscle", "reduction_percent", "sd")


class InputError(StationError):
    """Files that do not make an assessment."""


class WrongOptions(InputError):
    """Options that do not make an assessment, or name no cuff of the file that it needs."""

    exit_code = WRONG_USAGE


@dataclass(frozen=True)
class AssessmentInputs:
    """The files of an assessment; None or "bundled" stands for a file of the station.

    chosen  names of the cuffs to wear in addition to the waist cuff, empty for all of them
    beside  another motion for comparison, without loads
    paths   path mode of the muscles (docs/paths.md)
    external_loads  OpenSim file of external loads on the motion
    subject folder of the wearer's own pose and motion trials, which then give body and motion
    effort  weights and reserves
    cutoff_hz  of the low-pass filter of the motion, None for no filter
    tendons rigid, or elastic where the model has them so (docs/tendons.md)
    """

    cuffs: Path
    motion: Path | None = None
    suit: Path = BUNDLED_SUIT
    model: str = "bundled"
    emg: Path | None = None
    beside: Path | None = None
    chosen: tuple[str, ...] = ()
    paths: PathMode = "opensim"
    external_loads: Path | None = None
    subject: Path | None = None
    effort: Path | None = None
    cutoff_hz: float | None = CUTOFF_HZ
    tendons: Tendons = "rigid"

    def read_model(self) -> Model:
        """With the reserves of the effort."""
        model = resolve_model(self.model)
        return model if self.effort is None else read_effort(self.effort).applied(model, RedundancyOptions())[0]

    def read_options(self, model: Model) -> RedundancyOptions:
        options = RedundancyOptions(path_mode=self.paths, tendons=self.tendons)
        return options if self.effort is None else read_effort(self.effort).applied(model, options)[1]

    def read_motion(self, model: Model) -> Kinematics:
        return resolve_kinematics(self.motion, model, self.cutoff_hz)

    def read_loads(self, model: Model, kinematics: Kinematics) -> tuple[ExternalForce, ...]:
        return resolve_loads(self.external_loads, model, kinematics.time)

    @property
    def has_bundled_suit(self) -> bool:
        """Whether the suit is the bundled file or a copy of it."""
        return file_sha256(self.suit) == file_sha256(BUNDLED_SUIT)

    def read_suit(self, most_rest_lengths: int | None = None) -> Suit:
        """The suit, with at most this number of rest lengths over the same range."""
        suit = read_suit(self.suit)
        if most_rest_lengths is None or len(suit.rest_lengths) <= most_rest_lengths:
            return suit
        first, last = suit.rest_lengths[[0, -1]]
        return replace(suit, rest_lengths=np.linspace(first, last, most_rest_lengths))

    def read_emg(self, model: Model, suit: Suit) -> tuple[MeasuredReductionEntry, ...]:
        return tuple(read_emg(self.emg, (*model.muscle_names, *suit.groups))) if self.emg else ()

    def read_other_motion(self, model: Model) -> tuple[str, Model, Kinematics] | None:
        """Name, model and kinematics of the other motion; by default the bundled raise, or that with a mass."""
        if self.beside is not None:
            kinematics = resolve_kinematics(self.beside, model, self.cutoff_hz)
            interpolated = "" if kinematics.steps is None else " (interpolated to even steps)"
            without = f" (without data: {', '.join(kinematics.missing)})" if kinematics.missing else ""
            counts = kinematics.row_counts
            other = "" if counts is None else f" (nRows {counts[0]}, found {counts[1]})"
            return self.beside.name + interpolated + without + other, model, kinematics
        try:
            kinematics = resolve_kinematics(None, model)
            if self.motion is not None:
                return "bundled raise of the arm", model, kinematics
            hand = model.bodies[model.body_index("hand")]
            loaded = with_point_mass(model, "hand", HELD_MASS, hand.mass_center)
        except (ModelError, MotionError):  # the bundled motion does not fit every model
            return None
        return f"bundled raise of the arm with {HELD_MASS:g} kg in the hand", loaded, kinematics

    def hashes(self) -> dict[str, str]:
        """Role → "name SHA-256", or a name alone for a file of the station."""
        files = {"cuffs": self.cuffs, "suit": self.suit, "emg": self.emg, "beside": self.beside, "effort": self.effort}
        named = {role: named_hash(path) for role, path in files.items() if path}
        if self.has_bundled_suit:
            named["suit"] = "bundled suit"
        if self.cutoff_hz != CUTOFF_HZ:
            named["cutoff_hz"] = "none" if self.cutoff_hz is None else f"{self.cutoff_hz:g}"
        if self.tendons != "rigid":
            named["tendons"] = self.tendons
        return named_hashes(self.model, self.motion, self.external_loads) | named | {"paths": self.paths}


def cuffs_file_standing(path: Path, cuffs: Iterable[Cuff]) -> Standing:
    """The file against its recorded hash; of a file without one, whether figures are given by hand."""
    standing = check_hash(path)
    is_by_hand = standing is Standing.UNRECORDED and any(cuff.given for cuff in cuffs)
    return Standing.BY_HAND if is_by_hand else standing


def cuff_remarks(path: Path, cuffs: Iterable[Cuff]) -> list[str]:
    """Remarks on the cuffs that a reader of the result must know."""
    cuffs = tuple(cuffs)
    remarks = [f"cuff {cuff.name}: {remark}" for cuff in cuffs for remark in cuff.remarks]
    return [*remarks, *map(str, changed_files([path]))]


def cuff_findings(cuffs: Iterable[Cuff]) -> list[Message[AssessmentCode]]:
    """A finding on each cuff that migrated against the pull, beyond its 95 % interval."""
    return [
        Message(AssessmentCode.NEGATIVE_MIGRATION, {"cuff": cuff.name, "migration_mm": 1e3 * cuff.migration.value})
        for cuff in cuffs
        if cuff.migration is not None and max(cuff.migration.value, cuff.migration.ci95[1]) < 0
    ]


def worn_cuffs(cuffs: dict[str, Cuff], chosen: tuple[str, ...]) -> list[CuffParameters]:
    """The chosen cuffs, or all, and the waist cuff.

    Raises InputError for one that is missing, or of another law, and SuitError for one that cannot be.
    """
    missing = [name for name in chosen if name not in cuffs]
    if missing:
        figures = {"missing": ", ".join(missing), "known": ", ".join(cuffs) or "none"}
        raise WrongOptions(Message(InputCode.UNKNOWN_CUFF, figures))
    worn = chosen_cuffs(cuffs, chosen)
    for cuff in worn:
        if cuff.name == RIGID:
            raise InputError(Message(InputCode.CUFF_NAMED_RIGID, {"name": RIGID}))
        _ensure_law(cuff)
    parameters = [with_interval_covariance(cuff) for cuff in worn]
    for cuff_parameters in parameters:
        ensure_possible(cuff_parameters)
    return parameters


def one_arm_cuff(cuffs: dict[str, Cuff], chosen: tuple[str, ...]) -> tuple[CuffParameters | None, CuffParameters]:
    """The waist cuff, if there is one, and the arm cuff. Raises InputError if there are others, and as worn_cuffs."""
    worn = worn_cuffs(cuffs, chosen)
    arms, waists = by_site(worn)
    if len(arms) != 1 or len(waists) > 1:
        found = ", ".join(f"{cuff.name} ({cuff.site})" for cuff in worn) or "none"
        known = ", ".join(name for name, cuff in cuffs.items() if cuff.site == "arm") or "none"
        raise WrongOptions(Message(InputCode.ONE_ARM_CUFF, {"found": found, "known": known}))
    return next(iter(waists), None), arms[0]


def chosen_cuffs(cuffs: Mapping[str, Cuff], chosen: tuple[str, ...]) -> list[Cuff]:
    """The chosen cuffs, or all, and the waist cuff."""
    return [cuff for cuff in cuffs.values() if not chosen or cuff.name in chosen or cuff.site == "waist"]


def wearable(cuffs: Mapping[str, Cuff]) -> tuple[dict[str, Cuff], dict[str, str]]:
    """The cuffs that can be worn, and the reason for each of the others by name."""
    left_out = {}
    for name, cuff in cuffs.items():
        try:
            worn_cuffs({name: cuff}, ())
        except (NotIdentified, InputError, SuitError) as error:
            left_out[name] = str(error)
    return {name: cuff for name, cuff in cuffs.items() if name not in left_out}, left_out


def read_cuffs_to_wear(path: Path, chosen: tuple[str, ...] = ()) -> dict[str, Cuff]:
    """Read cuffs.json. Raises InputError if one of the chosen cuffs has a law that no suit wears."""
    cuffs = read_cuffs(path)
    for cuff in chosen_cuffs(cuffs, chosen):
        _ensure_law(cuff)
    return cuffs


def _ensure_law(cuff: Cuff) -> None:
    """Raise InputError if the law of the cuff, or the model class of its trials, has more than a spring and a damper.

    Slip is no extension of the law: the suit wears its migration.
    """
    if set(cuff.law) - {SLIP}:
        figures = {"cuff": cuff.name, "law": " + ".join(cuff.law), "known": KNOWN_LAW}
        raise InputError(Message(InputCode.RICHER_LAW, figures))


class EffortError(StationError):
    """The weights of the effort cannot be used."""


class EffortWeights(Section):
    """The keys of effort.toml."""

    muscle_weight: Weight = 1.0
    reserve_weight: Weight = 10.0
    unweighted_coordinates: tuple[str, ...] = UNWEIGHTED_COORDINATES
    weights: dict[str, Weight] = Field(default_factory=dict)
    reserves: dict[str, Reserve] = Field(default_factory=dict)

    def applied(self, model: Model, options: RedundancyOptions) -> tuple[Model, RedundancyOptions]:
        """The model with these reserves, the options with the weights in the file. ModelError for an unknown name."""
        if "unweighted_coordinates" in self.model_fields_set:
            for name in self.unweighted_coordinates:
                model.coordinate_index(name)
        given = {name: getattr(self, name) for name in self.model_fields_set - {"reserves"}}
        return with_reserves(model, self.reserves), replace(options, **given)


def read_effort(path: Path) -> EffortWeights:
    """Read effort.toml. Raises EffortError."""
    with refused_as(EffortError, path, InputCode.EFFORT):
        return EffortWeights.model_validate(read_toml(path))


class EmgError(StationError):
    """An EMG file that cannot be used."""


def read_emg(path: Path, known: Collection[str]) -> list[MeasuredReductionEntry]:
    """Read a table of measured reductions; known are the model's muscles and the suit's groups. Raises EmgError."""
    try:
        rows = list(
            csv.DictReader(read_regular(path, LARGEST_TABLE).decode("utf-8-sig").splitlines(), skipinitialspace=True)
        )
    except (OSError, UnicodeDecodeError) as error:
        raise EmgError(Message(InputCode.EMG_UNREADABLE, {"path": str(path), **because(error)})) from error
    found = list(rows[0]) if rows else []
    if not set(REDUCTION_COLUMNS) <= set(found):
        figures = {"path": path.name, "found": ",".join(found) or "none", "expected": ",".join(REDUCTION_COLUMNS)}
        raise EmgError(Message(InputCode.EMG_COLUMNS, figures))
    return [_measured(path, line, row, known) for line, row in enumerate(rows, start=2)]


def _measured(path: Path, line: int, row: dict[str, str], known: Collection[str]) -> MeasuredReductionEntry:
    if row["muscle"] not in known:
        figures: Figures = {"path": path.name, "line": line, "muscle": row["muscle"], "known": ", ".join(known)}
        raise EmgError(Message(InputCode.EMG_MUSCLE, figures))
    try:
        reduction, sd = float(row["reduction_percent"]), float(row["sd"])
    except (TypeError, ValueError):
        reduction = sd = math.nan
    if not math.isfinite(reduction) or not 0 <= sd < math.inf:
        given = {"reduction": str(row["reduction_percent"]), "sd": str(row["sd"])}
        raise EmgError(Message(InputCode.EMG_NUMBER, {"path": path.name, "line": line, **given}))
    numbers = NumberEntry(value=reduction, ci95=None), NumberEntry(value=sd, ci95=None)
    return MeasuredReductionEntry(muscle=row["muscle"], reduction_percent=numbers[0], sd_percent=numbers[1])

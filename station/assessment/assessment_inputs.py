"""What goes into an assessment: the files, read, checked against each other, and named with their hashes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fitting.cuffs_file import read_cuffs
from fitting.interval_covariance import with_interval_covariance
from fitting.laws.model_class import SLIP
from fitting.seal import Standing
from fitting.wearable_cuff import KNOWN_LAW, NotIdentified, WearableCuff
from solver.cuff import CuffParameters
from solver.model import Model, ModelError
from solver.motion import Kinematics, MotionError, differentiate, read_motion
from solver.multibody.external_loads import ExternalForce
from solver.paths import PathMode
from solver.point_mass import with_point_mass
from solver.suit.suit import BUNDLED_SUIT, Suit, read_suit
from station.assessment.emg import MeasuredReduction, read_emg
from station.assessment.sources import loads_of, model_of, motion_of, named_hash, named_hashes
from station.checksums import standing_of
from station.errors import StationError
from station.exit_code import WRONG_USAGE

RIGID = "rigid"
HELD_WEIGHT = 2.0  # kg in the hand, where the bundled motion stands beside itself


class InputError(StationError):
    """Files that do not make an assessment; one sentence."""


class UnknownCuff(InputError):
    """The command names a cuff that the file does not hold."""

    exit_code = WRONG_USAGE


@dataclass(frozen=True)
class AssessmentInputs:
    """The files of an assessment; what is None or "bundled" comes with the station.

    chosen  names of the cuffs to wear besides the waist's, empty for all of them
    beside  another motion to show beside the assessed one, without loads
    paths   how muscles lie on surfaces (docs/paths.md)
    external_loads  OpenSim's file of them, which bear on the motion
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

    def read_model(self) -> Model:
        return model_of(self.model)

    def read_motion(self, model: Model) -> Kinematics:
        return differentiate(motion_of(self.motion, model))

    def read_loads(self, model: Model, kinematics: Kinematics) -> tuple[ExternalForce, ...]:
        return loads_of(self.external_loads, model, kinematics.time)

    def read_suit(self, most_rest_lengths: int | None = None) -> Suit:
        """The suit, where asked for with fewer rest lengths over the same span."""
        suit = read_suit(self.suit)
        if most_rest_lengths is None or len(suit.rest_lengths) <= most_rest_lengths:
            return suit
        first, last = suit.rest_lengths[[0, -1]]
        return replace(suit, rest_lengths=np.linspace(first, last, most_rest_lengths))

    def read_emg(self, model: Model, suit: Suit) -> tuple[MeasuredReduction, ...]:
        return tuple(read_emg(self.emg, (*model.muscle_names, *suit.groups))) if self.emg else ()

    def read_beside(self, model: Model) -> tuple[str, Model, Kinematics] | None:
        """Another motion and what to call it; without one given, the bundled raise, with a weight if it is assessed."""
        if self.beside is not None:
            return self.beside.name, model, differentiate(read_motion(self.beside, model))
        try:
            kinematics = differentiate(motion_of(None, model))
            if self.motion is not None:
                return "bundled raise of the arm", model, kinematics
            hand = model.bodies[model.body_index("hand")]
            loaded = with_point_mass(model, "hand", HELD_WEIGHT, hand.mass_center)
        except (ModelError, MotionError):  # someone's own model, which the bundled motion does not fit
            return None
        return f"bundled raise of the arm with {HELD_WEIGHT:g} kg in the hand", loaded, kinematics

    def hashes(self) -> dict[str, str]:
        """Role → "name SHA-256", or a name alone for what comes with the station."""
        files = {"cuffs": self.cuffs, "suit": self.suit, "emg": self.emg, "beside": self.beside}
        named = {role: named_hash(path) for role, path in files.items() if path}
        return named_hashes(self.model, self.motion, self.external_loads) | named | {"paths": self.paths}


def standing_of_cuffs(path: Path, cuffs: Iterable[WearableCuff]) -> Standing:
    """How the file stands to what was recorded of it; figures given by hand in these cuffs explain a change."""
    found = {fit.standing for fit in cuffs}
    if Standing.CHANGED in found:
        return Standing.CHANGED
    return Standing.BY_HAND if Standing.BY_HAND in found else standing_of(path)


def cuff_remarks(path: Path, cuffs: Iterable[WearableCuff]) -> list[str]:
    """What a reader of a result must know of the cuffs that went into it, in sentences."""
    cuffs = tuple(cuffs)
    said = [f"cuff {fit.name}: {remark}" for fit in cuffs for remark in fit.remarks]
    if standing_of_cuffs(path, cuffs) is Standing.CHANGED:
        said.append(f"{path} has changed since it was recorded; fit the session again, or see `station verify`")
    return said


def ensure_folder(output: Path) -> None:
    """Before anything is solved. Raises InputError where results have no place to go."""
    if output.exists() and not output.is_dir():
        raise InputError(f"{output} should be a folder to write into and is a file; give another --output")


def worn_cuffs(cuffs: dict[str, WearableCuff], chosen: tuple[str, ...]) -> list[CuffParameters]:
    """The chosen cuffs, or all, and the waist's. Raises InputError for one that is missing, or of another law."""
    missing = [name for name in chosen if name not in cuffs]
    if missing:
        raise UnknownCuff(
            f"the cuffs file should hold {', '.join(missing)} and holds {', '.join(cuffs) or 'none'}; fit it or choose "
            "another"
        )
    worn = chosen_cuffs(cuffs, chosen)
    for fit in worn:
        if fit.name == RIGID:
            raise InputError(f"a cuff is called {RIGID}, as is the suit with cuffs that do not yield; rename it")
        _ensure_is_worn(fit)
    return [with_interval_covariance(fit) for fit in worn]


def chosen_cuffs(cuffs: Mapping[str, WearableCuff], chosen: tuple[str, ...]) -> list[WearableCuff]:
    """Those of the chosen cuffs, or of all, and the waist's."""
    return [fit for fit in cuffs.values() if not chosen or fit.name in chosen or fit.site == "waist"]


def wearable(cuffs: Mapping[str, WearableCuff]) -> tuple[dict[str, WearableCuff], dict[str, str]]:
    """The cuffs that can be worn, and of the others by name why not."""
    left_out = {}
    for name, fit in cuffs.items():
        try:
            worn_cuffs({name: fit}, ())
        except (NotIdentified, InputError) as error:
            left_out[name] = str(error)
    return {name: fit for name, fit in cuffs.items() if name not in left_out}, left_out


def read_cuffs_to_wear(path: Path, chosen: tuple[str, ...] = ()) -> dict[str, WearableCuff]:
    """Reads cuffs.json; of the cuffs that worn_cuffs would take, raises InputError for a law that no suit wears."""
    cuffs = read_cuffs(path)
    for cuff in chosen_cuffs(cuffs, chosen):
        _ensure_is_worn(cuff)
    return cuffs


def _ensure_is_worn(cuff: WearableCuff) -> None:
    """Raises InputError where a cuff's law, or the class of its trials (fitting/laws/model_class.py), is a richer one.

    A cuff that slips is no other law: the suit wears its migration.
    """
    if set(cuff.law) - {SLIP}:
        raise InputError(
            f"the cuff {cuff.name} has the law {' + '.join(cuff.law)}, and the suit wears cuffs of the law {KNOWN_LAW} "
            f"only, which F = k x + c ẋ describes; where that will do, write {cuff.name} with its k, c and migration "
            "alone into a cuffs file"
        )

"""Model, motion and loads of an analysis: from a file, or the bundled ones of the solver."""

from __future__ import annotations

import hashlib
import re
import tempfile
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from numpy import float64
from numpy.typing import NDArray

from documents.regular_file import LARGEST_TABLE, read_regular
from solver.bundled import bundled_model, simulate_arm_raise
from solver.errors import SolverCode
from solver.model import Model, ModelError
from solver.motion import Kinematics, Motion, differentiate, motion_from_dataframe, read_motion
from solver.motion_splines import held_by_constraints
from solver.multibody.loads import ExternalForce
from solver.osim.document import read_document
from solver.osim.loads_document import data_file, read_external_loads
from solver.osim.model_reader import read_osim, read_osim_model
from solver.osim.suited import CORD, CUFFS_AT_ENDS, SuitedModel, read_suited
from solver.suit.suit import Suit, read_suit
from station.defaults import CUTOFF_HZ

if TYPE_CHECKING:
    import pandas as pd

BUNDLED = "bundled"
T = TypeVar("T")


def resolve_model(name: str, *, ignore_forces: bool = False, actuators: Sequence[Path] = ()) -> Model:
    """The model of an .osim file, or the "bundled" one; ignore_forces leaves out forces that the solver lacks.

    actuators are files with a ForceSet that is added to that of an .osim file.

    Raises ModelError for a model that already has the suit of `station export --osim`.
    """
    if name == BUNDLED:
        return _bundled(actuators)
    model = read_osim(Path(name), ignore_forces=ignore_forces, actuators=actuators)
    if CORD in {force.name for force in model.forces} and {*CUFFS_AT_ENDS} <= {body.name for body in model.bodies}:
        raise ModelError(
            f"{Path(name).name} already has the suit of `station export --osim`; give the model without the suit",
            SolverCode.UNSUPPORTED,
        )
    return model


def resolve_model_and_suit(
    name: str, *, ignore_forces: bool = False, actuators: Sequence[Path] = (), needs_paths: bool = True
) -> tuple[Model, SuitedModel | None]:
    """As resolve_model, but a model with the suit of `station export --osim` is read, and returned with it; needs_paths
    as in read_osim_model.
    """
    if name == BUNDLED:
        return _bundled(actuators), None
    document = read_document(Path(name))
    options: dict[str, Any] = {"ignore_forces": ignore_forces, "actuators": actuators, "needs_paths": needs_paths}
    suited = read_suited(document, **options)
    if suited is not None:
        return suited.model, suited
    return read_osim_model(document, **options), None


def resolve_motion(source: Path | pd.DataFrame | None, model: Model) -> Motion:
    """The motion of a file or a table, with defaults for missing columns, or the bundled raise of the arm."""
    if source is None:
        return _bundled_arm_raise(model)
    if isinstance(source, Path):
        return read_motion(source, model, with_defaults=True)
    return motion_from_dataframe(source, model)


def resolve_kinematics(
    path: Path | pd.DataFrame | None, model: Model, cutoff_hz: float | None = CUTOFF_HZ
) -> Kinematics:
    """The motion of resolve_motion, filtered and differentiated; those without data are where constraints hold them."""
    kinematics = differentiate(resolve_motion(path, model), cutoff_hz)
    return held_by_constraints(model, kinematics, kinematics.missing)


def resolve_loads(path: Path | None, model: Model, time: NDArray[float64]) -> tuple[ExternalForce, ...]:
    """External loads of an OpenSim file at times (frames,) [s]; none without a file."""
    return () if path is None else read_external_loads(path, model, time)


def named_hashes(model: str, motion: Path | None, external_loads: Path | None) -> dict[str, str]:
    """Role → "name SHA-256", or a name alone for a bundled input."""
    named = {
        "model": "bundled thoracoscapular model" if model == BUNDLED else named_hash(Path(model)),
        "motion": "bundled raise of the arm" if motion is None else named_hash(motion),
    }
    if external_loads is not None:
        named["external_loads"] = named_hash(external_loads)
        named["external_loads_data"] = named_hash(data_file(external_loads))
    return named


def named_hash(path: Path) -> str:
    """Name and SHA-256 of a file."""
    return f"{path.name} {hashlib.sha256(read_regular(path, LARGEST_TABLE)).hexdigest()}"


def repeated_name(trials: Sequence[Path]) -> str | None:
    """The first name that two of these files give to a trial: that of the file, without folder and suffix."""
    names = [path.stem for path in trials]
    return next((name for name in names if names.count(name) > 1), None)


def without_hash(named: str) -> str:
    """The name without the SHA-256."""
    return re.sub(r" [0-9a-f]{64}$", "", named)


def _bundled_arm_raise(model: Model) -> Motion:
    """The bundled motion. Raises ModelError, which asks for a motion, where the model lacks its coordinates."""
    try:
        return simulate_arm_raise(model)
    except ModelError as error:
        if error.code != SolverCode.UNKNOWN_NAME:
            raise
        raise ModelError(
            f"the bundled arm raise does not fit the model {model.name}; give a motion of this model with --motion",
            SolverCode.UNKNOWN_NAME,
        ) from error


def _bundled(actuators: Sequence[Path]) -> Model:
    if actuators:
        raise ModelError("the bundled model takes no files of actuators; give an .osim file", SolverCode.WRONG_OPTION)
    return bundled_model()


def drawn_body(osim: str, suit_toml: str) -> tuple[Model, Suit | None]:
    """Model and suit in the texts of their files, as a live process publishes them, for views that draw the body.

    The suit is None if the model lacks one of its bodies. Raises SolverError for what cannot be read.
    """
    model, suit = read_model(osim), _read_text(suit_toml, "suit.toml", read_suit) if suit_toml else read_suit()
    bodies = {body.name for body in model.bodies}
    return model, suit if bodies >= {part.body for part in suit.line} else None


def read_model(osim: str) -> Model:
    """The model in the text of an OpenSim file; the bundled one for an empty text. Raises ModelError."""
    return _read_text(osim, "body.osim", partial(read_osim, ignore_forces=True)) if osim else bundled_model()


def _read_text(text: str, name: str, read: Callable[[Path], T]) -> T:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / name
        file.write_text(text, encoding="utf-8")
        return read(file)

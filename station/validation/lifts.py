"""Lifts of a patient with an instrumented shoulder prosthesis: the files of a folder, and what they hold.

NAME_as_solved.osim, NAME.mot            the model and its motion, with the load in the hand
NAME_measured_force.txt                  the joint force relative to the implant, with the body weight
NAME_measured_force_glenoid.txt          the same relative to the glenoid, if it is known
NAME_published_{none,circle,ellipse}.txt the published solutions, where there are any
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recordings.errors import ForeignFile, RecordingCode
from recordings.exchange.joint_force import JointForceRecord, read_joint_force
from recordings.exchange.tables import require_rising
from recordings.exchange.text import read_lines, read_numbers
from solver.model import Model
from solver.motion import Motion, read_motion
from solver.osim.model_reader import read_osim
from station.errors import StationError
from station.messages.message import Figures, Message
from station.messages.validation_codes import ValidationCode

Array = NDArray[np.float64]

MODEL, IMPLANT, GLENOID = "_as_solved.osim", "_measured_force.txt", "_measured_force_glenoid.txt"
PUBLISHED = "_published_{variant}.txt"
FORCE = ("time", "Fx", "Fy", "Fz")
LARGEST_DIFFERENCE_N = 2.0
"""Between the two records of one force; 0.9 N in the public lifts."""
TIME_TOLERANCE_S = 1e-4


class ValidationFileError(StationError):
    """A folder or a file that does not make a lift with a measured force."""


@dataclass(frozen=True, eq=False)
class PublishedForce:
    """Force (frames, 3) [N] on the scapula in ground of a published solution, at time (frames,) [s]."""

    time: Array
    force: Array


@dataclass(frozen=True, eq=False)
class MeasuredLift:
    """A lift: model, motion, the measured force, body weight [N], and published solutions.

    measured    relative to the implant, for the size
    in_glenoid  relative to the glenoid, for the direction; None where it is not known
    notes       on the files
    """

    name: str
    model: Model
    motion: Motion
    measured: JointForceRecord
    in_glenoid: JointForceRecord | None
    body_weight: float
    published: Mapping[str, PublishedForce]
    notes: tuple[Message[ValidationCode], ...] = ()


def find_lifts(folder: Path) -> list[str]:
    """Names of the lifts in a folder, in alphabetical order. Raises ValidationFileError where there is none."""
    if not folder.is_dir():
        raise ValidationFileError(Message(ValidationCode.NOT_A_FOLDER, {"path": str(folder)}))
    names = sorted(path.name.removesuffix(MODEL) for path in folder.glob(f"*{MODEL}"))
    if not names:
        raise ValidationFileError(Message(ValidationCode.NO_LIFT, {"path": str(folder)}))
    return names


def read_lift(folder: Path, name: str, variants: tuple[str, ...]) -> MeasuredLift:
    """A lift with the published solutions of these variants. Raises ValidationFileError, ForeignFile, SolverError."""
    needed = [f"{name}.mot", name + IMPLANT]
    if missing := [file for file in needed if not (folder / file).is_file()]:
        figures = {"lift": name, "path": str(folder), "missing": ", ".join(missing)}
        raise ValidationFileError(Message(ValidationCode.FILES_MISSING, figures))
    model = read_osim(folder / (name + MODEL))
    implant = read_joint_force(folder / (name + IMPLANT))
    if implant.body_weight is None:
        raise ValidationFileError(Message(ValidationCode.NO_BODY_WEIGHT, {"file": name + IMPLANT}))
    glenoid = read_joint_force(folder / (name + GLENOID)) if (folder / (name + GLENOID)).is_file() else None
    if glenoid is not None:
        _ensure_same_force(name, implant, glenoid)
    motion = read_motion(folder / f"{name}.mot", model)
    last = float(implant.time_s[-1])
    if motion.time[-1] > last + TIME_TOLERANCE_S or motion.time[0] < -TIME_TOLERANCE_S:
        times: Figures = {
            "lift": name,
            "start_s": float(motion.time[0]),
            "end_s": float(motion.time[-1]),
            "last_s": last,
            "file": name + IMPLANT,
        }
        raise ValidationFileError(Message(ValidationCode.NOT_COVERED, times))
    files = {variant: folder / (name + PUBLISHED.format(variant=variant)) for variant in variants}
    published = {variant: read_published_force(path) for variant, path in files.items() if path.is_file()}
    notes = tuple(_notes(folder, name, implant, files))
    return MeasuredLift(name, model, motion, implant, glenoid, implant.body_weight, published, notes)


def read_published_force(path: Path) -> PublishedForce:
    """Read the force of a published solution: a table with commas, and columns time, Fx, Fy, Fz among others.

    Raises ForeignFile.
    """
    lines = read_lines(path)
    titles = [title.strip() for title in lines[0].split(",")]
    if missing := [title for title in FORCE if titles.count(title) != 1]:
        raise ForeignFile(
            f"{path} has {len(titles)} columns and not one {', one '.join(missing)}; use a published solution",
            RecordingCode.FOREIGN_MISSING_COLUMN,
        )
    for number, line in enumerate(lines[1:], start=2):
        if (found := len(line.split(","))) != len(titles):
            raise ForeignFile(
                f"{path} has {found} columns in line {number}, expected {len(titles)}; the file may be cut, download "
                "it again",
                RecordingCode.FOREIGN_CUT,
            )
    table = read_numbers(lines[1:], ",", [titles.index(title) for title in FORCE], path, 2)
    require_rising(table[:, 0], f"{path}, time,", 2)
    holes = np.flatnonzero(~np.isfinite(table).all(axis=1))
    if len(holes):
        raise ForeignFile(
            f"{path} has no force in line {holes[0] + 2}, expected one at every time; download it again",
            RecordingCode.FOREIGN_NOT_A_NUMBER,
        )
    return PublishedForce(table[:, 0], table[:, 1:])


def _notes(
    folder: Path, name: str, implant: JointForceRecord, files: Mapping[str, Path]
) -> Iterator[Message[ValidationCode]]:
    """What may be wrong with the names of published solutions and with the time of the record."""
    if implant.is_cut:
        yield Message(ValidationCode.START_NOT_MARKED, {"file": name + IMPLANT})
    found = {path.name for path in folder.glob(name + PUBLISHED.format(variant="*"))}
    expected = {path.name for path in files.values()}
    if found and (missing := expected - found):
        yield Message(ValidationCode.PUBLISHED_MISSING, {"files": ", ".join(sorted(missing))})
    if expected and (unused := found - expected):
        yield Message(
            ValidationCode.PUBLISHED_UNUSED, {"files": ", ".join(sorted(unused)), "variants": ", ".join(files)}
        )


def _ensure_same_force(name: str, implant: JointForceRecord, glenoid: JointForceRecord) -> None:
    same = implant.at(glenoid.time_s)[1]
    worst = float(np.nanmax(np.abs(same - glenoid.resultant)))
    if worst > LARGEST_DIFFERENCE_N:
        figures: Figures = {"lift": name, "difference_n": worst, "limit_n": LARGEST_DIFFERENCE_N}
        raise ValidationFileError(Message(ValidationCode.DIFFERENT_FORCES, figures))

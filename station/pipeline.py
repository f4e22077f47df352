"""The way from a session's folder to its report, in lines that read like the picture in the README."""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

from fitting.result import CuffFit, SessionFit, read_cuffs
from fitting.session import fit_session
from fitting.trial import read_trials
from solver.assessment import Assessment, assess
from solver.bundled import bundled_model
from solver.model import Model
from solver.motion import Kinematics, differentiate, read_motion, thin, write_table
from solver.osim.reader import read_osim
from solver.raise_arm import raise_arm
from solver.redundancy import Redundancy, RedundancyOptions, solve_motion
from solver.suit import BUNDLED_SUIT, read_suit
from station.progress import Progress, silent


class SessionError(Exception):
    """The folder cannot be fitted or assessed; one sentence."""


@dataclass(frozen=True)
class AssessedSuit:
    """An assessment and what went into it: input's role → "name SHA-256"."""

    assessment: Assessment
    inputs: dict[str, str]


def recordings_in(folder: Path) -> list[Path]:
    """The session's trial files; where one was recovered, the recovered file stands for the cut one."""
    files = sorted(folder.glob("*.mcap"))
    cut = {path.with_suffix("").with_suffix(".mcap") for path in files if path.suffixes[-2:] == [".recovered", ".mcap"]}
    return [path for path in files if path not in cut]


def fit_session_folder(folder: Path, output: Path | None, progress: Progress = silent) -> SessionFit:
    """Recordings → trials → fit → cuffs.json. Raises SessionError when not one trial can be used."""
    if not folder.is_dir():
        raise SessionError(f"{folder} is not a folder; give the folder that `station record` wrote into")
    paths = recordings_in(folder)
    if not paths:
        raise SessionError(f"{folder} holds no recording (*.mcap); record a trial into it first")
    trials, rejected = read_trials(_counted(paths, "reading trials", progress))
    if not trials:
        reasons = "; ".join(f"{trial.file}: {trial.reason}" for trial in rejected)
        raise SessionError(f"no recording in {folder} can be used: {reasons}")
    fitted = fit_session(trials, rejected)
    if output is not None:
        write_whole(output, fitted.to_json())
    return fitted


def assess_cuffs(
    cuffs: dict[str, CuffFit],
    cuffs_file: Path,
    motion: Path | None = None,
    suit: Path | None = None,
    most_frames: int | None = None,
    progress: Progress = silent,
) -> AssessedSuit:
    """Cuff parameters → suit on a model → assessment, on the bundled model and, unless given, motion and suit.

    most_frames bounds the frames whose muscles are solved, evenly spread; None solves all.
    """
    model = bundled_model()
    kinematics = differentiate(raise_arm(model) if motion is None else read_motion(motion, model))
    assessment = assess(
        model,
        kinematics,
        read_suit(suit or BUNDLED_SUIT),
        [cuff.parameters() for cuff in cuffs.values()],
        every=1 if most_frames is None else math.ceil(len(kinematics.time) / most_frames),
        progress=lambda done, total: progress("solving muscles", done, total),
    )
    inputs = {"cuffs": _named_hash(cuffs_file), "suit": _named_hash(suit or BUNDLED_SUIT)}
    inputs["motion"] = "bundled raise of the arm" if motion is None else _named_hash(motion)
    return AssessedSuit(assessment, inputs)


def assess_file(
    cuffs_file: Path,
    output: Path,
    motion: Path | None = None,
    suit: Path | None = None,
    progress: Progress = silent,
) -> AssessedSuit:
    """cuffs.json → assessment.json in the output folder."""
    assessed = assess_cuffs(read_cuffs(cuffs_file), cuffs_file, motion, suit, progress=progress)
    write_assessment(assessed, output)
    return assessed


@dataclass(frozen=True)
class MotionCut:
    """Which part of a motion is solved, times in seconds; cutoff_hz is the low-pass filter's."""

    cutoff_hz: float = 3.0
    start: float | None = None
    end: float | None = None
    every: int = 1


def solve_muscles(
    model_file: str,
    motion_file: Path,
    output: Path,
    cut: MotionCut,
    options: RedundancyOptions,
    progress: Progress = silent,
) -> Redundancy:
    """Motion → muscle activations, as a .csv or .sto with a column per muscle. model_file "bundled" is our table."""
    model = bundled_model() if model_file == "bundled" else read_osim(Path(model_file))
    solution = solve_motion(
        model,
        _kinematics(model, motion_file, cut),
        options,
        progress=lambda done, total: progress("solving muscles", done, total),
    )
    output.parent.mkdir(parents=True, exist_ok=True)
    write_table(output, [muscle.name for muscle in model.muscles], solution.time, solution.activations)
    return solution


def write_assessment(assessed: AssessedSuit, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    plain: dict[str, Any] = assessed.assessment.to_json()
    plain |= {"inputs": assessed.inputs, "versions": {"cuffstation": metadata.version("cuffstation")}}
    write_whole(folder / "assessment.json", json.dumps(plain, indent=2, ensure_ascii=False) + "\n")


def write_whole(path: Path, text: str) -> None:
    """The whole file or the one that was there before, never half of it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_name(f".{path.name}.draft")
    draft.write_text(text, encoding="utf-8", newline="\n")
    os.replace(draft, path)  # noqa: PTH105  (says what it does)


def _kinematics(model: Model, motion_file: Path, cut: MotionCut) -> Kinematics:
    whole = differentiate(read_motion(motion_file, model), cut.cutoff_hz, cut.start, cut.end)
    return thin(whole, cut.every)


def _named_hash(path: Path) -> str:
    return f"{path.name} {hashlib.sha256(path.read_bytes()).hexdigest()}"


def _counted(paths: Sequence[Path], what: str, progress: Progress) -> Iterator[Path]:
    for done, path in enumerate(paths):
        progress(what, done, len(paths))
        yield path
    progress(what, len(paths), len(paths))

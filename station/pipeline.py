"""The way from a session's folder to its report, in lines that read like the picture in the README."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

from fitting.result import CuffFit, SessionFit
from fitting.session import fit_session
from fitting.trial import read_trials
from solver.assessment import Assessment, assess
from solver.bundled import bundled_model
from solver.model import Model
from solver.motion import Kinematics, differentiate, read_motion, thin, write_table
from solver.osim.reader import read_osim
from solver.redundancy import Redundancy, RedundancyOptions, solve_motion
from station.assessment_inputs import AssessmentInputs, read_cuffs_to_wear, worn_cuffs
from station.assessment_json import ACTIVATIONS_FILE, activations_table, plain_assessment, plain_emg
from station.emg import MeasuredReduction
from station.findings import findings
from station.progress import Progress, silent

BESIDE_FRAMES, BESIDE_REST_LENGTHS = 40, 16
"""How much is solved of the motion that stands beside the assessed one."""


class SessionError(Exception):
    """The folder cannot be fitted or assessed; one sentence."""


@dataclass(frozen=True)
class AssessedSuit:
    """An assessment, a short one of another motion (its name first) or None, measured EMG, and what went in."""

    assessment: Assessment
    beside: tuple[str, Assessment] | None
    emg: tuple[MeasuredReduction, ...]
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
    progress("fitting", 0, len(trials))
    fitted = fit_session(trials, rejected)
    progress("fitting", len(trials), len(trials))
    if output is not None:
        write_whole(output, fitted.to_json())
    return fitted


def assess_cuffs(
    cuffs: dict[str, CuffFit],
    inputs: AssessmentInputs,
    *,
    most_frames: int | None = None,
    most_rest_lengths: int | None = None,
    draws: int = 200,
    progress: Progress = silent,
) -> AssessedSuit:
    """Cuff parameters → suit on a model → assessment, and a short one of another motion beside it.

    most_frames and most_rest_lengths bound what is solved, evenly spread; None is the whole motion, all of the suit's.
    draws is how often the cuffs are drawn from the covariance of their fit.
    """
    model = inputs.read_model()
    kinematics, suit = inputs.read_motion(model), inputs.read_suit(most_rest_lengths)
    emg, worn = inputs.read_emg(model, suit), worn_cuffs(cuffs, inputs.chosen)
    every = 1 if most_frames is None else math.ceil(len(kinematics.time) / most_frames)
    assessment = assess(model, kinematics, suit, worn, every=every, draws=draws, progress=progress)
    other = inputs.read_beside(model)
    beside = None
    if other is not None:
        what, loaded, moving = other
        every = math.ceil(len(moving.time) / min(most_frames or BESIDE_FRAMES, BESIDE_FRAMES))
        short = inputs.read_suit(BESIDE_REST_LENGTHS)
        beside = what, assess(loaded, moving, short, worn, every=every, draws=0)
    return AssessedSuit(assessment, beside, emg, inputs.hashes())


def assess_file(inputs: AssessmentInputs, output: Path, draws: int = 200, progress: Progress = silent) -> AssessedSuit:
    """cuffs.json → assessment.json and activations.csv in the output folder."""
    assessed = assess_cuffs(read_cuffs_to_wear(inputs.cuffs), inputs, draws=draws, progress=progress)
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
    """assessment.json and, for the figures, activations.csv."""
    folder.mkdir(parents=True, exist_ok=True)
    plain: dict[str, Any] = plain_assessment(assessed.assessment)
    if assessed.beside:
        what, other = assessed.beside
        plain["beside"] = {"motion": what, **plain_assessment(other)}
    plain["findings"] = findings(assessed.assessment)
    plain["emg"] = plain_emg(assessed.emg)
    plain["inputs"] = assessed.inputs
    plain["versions"] = {name: metadata.version(name) for name in ("cuffstation", "numpy", "scipy", "clarabel")}
    write_whole(folder / "assessment.json", json.dumps(plain, indent=2, ensure_ascii=False, allow_nan=False) + "\n")
    write_whole(folder / ACTIVATIONS_FILE, activations_table(assessed.assessment))


def write_whole(path: Path, text: str) -> None:
    """The whole file or the one that was there before, never half of it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_name(f".{path.name}.draft")
    draft.write_text(text, encoding="utf-8", newline="\n")
    os.replace(draft, path)  # noqa: PTH105  (says what it does)


def _kinematics(model: Model, motion_file: Path, cut: MotionCut) -> Kinematics:
    whole = differentiate(read_motion(motion_file, model), cut.cutoff_hz, cut.start, cut.end)
    return thin(whole, cut.every)


def _counted(paths: Sequence[Path], what: str, progress: Progress) -> Iterator[Path]:
    for done, path in enumerate(paths):
        progress(what, done, len(paths))
        yield path
    progress(what, len(paths), len(paths))

"""Cuffs → suit on a model → assessment.json, in lines that read like the picture in the README."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from fitting.seal import Standing
from fitting.wearable_cuff import WearableCuff
from recordings.manifest import DataOrigin
from solver.redundancy.motion import RedundancyOptions
from solver.suit.assessment import Assessment, assess
from station.assessment.assessment_file import FORMAT, AssessmentDocument
from station.assessment.assessment_inputs import (
    AssessmentInputs,
    ensure_folder,
    read_cuffs_to_wear,
    standing_of_cuffs,
    worn_cuffs,
)
from station.assessment.assessment_json import (
    ACTIVATIONS_FILE,
    ASSESSMENT_FILE,
    activations_table,
    plain_assessment,
    plain_cuffs,
    plain_emg,
)
from station.assessment.emg import MeasuredReduction
from station.assessment.findings import findings
from station.checksums import write_checksums
from station.progress import Progress, silent
from station.versions import solving_versions
from station.whole_file import write_whole

BESIDE_FRAMES, BESIDE_REST_LENGTHS = 40, 16
"""How much is solved of the motion that stands beside the assessed one."""


@dataclass(frozen=True)
class AssessedSuit:
    """The cuffs worn, an assessment, a short one of another motion (its name first) or None, measured EMG, what went
    in, and how the cuffs' file stood to what was recorded of it.
    """

    cuffs: tuple[WearableCuff, ...]
    assessment: Assessment
    beside: tuple[str, Assessment] | None
    emg: tuple[MeasuredReduction, ...]
    inputs: dict[str, str]
    cuffs_standing: Standing

    @property
    def origin(self) -> DataOrigin:
        """Of the cuffs' data: simulated if any of them is."""
        return DataOrigin.joined(fit.origin for fit in self.cuffs)


def assess_cuffs(
    cuffs: dict[str, WearableCuff],
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
    options = RedundancyOptions(path_mode=inputs.paths)
    beside = None
    other = inputs.read_beside(model)
    if other is not None:  # the short one first: what is wrong with its motion is told at once
        what, loaded, moving = other
        every = math.ceil(len(moving.time) / min(most_frames or BESIDE_FRAMES, BESIDE_FRAMES))
        short = inputs.read_suit(BESIDE_REST_LENGTHS)
        count = partial(_count_beside, progress)
        beside = what, assess(loaded, moving, short, worn, every=every, draws=0, options=options, progress=count)
    assessment = assess(
        model,
        kinematics,
        suit,
        worn,
        every=1 if most_frames is None else math.ceil(len(kinematics.time) / most_frames),
        draws=draws,
        options=options,
        loads=inputs.read_loads(model, kinematics),
        progress=progress,
    )
    fits = tuple(cuffs[each.name] for each in worn)
    return AssessedSuit(fits, assessment, beside, emg, inputs.hashes(), standing_of_cuffs(inputs.cuffs, fits))


def _count_beside(progress: Progress, what: str, done: int, total: int) -> None:
    """The stages of the other motion have names of their own."""
    progress(f"{what}, other motion", done, total)


def assess_file(inputs: AssessmentInputs, output: Path, draws: int = 200, progress: Progress = silent) -> AssessedSuit:
    """cuffs.json → assessment.json and activations.csv in the output folder."""
    ensure_folder(output)
    assessed = assess_cuffs(read_cuffs_to_wear(inputs.cuffs, inputs.chosen), inputs, draws=draws, progress=progress)
    write_assessment(assessed, output)
    return assessed


def write_assessment(assessed: AssessedSuit, folder: Path) -> None:
    """assessment.json and, for the figures, activations.csv."""
    folder.mkdir(parents=True, exist_ok=True)
    plain: dict[str, Any] = {
        "format": FORMAT,
        "origin": assessed.origin,
        "cuffs": plain_cuffs(assessed.cuffs),
        **plain_assessment(assessed.assessment),
    }
    if assessed.beside:
        what, other = assessed.beside
        plain["beside"] = {"motion": what, **plain_assessment(other)}
    plain["findings"] = findings(assessed.assessment)
    plain["emg"] = plain_emg(assessed.emg)
    plain["inputs"] = assessed.inputs
    plain["inputs_checked"] = {"cuffs": assessed.cuffs_standing}
    plain["versions"] = solving_versions()
    AssessmentDocument.model_validate(plain)
    write_whole(folder / ASSESSMENT_FILE, json.dumps(plain, indent=2, ensure_ascii=False, allow_nan=False) + "\n")
    write_whole(folder / ACTIVATIONS_FILE, activations_table(assessed.assessment))
    write_checksums(folder / ASSESSMENT_FILE, folder / ACTIVATIONS_FILE)

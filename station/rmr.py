"""A motion → the activations that carry it: the muscle-redundancy problem from files to a table."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

import numpy as np

from solver.bundled import bundled_model
from solver.loads import data_file, read_external_loads
from solver.model import Model
from solver.motion import Kinematics, differentiate, read_motion, thin
from solver.osim.reader import read_osim
from solver.raise_arm import raise_arm
from solver.redundancy import FrameOutcome, Redundancy, RedundancyOptions, solve_motion
from station.effort import read_effort
from station.progress import Progress, silent

STATUS = tuple(FrameOutcome)
"""A frame's status in a table is its outcome's place in here."""


@dataclass(frozen=True)
class MotionCut:
    """Which part of a motion is solved, times in seconds; cutoff_hz is the low-pass filter's, None without one."""

    cutoff_hz: float | None = 3.0
    start: float | None = None
    end: float | None = None
    every: int = 1


@dataclass(frozen=True)
class MuscleInputs:
    """The files of the problem; a motion of None and the model "bundled" come with the solver."""

    motion: Path | None = None
    model: str = "bundled"
    external_loads: Path | None = None
    effort: Path | None = None

    def hashes(self) -> dict[str, str]:
        """Role → "name SHA-256", or a name alone for what comes with the station."""
        files = {"motion": self.motion, "external_loads": self.external_loads, "effort": self.effort}
        if self.external_loads is not None:
            files["external_loads_data"] = data_file(self.external_loads)
        if self.model != "bundled":
            files["model"] = Path(self.model)
        named = {
            role: f"{path.name} {hashlib.sha256(path.read_bytes()).hexdigest()}" for role, path in files.items() if path
        }
        return {"model": "bundled thoracoscapular model", "motion": "bundled raise of the arm", **named}


@dataclass(frozen=True)
class SolvedMotion:
    """Who did the work, in which model, and in `notes` what a reader of the numbers must know to make them again."""

    model: Model
    options: RedundancyOptions
    solution: Redundancy
    notes: Mapping[str, str]


def solve_muscles(
    inputs: MuscleInputs, cut: MotionCut, options: RedundancyOptions, progress: Progress = silent
) -> SolvedMotion:
    """Files → muscle activations and what comes with them. An effort file overrules the weights of the options."""
    model = bundled_model() if inputs.model == "bundled" else read_osim(Path(inputs.model))
    if inputs.effort is not None:
        model, options = read_effort(inputs.effort).applied(model, options)
    motion = raise_arm(model) if inputs.motion is None else read_motion(inputs.motion, model)
    whole = differentiate(motion, cut.cutoff_hz, cut.start, cut.end)
    kinematics = thin(whole, cut.every)
    loads = read_external_loads(inputs.external_loads, model, kinematics.time) if inputs.external_loads else ()
    solution = solve_motion(
        model, kinematics, options, lambda done, total: progress("solving muscles", done, total), loads
    )
    return SolvedMotion(model, options, solution, inputs.hashes() | _notes(kinematics, options))


def unsolved_in_words(solution: Redundancy) -> list[str]:
    """A sentence for each way in which frames did not come out solved; of infeasible ones, the smallest violation."""
    sentences = []
    for outcome in STATUS[1:]:
        frames = [index for index, each in enumerate(solution.outcomes) if each is outcome]
        if not frames:
            continue
        words = f"{len(frames)} of {len(solution.outcomes)} frames, the first at {solution.time[frames[0]]:g} s: "
        words += outcome.value
        if outcome is FrameOutcome.INFEASIBLE:
            outside = np.maximum(-solution.cone_slack[frames], 0.0)
            missed = solution.equality_residual[frames].max()
            words += f"; the smallest violation leaves it by up to {outside.max():.3g} N and misses accelerations by "
            words += f"up to {missed:.3g} rad/s² or m/s²"
        sentences.append(words)
    return sentences


def _notes(kinematics: Kinematics, options: RedundancyOptions) -> dict[str, str]:
    """In single lines without an equals sign, which OpenSim's files set apart."""
    weights = {
        "muscles": options.muscle_weight,
        "reserves": options.reserve_weight,
        "unweighted": options.unweighted_coordinates,
        "single": dict(options.weights),
    }
    glenoid = (
        f"reaction kept inside, aspect {options.glenoid_aspect:g}" if options.has_glenoid_cone else "not asked for"
    )
    packages = ("cuffstation", "numpy", "scipy", "numba", "clarabel")
    return {
        "made_by": "station rmr",
        "versions": ", ".join(f"{name} {metadata.version(name)}" for name in packages),
        "filter": kinematics.filter,
        "interval_s": f"{kinematics.interval:.10g}",
        "weights": json.dumps(weights),
        "joint": options.joint,
        "glenoid": glenoid,
        "paths": options.path_mode,
        "free_coordinates": ", ".join(options.free_coordinates) or "none",
        "status_codes": ", ".join(f"{code} {outcome.name.lower()}" for code, outcome in enumerate(STATUS)),
    }

"""A motion → the activations that carry it: the muscle-redundancy problem from files to a file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from solver.bundled import bundled_model
from solver.model import Model
from solver.motion import Kinematics, differentiate, read_motion, thin, write_table
from solver.osim.reader import read_osim
from solver.redundancy import Redundancy, RedundancyOptions, solve_motion
from station.progress import Progress, silent


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


def _kinematics(model: Model, motion_file: Path, cut: MotionCut) -> Kinematics:
    whole = differentiate(read_motion(motion_file, model), cut.cutoff_hz, cut.start, cut.end)
    return thin(whole, cut.every)

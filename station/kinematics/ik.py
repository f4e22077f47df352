"""Markers → postures: inverse kinematics from files to a motion file and a table."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recordings.exchange.trc import read_trc
from solver.inverse_kinematics.solve import InverseKinematics, PostureOutcome, TrackingTasks, solve_inverse_kinematics
from solver.inverse_kinematics.uncertainty import PostureUncertainty, estimate_marker_noise, posture_uncertainty
from solver.model import Model, ModelError
from solver.motion import MotionError, write_table
from solver.osim.ik_setup import IkSetup, read_ik_setup
from station.assessment.sources import model_of
from station.whole_file import drafted

Array = NDArray[np.float64]

LEAST_NOISE = 1e-5
"""m; markers that were written with few digits show less than this."""


@dataclass(frozen=True)
class IkInputs:
    """Files of a trial. model and markers may come from the set-up; without a set-up every marker that model and file
    share is followed, with weight 1. start, end [s] narrow the set-up's time range. noise [m] is the standard deviation
    of a marker along each axis, None: as found in the markers.
    """

    model: str | None
    markers: Path | None
    setup: Path | None
    start: float = -math.inf
    end: float = math.inf
    noise: float | None = None


@dataclass(frozen=True, eq=False)
class SolvedPostures:
    """Postures of a trial at time (frames,) [s], with what they follow and how well they are known.

    noise  (markers,) [m] that was used, in the order of tasks.markers;  notes on what was read otherwise than written
    """

    model: Model
    time: Array
    tasks: TrackingTasks
    solution: InverseKinematics
    uncertainty: PostureUncertainty
    noise: Array
    notes: tuple[str, ...]

    @property
    def is_whole(self) -> bool:
        return self.solution.unsolved == 0


def solve_postures(inputs: IkInputs) -> SolvedPostures:
    """Raises ModelError, MotionError, ForeignFile for files that do not fit together."""
    setup = None if inputs.setup is None else read_ik_setup(inputs.setup)
    model = model_of(str(inputs.model or named_file(setup.model_file if setup else None, "model", "--model")))
    file = inputs.markers or named_file(setup.marker_file if setup else None, "markers' file", "--markers")
    table = read_trc(file, tracked=setup.markers if setup else [marker.name for marker in model.markers])
    low, high = setup.time_range if setup else (-math.inf, math.inf)
    kept = (table.time_s >= max(low, inputs.start) - 1e-6) & (table.time_s <= min(high, inputs.end) + 1e-6)
    if not kept.any():
        raise MotionError(
            f"{file.name} has no frame between {inputs.start:g} and {inputs.end:g} s; choose other limits"
        )
    time = table.time_s[kept]
    setup = setup or IkSetup((-math.inf, math.inf), dict.fromkeys(table.labels, 1.0), {}, None, None, None)
    tasks = setup.tasks(model, table.labels, time)
    columns = [table.labels.index(marker.name) for marker in tasks.markers]
    observed = 1e-3 * table.positions[kept][:, columns]
    solution = solve_inverse_kinematics(model, observed, tasks)
    noise = _noise(observed) if inputs.noise is None else np.full(len(columns), inputs.noise)
    uncertainty = posture_uncertainty(model, observed, tasks, solution, noise)
    return SolvedPostures(model, time, tasks, solution, uncertainty, noise, table.notes)


def write_postures(path: Path, solved: SolvedPostures) -> None:
    """The coordinates in radians and metres, as .mot, .sto or .csv; frames without a posture are left out."""
    known = np.isfinite(solved.solution.coordinates[:, 0])
    names, notes = solved.model.coordinate_names, {"made_by": "station ik"}
    with drafted(path) as draft:
        write_table(draft, names, solved.time[known], solved.solution.coordinates[known], notes)


def summary(solved: SolvedPostures) -> list[str]:
    """What a person wants to know of it, line by line."""
    solution, uncertainty = solved.solution, solved.uncertainty
    frames = len(solved.time)
    rms = 1e3 * math.sqrt(float(np.nanmean(solution.residuals**2)))
    lines = [f"{frames} frames, {frames - solution.unsolved} solved; markers {rms:.1f} mm from the model's (RMS)"]
    for outcome in (each for each in PostureOutcome if each is not PostureOutcome.SOLVED):
        found = [frame for frame, each in enumerate(solution.outcomes) if each is outcome]
        if found:
            lines.append(f"{len(found)} frames {outcome.replace('_', ' ')}, the first at {solved.time[found[0]]:g} s")
    worst = np.nanmax(solution.residuals, axis=0, initial=0.0)
    order = np.argsort(worst)[::-1][:3]
    far = ", ".join(f"{solved.tasks.markers[m].name} {1e3 * worst[m]:.0f} mm" for m in order)
    lines.append(f"farthest markers: {far}; noise {1e3 * np.median(solved.noise):.2f} mm")
    known = np.isfinite(solution.coordinates[:, 0])
    for k, coordinate in enumerate(solved.model.coordinates):
        loose = int((~uncertainty.is_held[known, k]).sum())
        if loose:
            lines.append(f"no marker holds {coordinate.name} in {loose} frames: its value there is not measured")
    return lines


def _noise(observed: Array) -> Array:
    """Of each marker; of one that is never seen for long, that of the others."""
    found = np.maximum(estimate_marker_noise(observed), LEAST_NOISE)
    usual = float(np.nanmedian(found)) if np.isfinite(found).any() else LEAST_NOISE
    return np.where(np.isfinite(found), found, usual)


def named_file(path: Path | None, what: str, option: str) -> Path:
    if path is None:
        raise ModelError(f"which {what} is not said: neither the set-up nor {option} names one; add {option}")
    return path

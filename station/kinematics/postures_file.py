"""What `station ik` writes: the motion, a table of its frames, and a report for programs."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from solver.coded_findings import CoverageCode
from solver.inverse_kinematics.smoother import SmoothedMotion, SmootherOutcome
from solver.inverse_kinematics.solve import PostureOutcome
from solver.time_series_table import write_table
from station.kinematics.ik import SolvedPostures
from station.kinematics.marker_checks import finding_lines
from station.messages.codes import KinematicsCode
from station.sources import BUNDLED, named_hash
from station.whole_file import drafted, write_whole

Array = NDArray[np.float64]


class IkFinding(BaseModel):
    """A finding with its figures; units are in the keys."""

    model_config = ConfigDict(frozen=True)

    code: KinematicsCode | CoverageCode
    figures: dict[str, float | str]


class IkMarker(BaseModel):
    """A marker over the frames that show it; null for one that is never seen."""

    model_config = ConfigDict(frozen=True, allow_inf_nan=False)

    frames: int
    residual_rms_m: float | None
    residual_max_m: float | None
    noise_m: Annotated[float, Field(description="standard deviation along each axis that was used")]


class IkCoordinate(BaseModel):
    """Median standard deviation over the frames that determine the coordinate, and the number of other frames."""

    model_config = ConfigDict(frozen=True, allow_inf_nan=False)

    standard_deviation: Annotated[float | None, Field(description="rad or m")]
    frames_not_held: int


class IkDocument(BaseModel):
    """The report of an inverse kinematics, `*_ik.json`."""

    model_config = ConfigDict(frozen=True, allow_inf_nan=False)

    format: Literal[1] = 1
    sources: Annotated[dict[str, str], Field(description='role → "name SHA-256"')]
    frames: int
    outcomes: dict[PostureOutcome, int]
    residual_rms_m: float | None
    largest_gap: Annotated[float | None, Field(description="m or rad; of the constraints")]
    markers: dict[str, IkMarker]
    coordinates: dict[str, IkCoordinate]
    findings: list[IkFinding]
    smoother: Annotated[SmootherOutcome | None, Field(description="null unless the trial was smoothed")] = None


def result_files(path: Path, *, is_smoothed: bool) -> list[Path]:
    """The motion and the files of the same name: report, table of frames, and the speeds of a smoothed trial."""
    endings = ["_ik.json", "_ik_frames.csv", *["_ik_kinematics.csv"] * is_smoothed]
    return [path, *(path.with_name(f"{path.stem}{ending}") for ending in endings)]


def write_postures(path: Path, solved: SolvedPostures) -> None:
    """Write the motion, and into the same folder the table *_ik_frames.csv and the report *_ik.json.

    Of a smoothed trial the motion is the smoothed one, and *_ik_kinematics.csv has its speeds and accelerations.
    Coordinates are in radians and metres. Frames without a posture are left out of the motion; the table has all.
    """
    names, notes = solved.model.coordinate_names, {"made_by": "station ik"}
    smoothed = solved.smoothed
    _, *beside = result_files(path, is_smoothed=smoothed is not None)
    texts = [plain_postures(solved).model_dump_json(indent=1) + "\n", frames_of(solved).to_csv(index=False)]
    if smoothed is not None:
        texts.append(kinematics_of(solved, smoothed).to_csv(index=False))
    coordinates = solved.solution.coordinates if smoothed is None else smoothed.positions
    known = np.isfinite(coordinates[:, 0])
    with drafted(path) as draft:
        write_table(draft, names, solved.time[known], coordinates[known], notes)
    for file, text in zip(beside, texts, strict=True):
        write_whole(file, text)


def plain_postures(solved: SolvedPostures) -> IkDocument:
    solution, uncertainty = solved.solution, solved.uncertainty
    known = np.isfinite(solution.coordinates[:, 0])
    markers = {
        marker.name: IkMarker(
            frames=int(np.isfinite(residuals).sum()),
            residual_rms_m=_finite(_rms(residuals)),
            residual_max_m=_finite(float(np.nanmax(residuals, initial=-math.inf))),
            noise_m=float(noise),
        )
        for marker, residuals, noise in zip(solved.tasks.markers, solution.residuals.T, solved.noise, strict=True)
    }
    coordinates = {
        name: IkCoordinate(
            standard_deviation=_finite(float(np.median(deviations[held]))) if held.any() else None,
            frames_not_held=int((~held & known).sum()),
        )
        for name, deviations, held in zip(
            solved.model.coordinate_names, uncertainty.standard_deviation.T, uncertainty.is_held.T & known, strict=True
        )
    }
    return IkDocument(
        sources={role: name if name == BUNDLED else named_hash(Path(name)) for role, name in solved.sources.items()},
        frames=len(solved.time),
        outcomes=dict(Counter(solution.outcomes)),
        residual_rms_m=_finite(_rms(solution.residuals)),
        largest_gap=_finite(float(np.nanmax(solution.gap, initial=-math.inf))),
        markers=markers,
        coordinates=coordinates,
        findings=[
            IkFinding.model_validate({"code": found.code, "figures": dict(found.figures)}) for found in solved.findings
        ],
        smoother=None if solved.smoothed is None else solved.smoothed.outcome,
    )


def frames_of(solved: SolvedPostures) -> pd.DataFrame:
    """A row per frame: outcome, gap, cost, residual of every marker, standard deviation of every coordinate.

    A cell is empty where a marker is hidden or a coordinate is not determined.
    """
    solution = solved.solution
    deviations = np.where(
        np.isfinite(solved.uncertainty.standard_deviation), solved.uncertainty.standard_deviation, np.nan
    )
    columns: dict[str, object] = {
        "time_s": solved.time,
        "outcome": [outcome.value for outcome in solution.outcomes],
        "gap": solution.gap,
        "cost_m2": solution.cost,
    }
    columns |= {f"residual_{m.name}_m": solution.residuals[:, k] for k, m in enumerate(solved.tasks.markers)}
    for k, coordinate in enumerate(solved.model.coordinates):
        unit = "m" if coordinate.motion == "translation" else "rad"
        columns[f"sd_{coordinate.name}_{unit}"] = deviations[:, k]
    return pd.DataFrame(columns)


def kinematics_of(solved: SolvedPostures, smoothed: SmoothedMotion) -> pd.DataFrame:
    """A row per frame: position, speed and acceleration of every coordinate, each with its standard deviation, which is
    empty for a coordinate that no marker determines.
    """
    columns: dict[str, object] = {"time_s": solved.time}
    values = (smoothed.positions, smoothed.speeds, smoothed.accelerations)
    deviations = np.where(np.isfinite(smoothed.standard_deviations), smoothed.standard_deviations, np.nan)
    for k, coordinate in enumerate(solved.model.coordinates):
        unit = "m" if coordinate.motion == "translation" else "rad"
        for derivative, per in enumerate(("", "_per_s", "_per_s2")):
            columns[f"{coordinate.name}_{unit}{per}"] = values[derivative][:, k]
            columns[f"sd_{coordinate.name}_{unit}{per}"] = deviations[derivative][:, k]
    return pd.DataFrame(columns)


def summary(solved: SolvedPostures) -> list[str]:
    """Lines for a person: how well the markers fit, the farthest of them, and the findings."""
    solution = solved.solution
    frames = len(solved.time)
    rms = 1e3 * _rms(solution.residuals)
    worst = np.nanmax(solution.residuals, axis=0, initial=0.0)
    farthest = [f"{solved.tasks.markers[m].name} {1e3 * worst[m]:.0f} mm" for m in np.argsort(worst)[::-1][:3]]
    smoothed = [] if solved.smoothed is None else [_of_smoother(solved.smoothed)]
    return [
        f"{frames} frames, {frames - solution.unsolved} solved; RMS residual of the markers {rms:.1f} mm",
        f"largest residuals: {', '.join(farthest)}; marker noise {1e3 * np.median(solved.noise):.2f} mm",
        *smoothed,
        *finding_lines(solved.findings),
    ]


def _of_smoother(smoothed: SmoothedMotion) -> str:
    if smoothed.outcome is not SmootherOutcome.SOLVED:
        return f"smoothed motion: {smoothed.outcome.value}; do not use its speeds and accelerations"
    deviation = smoothed.standard_deviations[2]
    usual = float(np.median(deviation[np.isfinite(deviation)]))
    return f"smoothed motion: median standard deviation of an acceleration {usual:.2g} rad/s² or m/s²"


def _rms(values: Array) -> float:
    seen = values[np.isfinite(values)]
    return math.sqrt(float(np.mean(seen**2))) if seen.size else math.nan


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None

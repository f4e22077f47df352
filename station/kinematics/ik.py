"""Markers → postures: inverse kinematics from files to a motion, a table of its frames and a report for programs."""

from __future__ import annotations

import math
import os
import xml.etree.ElementTree as Xml
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from documents.interval import counted
from documents.message import Figures, Message
from documents.plain_data import finite_or_none
from recordings.exchange.sample_tables import MarkerTable
from solver.errors import CoverageCode, MotionError, SolverCode
from solver.inverse_kinematics.marker_fit import Vertical, rotation_laboratory_to_ground
from solver.inverse_kinematics.smoother import SmoothedMotion, SmootherOutcome, smooth_motion
from solver.inverse_kinematics.solve import (
    InverseKinematics,
    PostureOutcome,
    PostureUncertainty,
    TrackingTasks,
    estimate_marker_noise,
    posture_uncertainty,
    solve_inverse_kinematics,
)
from solver.model import Array, Model, ModelError
from solver.motion import ensure_interval, limits_outside
from solver.osim.document import read_document
from solver.osim.tool_setups import IkSetup, ik_setup_document, read_ik_setup
from solver.personalisation.coverage import check_coverage
from solver.time_series_table import write_table
from station.checksums import drafted, write_whole
from station.kinematics.marker_checks import (
    Finding,
    KinematicsError,
    ensure_markers_fit,
    find_far_markers,
    find_in_markers,
    find_in_postures,
    find_never_seen,
    finding_lines,
    read_body_markers,
    seen_markers,
    setup_findings,
    unattached_findings,
)
from station.kinematics.marker_sets import place_marker_set
from station.messages.kinematics_messages import KinematicsCode
from station.sources import BUNDLED, named_hash, resolve_model

if TYPE_CHECKING:
    import pandas as pd

MOST_LISTED = 10
WRONG_POSTURES = (KinematicsCode.EXCHANGED, KinematicsCode.FAR)
LEAST_SMOOTHED = 3
LEAST_NOISE = 1e-5
"""m; markers that were written with few digits show less than this."""


@dataclass(frozen=True)
class IkInputs:
    """Files of a trial. model and markers may come from the set-up; without a set-up every marker that model and file
    share is followed, with weight 1. start, end [s] replace those of the set-up's time range. noise [m] is the standard
    deviation of a marker along each axis, None: as found in the markers. prefix stands before the labels of the person.
    vertical is the upward axis of the file; where it is not y, the markers are turned into the ground of the model.
    marker_set is the name or the file of a set whose markers the model is to have (marker_sets.toml). is_smoothed: the
    trial is smoothed as a whole, too.
    """

    model: str | None
    markers: Path | None
    setup: Path | None
    start: float | None = None
    end: float | None = None
    noise: float | None = None
    prefix: str = ""
    vertical: Vertical = "y"
    marker_set: str = ""
    is_smoothed: bool = False


@dataclass(frozen=True, eq=False)
class SolvedPostures:
    """Postures of a trial at time (frames,) [s], with what they follow and how well they are known.

    sources   role ("model", "markers", "setup") → file or name
    setup     what was solved, as OpenSim's set-up
    observed  (frames, markers, 3) [m] in ground, in the order of tasks.markers;  noise (markers,) [m] that was used
    smoothed  the trial as a whole, where that was asked for
    findings  on markers and postures;  notes on what was read otherwise than written
    """

    sources: dict[str, str]
    setup: IkSetup
    model: Model
    time: Array
    tasks: TrackingTasks
    observed: Array
    solution: InverseKinematics
    uncertainty: PostureUncertainty
    noise: Array
    smoothed: SmoothedMotion | None
    findings: tuple[Finding, ...]
    notes: tuple[str, ...]

    @property
    def is_whole(self) -> bool:
        """Whether every frame is solved, the smoother settled, no labels are exchanged and no marker is far off."""
        is_wrong = any(finding.code in WRONG_POSTURES for finding in self.findings)
        settled = self.smoothed is None or self.smoothed.outcome is SmootherOutcome.SOLVED
        return self.solution.unsolved == 0 and settled and not is_wrong


def solve_postures(inputs: IkInputs) -> SolvedPostures:
    """Raises KinematicsError, MarkerSetError, ModelError, MotionError or ForeignFile for files that do not fit."""
    setup = None if inputs.setup is None else read_ik_setup(inputs.setup)
    name = str(inputs.model or named_file(inputs.setup, setup.model_file if setup else None, "model", "--model"))
    model, names, findings = model_with_markers(name, inputs.marker_set)
    file = inputs.markers or named_file(
        inputs.setup, setup.marker_file if setup else None, "markers' file", "--markers"
    )
    followed = [task for task, weight in setup.markers.items() if weight > 0] if setup else names
    table = read_body_markers(file, followed, inputs.prefix)
    span, on_range = _time_range(inputs, setup)
    kept = frames_in(file, table, span, "--from and --to, or the set-up's time_range")
    on_range += _uncovered(file, table, span)
    known = [marker.name for marker in model.markers]
    ensure_common(file.name, table.labels, followed, known)
    expected = [marker for marker in followed if marker in known and (setup or marker in table.labels)]
    setup = setup or IkSetup((-math.inf, math.inf), dict.fromkeys(expected, 1.0), {}, None, None, None)
    setup = replace(setup, model_file=None if name == BUNDLED else Path(name), marker_file=file)
    time = table.time_s[kept]
    tasks = setup.tasks(model, table.labels, time)
    observed = markers_in_ground(model, table, tasks, kept, inputs.vertical)
    if inputs.setup is not None:
        findings += setup_findings(inputs.setup.name, setup, setup.without_place(model))
    findings += on_range + ensure_markers_fit(model, file.name, expected, tasks, observed)
    solution = solve_inverse_kinematics(model, observed, tasks)
    noise = _noise(time, observed) if inputs.noise is None else np.full(len(tasks.markers), inputs.noise)
    uncertainty = posture_uncertainty(model, observed, tasks, solution, noise)
    findings += find_in_markers(time, tasks, observed) + find_far_markers(time, tasks, solution)
    findings += find_in_postures(model, time, solution, uncertainty)
    seen = seen_markers(tasks.markers, observed)
    findings += find_never_seen(expected, seen) + tuple(Message(code) for code in check_coverage(model, seen))
    smoothed = _smoothed(model, time, observed, tasks, noise) if inputs.is_smoothed else None
    sources = {"model": name, "markers": str(file)} | ({"setup": str(inputs.setup)} if inputs.setup else {})
    return SolvedPostures(
        sources, setup, model, time, tasks, observed, solution, uncertainty, noise, smoothed, findings, table.notes
    )


def _smoothed(model: Model, time: Array, observed: Array, tasks: TrackingTasks, noise: Array) -> SmoothedMotion:
    """Raises MotionError where frames are missing from the file, or the range has too few."""
    if len(time) < LEAST_SMOOTHED:
        raise MotionError(
            f"a trial that is smoothed needs at least {LEAST_SMOOTHED} frames, and {len(time)} lie between "
            f"{time[0]:g} and {time[-1]:g} s; choose a longer range",
            SolverCode.NO_FRAMES,
        )
    steps = np.diff(time)
    if steps.max() > 1.5 * np.median(steps):
        raise MotionError(
            "a trial that is smoothed needs every frame; leave a missing marker empty, and keep its row",
            SolverCode.NOT_COVERED,
        )
    return smooth_motion(model, observed, float(np.median(steps)), tasks, noise)


def _time_range(inputs: IkInputs, setup: IkSetup | None) -> tuple[tuple[float, float], tuple[Finding, ...]]:
    """The range [s] that is solved: of the command line before that of the set-up; and a finding where they differ."""
    ensure_interval(-math.inf if inputs.start is None else inputs.start, math.inf if inputs.end is None else inputs.end)
    low, high = setup.time_range if setup else (-math.inf, math.inf)
    first, last = low if inputs.start is None else inputs.start, high if inputs.end is None else inputs.end
    is_overridden = (math.isfinite(low) and first != low) or (math.isfinite(high) and last != high)
    figures = {"setup_range": range_text(low, high), "range": range_text(first, last)}
    return (first, last), (Message(KinematicsCode.OTHER_RANGE, figures),) if is_overridden else ()


def range_text(first: float, last: float) -> str:
    """A range of time [s] that may be open at an end: `from 0.5 to 2 s`, `from 0.5 s on`, `up to 2 s`."""
    if math.isinf(first) and math.isinf(last):
        return "of all times"
    if math.isinf(last):
        return f"from {first:g} s on"
    return f"up to {last:g} s" if math.isinf(first) else f"from {first:g} to {last:g} s"


def frames_in(
    file: Path, table: MarkerTable, span: tuple[float, float], named_by: str = "the set-up's time_range"
) -> NDArray[np.bool_]:
    """(frames,) of the file within the range [s]. Raises MotionError where there is none."""
    first, last = span
    kept = (table.time_s >= first - 1e-6) & (table.time_s <= last + 1e-6)
    if not kept.any():
        raise MotionError(
            f"{file.name} lasts from {table.time_s[0]:g} to {table.time_s[-1]:g} s and has no frame "
            f"{range_text(first, last)}; correct {named_by}",
            SolverCode.NO_FRAMES,
        )
    return np.asarray(kept)


def _uncovered(file: Path, table: MarkerTable, span: tuple[float, float]) -> tuple[Finding, ...]:
    """A finding where a limit of the range [s] lies outside the file."""
    outside, time = limits_outside(table.time_s, *span), table.time_s
    figures: Figures = {"file": file.name, "range": outside, "first_s": float(time[0]), "last_s": float(time[-1])}
    return (Message(KinematicsCode.RANGE_NOT_COVERED, figures),) if outside else ()


def model_with_markers(name: str, marker_set: str) -> tuple[Model, list[str], tuple[Finding, ...]]:
    """The model, the names of the markers to follow unless a set-up names others, and findings on the marker set."""
    return with_marker_set(resolve_model(name, ignore_forces=True), marker_set)  # postures do not depend on forces


def with_marker_set(model: Model, marker_set: str) -> tuple[Model, list[str], tuple[Finding, ...]]:
    """The same of a model that is there already."""
    on_model = unattached_findings(f"the file of {model.name}", model.unattached)
    if not marker_set:
        return model, [marker.name for marker in model.markers], on_model
    model, names, findings = place_marker_set(model, marker_set)
    return model, names, on_model + findings


def ensure_common(file: str, labels: Sequence[str], followed: Sequence[str], known: Sequence[str]) -> None:
    """Raises KinematicsError where no marker is in the file, followed by the set-up, and known to the model."""
    if not set(labels) & set(followed) & set(known):
        lists = {"followed": followed, "known": known, "found": labels}
        shown = {name: _listed(labels) for name, labels in lists.items()}
        raise KinematicsError(Message(KinematicsCode.NONE_IN_COMMON, {"file": file, **shown}))


def markers_in_ground(
    model: Model, table: MarkerTable, tasks: TrackingTasks, kept: NDArray[np.bool_], vertical: Vertical
) -> Array:
    """(frames, markers, 3) [m] in the ground of the model."""
    columns = [table.labels.index(marker.name) for marker in tasks.markers]
    observed: Array = 1e-3 * table.positions[kept][:, columns]
    if vertical == "y":
        return observed
    return observed @ rotation_laboratory_to_ground(model, tasks.markers, observed, vertical).T


def write_ik_setup(path: Path, solved: SolvedPostures, motion: Path) -> None:
    """OpenSim's InverseKinematicsTool for what was solved; motion is the file that OpenSim is to write."""
    weights = zip(solved.tasks.markers, solved.tasks.weights, strict=True)
    followed = {marker.name: float(weight) for marker, weight in weights}
    span = (float(solved.time[0]), float(solved.time[-1]))
    setup = replace(solved.setup, time_range=span, markers=followed)
    write_xml(path, ik_setup_document(setup, path.parent, f"{motion.stem}_opensim.mot"))


def write_xml(path: Path, root: Xml.Element) -> None:
    with drafted(path) as draft:
        Xml.indent(root)
        Xml.ElementTree(root).write(draft, encoding="utf-8", xml_declaration=True)


def named_file(setup: Path | None, path: Path | None, what: str, option: str) -> Path:
    """The file that the set-up names. Raises ModelError where it names none, or one that is not there."""
    if path is None or setup is None:
        raise ModelError(
            f"no {what} is given: neither the set-up nor {option} names one; add {option}", SolverCode.NOT_NAMED
        )
    if not os.path.exists(path):  # noqa: PTH110  (False also for a name that is too long)
        line = read_document(setup).line_naming(path)
        raise ModelError(
            f"{setup.name}, line {line}, names the {what} {path.name}, which is not there; correct the path, put the "
            f"file into the set-up's folder, or give {option}",
            SolverCode.UNREADABLE_FILE,
        )
    return path


def _listed(labels: Sequence[str]) -> str:
    return ", ".join(sorted(labels)[:MOST_LISTED]) + ", …" * (len(labels) > MOST_LISTED) or "none"


def _noise(time: Array, observed: Array) -> Array:
    """Of each marker; of one that is never seen for long, that of the others."""
    interval = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
    found = np.maximum(estimate_marker_noise(observed, interval), LEAST_NOISE)
    usual = float(np.nanmedian(found)) if np.isfinite(found).any() else LEAST_NOISE
    return np.where(np.isfinite(found), found, usual)


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
    texts = [ik_document(solved).model_dump_json(indent=1) + "\n", tabulate_frames(solved).to_csv(index=False)]
    if smoothed is not None:
        texts.append(tabulate_kinematics(solved, smoothed).to_csv(index=False))
    coordinates = solved.solution.coordinates if smoothed is None else smoothed.positions
    known = np.isfinite(coordinates[:, 0])
    with drafted(path) as draft:
        write_table(draft, names, solved.time[known], coordinates[known], notes)
    for file, text in zip(beside, texts, strict=True):
        write_whole(file, text)


def ik_document(solved: SolvedPostures) -> IkDocument:
    solution, uncertainty = solved.solution, solved.uncertainty
    known = np.isfinite(solution.coordinates[:, 0])
    markers = {
        marker.name: IkMarker(
            frames=int(np.isfinite(residuals).sum()),
            residual_rms_m=finite_or_none(_rms(residuals)),
            residual_max_m=finite_or_none(float(np.nanmax(residuals, initial=-math.inf))),
            noise_m=float(noise),
        )
        for marker, residuals, noise in zip(solved.tasks.markers, solution.residuals.T, solved.noise, strict=True)
    }
    coordinates = {
        name: IkCoordinate(
            standard_deviation=finite_or_none(float(np.median(deviations[held]))) if held.any() else None,
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
        residual_rms_m=finite_or_none(_rms(solution.residuals)),
        largest_gap=finite_or_none(float(np.nanmax(solution.gap, initial=-math.inf))),
        markers=markers,
        coordinates=coordinates,
        findings=[
            IkFinding.model_validate({"code": found.code, "figures": dict(found.figures)}) for found in solved.findings
        ],
        smoother=None if solved.smoothed is None else solved.smoothed.outcome,
    )


def tabulate_frames(solved: SolvedPostures) -> pd.DataFrame:
    """A row per frame: outcome, gap, cost, residual of every marker, standard deviation of every coordinate.

    A cell is empty where a marker is hidden or a coordinate is not determined.
    """
    import pandas as pd  # the live process, which fits postures as well, has no tables

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


def tabulate_kinematics(solved: SolvedPostures, smoothed: SmoothedMotion) -> pd.DataFrame:
    """A row per frame: position, speed and acceleration of every coordinate, each with its standard deviation, which is
    empty for a coordinate that no marker determines.
    """
    import pandas as pd  # as above

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
        f"{counted(frames, 'frame')}, {frames - solution.unsolved} solved; RMS residual of the markers {rms:.1f} mm",
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

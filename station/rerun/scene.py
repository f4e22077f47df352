"""What a fit and an assessment add to a trial in Rerun: plateaus, fitted line, and the body with its muscles."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from fitting.curves import TrialCurves
from fitting.session import fit_session
from fitting.trial import read_trial
from recordings.reader import open_recording
from recordings.samples import Event
from solver.bundled import bundled_model
from solver.kinematics import Postures, points_in_ground, postures
from solver.model import ConditionalPathPoint, Model, PathPoint
from solver.motion import differentiate, thin
from solver.raise_arm import raise_arm
from solver.wearing.suit import SuitPoint, read_suit
from station.muscles.assessment_json import ACTIVATIONS_FILE

Array = NDArray[np.float64]
POINTS_A_SECOND = 25
SHOWN_CONDITION = "both"
"""Cuffs that yield and have shifted: what a wearer feels in the end."""
IDLE, BUSY = np.array([60, 90, 160]), np.array([215, 40, 30])
"""Colours of a muscle at rest and at full activation."""


def log_scene(stream: rr.RecordingStream, recording: Path) -> None:
    """Adds the fit of one recording, and the model where its folder holds an assessment, at the trial's own times."""
    edge_ns = _edge_host_ns(recording)
    trial = read_trial(recording)
    curves = fit_session([trial]).curves.get(trial.file)
    if curves is not None:
        _log_fit(stream, curves, edge_ns)
    activations = recording.parent / ACTIVATIONS_FILE
    if activations.is_file():
        _log_body(stream, activations, edge_ns)


def _edge_host_ns(recording: Path) -> int:
    for item in open_recording(recording).items():
        if isinstance(item, Event) and item.kind == "sync_edge":
            return item.host_time_ns
    return open_recording(recording).manifest.start_utc_ns


def _log_fit(stream: rr.RecordingStream, curves: TrialCurves, edge_ns: int) -> None:
    displacement = np.isfinite(curves.displacement)
    _curve(
        stream,
        "fit/displacement_mm",
        edge_ns,
        curves.marker_time[displacement],
        1e3 * curves.displacement[displacement],
    )
    _curve(stream, "fit/force_n", edge_ns, curves.force_time, curves.force)
    if curves.static is not None:
        held = [(plateau.start, plateau.end, plateau.force) for plateau in curves.static.plateaus]
        for start, end, force in held:
            _curve(stream, "fit/plateaus_n", edge_ns, np.array([start, end]), np.array([force, force]))
    if curves.dynamic is not None:
        dynamic = curves.dynamic
        fitted = (
            dynamic.stiffness.value * dynamic.displacement + dynamic.damping.value * dynamic.velocity + dynamic.offset
        )
        _curve(stream, "fit/fitted_force_n", edge_ns, dynamic.time, fitted)


def _curve(stream: rr.RecordingStream, path: str, edge_ns: int, time: Array, values: Array) -> None:
    """One scalar curve, as dense as an eye wants it."""
    step = max(1, len(time) // max(2, int(4 * POINTS_A_SECOND * (time[-1] - time[0]))))
    at = (edge_ns + (time[::step] * 1e9).astype(np.int64)).astype("datetime64[ns]")
    stream.send_columns(
        path, indexes=[rr.TimeColumn("host", timestamp=at)], columns=rr.Scalars.columns(scalars=values[::step])
    )


@dataclass(frozen=True)
class _Activity:
    """time (frames,) s, activations (frames, muscles) under one condition."""

    time: Array
    activations: Array


def _read_activity(path: Path, model: Model) -> _Activity | None:
    with path.open(newline="", encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["condition"] == SHOWN_CONDITION]
    if not rows or set(model.muscle_names) - set(rows[0]):
        return None
    first = [row for row in rows if row["cuff"] == rows[0]["cuff"]]
    time = np.array([float(row["time_s"]) for row in first])
    return _Activity(time, np.array([[float(row[name]) for name in model.muscle_names] for row in first]))


def _log_body(stream: rr.RecordingStream, activations: Path, edge_ns: int) -> None:
    """The bundled body raising its arm, its muscles straight through the points they are fixed to (no wrapping)."""
    model, suit = bundled_model(), read_suit()
    activity = _read_activity(activations, model)
    if activity is None:
        return
    motion = differentiate(raise_arm(model))
    motion = thin(motion, max(1, round(len(motion.time) / (POINTS_A_SECOND * float(np.ptp(motion.time))))))
    state = postures(model, motion.positions, motion.speeds)
    strengths = np.array([np.interp(motion.time, activity.time, column) for column in activity.activations.T]).T
    lines = [_muscle_points(model, state, muscle) for muscle in range(len(model.muscles))]
    cord = np.stack([_suit_point(model, state, point) for point in (suit.waist, suit.shoulder, suit.arm)], axis=1)
    bones = [(joint.parent, joint.child) for joint in model.joints]
    for frame, time in enumerate(motion.time):
        stream.set_time("host", timestamp=np.datetime64(edge_ns + int(time * 1e9), "ns"))
        colours = (IDLE + strengths[frame][:, None] * (BUSY - IDLE)).astype(np.uint8)
        stream.log("body/muscles", rr.LineStrips3D([line[frame] for line in lines], colors=colours, radii=0.003))
        origins = state.origin_in_ground[frame]
        stream.log(
            "body/bones", rr.LineStrips3D([origins[[a, b]] for a, b in bones], colors=[200, 200, 190], radii=0.006)
        )
        stream.log("suit/cord", rr.LineStrips3D([cord[frame]], colors=[30, 140, 60], radii=0.004))
        stream.log(
            "suit/cuffs", rr.Points3D(cord[frame, [0, 2]], colors=[30, 140, 60], radii=0.02, labels=["waist", "arm"])
        )


def _muscle_points(model: Model, state: Postures, muscle: int) -> Array:
    """(frames, points, 3) m in ground."""
    fixed = [
        point for point in model.muscles[muscle].path.points if isinstance(point, PathPoint | ConditionalPathPoint)
    ]
    return np.stack([points_in_ground(state, point.body, point.location) for point in fixed], axis=1)


def _suit_point(model: Model, state: Postures, point: SuitPoint) -> Array:
    return points_in_ground(state, model.body_index(point.body), point.location)

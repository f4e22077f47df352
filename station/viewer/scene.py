"""What a fit and an assessment add to a trial in Rerun: plateaus, fitted line, and the body with its muscles."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from documents.plain_data import read_json
from fitting.curves import TrialCurves
from fitting.session import fit_session
from fitting.trial import read_trial
from recordings.reader import open_recording
from solver.bundled import bundled_model
from solver.model import ConditionalPathPoint, Model, PathPoint
from solver.motion import decimate, differentiate
from solver.multibody.postures import Postures, points_in_ground, postures
from solver.raise_arm import simulate_arm_raise
from solver.suit.suit import SuitPoint, read_suit
from station.assessment.assessment_json import ACTIVATIONS_FILE, ASSESSMENT_FILE
from station.assessment.sources import BUNDLED, named_hashes
from station.viewer.layout import TIMELINE, Framed, layout

Array = NDArray[np.float64]
POINTS_A_SECOND = 25
Look = tuple[tuple[int, int, int], float]
MEASURED: Look = ((130, 170, 225), 2.5)
FITTED: Look = ((245, 150, 40), 1.2)
"""Colour and width of a curve: what is fitted stays to be seen upon what is measured."""
GAP_S = 1e-3
"""After a held level the line ends."""
SHOWN_CONDITION = "both"
"""Cuffs that yield and have shifted: what a wearer feels in the end."""
IDLE, BUSY = np.array([60, 90, 160]), np.array([215, 40, 30])
"""Colours of a muscle at rest and at full activation."""


def log_scene(stream: rr.RecordingStream, recording: Path, edge_ns: int | None, framed: Framed | None = None) -> None:
    """Adds the fit of one recording, and the model where its folder holds an assessment, at the trial's own times.

    edge_ns is the sync edge on the timeline, framed what the view of the markers shows.
    """
    edge_ns = open_recording(recording).manifest.start_utc_ns if edge_ns is None else edge_ns
    trial = read_trial(recording)
    curves = fit_session([trial]).curves.get(trial.file)
    if curves is not None:
        _log_fit(stream, curves, edge_ns)
    activity = _read_activity(recording.parent, bundled_model())
    body = _log_body(stream, activity, edge_ns) if activity is not None else None
    stream.send_blueprint(layout(framed=framed, body=body, has_fit=curves is not None))


def _log_fit(stream: rr.RecordingStream, curves: TrialCurves, edge_ns: int) -> None:
    is_seen = np.isfinite(curves.displacement)
    moved = 1e3 * curves.displacement[is_seen]
    _curve(stream, "fit/displacement_mm", "cuff", MEASURED, edge_ns, curves.marker_time[is_seen], moved)
    _curve(stream, "fit/force_n", "measured", MEASURED, edge_ns, curves.force_time, curves.force)
    if curves.static is not None:
        plateaus = curves.static.plateaus
        ends = np.array([(held.start, held.end, held.end + GAP_S) for held in plateaus]).ravel()
        levels = np.array([(held.force, held.force, np.nan) for held in plateaus]).ravel()
        _curve(stream, "fit/plateaus_n", "held", FITTED, edge_ns, ends, levels)
    if curves.dynamic is not None:
        dynamic = curves.dynamic
        fitted = (
            dynamic.stiffness.value * dynamic.displacement + dynamic.damping.value * dynamic.velocity + dynamic.offset
        )
        _curve(stream, "fit/predicted_n", "k x + c dx/dt", FITTED, edge_ns, dynamic.time, fitted)


def _curve(
    stream: rr.RecordingStream, path: str, name: str, look: Look, edge_ns: int, time: Array, values: Array
) -> None:
    """One scalar curve, as dense as an eye wants it; NaN parts it."""
    step = max(1, len(time) // max(2, int(4 * POINTS_A_SECOND * (time[-1] - time[0]))))
    at = (edge_ns + (time[::step] * 1e9).astype(np.int64)).astype("datetime64[ns]")
    stream.log(path, rr.SeriesLines(names=name, colors=look[0], widths=look[1]), static=True)
    stream.send_columns(
        path, indexes=[rr.TimeColumn(TIMELINE, timestamp=at)], columns=rr.Scalars.columns(scalars=values[::step])
    )


@dataclass(frozen=True)
class _Activity:
    """time (frames,) s, activations (frames, muscles) under one condition."""

    time: Array
    activations: Array


def _read_activity(folder: Path, model: Model) -> _Activity | None:
    """Of the folder's assessment, if that can be read and is of what is drawn: the body and motion of the solver."""
    try:
        inputs = dict(read_json(folder / ASSESSMENT_FILE)["inputs"])
        with (folder / ACTIVATIONS_FILE).open(newline="", encoding="utf-8") as file:
            rows = [row for row in csv.DictReader(file) if row["condition"] == SHOWN_CONDITION]
        first = [row for row in rows if row["cuff"] == rows[0]["cuff"]]
        time = np.array([float(row["time_s"]) for row in first])
        activations = np.array([[float(row[name]) for name in model.muscle_names] for row in first])
    except (OSError, ValueError, LookupError, TypeError):
        return None
    is_drawn = all(inputs.get(role) == named for role, named in named_hashes(BUNDLED, None, None).items())
    return _Activity(time, activations) if is_drawn and first else None


def _log_body(stream: rr.RecordingStream, activity: _Activity, edge_ns: int) -> Framed:
    """The bundled body raising its arm, its muscles straight through the points they are fixed to (no wrapping).

    Returns what a view of it is to show.
    """
    stream.log("body", rr.ViewCoordinates.RIGHT_HAND_Y_UP, static=True)  # as OpenSim's models
    model, suit = bundled_model(), read_suit()
    motion = differentiate(simulate_arm_raise(model))
    motion = decimate(motion, max(1, round(len(motion.time) / (POINTS_A_SECOND * float(np.ptp(motion.time))))))
    state = postures(model, motion.positions, motion.speeds)
    strengths = np.array([np.interp(motion.time, activity.time, column) for column in activity.activations.T]).T
    lines = [_muscle_points(model, state, muscle) for muscle in range(len(model.muscles))]
    cord = np.stack([_suit_point(model, state, point) for point in (suit.waist, suit.shoulder, suit.arm)], axis=1)
    bones = [(joint.parent, joint.child) for joint in model.joints]
    for frame, time in enumerate(motion.time):
        stream.set_time(TIMELINE, timestamp=np.datetime64(edge_ns + int(time * 1e9), "ns"))
        colours = (IDLE + strengths[frame][:, None] * (BUSY - IDLE)).astype(np.uint8)
        stream.log("body/muscles", rr.LineStrips3D([line[frame] for line in lines], colors=colours, radii=0.003))
        origins = state.origin_in_ground[frame]
        stream.log(
            "body/bones", rr.LineStrips3D([origins[[a, b]] for a, b in bones], colors=[200, 200, 190], radii=0.006)
        )
        stream.log("body/cord", rr.LineStrips3D([cord[frame]], colors=[30, 140, 60], radii=0.004))
        stream.log(
            "body/cuffs", rr.Points3D(cord[frame, [0, 2]], colors=[30, 140, 60], radii=0.02, labels=["waist", "arm"])
        )
    drawn = [state.origin_in_ground.reshape(-1, 3), *(line.reshape(-1, 3) for line in lines)]
    return Framed.around(np.concatenate(drawn))


def _muscle_points(model: Model, state: Postures, muscle: int) -> Array:
    """(frames, points, 3) m in ground."""
    fixed = [
        point for point in model.muscles[muscle].path.points if isinstance(point, PathPoint | ConditionalPathPoint)
    ]
    return np.stack([points_in_ground(state, point.body, point.location) for point in fixed], axis=1)


def _suit_point(model: Model, state: Postures, point: SuitPoint) -> Array:
    return points_in_ground(state, model.body_index(point.body), point.location)

"""Add fit and assessment to a trial in Rerun: plateaus, fitted line, and the body with its muscles.

A pose or a motion also shows the elevation of the arm and the EMG.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from documents.plain_data import read_json
from fitting.diagnosis.identification import FittedPull
from fitting.errors import UnusableTrial
from fitting.session import fit_session
from fitting.trial.analog_signals import AnalogSignals
from fitting.trial.trial import read_trial
from fitting.wearer.wearer_trial import read_wearer_trial
from recordings.reader import read_manifest
from solver.bundled import bundled_model, simulate_arm_raise
from solver.cuff import KelvinVoigt
from solver.model import Model
from solver.motion import decimate, differentiate
from solver.suit.suit import read_suit
from station.assessment.assessment_json import ACTIVATIONS_FILE, ASSESSMENT_FILE
from station.sources import BUNDLED, named_hashes
from station.viewer.viewer import DISPLAY_HZ, ELEVATION, EMG, BodyScene, LineStyle, SceneExtent, layout, log_curve

Array = NDArray[np.float64]
MEASURED: LineStyle = ((130, 170, 225), 2.5)
FITTED: LineStyle = ((245, 150, 40), 1.2)
"""Colour and width of a curve; the fitted one is drawn thinner, on top of the measured one."""
GAP_S = 1e-3
"""Gap after a plateau, at which its line ends."""
SHOWN_CONDITION = "both"
"""Migration and compliance of the cuffs, the condition of a worn suit."""
ELEVATION_STYLE: LineStyle = ((245, 150, 40), 2.0)
EMG_COLOURS = ((130, 170, 225), (225, 130, 170), (150, 200, 120), (200, 180, 90))
RMS_WINDOW_S = 0.1


def log_scene(
    stream: rr.RecordingStream, recording: Path, edge_ns: int | None, markers: SceneExtent | None = None
) -> None:
    """Add the fit of a recording, and the model if its folder has an assessment, at the times of the trial.

    For a pose or a motion of the wearer, add the elevation of the arm and the RMS of the EMG.

    edge_ns: the sync edge on the timeline; markers: extent of the markers in their view.
    """
    manifest = read_manifest(recording)
    edge_ns = manifest.start_utc_ns if edge_ns is None else edge_ns
    if manifest.body is not None:
        log_wearer(stream, recording, edge_ns)
        stream.send_blueprint(layout(markers=markers, is_of_wearer=True))
        return
    trial = read_trial(recording)
    curves = fit_session([trial]).pulls.get(trial.file)
    if curves is not None:
        _log_fit(stream, curves, edge_ns)
    activity = _read_activity(recording.parent, bundled_model())
    body = _log_body(stream, activity, edge_ns) if activity is not None else None
    stream.send_blueprint(layout(markers=markers, body=body, has_fit=curves is not None))


def _log_fit(stream: rr.RecordingStream, curves: FittedPull, edge_ns: int) -> None:
    is_seen = np.isfinite(curves.pull.displacement)
    displacement_mm = 1e3 * curves.pull.displacement[is_seen]
    marker_time = curves.pull.marker_time[is_seen]
    log_curve(stream, "fit/displacement_mm", "cuff", MEASURED, edge_ns, marker_time, displacement_mm)
    log_curve(stream, "fit/force_n", "measured", MEASURED, edge_ns, curves.pull.force_time, curves.pull.force)
    if curves.static is not None:
        plateaus = curves.static.plateaus
        ends = np.array([(held.start, held.end, held.end + GAP_S) for held in plateaus]).ravel()
        levels = np.array([(held.force, held.force, np.nan) for held in plateaus]).ravel()
        log_curve(stream, "fit/plateaus_n", "held", FITTED, edge_ns, ends, levels)
    if curves.dynamic is not None:
        dynamic = curves.dynamic
        law = KelvinVoigt(dynamic.stiffness.value, dynamic.damping.value)
        fitted = law.force(dynamic.displacement, dynamic.velocity) + dynamic.offset
        log_curve(stream, "fit/predicted_n", "k x + c dx/dt", FITTED, edge_ns, dynamic.time, fitted)


@dataclass(frozen=True)
class _Activity:
    """Activations (frames, muscles) in one condition at time (frames,) [s]."""

    time: Array
    activations: Array


def _read_activity(folder: Path, model: Model) -> _Activity | None:
    """Activations of the assessment in the folder, if they belong to the bundled model and motion; otherwise None."""
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


def _log_body(stream: rr.RecordingStream, activity: _Activity, edge_ns: int) -> SceneExtent:
    """Log the bundled model raising its arm. Returns the extent of the scene."""
    model = bundled_model()
    motion = differentiate(simulate_arm_raise(model))
    motion = decimate(motion, max(1, round(len(motion.time) / (DISPLAY_HZ * float(np.ptp(motion.time))))))
    activations = np.array([np.interp(motion.time, activity.time, column) for column in activity.activations.T]).T
    times_ns = edge_ns + (motion.time * 1e9).astype(np.int64)
    return BodyScene(stream, model, read_suit()).log(times_ns, motion.positions, activations)


def log_wearer(stream: rr.RecordingStream, recording: Path, edge_ns: int) -> None:
    """Log elevation [deg] and EMG RMS [µV]. An unusable recording adds nothing: the replay shows its samples."""
    try:
        trial = read_wearer_trial(recording)
    except UnusableTrial:
        return
    if trial.elevation is not None:
        log_curve(stream, ELEVATION, "elevation", ELEVATION_STYLE, edge_ns, trial.time, np.degrees(trial.elevation))
    if trial.emg is not None and trial.emg.unit == "V":
        _log_emg(stream, trial.emg, edge_ns)


def emg_rms(emg: AnalogSignals) -> tuple[Array, Array]:
    """Root mean square about the mean in windows of RMS_WINDOW_S.

    Returns times (windows,) [s] of the centres and values (windows, channels) in emg.unit.
    """
    width = max(2, round(emg.rate * RMS_WINDOW_S))
    count = len(emg.time) // width
    time = emg.time[: count * width].reshape(count, width).mean(axis=1)
    return time, emg.values[: count * width].reshape(count, width, -1).std(axis=1)


def _log_emg(stream: rr.RecordingStream, emg: AnalogSignals, edge_ns: int) -> None:
    """Log the RMS of every channel [µV at the electrodes]."""
    time, rms = emg_rms(emg)
    if len(time) < 2:
        return
    for number, label in enumerate(emg.labels):
        style = EMG_COLOURS[number % len(EMG_COLOURS)], 1.5
        log_curve(stream, f"{EMG}/{label}", label, style, edge_ns, time, 1e6 * rms[:, number])

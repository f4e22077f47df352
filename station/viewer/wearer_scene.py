"""Add the elevation of the arm and the EMG of a pose or a motion to a trial in Rerun."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from fitting.errors import UnusableTrial
from fitting.trial.analog_signals import AnalogSignals
from fitting.wearer.wearer_trial import read_wearer_trial
from station.viewer.curves import LineStyle, log_curve
from station.viewer.layout import ELEVATION, EMG

Array = NDArray[np.float64]
ELEVATION_STYLE: LineStyle = ((245, 150, 40), 2.0)
EMG_COLOURS = ((130, 170, 225), (225, 130, 170), (150, 200, 120), (200, 180, 90))
RMS_WINDOW_S = 0.1


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

"""Add fit and assessment to a trial in Rerun: plateaus, fitted line, and the body with its muscles.

A pose or a motion also shows the elevation of the arm and the EMG. Live values, of a trial and of its replay alike,
show the body, the effort by scenario, the cord force, the EMG and findings.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

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
from solver.model import Array, Model
from solver.motion import decimate, differentiate
from solver.suit.suit import read_suit
from station.assessment.assessment_json import ACTIVATIONS_FILE, ASSESSMENT_FILE
from station.live.published import LiveDelivery, LiveFinding, LiveSetup, LiveValues
from station.live.subscription import LiveSubscription
from station.sources import BUNDLED, drawn_body, named_hashes
from station.viewer.viewer import (
    BODY_NAME,
    DISPLAY_HZ,
    ELEVATION,
    EMG,
    TIMELINE,
    BodyScene,
    LineStyle,
    SceneExtent,
    layout,
    log_curve,
    open_stream,
)

MEASURED: LineStyle = ((130, 170, 225), 2.5)
FITTED: LineStyle = ((245, 150, 40), 1.2)
"""Colour and width of a curve; the fitted one is drawn thinner, on top of the measured one."""
GAP_S = 1e-3
"""Gap after a plateau, at which its line ends."""
SHOWN_CONDITION = "both"
"""Migration and compliance of the cuffs, the condition of a worn suit."""
ELEVATION_STYLE: LineStyle = ((245, 150, 40), 2.0)
REFRESH_S = 0.1
BODY_INTERVAL_S = 0.04
"""Time between two drawn bodies."""
COLOURS = ((90, 100, 112), (30, 100, 190), (200, 80, 10), (0, 130, 100), (140, 80, 170), (200, 150, 30))
"""Of Okabe and Ito's palette, darkened for a light window."""
EFFORT, CORD, LIVE_EMG = "live/effort", "live/cord_force_n", "live/emg_uv"
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


class LiveScene:
    """A sink of live values (station/live/engine.py): begin() once, then write() for every solved frame.

    The body wears the suit of the scenario "worn", without one the last scenario. Times are UTC, by the cameras' clock.
    """

    def __init__(self, sink: Path | str) -> None:
        """An .rrd file, or the address of a viewer."""
        self.stream = open_stream("cuffstation live", sink)
        self._logged: set[str] = set()
        self._next_body_s = -math.inf
        self._origin_s: float | None = None
        self._extent: SceneExtent | None = None

    def begin(self, setup: LiveSetup) -> None:
        model, suit = drawn_body(setup.subject.model_osim, setup.suit_toml)
        self._setup, self._body = setup, BodyScene(self.stream, model, suit)
        names = [scenario.name for scenario in setup.scenarios]
        self._worn = names.index("worn") if "worn" in names else len(names) - 1
        for place, name in enumerate(names):
            self._style(_effort_path(name), name, (COLOURS[place % len(COLOURS)], 2.0))
        for place, name in enumerate(("predicted", *(["measured"] if setup.has_cord_cell else []))):
            self._style(f"{CORD}/{name}", name, (COLOURS[1 + place], 2.0))
        for place, name in enumerate(setup.emg_channels):
            self._style(f"{LIVE_EMG}/{name}", name, (COLOURS[place % len(COLOURS)], 1.5))
        self.stream.send_blueprint(self._layout())
        scaled = "scaled to the wearer" if setup.subject.is_scaled else "generic, not scaled to the wearer"
        self.note("body", f"{setup.trial}; body {setup.subject.name}, {scaled}; lag {1e3 * setup.lag_s:.0f} ms")

    def begin_recording(self, recording: Path) -> None:
        self.note("recording", recording.name)

    def write(self, values: LiveValues, delivery: LiveDelivery) -> None:
        if self._origin_s is None:
            age_s = delivery.age_s if math.isfinite(delivery.age_s) else 0.0
            self._origin_s = delivery.published_s - age_s - values.time_s
        time_ns = round(1e9 * (self._origin_s + values.time_s))
        self.stream.set_time(TIMELINE, timestamp=np.datetime64(time_ns, "ns"))
        for scenario, solved in zip(self._setup.scenarios, values.scenarios, strict=True):
            self._log(_effort_path(scenario.name), solved.effort)
        self._log(f"{CORD}/predicted", values.scenarios[self._worn].cord_force_n if values.scenarios else math.nan)
        self._log(f"{CORD}/measured", values.cord_force_measured_n)
        for name, rms in zip(self._setup.emg_channels, values.emg_rms_uv, strict=False):
            self._log(f"{LIVE_EMG}/{name}", rms)
        if values.time_s > self._next_body_s and values.scenarios and np.isfinite(values.coordinates).all():
            self._next_body_s = values.time_s + 0.9 * BODY_INTERVAL_S
            self._draw(time_ns, values)

    def note(self, kind: str, text: str) -> None:
        self.stream.log("events", rr.TextLog(f"{kind}: {text}"))

    def tell(self, findings: Sequence[LiveFinding]) -> None:
        """Log findings that are new since the last call."""
        for finding in findings:
            if finding.sentence not in self._logged:
                self.note(finding.code, finding.sentence)
        self._logged = {finding.sentence for finding in findings}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stream.disconnect()

    def _draw(self, time_ns: int, values: LiveValues) -> None:
        activations = np.array(values.scenarios[self._worn].activations)[None]
        extent = self._body.log(np.array([time_ns]), np.array(values.coordinates)[None], activations)
        if self._extent is None:
            self._extent = extent
            self.stream.send_blueprint(self._layout())

    def _log(self, path: str, value: float) -> None:
        if math.isfinite(value):
            self.stream.log(path, rr.Scalars(value))

    def _style(self, path: str, name: str, style: LineStyle) -> None:
        self.stream.log(path, rr.SeriesLines(names=name, colors=style[0], widths=style[1]), static=True)

    def _layout(self) -> rrb.Blueprint:
        eye = self._extent.eye((0.0, 1.0, 0.0)) if self._extent else None
        body = rrb.Spatial3DView(origin="/body", name=BODY_NAME, eye_controls=eye)
        curves = [
            rrb.TimeSeriesView(origin=f"/{EFFORT}", name="Muscle effort \u03a3 w a\u00b2"),
            rrb.TimeSeriesView(origin=f"/{CORD}", name="Cord force [N]"),
        ]
        curves += (
            [rrb.TimeSeriesView(origin=f"/{LIVE_EMG}", name="EMG RMS [\u00b5V]")] if self._setup.emg_channels else []
        )
        events = rrb.TextLogView(origin="/events", name="Findings")
        return rrb.Blueprint(
            rrb.Horizontal(body, rrb.Vertical(*curves, events)),
            rrb.BlueprintPanel(state="collapsed"),
            rrb.SelectionPanel(state="collapsed"),
            rrb.TimePanel(state="collapsed", timeline=TIMELINE),
        )


def _effort_path(scenario: str) -> str:
    """Rerun's paths have no spaces."""
    return f"{EFFORT}/{scenario.replace(' ', '_')}"


def show_live(subscription: LiveSubscription, scenes: Sequence[LiveScene]) -> None:
    """Log what a live process publishes, until it ends."""
    for scene in scenes:
        scene.begin(subscription.setup)
    is_over = False
    while not is_over:
        is_over = subscription.wait_until_over(REFRESH_S)
        for update in subscription.take():
            for scene in scenes:
                scene.tell(update.findings)
                if update.values is not None:
                    scene.write(update.values, update.delivery)

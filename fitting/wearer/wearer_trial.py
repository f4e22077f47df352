"""Read a pose or a motion of the wearer: markers, cord force and EMG in SI units on one clock, and arm cycles."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from documents.message import because
from fitting.errors import UnusableTrial
from fitting.results.sentences import Note
from fitting.results.trial_codes import RejectionCode, TrialNoteCode
from fitting.trial.analog_signals import AnalogSignals, build_analog_signals
from fitting.trial.timeline import Timeline, build_timeline, require_labels
from recordings.manifest import BodyMarkers, Manifest
from recordings.reader import Track, TrackCollector, open_recording
from recordings.topics import ANALOG, EMG

Floats = NDArray[np.float64]

LEAST_SWING = float(np.radians(25.0))
"""A smaller reversal [rad] is part of the movement that it interrupts."""
LEAST_SHARE = 0.5
"""Smallest raise of a cycle over the largest one of the trial; smaller ones are attempts, or the hand at the face."""
REST_SHARE = 0.1
"""Part of a rise or fall below which the arm is at rest."""


def elevation(shoulder: Floats, elbow: Floats, upper: Floats, lower: Floats) -> Floats:
    """(frames,) angle [rad] between the upper arm and the trunk, from markers (frames, 3) in any unit and frame.

    0 for an arm along the trunk, π for an arm overhead; NaN where a marker is missing. Like the thoracohumeral
    elevation of the ISB (G. Wu et al., J. Biomech. 38(5):981-992, 2005) it does not depend on the tilt of the trunk.
    """
    arm, trunk = elbow - shoulder, lower - upper
    with np.errstate(invalid="ignore"):
        across = np.linalg.norm(np.cross(arm, trunk), axis=1)
        return np.asarray(np.arctan2(across, np.sum(arm * trunk, axis=1)))


def elevation_from_markers(
    markers: Floats, labels: Sequence[str], arm: Sequence[str], trunk: Sequence[str]
) -> Floats | None:
    """Elevation (frames,) [rad] from markers (frames, labels, 3); None if a label is not declared or not recorded."""
    wanted = (*arm, *trunk)
    if len(wanted) != 4 or not set(wanted) <= set(labels):
        return None
    return elevation(*(markers[:, labels.index(label)].astype(np.float64) for label in wanted))


@dataclass(frozen=True)
class ArmCycle:
    """One raise of the arm and back: start, peak and end [s]; lowest elevation before it and highest in it [rad]."""

    start: float
    peak: float
    end: float
    lowest: float
    highest: float


class CycleDetector:
    """Online detection of cycles by turning points of the elevation that are at least LEAST_SWING apart.

    turns: time [s] and elevation [rad] of the minimum before every completed cycle, and of its maximum. A cycle is
    complete once the arm has fallen by LEAST_SWING from its maximum.
    """

    def __init__(self) -> None:
        self.turns: list[tuple[float, float, float, float]] = []
        self._valley: tuple[float, float] | None = None
        self._peak: tuple[float, float] | None = None  # of the present raise

    @property
    def is_raised(self) -> bool:
        """Whether a raise has begun and the arm is not down again."""
        return self._peak is not None

    def update(self, times: Iterable[float], elevations: Iterable[float]) -> None:
        """Add elevations [rad] at increasing times [s]; NaN is ignored."""
        for time, angle in zip(times, elevations, strict=True):
            if np.isfinite(angle):
                self._add(float(time), float(angle))

    def _add(self, time: float, angle: float) -> None:
        if self._valley is None or (self._peak is None and angle <= self._valley[1]):
            self._valley = time, angle
        elif self._peak is None:
            self._peak = (time, angle) if angle - self._valley[1] >= LEAST_SWING else None
        elif angle > self._peak[1]:
            self._peak = time, angle
        elif self._peak[1] - angle >= LEAST_SWING:
            self.turns.append((*self._valley, *self._peak))
            self._valley, self._peak = (time, angle), None


def find_cycles(time: Floats, angle: Floats) -> tuple[ArmCycle, ...]:
    """Cycles of a trial from the elevation (frames,) [rad] at time (frames,) [s]; low raises are left out.

    A cycle starts at the end of the lowest tenth of its rise, and ends at the start of the lowest tenth of its fall.
    """
    detector = CycleDetector()
    detector.update(time, angle)
    rises = [peak - valley for _, valley, _, peak in detector.turns]
    highest, bounds = max(rises, default=0.0), [*(turn[0] for turn in detector.turns[1:]), float(time[-1])]
    return tuple(
        _cycle(time, angle, turn, until)
        for turn, rise, until in zip(detector.turns, rises, bounds, strict=False)
        if rise >= LEAST_SHARE * highest
    )


def _cycle(time: Floats, angle: Floats, turn: tuple[float, float, float, float], until: float) -> ArmCycle:
    """The cycle of a turn; the arm is down again before `until` [s]."""
    valley_time, valley, peak_time, peak = turn
    rising = (time >= valley_time) & (time <= peak_time) & (angle < valley + REST_SHARE * (peak - valley))
    falling = (time >= peak_time) & (time <= until)
    after = float(np.nanmin(angle[falling]))
    down = time[falling & (angle <= after + REST_SHARE * (peak - after))]
    return ArmCycle(float(time[rising][-1]), peak_time, float(down[0]), valley, peak)


@dataclass(frozen=True, eq=False)
class WearerTrial:
    """A pose or a motion. Session time 0 is the rising edge of /sync; arrays are read-only.

    manifest    test, condition, repeat, markers of body and suit, origin
    time        (frames,) s, a regular grid;  labels of all recorded markers
    markers     (frames, labels, 3) m in the mocap frame, NaN where a marker is missing
    force_time, force  (n,) s, N of the load cell, not tared: force of the cord if body.is_cord_measured
    emg, analog  None if not recorded or without a common clock with the markers, which a note reports
    elevation   (frames,) rad of the arm relative to the trunk; None if its markers are not declared
    cycles      of the arm in a motion;  is_whole: no samples are lost, and the recording is complete
    marks       number of the operator's marks
    """

    manifest: Manifest
    file: str
    sha256: str
    time: Floats
    labels: tuple[str, ...]
    markers: Floats
    force_time: Floats
    force: Floats
    emg: AnalogSignals | None
    analog: AnalogSignals | None
    elevation: Floats | None
    cycles: tuple[ArmCycle, ...]
    is_whole: bool
    notes: tuple[Note, ...]
    marks: int = 0

    def __post_init__(self) -> None:
        for array in (self.time, self.markers, self.force_time, self.force, self.elevation):
            if array is not None:
                array.setflags(write=False)

    @property
    def body(self) -> BodyMarkers:
        assert self.manifest.body is not None  # noqa: S101  (build_wearer_trial refuses others)
        return self.manifest.body

    def hidden(self) -> dict[str, float]:
        """Part of the frames in which a marker is missing, by label, of the markers that the trial needs."""
        missing = np.isnan(self.markers[..., 0]).mean(axis=0)
        return {label: float(missing[self.labels.index(label)]) for label in self.body.labels}


def read_wearer_trial(path: Path) -> WearerTrial:
    """Read a recording. Raises UnusableTrial, or RecordingError if the file is not a cuffstation recording."""
    collector = TrackCollector(path)
    recording = open_recording(path, collector.take)
    if recording.outcome is not None and not recording.outcome.accepted:
        raise UnusableTrial(RejectionCode.NOT_ACCEPTED, {"outcome": recording.outcome.sentence})
    tracks = {stream.name: collector.track(stream) for stream in recording.streams}
    sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
    trial = build_wearer_trial(recording.manifest, tracks, path.name, sha256)
    trial = replace(trial, marks=sum(event.kind == "mark" for event in collector.events()))
    missing = (Note(TrialNoteCode.INCOMPLETE, {"missing": sentence}) for sentence in recording.missing)
    return trial if recording.complete else replace(trial, is_whole=False, notes=(*trial.notes, *missing))


def build_wearer_trial(manifest: Manifest, tracks: Mapping[str, Track], file: str, sha256: str) -> WearerTrial:
    """Build the trial from the streams of a recording. Raises UnusableTrial."""
    body = manifest.body
    if body is None:
        raise UnusableTrial(RejectionCode.NO_BODY, {"file": file})
    labels = tracks["/markers"].stream.labels if "/markers" in tracks else ()
    require_labels(body.labels, labels)
    timeline = build_timeline(manifest, tracks, labels)
    signals, notes = _signals(manifest, tracks, timeline)
    angle = elevation_from_markers(timeline.markers, labels, body.arm, body.trunk)
    is_motion = manifest.test == "motion" and angle is not None
    return WearerTrial(
        manifest=manifest,
        file=file,
        sha256=sha256,
        time=timeline.marker_time,
        labels=labels,
        markers=timeline.markers,
        force_time=timeline.force_time,
        force=timeline.force,
        emg=signals.get(EMG),
        analog=signals.get(ANALOG),
        elevation=angle,
        cycles=find_cycles(timeline.marker_time, angle) if is_motion and angle is not None else (),
        is_whole=not timeline.force_gaps and not timeline.frame_gaps,
        notes=(*timeline.notes, *notes),
    )


def _signals(
    manifest: Manifest, tracks: Mapping[str, Track], timeline: Timeline
) -> tuple[dict[str, AnalogSignals], tuple[Note, ...]]:
    try:
        signals = build_analog_signals(manifest, tracks, timeline)
    except UnusableTrial as error:
        return {}, (Note(TrialNoteCode.EMG_LEFT_OUT, because(error)),)
    return signals, tuple(note for found in signals.values() for note in found.notes)

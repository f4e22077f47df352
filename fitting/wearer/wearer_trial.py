"""Read a pose or a motion of the wearer: markers, cord force and EMG in SI units on one clock, and arm cycles."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fitting.errors import UnusableTrial
from fitting.results.codes import RejectionCode, TrialNoteCode
from fitting.results.rendering import Note
from fitting.trial.analog_signals import AnalogSignals, build_analog_signals
from fitting.trial.force_quality import require_labels
from fitting.trial.timeline import Timeline, build_timeline
from fitting.wearer.arm_cycles import ArmCycle, elevation_of, find_cycles
from recordings.manifest import BodyMarkers, Manifest
from recordings.reader import Track, TrackCollector, open_recording
from recordings.topics import ANALOG, EMG

Floats = NDArray[np.float64]


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
    angle = elevation_of(timeline.markers, labels, body.arm, body.trunk)
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
        return {}, (Note(TrialNoteCode.EMG_LEFT_OUT, {"reason": str(error), "reason_code": error.reason.code}),)
    return signals, tuple(note for found in signals.values() for note in found.notes)

"""A recording with all its streams on one clock, as every export needs it."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path

import numpy as np

from documents.message import Figures, Message, because
from fitting.errors import UnusableTrial
from fitting.trial.analog_signals import AnalogSignals, build_analog_signals
from fitting.trial.timeline import Timeline, build_timeline
from recordings.exchange.sample_tables import MarkerTable
from recordings.manifest import Manifest
from recordings.reader import Track, TrackCollector, open_recording
from station.errors import StationError
from station.exit_code import WRONG_USAGE
from station.messages.file_messages import ExportCode


class ExportRefused(StationError):
    """The recording cannot be exported in this format."""


class WrongExport(ExportRefused):
    """The command line is wrong."""

    exit_code = WRONG_USAGE


class NoCommonClock(ExportRefused):
    """The streams cannot be synchronised; their samples can be exported raw."""

    def __init__(self, file: str, cause: UnusableTrial) -> None:
        self.figures: Figures = {"file": file, **because(cause)}
        super().__init__(Message(ExportCode.NO_COMMON_CLOCK, self.figures))


@dataclass(frozen=True)
class SynchronisedRecording:
    """A recording on the clock of the markers; time 0 is the sync edge, edge_utc_ns its time on the station's clock.

    labels: of all markers; line.markers: (frames, labels, 3) m. signals: by stream, "/emg" and "/analog" if they were
    recorded; signal_notes: uncertainty of their synchronisation, or the reason why they are missing.
    """

    path: Path
    manifest: Manifest
    labels: tuple[str, ...]
    frame_rate: float
    line: Timeline
    edge_utc_ns: int
    signals: Mapping[str, AnalogSignals] = field(default_factory=dict)
    signal_notes: tuple[str, ...] = ()

    @property
    def edge(self) -> datetime:
        """Time of the sync edge on the station's clock."""
        return datetime.fromtimestamp(self.edge_utc_ns // 1000 / 1e6, UTC)

    @cached_property
    def sha256(self) -> str:
        return hashlib.sha256(self.path.read_bytes()).hexdigest()

    @property
    def markers(self) -> MarkerTable:
        """Positions in mm, times from the sync edge; the residuals are not kept and set to 0."""
        residuals = np.zeros(self.line.markers.shape[:2])
        return MarkerTable(self.labels, self.frame_rate, self.line.marker_time, 1e3 * self.line.markers, residuals)


def read_synchronised(path: Path) -> SynchronisedRecording:
    """Read a recording and synchronise its streams. Raises NoCommonClock or RecordingError."""
    collector = TrackCollector(path)
    recording = open_recording(path, collector.take)
    tracks = {stream.name: collector.track(stream) for stream in recording.streams}
    labels = tracks["/markers"].stream.labels if "/markers" in tracks else ()
    try:
        line = build_timeline(recording.manifest, tracks, labels)
    except UnusableTrial as error:
        raise NoCommonClock(path.name, error) from error
    rate, edge_utc_ns = tracks["/markers"].stream.rate_hz, _edge_utc_ns(recording.manifest, tracks, line)
    signals, notes = _signals(recording.manifest, tracks, line)
    return SynchronisedRecording(path, recording.manifest, labels, rate, line, edge_utc_ns, signals, notes)


def _signals(
    manifest: Manifest, tracks: Mapping[str, Track], line: Timeline
) -> tuple[Mapping[str, AnalogSignals], tuple[str, ...]]:
    try:
        signals = build_analog_signals(manifest, tracks, line)
    except UnusableTrial as error:
        return {}, (str(error),)
    return signals, tuple(str(note) for found in signals.values() for note in found.notes)


def _edge_utc_ns(manifest: Manifest, tracks: Mapping[str, Track], line: Timeline) -> int:
    """UTC of time 0 from the sample with the smallest transfer delay."""
    track = tracks.get("/sync", tracks["/force"])
    device = track.device_time_ns
    if manifest.begins_at_edge:  # the clock was fitted to the sample count of the device
        device = np.rint(1e9 * track.sample_numbers.astype(np.float64) / track.stream.rate_hz).astype(np.int64)
    return int(np.min(track.host_time_ns - device)) + round(1e9 * line.clock.start)

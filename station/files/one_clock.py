"""A recording with both streams on the common clock, and all its markers: what every export is made of."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path

import numpy as np

from fitting.quality import UnusableTrial
from fitting.timing.timeline import Timeline, lay_out
from recordings.exchange.tables import MarkerTable
from recordings.manifest import Manifest
from recordings.reader import Track, TrackCollector, open_recording
from station.errors import StationError
from station.exit_code import WRONG_USAGE


class ExportRefused(StationError):
    """The recording cannot be exported so; one sentence."""


class WrongExport(ExportRefused):
    """The command itself is at fault."""

    exit_code = WRONG_USAGE


class NoCommonClock(ExportRefused):
    """The streams cannot be brought on one clock; what was sampled is there."""


@dataclass(frozen=True)
class OneClock:
    """One recording; time 0 is the sync edge, which was at edge_utc_ns by the station's clock.

    labels of all its markers; line.markers (frames, labels, 3) m.
    """

    path: Path
    manifest: Manifest
    labels: tuple[str, ...]
    frame_rate: float
    line: Timeline
    edge_utc_ns: int

    @property
    def edge(self) -> datetime:
        """When the sync edge was, by the station's clock."""
        return datetime.fromtimestamp(self.edge_utc_ns // 1000 / 1e6, UTC)

    @cached_property
    def sha256(self) -> str:
        return hashlib.sha256(self.path.read_bytes()).hexdigest()

    @property
    def markers(self) -> MarkerTable:
        """In mm, with times that count from the edge; what the residuals were is not kept."""
        nothing = np.zeros(self.line.markers.shape[:2])
        return MarkerTable(self.labels, self.frame_rate, self.line.marker_time, 1e3 * self.line.markers, nothing)


def read_on_one_clock(path: Path) -> OneClock:
    """Raises ExportRefused or RecordingError where the streams cannot be brought on one clock."""
    collector = TrackCollector(path)
    recording = open_recording(path, collector.take)
    tracks = {stream.name: collector.track(stream) for stream in recording.streams}
    labels = tracks["/markers"].stream.labels if "/markers" in tracks else ()
    try:
        line = lay_out(recording.manifest, tracks, labels)
    except UnusableTrial as error:
        raise NoCommonClock(f"{path.name} cannot be exported: {error}") from error
    rate = tracks["/markers"].stream.rate_hz
    return OneClock(path, recording.manifest, labels, rate, line, _edge_utc_ns(recording.manifest, tracks, line))


def _edge_utc_ns(manifest: Manifest, tracks: Mapping[str, Track], line: Timeline) -> int:
    """As the sample tells that travelled fastest."""
    track = tracks.get("/sync", tracks["/force"])
    device = track.device_time_ns
    if manifest.begins_at_edge:  # the clock was fitted to what the device counted
        device = np.rint(1e9 * track.sample_numbers.astype(np.float64) / track.stream.rate_hz).astype(np.int64)
    return int(np.min(track.host_time_ns - device)) + round(1e9 * line.clock.start)

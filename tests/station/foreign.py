"""An independent experiment, written into the files that other programs leave, and beside them into our own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from recordings.exchange.c3d import write_c3d
from recordings.exchange.qtm_tsv import write_qtm_tsv
from recordings.exchange.sample_tables import MarkerTable
from recordings.exchange.signal_csv import write_columns
from recordings.exchange.trc import write_trc
from recordings.manifest import Manifest, TrialOutcome
from recordings.reader import Track
from recordings.samples import Event, Samples
from recordings.writer import RecordingWriter
from station.config import StationConfig, parse_config
from tests.fitting.experiment import Session, published
from tests.station.command import Ran

CONFIG = {
    "cuffs": {"hand": {"anchor_markers": [f"anchor_{i}" for i in (1, 2, 3, 4)], "cuff_markers": ["cuff_1"]}},
    "bounce": {"mass_kg": 2.0, "marker": "cuff_1"},
    "sync": {"stop_edge": "end_of_frame"},
}


def config() -> StationConfig:
    return parse_config(CONFIG, "test")


@dataclass(frozen=True)
class Truth:
    """One trial as the instruments saw it."""

    manifest: Manifest
    tracks: dict[str, Track]

    @property
    def edge_s(self) -> float:
        """Where the sync line rises on the DAQ's clock, within half a sample."""
        return float(np.argmax(self.tracks["/sync"].values[:, 0] > 2.5) - 0.5) / 1000

    @property
    def markers(self) -> MarkerTable:
        track = self.tracks["/markers"]
        values = track.values.astype(np.float64)
        time = (track.sample_numbers.astype(np.float64) - 1) / 100
        return MarkerTable(track.stream.labels, 100.0, time, values[..., :3], values[..., 3])

    def with_track(self, name: str, kept: Any = slice(None), **changes: Any) -> Truth:
        """With other values of a stream, and of its samples only those that are kept."""
        track = replace(self.tracks[name], **changes)
        fields = ("sample_numbers", "device_time_ns", "host_time_ns", "values")
        track = replace(track, **{field: getattr(track, field)[kept] for field in fields})
        return replace(self, tracks=self.tracks | {name: track})

    def write_csv(
        self, path: Path, *, has_sync: bool = True, newtons_per_unit: float = 1.0, column: str = "force_v"
    ) -> Path:
        time = np.arange(len(self.tracks["/force"].values)) / 1000
        columns = {"time_s": time if has_sync else time - self.edge_s}
        columns[column] = newtons_per_unit * self.tracks["/force"].values[:, 0]
        if has_sync:
            columns["sync_v"] = self.tracks["/sync"].values[:, 0]
        path.write_text(write_columns(columns, ","), encoding="utf-8")
        return path

    def write_markers(self, path: Path) -> Path:
        """As .tsv, .trc or .c3d; a .c3d holds the force of the same time in volts too."""
        if path.suffix == ".c3d":
            first = round(self.edge_s * 1000)
            volts = self.tracks["/force"].values[first : first + 10 * len(self.markers.time_s), 0]
            write_c3d(path, self.markers, {"ai0": volts}, {"ai0": "V"})
        else:
            text = write_qtm_tsv(self.markers) if path.suffix == ".tsv" else write_trc(self.markers, path.name)
            path.write_text(text, encoding="utf-8")
        return path

    def record(self, path: Path, events: Sequence[Event] = ()) -> Path:
        """What the station itself would have recorded of it."""
        streams = [track.stream for track in self.tracks.values()]
        writer = RecordingWriter(path, self.manifest, streams, sync=lambda _: None)
        for name, track in self.tracks.items():
            hosts, starts = np.unique(track.host_time_ns, return_index=True)
            columns = (track.sample_numbers, track.device_time_ns, track.values)
            parts = (np.split(column, starts)[1:] for column in columns)
            for host, numbers, device, values in zip(hosts, *parts, strict=True):
                writer.write(Samples(name, numbers, device, int(host), values))
        for event in events:
            writer.write(event)
        writer.close(TrialOutcome(True, "closed", "the mocap capture ended"))
        return path


@cache
def static_and_dynamic(seed: int = 3) -> tuple[Truth, Truth]:
    truth = published("hand", weights=(25.0, 50.0, 75.0), hold=4.2, unloads_at_once=True)
    session = Session(truth, seed)
    return Truth(*session.static()), Truth(*session.dynamic())


def import_by_verb(station, static: tuple[Path, Path], session: Path, *options: object) -> Ran:
    """`station import` of these files as the hand cuff's first static test."""
    toml = static[0].with_name("station.toml")
    toml.write_text(
        '[cuffs.hand]\nanchor_markers = ["anchor_1", "anchor_2", "anchor_3", "anchor_4"]\ncuff_markers = ["cuff_1"]\n'
    )
    return station(
        *("import", "--session", session, "--cuff", "hand", "--test", "static", "--repeat", 1, "--config", toml),
        *("--force", static[0], "--mocap", static[1], *options),
    )

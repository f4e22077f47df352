"""The live result of a trial in its file: written while the trial runs, closed with the hash of the recording."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from recordings.live_result import LiveFrame, LiveManifest, LiveOutcome, LiveResultWriter
from recordings.samples import Event
from station.checksums import list_in_session
from station.config import LiveSection
from station.live.outlet import live_columns, live_row
from station.live.published import LiveDelivery, LiveSetup, LiveValues
from station.versions import solver_digest, solving_versions

FOLDER = "live"
"""Of the session: beside the recordings, and not among them."""
SUFFIX = ".live.mcap"


def live_path(recording: Path, folder: Path | None = None) -> Path:
    """Where the live result of a recording is; folder: instead of the session's."""
    return (folder or recording.parent / FOLDER) / f"{recording.stem}{SUFFIX}"


def live_results_in(session: Path) -> list[Path]:
    """The live results of a session's recordings."""
    return sorted((session / FOLDER).glob(f"*{SUFFIX}"))


class ResultFile:
    """A sink that writes from begin_recording() on; before it nothing is recorded, and nothing kept."""

    def __init__(self, settings: LiveSection, folder: Path | None = None) -> None:
        self._settings, self._folder = settings, folder
        self._setup: LiveSetup | None = None
        self._recording: Path | None = None
        self._writer: LiveResultWriter | None = None
        self._frames = self._dropped = self._latest_ns = 0

    @property
    def path(self) -> Path | None:
        """The file, None before it begins."""
        return self._writer.path if self._writer else None

    def begin(self, setup: LiveSetup) -> None:
        self._setup = setup

    def begin_recording(self, recording: Path) -> None:
        """Create the file. Raises OSError."""
        if self._setup is None or self._writer is not None:
            return
        self._recording = recording
        self._writer = LiveResultWriter(live_path(recording, self._folder), self._manifest(self._setup, recording))

    def write(self, values: LiveValues, delivery: LiveDelivery) -> None:
        if self._writer is None or self._setup is None:
            return
        self._frames, self._dropped = self._frames + 1, delivery.dropped_frames
        self._latest_ns = round(1e9 * values.host_time_s)
        frame = LiveFrame(
            frame=values.frame,
            time_s=values.time_s,
            outcome=str(values.outcome),
            suit_outcomes=tuple(str(one.outcome) for one in values.scenarios),
            values=np.array(live_row(self._setup, values)),
            hidden=values.hidden,
            left_out=values.left_out,
            exchanged=tuple(" ".join(pair) for pair in values.exchanged),
            lost=values.lost,
            latency_s=delivery.latency_s,
            dropped_frames=delivery.dropped_frames,
            every=delivery.every,
        )
        self._writer.write(frame, self._latest_ns)

    def note(self, kind: str, text: str) -> None:
        if self._writer is not None:
            self._writer.note(Event(kind, text, self._latest_ns, "live"))

    def close(self, sentence: str, *, has_ended: bool) -> None:
        """has_ended: the recorder has closed the recording, and it can be hashed. Raises OSError."""
        writer, self._writer = self._writer, None
        if writer is None or self._recording is None:
            return
        if has_ended and not self._recording.exists():
            writer.discard()
            return
        digest = hashlib.sha256(self._recording.read_bytes()).hexdigest() if has_ended else ""
        outcome = LiveOutcome(
            complete=has_ended,
            sentence=sentence,
            recording=self._recording.name,
            recording_sha256=digest,
            frames=self._frames,
            dropped_frames=self._dropped,
        )
        writer.close(outcome, self._latest_ns)
        list_in_session(writer.path)

    def _manifest(self, setup: LiveSetup, recording: Path) -> LiveManifest:
        return LiveManifest(
            recording=recording.name,
            columns={column.name: column.unit for column in live_columns(setup)},
            suits=tuple(scenario.name for scenario in setup.scenarios),
            model=setup.subject.name,
            is_scaled=setup.subject.is_scaled,
            lag_s=setup.lag_s,
            origin=setup.origin,
            versions={**solving_versions(), "solver": solver_digest()},
            settings=self._settings.model_dump(mode="json"),
        )

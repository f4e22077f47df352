"""The live values of a trial as a table, written while the trial runs, and at its end their description.

TRIAL.live.csv has a row for each solved frame, with all digits. It is not the offline result, and no assessment reads
it. TRIAL.live.json has the units and the hash of the recording; without it, the live process or the recorder ended
before the trial did. A replay of the recording gives the same values if no frame was left out.
"""

from __future__ import annotations

import csv
import hashlib
import json
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, TextIO

from station.checksums import list_in_session
from station.config import LiveSection
from station.live.outlet import live_columns, live_row
from station.live.published import LiveDelivery, LiveSetup, LiveValues
from station.versions import solver_digest, solving_versions
from station.whole_file import write_whole

FOLDER = "live"
"""Of the session: beside the recordings, and not among them."""
SUFFIX = ".live.csv"


def live_path(recording: Path, folder: Path | None = None) -> Path:
    """Where the live result of a recording is; folder: instead of the session's."""
    return (folder or recording.parent / FOLDER) / f"{recording.stem}{SUFFIX}"


class ResultFile:
    """A sink that writes from begin_recording() on; before it nothing is recorded, and nothing kept."""

    def __init__(self, settings: LiveSection, folder: Path | None = None) -> None:
        self.path: Path | None = None
        """The table, None before it begins."""
        self._settings, self._folder = settings, folder
        self._setup: LiveSetup | None = None
        self._recording = Path()
        self._file: TextIO | None = None
        self._outcomes: Counter[str] = Counter()
        self._dropped = 0
        self._events: list[dict[str, str]] = []

    def begin(self, setup: LiveSetup) -> None:
        self._setup = setup

    def begin_recording(self, recording: Path) -> None:
        """Create the table. Raises OSError."""
        if self._setup is None or self._file is not None:
            return
        path = live_path(recording, self._folder)
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = path.open("x", encoding="utf-8", newline="", buffering=1)  # a row is written at once
        self.path, self._recording = path, recording
        csv.writer(self._file).writerow(_header(self._setup))

    def write(self, values: LiveValues, delivery: LiveDelivery) -> None:
        if self._file is None or self._setup is None:
            return
        self._outcomes[str(values.outcome)] += 1
        self._dropped = delivery.dropped_frames
        csv.writer(self._file).writerow(_row(self._setup, values, delivery))

    def note(self, kind: str, text: str) -> None:
        if self._file is not None:
            self._events.append({"kind": kind, "text": text})

    def close(self, sentence: str, *, has_ended: bool) -> None:
        """has_ended: the recorder has closed the recording, and it can be hashed. Raises OSError."""
        file, self._file = self._file, None
        if file is None or self.path is None or self._setup is None:
            return
        file.close()
        if has_ended and not self._recording.exists():
            self.path.unlink()
            return
        list_in_session(self.path)
        if has_ended:
            text = json.dumps(self._description(self._setup, sentence), indent=2)
            write_whole(self.path.with_suffix(".json"), f"{text}\n")

    def _description(self, setup: LiveSetup, sentence: str) -> dict[str, Any]:
        return {
            "result": "live",
            "sentence": sentence,
            "recording": self._recording.name,
            "recording_sha256": hashlib.sha256(self._recording.read_bytes()).hexdigest(),
            "model": setup.subject.name,
            "is_scaled": setup.subject.is_scaled,
            "lag_s": setup.lag_s,
            "suits": [scenario.name for scenario in setup.scenarios],
            "frames": self._outcomes.total(),
            "dropped_frames": self._dropped,
            "outcomes": dict(self._outcomes),
            "units": {"time_s": "s", "latency_s": "s"} | {one.name: one.unit for one in live_columns(setup)},
            "events": self._events,
            "origin": setup.origin,
            "versions": {**solving_versions(), "solver": solver_digest()},
            "settings": self._settings.model_dump(mode="json"),
        }


def _header(setup: LiveSetup) -> Iterator[str]:
    yield from ("frame", "time_s", "outcome")
    yield from (f"{scenario.name}/outcome" for scenario in setup.scenarios)
    yield from (column.name for column in live_columns(setup))
    yield from ("hidden", "left_out", "exchanged", "lost", "latency_s", "dropped_frames", "every")


def _row(setup: LiveSetup, values: LiveValues, delivery: LiveDelivery) -> Iterator[Any]:
    yield from (values.frame, values.time_s, str(values.outcome))
    yield from (str(scenario.outcome) for scenario in values.scenarios)
    yield from live_row(setup, values)
    yield from map(_names, (values.hidden, values.left_out, map(" ".join, values.exchanged), values.lost))
    yield from (delivery.latency_s, delivery.dropped_frames, delivery.every)


def _names(names: Iterable[str]) -> str:
    return ";".join(names)

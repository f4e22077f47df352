"""What a trial writes to its recording: repeated events once and with a count; samples also for a check of the fit."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from fitting.errors import UnusableTrial
from fitting.trial.decimation import Decimator
from recordings.manifest import Manifest
from recordings.samples import Event, Item, Stream
from recordings.writer import RecordingWriter
from station.messages.codes import TrialCode
from station.messages.message import Message

READ_ONE_BY_ONE = ("mark", "capture", "connection", "sync_edge")
"""Beginnings of the kinds of events whose times a reader of the recording uses."""


class RepeatedEvents:
    """Passes the first event of a kind and source, and counts those that follow."""

    def __init__(self) -> None:
        self._counts: dict[tuple[str, str], int] = {}
        self._latest: dict[tuple[str, str], Event] = {}

    def is_repeat(self, item: Item) -> bool:
        """Count the item; whether it is an event of a kind and source that was passed before."""
        if not isinstance(item, Event) or item.kind.startswith(READ_ONE_BY_ONE):
            return False
        key = item.kind, item.source
        self._counts[key] = self._counts.get(key, 0) + 1
        self._latest[key] = item
        return self._counts[key] > 1

    def summary(self) -> list[Event]:
        """An event with the count of every kind and source that was repeated."""
        return [
            replace(event, text=f"{self._counts[key]} times in this trial, at last: {event.text}")
            for key, event in self._latest.items()
            if self._counts[key] > 1
        ]


class RecordedItems:
    """Writes the items of a trial, and judges at its end whether a fit can align its streams."""

    def __init__(self, writer: RecordingWriter, manifest: Manifest, streams: Iterable[Stream]) -> None:
        self._writer, self._manifest = writer, manifest
        self._decimator, self._repeated = Decimator(manifest, streams), RepeatedEvents()

    def write(self, item: Item) -> None:
        if not self._repeated.is_repeat(item):
            self._decimator.take(item)
            self._writer.write(item)

    def flush_if_due(self) -> None:
        self._writer.flush_if_due()

    def write_summary(self) -> None:
        """Write the counts of repeated events."""
        for event in self._repeated.summary():
            self._writer.write(event)

    def misalignment(self) -> Message[TrialCode] | None:
        """Why a fit could not align the streams; None if it can. Call once, after the last item."""
        from fitting.trial.timeline import align_by_sync_edge  # takes as long to import as a device to open

        if not self._manifest.begins_at_edge:
            return None
        try:
            align_by_sync_edge(self._manifest, self._decimator.tracks())
        except UnusableTrial as error:
            reason = error.reason
            return Message(TrialCode.NOT_ALIGNED, {"reason": str(reason), "reason_code": reason.code})
        return None

"""Complete a recording with the export of QTM: fill the gaps of the live stream of markers, and list them."""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from documents.message import Figures, Message, because
from fitting.errors import UnusableTrial
from fitting.trial import clocks
from fitting.trial.clocks import find_edges
from recordings.exchange.sample_tables import MarkerTable
from recordings.manifest import Manifest
from recordings.reader import Recording, Track, open_recording
from recordings.samples import Event, Item, Loss, Samples
from station.files.foreign_files import ImportRefused, MarkerSource, read_markers
from station.files.import_trial import Imported, blocks, marker_file_notes, nanoseconds, write_recording
from station.messages.file_messages import ImportCode

SAME_TRIAL_MM = 5.0
"""Largest median distance of export and live stream; repeated tracking, filtering and gap filling move less."""


def completed_path(path: Path) -> Path:
    """run-1.mcap → run-1.completed.mcap"""
    return path.with_suffix(".completed.mcap")


def complete_trial(path: Path, source: MarkerSource) -> Imported:
    """Write a copy of the recording with the markers of the export; the original is not changed.

    The export replaces the live stream in every frame that it has, also with a hidden marker; frames that only the
    live stream has are kept. The notes list what was added. Raises ImportRefused or RecordingError.
    """
    recording = open_recording(path)
    if recording.outcome is None:
        raise ImportRefused(Message(ImportCode.CUT_RECORDING, {"path": str(path)}))
    subject = recording.manifest.subject
    export = read_markers(source, subject.labels if subject else ())
    live = _captured(recording)
    numbers = export.frame_numbers
    _require_same_trial(path, source.path, live, export, numbers)
    merged_numbers, values = _merged(live, export, numbers)
    stream = replace(live.stream, labels=_labels(live, export), source=f"{live.stream.source}; {source.path.name}")
    streams = [stream if recorded.name == "/markers" else recorded for recorded in recording.streams]
    text = f"markers from {source.path.name}, and from the live stream where that file has no frame"
    event = Event("completed", text, recording.manifest.start_utc_ns, "station")
    items = _items(recording, live, event, merged_numbers, values)
    output = completed_path(path)
    files = f"{path.name} and {source.path.name}"
    write_recording(output, recording.manifest, streams, items, recording.outcome, files)
    return Imported(output, (*marker_file_notes(export), *_notes(live, export, numbers)))


def _captured(recording: Recording) -> Track:
    """The live frames of the capture, without the preview before and after it."""
    track = recording.load("/markers")
    if not len(track.sample_numbers):
        raise ImportRefused(Message(ImportCode.NO_LIVE_FRAMES, {"path": str(recording.path)}))
    if not recording.manifest.begins_at_edge:
        return track
    device, host = (1e-9 * times.astype(np.float64) for times in (track.device_time_ns, track.host_time_ns))
    try:
        edge = _edge_on_host(recording, recording.manifest)
    except UnusableTrial as error:
        figures = {"path": recording.path.name, **because(error)}
        raise ImportRefused(Message(ImportCode.NO_EDGE, figures)) from error
    part = clocks.capture_frames(track.sample_numbers.astype(np.int64), device, host, track.stream.rate_hz, edge)
    return Track(
        track.stream,
        track.sample_numbers[part],
        track.device_time_ns[part],
        track.host_time_ns[part],
        track.values[part],
    )


def _edge_on_host(recording: Recording, manifest: Manifest) -> float:
    """Start of the capture on the clock of the host [s]."""
    is_started_by_edge = manifest.start == "pfi0"
    track = recording.load("/force" if is_started_by_edge else "/sync")
    seconds = track.sample_numbers.astype(np.float64) / track.stream.rate_hz
    rising = 0.0
    if not is_started_by_edge:
        rising = find_edges(seconds, track.values[:, 0], manifest.sync_threshold_v).rising
    return rising + clocks.arrival_offset(1e-9 * track.host_time_ns.astype(np.float64), seconds)


def _require_same_trial(path: Path, file: Path, live: Track, export: MarkerTable, numbers: NDArray[np.int64]) -> None:
    if abs(export.rate_hz / live.stream.rate_hz - 1) > 1e-3:
        rates: Figures = {
            "file": file.name,
            "rate_hz": export.rate_hz,
            "path": path.name,
            "live_rate_hz": live.stream.rate_hz,
        }
        raise ImportRefused(Message(ImportCode.FRAME_RATE, rates))
    shared = [label for label in export.labels if label in live.stream.labels]
    _, in_live, in_export = np.intersect1d(live.sample_numbers.astype(np.int64), numbers, return_indices=True)
    recorded = live.values[in_live][:, [live.stream.labels.index(label) for label in shared], :3]
    exported = export.positions[in_export][:, [export.labels.index(label) for label in shared]]
    distances = np.linalg.norm(recorded - exported, axis=2)
    distances = distances[np.isfinite(distances)]
    if not len(distances):
        raise ImportRefused(Message(ImportCode.NOTHING_IN_COMMON, {"file": file.name, "path": path.name}))
    if (distance := float(np.median(distances))) > SAME_TRIAL_MM:
        figures: Figures = {"file": file.name, "path": path.name, "distance_mm": distance, "limit_mm": SAME_TRIAL_MM}
        raise ImportRefused(Message(ImportCode.OTHER_TRIAL, figures))


def _labels(live: Track, export: MarkerTable) -> tuple[str, ...]:
    return export.labels + tuple(label for label in live.stream.labels if label not in export.labels)


def _merged(
    live: Track, export: MarkerTable, numbers: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Numbers (frames,) of the frames of both, and values (frames, labels, 4)."""
    live_numbers = live.sample_numbers.astype(np.int64)
    merged = np.union1d(live_numbers, numbers)
    labels = _labels(live, export)
    values = np.full((len(merged), len(labels), 4), np.nan, np.float32)
    columns = [labels.index(label) for label in live.stream.labels]
    values[np.searchsorted(merged, live_numbers)[:, None], columns] = live.values
    full = np.concatenate((export.positions, export.residuals[..., None]), axis=2).astype(np.float32)
    full[export.missing] = np.nan
    values[np.searchsorted(merged, numbers), : len(export.labels)] = full
    return merged, values


def _items(
    recording: Recording, live: Track, origin: Event, numbers: NDArray[np.int64], values: NDArray[np.float32]
) -> Iterator[Item]:
    """The items of the original in their order, with the frames inserted at their time of arrival."""
    rate = live.stream.rate_hz
    since_first = nanoseconds((numbers - int(live.sample_numbers[0])) / rate)
    counted = nanoseconds((live.sample_numbers.astype(np.int64) - int(live.sample_numbers[0])) / rate)
    host = since_first + int(np.min(live.host_time_ns - counted))
    frames = blocks("/markers", numbers, since_first + int(live.device_time_ns[0]), host, values)
    others = (
        item
        for item in recording.items()
        if isinstance(item, Event) or (isinstance(item, Samples | Loss) and item.stream != "/markers")
    )
    yield origin
    yield from heapq.merge(frames, others, key=lambda item: item.host_time_ns)


def _notes(live: Track, export: MarkerTable, numbers: NDArray[np.int64]) -> Iterator[Message[ImportCode]]:
    """Gaps of the live stream, and frames that are missing in the export."""
    live_numbers = live.sample_numbers.astype(np.int64)
    added = np.setdiff1d(numbers, live_numbers)
    first = f", from frame {added[0]} on" if len(added) else ""
    yield Message(ImportCode.FRAMES_ADDED, {"added": len(added), "frames": len(numbers), "first": first})
    unknown = [label for label in export.labels if label not in live.stream.labels]
    if unknown:
        yield Message(ImportCode.LABELS_ADDED, {"labels": ", ".join(unknown)})
    _, in_live, in_export = np.intersect1d(live_numbers, numbers, return_indices=True)
    filled = {}
    for label in export.labels:
        if label in live.stream.labels:
            hidden = np.isnan(live.values[in_live, live.stream.labels.index(label), 0])
            filled[label] = int(np.sum(hidden & ~export.missing[in_export, export.labels.index(label)]))
    if any(filled.values()):
        counts = ", ".join(f"{label} in {count}" for label, count in filled.items() if count)
        yield Message(ImportCode.MARKERS_FILLED, {"filled": counts})
    kept = np.setdiff1d(live_numbers, numbers)
    if len(kept):
        yield Message(ImportCode.FRAMES_KEPT, {"frames": len(kept)})

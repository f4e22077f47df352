"""QTM's full export laid over the live stream of the same trial: what that lacked, and a recording without gaps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fitting.quality import UnusableTrial
from fitting.timing import clocks
from fitting.timing.sync_line import find_edges
from recordings.exchange.tables import MarkerTable
from recordings.manifest import Manifest
from recordings.reader import Recording, Track, open_recording
from recordings.samples import Event, Item, Loss, Samples, Stream
from station.files.foreign_files import ImportRefused, MarkerSource, read_markers
from station.files.import_trial import Imported
from station.files.new_recording import blocks, nanoseconds, write_recording

SAME_TRIAL_MM = 5.0
"""Median distance between the export and the live stream: tracking anew, filtering and gap filling move less."""


def completed_path(path: Path) -> Path:
    """run-1.mcap → run-1.completed.mcap"""
    return path.with_suffix(".completed.mcap")


def complete_trial(path: Path, source: MarkerSource) -> Imported:
    """Writes the recording anew with the export's markers, beside the original, which stays as it is.

    The export is believed wherever it has a frame, also where it says that a marker was not seen; frames that only the
    live stream has are kept. The notes say what the live stream lacked.
    Raises ImportRefused or RecordingError, each one sentence.
    """
    recording = open_recording(path)
    if recording.outcome is None:
        raise ImportRefused(f"{path} was cut, so nobody knows where it ends; only a whole recording can be completed")
    subject = recording.manifest.cuff or recording.manifest.bounce
    export = read_markers(source, subject.labels if subject else ())
    live = _captured(recording)
    numbers = np.rint(export.time_s * export.rate_hz).astype(np.int64) + 1
    _require_same_trial(path, source.path, live, export, numbers)
    merged_numbers, values = _merged(live, export, numbers)
    stream = replace(live.stream, labels=_labels(live, export), source=f"{live.stream.source}; {source.path.name}")
    streams = [stream if each.name == "/markers" else each for each in recording.streams]
    words = f"the markers are those of {source.path.name} over those of the live stream"
    items = _items(
        recording, live, Event("completed", words, recording.manifest.start_utc_ns, "station"), merged_numbers, values
    )
    output = completed_path(path)
    files = f"{path.name} and {source.path.name}"
    write_recording(output, recording.manifest, streams, items, recording.outcome, files)
    return Imported(output, (*export.notes, *_notes(live, export, numbers)))


def _captured(recording: Recording) -> Track:
    """The live frames of the capture, without preview before and after it."""
    track = recording.load("/markers")
    if not len(track.sample_numbers):
        raise ImportRefused(
            f"{recording.path} holds no live frame to lay the export over; import force and markers anew"
        )
    if not recording.manifest.begins_at_edge:
        return track
    device, host = (1e-9 * times.astype(np.float64) for times in (track.device_time_ns, track.host_time_ns))
    try:
        edge = _edge_on_host(recording, recording.manifest)
    except UnusableTrial as error:
        raise ImportRefused(f"{recording.path.name} cannot be completed: {error}") from error
    part = clocks.capture_frames(track.sample_numbers.astype(np.int64), device, host, track.stream.rate_hz, edge)
    return Track(
        track.stream,
        track.sample_numbers[part],
        track.device_time_ns[part],
        track.host_time_ns[part],
        track.values[part],
    )


def _edge_on_host(recording: Recording, manifest: Manifest) -> float:
    """When the capture began, on the host's clock [s]."""
    is_started_by_edge = manifest.start == "pfi0"
    track = recording.load("/force" if is_started_by_edge else "/sync")
    seconds = track.sample_numbers.astype(np.float64) / track.stream.rate_hz
    rising = 0.0
    if not is_started_by_edge:
        rising = find_edges(seconds, track.values[:, 0], manifest.sync_threshold_v).rising
    return rising + clocks.arrival_offset(1e-9 * track.host_time_ns.astype(np.float64), seconds)


def _require_same_trial(path: Path, file: Path, live: Track, export: MarkerTable, numbers: NDArray[np.int64]) -> None:
    if abs(export.rate_hz / live.stream.rate_hz - 1) > 1e-3:
        raise ImportRefused(
            f"{file.name} has {export.rate_hz:g} frames a second and {path.name} {live.stream.rate_hz:g}, expected the "
            "same; is it the export of this trial?"
        )
    shared = [label for label in export.labels if label in live.stream.labels]
    _, in_live, in_export = np.intersect1d(live.sample_numbers.astype(np.int64), numbers, return_indices=True)
    ours = live.values[in_live][:, [live.stream.labels.index(label) for label in shared], :3]
    theirs = export.positions[in_export][:, [export.labels.index(label) for label in shared]]
    apart = np.linalg.norm(ours - theirs, axis=2)
    apart = apart[np.isfinite(apart)]
    if not len(apart) or float(np.median(apart)) > SAME_TRIAL_MM:
        found = f"are {np.median(apart):.0f} mm apart" if len(apart) else "have no marker and frame in common"
        raise ImportRefused(
            f"the markers of {file.name} and of {path.name} {found}, expected the same within {SAME_TRIAL_MM:g} mm; is "
            "it the export of this trial, from frame 1 on?"
        )


def _labels(live: Track, export: MarkerTable) -> tuple[str, ...]:
    return export.labels + tuple(label for label in live.stream.labels if label not in export.labels)


def _merged(
    live: Track, export: MarkerTable, numbers: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Numbers (frames,) of every frame that one of both has, and values (frames, labels, 4)."""
    ours = live.sample_numbers.astype(np.int64)
    every = np.union1d(ours, numbers)
    labels = _labels(live, export)
    values = np.full((len(every), len(labels), 4), np.nan, np.float32)
    columns = [labels.index(label) for label in live.stream.labels]
    values[np.searchsorted(every, ours)[:, None], columns] = live.values
    full = np.concatenate((export.positions, export.residuals[..., None]), axis=2).astype(np.float32)
    full[export.missing] = np.nan
    values[np.searchsorted(every, numbers), : len(export.labels)] = full
    return every, values


def _items(
    recording: Recording, live: Track, origin: Event, numbers: NDArray[np.int64], values: NDArray[np.float32]
) -> Iterator[Item]:
    """The original's items in their order, and among them the frames when they would have arrived."""
    rate = live.stream.rate_hz
    since_first = nanoseconds((numbers - int(live.sample_numbers[0])) / rate)
    counted = nanoseconds((live.sample_numbers.astype(np.int64) - int(live.sample_numbers[0])) / rate)
    host = since_first + int(np.min(live.host_time_ns - counted))
    frames = blocks("/markers", numbers, since_first + int(live.device_time_ns[0]), host, values)
    yield origin
    waiting = next(frames, None)
    for item in recording.items():
        if isinstance(item, Stream) or (isinstance(item, Samples | Loss) and item.stream == "/markers"):
            continue
        while waiting is not None and waiting.host_time_ns <= item.host_time_ns:
            yield waiting
            waiting = next(frames, None)
        yield item
    while waiting is not None:
        yield waiting
        waiting = next(frames, None)


def _notes(live: Track, export: MarkerTable, numbers: NDArray[np.int64]) -> Iterator[str]:
    """What the live stream lacked, and what the export lacks."""
    ours = live.sample_numbers.astype(np.int64)
    lacking = np.setdiff1d(numbers, ours)
    where = f", the first of them {lacking[0]}" if len(lacking) else ""
    yield f"the live stream lacked {len(lacking)} of the export's {len(numbers)} frames{where}"
    unknown = [label for label in export.labels if label not in live.stream.labels]
    if unknown:
        yield f"the live stream lacked the marker(s) {', '.join(unknown)}"
    _, in_live, in_export = np.intersect1d(ours, numbers, return_indices=True)
    filled = {}
    for label in export.labels:
        if label in live.stream.labels:
            hidden = np.isnan(live.values[in_live, live.stream.labels.index(label), 0])
            filled[label] = int(np.sum(hidden & ~export.missing[in_export, export.labels.index(label)]))
    if any(filled.values()):
        each = ", ".join(f"{label} in {count}" for label, count in filled.items() if count)
        yield f"in frames that it had, the live stream lacked {each}"
    beyond = np.setdiff1d(ours, numbers)
    if len(beyond):
        yield f"the export lacks {len(beyond)} frames that the live stream had, and they are kept"

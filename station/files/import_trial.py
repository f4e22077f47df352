"""Import force and markers from files of other programs into a recording like those of the station.

Samples are written in blocks as devices deliver them, and the file in one piece.
"""

from __future__ import annotations

import hashlib
import math
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from documents.message import Figures, Message, because
from documents.regular_file import draft_folder, replace_file
from fitting.errors import UnusableTrial
from fitting.trial.clocks import find_edges
from fitting.trial.trial import read_trials
from recordings.errors import RecordingError, WriteFailed
from recordings.exchange.sample_tables import MarkerTable, count_samples, unit_of_times
from recordings.manifest import LoadCell, Manifest, TrialOutcome
from recordings.reader import read_manifest
from recordings.samples import Event, Item, Loss, Samples, Stream
from recordings.writer import RecordingWriter
from station.checksums import write_checksums
from station.config import INDICATOR_UNITS_N, StationConfig
from station.files.foreign_files import (
    Force,
    ForceSource,
    ImportRefused,
    MarkerSource,
    WrongImport,
    read_force,
    read_markers,
)
from station.messages.file_messages import ImportCode
from station.protocol import TrialSpec
from station.trial_manifest import make_manifest

LEAST_OVERLAP = 0.5
"""Fraction of the longer file, or with a sync line of the markers, that both files must have in common."""
UNUSED_S = 1.0
"""Longest part of a file outside of the common time that is not reported."""
PAUSE_NS = 60_000_000_000
"""Between trials whose order is known, but not their times."""
EARLIEST, LATEST = datetime(1970, 1, 1, tzinfo=UTC), datetime(2262, 1, 1, tzinfo=UTC)
"""A recording counts nanoseconds from 1970 in 64 bits, which end in April 2262."""
BLOCK_S = 0.5


@dataclass(frozen=True)
class Imported:
    """The recording that was written, and notes for the operator."""

    path: Path
    notes: tuple[Message[ImportCode], ...]


def import_trial(
    session: Path,
    spec: TrialSpec,
    config: StationConfig,
    force_source: ForceSource,
    marker_source: MarkerSource,
    captured: datetime | None = None,
) -> Imported:
    """Write the trial into the session folder under its next free run, completely or not at all.

    The rising edge of a sync line is time 0 of the markers; without a sync line, both files are taken to have the same
    clock. Lag of the force and its uncertainty are those of config.sync; without sync line and config.sync.lag_sd_s,
    half a sample is added to the uncertainty. captured: UTC if it has no time zone; without it, trials of a donning
    have the order of the plan. Raises ImportRefused (also for data that the fit cannot use), ConfigError or
    RecordingError.
    """
    subject = config.subject(spec)
    markers = read_markers(marker_source, subject.labels)
    force = read_force(force_source, has_own_clock=force_source.path != marker_source.path)
    files = f"{force_source.path.name} and {marker_source.path.name}"
    if force.sync is not None:
        aligned = _align_by_edge(force, markers, config, files)
    else:
        is_one_file = force_source.path == marker_source.path
        aligned = _align_by_times(force, markers, config.sync.lag_s, files, is_one_file=is_one_file)
    if aligned.start == "declared" and "lag_sd_s" not in config.sync.model_fields_set:
        config, note = _assume_lag(config, aligned.force_rate, files)
        aligned = replace(aligned, notes=(*aligned.notes, note))
    run, start_utc_ns = spec.next_free_run(session), _start_utc_ns(session, spec, captured)
    manifest = make_manifest(
        config, spec, run, subject, start_utc_ns, start=aligned.start, load_cell=_load_cell(force, config)
    )
    manifest = replace(manifest, origin_s=aligned.origin_s)
    streams = _streams(force, aligned.force_rate, force_source.path.name, markers, marker_source.path.name)
    origin = _origin(aligned, (force_source.path, marker_source.path), start_utc_ns)
    path = session / spec.file_name(run)
    items = [origin, *_items(aligned, force, markers, start_utc_ns)]
    outcome = TrialOutcome(accepted=True, state="closed", sentence=f"imported from {files}")
    write_recording(path, manifest, streams, items, outcome, files)
    return Imported(path, (*_force_notes(force, force_source), *marker_file_notes(markers), *aligned.notes))


def marker_file_notes(markers: MarkerTable) -> tuple[Message[ImportCode], ...]:
    """The notes of the reader of the file."""
    return tuple(Message(ImportCode.MARKER_FILE, because(note)) for note in markers.notes)


def _force_notes(force: Force, source: ForceSource) -> tuple[Message[ImportCode], ...]:
    """Column and range of the force, if the file has other signals and no option names the column."""
    if source.column or not force.others:
        return ()
    figures: Figures = {
        "column": force.column,
        "file": source.path.name,
        "least": float(np.min(force.values)),
        "most": float(np.max(force.values)),
        "unit": force.unit,
    }
    return (Message(ImportCode.FORCE_COLUMN, figures),)


def with_lag(config: StationConfig, lag_s: float | None, lag_sd_s: float | None) -> StationConfig:
    """The configuration with another lag of force against markers [s], or another standard uncertainty of it [s]."""
    given = {"lag_s": lag_s, "lag_sd_s": lag_sd_s}
    sync = config.sync.model_copy(update={key: value for key, value in given.items() if value is not None})
    return config.model_copy(update={"sync": sync})


@dataclass(frozen=True)
class _AlignedFiles:
    """Force and markers with sample numbers and on session time.

    force_numbers (n,), frame_numbers (frames,): as counted by a device; force_rate [Hz]
    force_at (n,), frames_at (frames,): session time [s]; origin_s: its zero on the clock of the files; reason: of the
    zero, in a sentence
    """

    start: Literal["sync_edge", "declared", "one_clock"]
    force_numbers: NDArray[np.int64]
    force_rate: float
    force_at: NDArray[np.float64]
    frame_numbers: NDArray[np.int64]
    frames_at: NDArray[np.float64]
    origin_s: float
    reason: str
    notes: tuple[Message[ImportCode], ...]


def _start_utc_ns(session: Path, spec: TrialSpec, captured: datetime | None) -> int:
    """Time of the capture; if it is not given, now, or a time that keeps the order of the plan in the session.

    The migration depends on the order of the trials, and files are imported in any order: alphabetically, a dynamic
    test comes before the static one that was recorded first.
    """
    if captured is not None:
        utc = captured if captured.tzinfo else captured.replace(tzinfo=UTC)
        if not EARLIEST <= utc < LATEST:
            figures: Figures = {"start": utc.isoformat(), "earliest": EARLIEST.year, "latest": LATEST.year - 1}
            raise WrongImport(Message(ImportCode.START_OUT_OF_RANGE, figures))
        return round(utc.timestamp() * 1e6) * 1000
    now, order = time.time_ns(), (spec.repeat, spec.test == "dynamic")
    before, after = [0], [now + PAUSE_NS]
    for path in session.glob("*.mcap"):
        with suppress(RecordingError):
            other = read_manifest(path)
            if other.cuff is not None and (other.cuff.name, other.donning) == (spec.cuff, spec.donning):
                is_before = (other.repeat, other.test == "dynamic") <= order
                (before if is_before else after).append(other.start_utc_ns)
    latest, earliest = max(before), min(after)
    return max(earliest - PAUSE_NS, (latest + earliest) // 2) if latest < earliest else now


def _align_by_edge(force: Force, markers: MarkerTable, config: StationConfig, files: str) -> _AlignedFiles:
    numbers, rate = _counted(force.time)
    assert force.sync is not None  # noqa: S101  (the caller has checked it)
    try:
        edge = find_edges(numbers / rate, force.sync, config.sync.threshold_v).rising
    except UnusableTrial as error:
        raise ImportRefused(Message(ImportCode.NOT_USABLE, {"files": files, **because(error)})) from error
    frames = markers.frame_numbers
    if frames[0] < 1:
        figures: Figures = {"files": files, "before_s": -float(markers.time_s[0])}
        raise ImportRefused(Message(ImportCode.BEFORE_CAPTURE, figures))
    force_at, frames_at = numbers / rate - edge, (frames - 1) / markers.rate_hz
    at = force_at + config.sync.lag_s
    notes = _require_common_time(at, frames_at, frames_at[-1] - frames_at[0], files)
    reason = f"the sync line rises at {edge:.4f} s of the force file, which is time 0 of the markers"
    return _AlignedFiles("sync_edge", numbers, rate, force_at, frames, frames_at, 0.0, reason, notes)


def _align_by_times(
    force: Force, markers: MarkerTable, lag_s: float, files: str, *, is_one_file: bool
) -> _AlignedFiles:
    numbers, rate = _counted(force.time)
    origin = float(markers.time_s[0])
    frames = markers.frame_numbers - markers.frame_numbers[0] + 1
    force_at, frames_at = force.time - origin, markers.time_s - origin
    longer = max(float(np.ptp(force_at)), float(np.ptp(frames_at)))
    notes = _require_common_time(force_at + lag_s, frames_at, longer, files)
    reason = f"without a sync line, both files are taken to have the same clock; {origin:g} s on it is time 0"
    if is_one_file:
        reason = f"force and markers have one clock; {origin:g} s on it is time 0"
    start: Literal["one_clock", "declared"] = "one_clock" if is_one_file else "declared"
    return _AlignedFiles(start, numbers, rate, force_at, frames, frames_at, origin, reason, notes)


def _assume_lag(config: StationConfig, force_rate: float, files: str) -> tuple[StationConfig, Message[ImportCode]]:
    """Add a lag that is uniform within half a force sample to the uncertainty of the configuration.

    The files do not define which instant of a sample its time stamp marks. The lag counts as common to all trials,
    because it depends on the program that wrote the files.
    """
    sd = math.hypot(config.sync.lag_sd_s, 0.5 / force_rate / math.sqrt(3))
    figures: Figures = {"files": files, "lag_sd_ms": 1e3 * sd, "rate_hz": force_rate}
    return with_lag(config, None, sd), Message(ImportCode.LAG_ASSUMED, figures)


def _counted(times: NDArray[np.float64]) -> tuple[NDArray[np.int64], float]:
    numbers, rate = count_samples(times)
    return numbers, float(f"{rate:.9g}")  # digits of the times in a file


def _require_common_time(
    force_at: NDArray[np.float64], frames_at: NDArray[np.float64], expected: float, files: str
) -> tuple[Message[ImportCode], ...]:
    """A note if one file ends long before the other. Raises ImportRefused if they have too little time in common.

    force_at (n,): time of the force with its lag [s]
    """
    starts, ends = (force_at[0], frames_at[0]), (force_at[-1], frames_at[-1])
    common = float(min(ends) - max(starts))
    figures: Figures = {
        "files": files,
        "common_s": max(0.0, common),
        "expected_s": float(expected),
        "force_from_s": float(starts[0]),
        "force_to_s": float(ends[0]),
        "markers_from_s": float(starts[1]),
        "markers_to_s": float(ends[1]),
    }
    if common < LEAST_OVERLAP * expected:
        ratio = float((ends[0] - starts[0]) / (ends[1] - starts[1]))
        for quantity, durations in (("the force", ratio), ("the markers", 1 / ratio)):
            if unit := unit_of_times(durations):
                raise ImportRefused(Message(ImportCode.TIME_UNIT, {**figures, "times_of": quantity, "unit": unit}))
        raise ImportRefused(Message(ImportCode.SHORT_OVERLAP, figures))
    return (Message(ImportCode.PARTIAL_OVERLAP, figures),) if ends[1] - common > UNUSED_S else ()


def _load_cell(force: Force, config: StationConfig) -> LoadCell:
    """Calibration of the configuration for volts; newtons and pounds-force are taken as they are, tension positive."""
    cell = config.load_cell
    if force.unit != "V":
        scale = 1.0 if force.unit == "N" else INDICATOR_UNITS_N["usb220"]
        return LoadCell("daq", scale, 1, cell.serial_number, gain_relative_sd=cell.gain_relative_sd)
    if cell.source != "daq":
        raise WrongImport(Message(ImportCode.NO_SCALE, {"source": cell.source, "column": force.column}))
    return config.calibration()


def _streams(force: Force, force_rate: float, force_file: str, markers: MarkerTable, marker_file: str) -> list[Stream]:
    streams = [Stream("/force", "lbf" if force.unit == "lbs" else force.unit, ("force",), force_rate, force_file)]
    if force.sync is not None:
        streams.append(Stream("/sync", "V", ("sync",), force_rate, force_file))
    return [*streams, Stream("/markers", "mm", markers.labels, markers.rate_hz, marker_file)]


def _origin(aligned: _AlignedFiles, files: Sequence[Path], start_utc_ns: int) -> Event:
    hashes = ", ".join(f"{path.name} (sha256 {hashlib.sha256(path.read_bytes()).hexdigest()})" for path in files)
    return Event("imported", f"from {hashes}; {aligned.reason}", start_utc_ns, "station")


def _items(aligned: _AlignedFiles, force: Force, markers: MarkerTable, start_utc_ns: int) -> list[Item]:
    """Blocks and losses in the order of arrival; the first sample arrives at start_utc_ns."""
    first = min(aligned.force_at[0], aligned.frames_at[0])
    host_of_force = start_utc_ns + nanoseconds(aligned.force_at - first)
    host_of_frames = start_utc_ns + nanoseconds(aligned.frames_at - first)
    positions = np.concatenate((markers.positions, markers.residuals[..., None]), axis=2)
    positions[markers.missing] = np.nan
    device = nanoseconds(force.time)
    items = [
        *blocks("/force", aligned.force_numbers, device, host_of_force, force.values[:, None]),
        *blocks(
            "/markers", aligned.frame_numbers, nanoseconds(markers.time_s), host_of_frames, positions.astype(np.float32)
        ),
    ]
    if force.sync is not None:
        items += blocks("/sync", aligned.force_numbers, device, host_of_force, force.sync[:, None])
    return sorted(items, key=lambda item: item.host_time_ns)


def blocks(
    stream: str,
    numbers: NDArray[np.int64],
    device_ns: NDArray[np.int64],
    host_ns: NDArray[np.int64],
    values: NDArray[Any],
) -> Iterator[Samples | Loss]:
    """Samples (n,) in blocks of half a second that arrive with their last sample; a gap begins with its loss."""
    cuts = np.flatnonzero(np.diff((host_ns - host_ns[0]) // round(1e9 * BLOCK_S)) | (np.diff(numbers) != 1)) + 1
    for part in np.split(np.arange(len(numbers)), cuts):
        begin, end = int(part[0]), int(part[-1]) + 1
        lost = int(numbers[begin - 1]) + 1 if begin else int(numbers[begin])
        if numbers[begin] > lost:
            count, arrival = int(numbers[begin]) - lost, int(host_ns[begin])
            yield Loss(stream, "skipped", lost, count, int(device_ns[begin - 1]), arrival)
        counted = numbers[begin:end].astype(np.uint64)
        yield Samples(stream, counted, device_ns[begin:end], int(host_ns[end - 1]), values[begin:end])


def nanoseconds(seconds: NDArray[np.float64]) -> NDArray[np.int64]:
    return np.rint(1e9 * seconds).astype(np.int64)


def write_recording(
    path: Path, manifest: Manifest, streams: Sequence[Stream], items: Iterable[Item], outcome: TrialOutcome, files: str
) -> None:
    """Write a recording under its name once it is complete and readable by the fit; otherwise leave no file.

    files: the sources of the data, for messages. Raises ImportRefused or RecordingError.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with ExitStack() as stack:
        draft = stack.enter_context(draft_folder(path.parent)) / path.name
        try:
            writer = RecordingWriter(draft, manifest, streams)
            stack.callback(writer.discard)
            for item in items:
                writer.write(item)
            writer.close(outcome)
        except WriteFailed as error:  # whose advice is that for a trial that is being recorded
            figures = {"path": str(path), **because(error.__cause__ or error)}
            raise ImportRefused(Message(ImportCode.NOT_WRITTEN, figures)) from error
        rejected = read_trials([draft])[1]
        if rejected:
            reason = {"files": files, **because(rejected[0].reason)}
            raise ImportRefused(Message(ImportCode.NOT_USABLE, reason))
        if path.exists():
            raise ImportRefused(Message(ImportCode.FILE_EXISTS, {"path": str(path)}))
        replace_file(draft, path)
    write_checksums(path)

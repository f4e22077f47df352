"""Force and markers from files of other programs → one recording like those the station makes itself."""

from __future__ import annotations

import hashlib
import math
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from fitting.quality import UnusableTrial
from fitting.timing.sync_line import find_edges
from recordings.errors import RecordingError
from recordings.exchange.tables import MarkerTable, count_samples
from recordings.manifest import BounceRig, CuffSite, LoadCell, Manifest, TrialOutcome
from recordings.reader import read_manifest
from recordings.samples import Event, Item, Stream
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
from station.files.new_recording import blocks, nanoseconds, write_recording
from station.protocol import TrialSpec
from station.versions import installed_versions

LEAST_OVERLAP = 0.5
"""Of the longer file, or with a sync line of the markers: less in common, and they are of two trials."""
WORTH_TELLING_S = 1.0
PAUSE_NS = 60_000_000_000
"""Between trials of whose times nothing is known but their order."""


@dataclass(frozen=True)
class Imported:
    """The recording that was made, and what the operator should know of it, in sentences."""

    path: Path
    notes: tuple[str, ...]


def import_trial(
    session: Path,
    spec: TrialSpec,
    config: StationConfig,
    force_source: ForceSource,
    marker_source: MarkerSource,
    captured: datetime | None = None,
) -> Imported:
    """Writes the trial into the session's folder under its next free run; all of it or nothing.

    With a sync line its rising edge is the markers' time 0; without one both files tell the same time. The lag of the
    force and its uncertainty are those of config.sync, and half a sample more where neither a sync line nor
    config.sync.lag_sd_s says how well the files' times agree. captured is in UTC where it names no zone; without it
    trials of a donning follow each other as in the plan. What the fit could not use is refused here already.
    Raises ImportRefused, ConfigError or RecordingError, each one sentence.
    """
    subject = config.subject(spec.cuff)
    markers = read_markers(marker_source, subject.labels)
    force = read_force(force_source, has_own_clock=force_source.path != marker_source.path)
    files = f"{force_source.path.name} and {marker_source.path.name}"
    if force.sync is not None:
        laid = _by_edge(force, markers, config, files)
    else:
        laid = _by_declaration(force, markers, files, is_one_file=force_source.path == marker_source.path)
    if laid.start == "declared" and "lag_sd_s" not in config.sync.model_fields_set:
        config, said = _unsaid_lag(config, laid.force_rate, files)
        laid = replace(laid, notes=(*laid.notes, said))
    run, start_utc_ns = spec.next_free_run(session), _start_utc_ns(session, spec, captured)
    manifest = Manifest(
        cuff=subject if isinstance(subject, CuffSite) else None,
        bounce=subject if isinstance(subject, BounceRig) else None,
        test=spec.test,
        repeat=spec.repeat,
        run=run,
        donning=spec.donning,
        start=laid.start,
        origin_s=laid.origin_s,
        sync_threshold_v=config.sync.threshold_v,
        load_cell=_load_cell(force, config),
        start_utc_ns=start_utc_ns,
        timing=config.timing(),
        protocol=config.measurement_protocol(),
        effective_config=config.model_dump(mode="json"),
        versions=installed_versions(),
    )
    streams = _streams(force, laid.force_rate, force_source.path.name, markers, marker_source.path.name)
    origin = _origin(laid, (force_source.path, marker_source.path), start_utc_ns)
    path = session / spec.file_name(run)
    items = [origin, *_items(laid, force, markers, start_utc_ns)]
    write_recording(
        path,
        manifest,
        streams,
        items,
        TrialOutcome(accepted=True, state="closed", sentence=f"imported from {files}"),
        files,
    )
    return Imported(path, (*markers.notes, *laid.notes))


def with_lag(config: StationConfig, lag_s: float | None, lag_sd_s: float | None) -> StationConfig:
    """The configuration with another lag of force against markers [s], or another standard uncertainty of it [s]."""
    said = {"lag_s": lag_s, "lag_sd_s": lag_sd_s}
    sync = config.sync.model_copy(update={key: value for key, value in said.items() if value is not None})
    return config.model_copy(update={"sync": sync})


@dataclass(frozen=True)
class _Laid:
    """Force and markers counted, and placed on session time.

    force_numbers (n,), frame_numbers (frames,) as a device would have counted them; force_rate Hz
    force_at (n,), frames_at (frames,) s of session time; origin_s, its zero on the files' clock; words say why there
    """

    start: Literal["sync_edge", "declared", "one_clock"]
    force_numbers: NDArray[np.int64]
    force_rate: float
    force_at: NDArray[np.float64]
    frame_numbers: NDArray[np.int64]
    frames_at: NDArray[np.float64]
    origin_s: float
    words: str
    notes: tuple[str, ...]


def _start_utc_ns(session: Path, spec: TrialSpec, captured: datetime | None) -> int:
    """When the trial was captured; where nobody says, now, or where the plan puts it among those already there.

    What the cuff slips depends on the order of the trials, and files are imported in any order: alphabetically, a
    dynamic test comes before the static one that was done first.
    """
    if captured is not None:
        return round((captured if captured.tzinfo else captured.replace(tzinfo=UTC)).timestamp() * 1e6) * 1000
    now, here = time.time_ns(), (spec.repeat, spec.test == "dynamic")
    before, after = [0], [now + PAUSE_NS]
    for path in session.glob("*.mcap"):
        with suppress(RecordingError):
            other = read_manifest(path)
            if other.cuff is not None and (other.cuff.name, other.donning) == (spec.cuff, spec.donning):
                is_before = (other.repeat, other.test == "dynamic") <= here
                (before if is_before else after).append(other.start_utc_ns)
    latest, earliest = max(before), min(after)
    return max(earliest - PAUSE_NS, (latest + earliest) // 2) if latest < earliest else now


def _by_edge(force: Force, markers: MarkerTable, config: StationConfig, files: str) -> _Laid:
    numbers, rate = _counted(force.time)
    assert force.sync is not None  # noqa: S101  (who calls has asked)
    try:
        edge = find_edges(numbers / rate, force.sync, config.sync.threshold_v).rising
    except UnusableTrial as error:
        raise ImportRefused(f"{files} cannot be used: {error}") from error
    frames = np.rint(markers.time_s * markers.rate_hz).astype(np.int64) + 1
    if frames[0] < 1:
        raise ImportRefused(
            f"{files}: the markers begin {-markers.time_s[0]:.3g} s before the capture; export from frame 1 on"
        )
    force_at, frames_at = numbers / rate - edge, (frames - 1) / markers.rate_hz
    notes = _require_common_time(force_at, frames_at, frames_at[-1] - frames_at[0], files)
    words = f"the sync line rises at {edge:.4f} s of the force file: that is time 0 of the markers"
    return _Laid("sync_edge", numbers, rate, force_at, frames, frames_at, 0.0, words, notes)


def _by_declaration(force: Force, markers: MarkerTable, files: str, *, is_one_file: bool) -> _Laid:
    numbers, rate = _counted(force.time)
    origin = float(markers.time_s[0])
    frames = np.rint((markers.time_s - origin) * markers.rate_hz).astype(np.int64) + 1
    force_at, frames_at = force.time - origin, markers.time_s - origin
    longer = max(float(np.ptp(force_at)), float(np.ptp(frames_at)))
    notes = _require_common_time(force_at, frames_at, longer, files)
    words = f"there is no sync line: both files are said to tell the same time, {origin:g} s in them is time 0"
    if is_one_file:
        words = f"force and markers have one clock, {origin:g} s on it is time 0"
    start: Literal["one_clock", "declared"] = "one_clock" if is_one_file else "declared"
    return _Laid(start, numbers, rate, force_at, frames, frames_at, origin, words, notes)


def _unsaid_lag(config: StationConfig, force_rate: float, files: str) -> tuple[StationConfig, str]:
    """The configuration with a lag that may lie anywhere within half a sample of force besides, and a note of it.

    Which moment of its sample a time stamp means, and when the first one was taken, no file says. It counts as shared
    by all trials: a habit of the program that wrote them is.
    """
    sd = math.hypot(config.sync.lag_sd_s, 0.5 / force_rate / math.sqrt(3))
    note = (
        f"{files} have no sync line, and nobody said how well their times agree: the lag is taken to be known to "
        f"{1e3 * sd:.1f} ms, half a sample of force at {force_rate:g} Hz; say it with --lag-sd-s, or import a bounce"
    )
    return with_lag(config, None, sd), note


def _counted(times: NDArray[np.float64]) -> tuple[NDArray[np.int64], float]:
    numbers, rate = count_samples(times)
    return numbers, float(f"{rate:.9g}")  # times are written with so many digits


def _require_common_time(
    force_at: NDArray[np.float64], frames_at: NDArray[np.float64], expected: float, files: str
) -> tuple[str, ...]:
    """A note where one file ends long before the other. Raises ImportRefused where they share too little."""
    starts, ends = (force_at[0], frames_at[0]), (force_at[-1], frames_at[-1])
    common = min(ends) - max(starts)
    spans = f"force from {starts[0]:.2f} to {ends[0]:.2f} s, markers from {starts[1]:.2f} to {ends[1]:.2f} s"
    if common < LEAST_OVERLAP * expected:
        raise ImportRefused(
            f"{files} share {max(0.0, common):.2f} s, expected at least half of {expected:.2f} s ({spans}); are they "
            "of the same trial? If they are, cut the longer one"
        )
    if ends[1] - common > WORTH_TELLING_S:
        return (f"{files} share {common:.2f} s, and nothing else of them is used: {spans}",)
    return ()


def _load_cell(force: Force, config: StationConfig) -> LoadCell:
    """Volts by the configuration's calibration; newtons and pounds-force as they stand, tension positive."""
    cell = config.load_cell
    if force.unit != "V":
        scale = 1.0 if force.unit == "N" else INDICATOR_UNITS_N["usb220"]
        return LoadCell("daq", scale, 1, cell.serial_number, gain_relative_sd=cell.gain_relative_sd)
    if cell.source != "daq":
        raise WrongImport(
            f'the configuration has load_cell.source = "{cell.source}" and no scale for the volts of {force.column}; '
            "give --force-unit N or lbs, or a configuration with the DAQ's capacity_kg and full_scale_v"
        )
    return config.calibration()


def _streams(force: Force, force_rate: float, force_file: str, markers: MarkerTable, marker_file: str) -> list[Stream]:
    streams = [Stream("/force", "lbf" if force.unit == "lbs" else force.unit, ("force",), force_rate, force_file)]
    if force.sync is not None:
        streams.append(Stream("/sync", "V", ("sync",), force_rate, force_file))
    return [*streams, Stream("/markers", "mm", markers.labels, markers.rate_hz, marker_file)]


def _origin(laid: _Laid, files: Sequence[Path], start_utc_ns: int) -> Event:
    hashes = ", ".join(f"{path.name} (sha256 {hashlib.sha256(path.read_bytes()).hexdigest()})" for path in files)
    return Event("imported", f"from {hashes}; {laid.words}", start_utc_ns, "station")


def _items(laid: _Laid, force: Force, markers: MarkerTable, start_utc_ns: int) -> list[Item]:
    """Blocks and losses in the order in which they would have arrived, the first sample of all at start_utc_ns."""
    first = min(laid.force_at[0], laid.frames_at[0])
    host_of_force = start_utc_ns + nanoseconds(laid.force_at - first)
    host_of_frames = start_utc_ns + nanoseconds(laid.frames_at - first)
    positions = np.concatenate((markers.positions, markers.residuals[..., None]), axis=2)
    positions[markers.missing] = np.nan
    device = nanoseconds(force.time)
    items = [
        *blocks("/force", laid.force_numbers, device, host_of_force, force.values[:, None]),
        *blocks(
            "/markers", laid.frame_numbers, nanoseconds(markers.time_s), host_of_frames, positions.astype(np.float32)
        ),
    ]
    if force.sync is not None:
        items += blocks("/sync", laid.force_numbers, device, host_of_force, force.sync[:, None])
    return sorted(items, key=lambda item: item.host_time_ns)

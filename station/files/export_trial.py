"""Export recordings to files of other programs: all streams on one clock, in SI or in the unit of the format.

A recording without a common clock becomes one table per stream, with counts, times and values of its device. Trials of
earlier exports to the same Motion-BIDS data set are kept.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import metadata
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from documents.message import Message, because, join_sentences
from fitting.trial.analog_signals import AnalogSignals, nearest_samples
from fitting.wearer.wearer_trial import elevation_from_markers, find_cycles
from recordings.contents import read_contents
from recordings.errors import RecordingError
from recordings.exchange.motion_bids import BidsSignals, BidsTrial, bids_files, bids_label, bids_summary
from recordings.exchange.qtm_tsv import write_qtm_tsv
from recordings.exchange.signal_csv import write_columns
from recordings.exchange.trc import write_trc
from recordings.manifest import Manifest
from recordings.reader import Track, open_recording
from recordings.samples import Event
from station.checksums import changed_files, check_hash, drafted, write_whole
from station.files.export_loads import write_loads
from station.files.synchronised import ExportRefused, NoCommonClock, SynchronisedRecording, read_synchronised
from station.messages.file_messages import ChainCode, ExportCode
from station.progress import Progress, silent
from station.protocol import CONDITION_NAMES

SHORTFALLS_LISTED = 4
"""Gaps and damages of a recording in its note; `station info` lists all."""
AXES = ("x", "y", "z")
LOADS = ("mot", "sto")


@dataclass(frozen=True)
class Exported:
    """The written files, notes on them, and the reasons why recordings were left out."""

    paths: tuple[Path, ...]
    notes: tuple[Message[ChainCode | ExportCode], ...]
    refused: tuple[Message[ExportCode], ...]

    @property
    def is_whole(self) -> bool:
        """Whether every recording is exported, and complete and unchanged."""
        return not self.refused and not {note.code for note in self.notes} & {ChainCode.CHANGED, ExportCode.INCOMPLETE}

    def to_plain(self) -> dict[str, Any]:
        """The result as JSON."""
        return {
            "written": [str(path) for path in self.paths],
            "notes": [str(note) for note in self.notes],
            "note_codes": [note.to_plain() for note in self.notes],
            "refused": [str(reason) for reason in self.refused],
            "refused_codes": [reason.to_plain() for reason in self.refused],
        }


def export_recordings(
    paths: Sequence[Path], to: str, output: Path, subject: str, progress: Progress = silent, *, fills_gaps: bool = False
) -> Exported:
    """Write every recording that can be exported; fills_gaps: interpolate gaps in mot and sto instead of splitting.

    Raises ExportRefused if nothing can be written.
    """
    written: list[Path] = []
    notes: list[Message[ExportCode]] = []
    refused: list[Message[ExportCode]] = []
    for_bids: list[SynchronisedRecording] = []
    for done, path in enumerate(paths):
        progress("exporting recordings", done, len(paths))
        try:
            notes += _shortfalls(path)
            trial = read_synchronised(path)
            if to == "bids":
                for_bids.append(trial)
            elif to in LOADS:
                stem, suffix = output / path.stem, f".{to}"
                loads = write_loads(trial, stem, suffix, fills_gaps=fills_gaps)
                written += [*loads.files, _sidecar(trial, stem, suffix, "m", loads.files, {"gaps": loads.gaps})]
                notes += loads.notes
            else:
                written += WRITERS[to](trial, output / path.stem)
        except NoCommonClock as error:
            raw, reason = _without_clock(path, to, output, error)
            written, refused = [*written, *raw], [*refused, reason]
        except (ExportRefused, RecordingError) as error:
            refused.append(_reason(error))
    progress("exporting recordings", len(paths), len(paths))
    if for_bids:
        written += write_bids(for_bids, output, subject)
    if not written:
        if len(refused) == 1:
            raise ExportRefused(refused[0])
        raise ExportRefused(Message(ExportCode.NOTHING_WRITTEN, {"reasons": join_sentences(refused)}))
    return Exported(tuple(written), (*changed_files(paths), *notes), tuple(refused))


def _shortfalls(path: Path) -> list[Message[ExportCode]]:
    """A note on a recording that is incomplete, as `station info` finds it."""
    found = read_contents(path).shortfalls
    more = len(found) - SHORTFALLS_LISTED
    listed = [*found[:SHORTFALLS_LISTED], *([f"and {more} more, see `station info`"] if more > 0 else [])]
    return [Message(ExportCode.INCOMPLETE, {"file": path.name, "reasons": "; ".join(listed)})] if found else []


def _reason(error: ExportRefused | RecordingError) -> Message[ExportCode]:
    if (
        isinstance(error, ExportRefused)
        and isinstance(error.cause, Message)
        and isinstance(error.cause.code, ExportCode)
    ):
        return Message(error.cause.code, error.cause.figures)
    return Message(ExportCode.NOT_EXPORTED, because(error))


def _without_clock(path: Path, to: str, output: Path, error: NoCommonClock) -> tuple[list[Path], Message[ExportCode]]:
    """Write the raw samples of a recording without a common clock, if the format is csv. Returns paths and reason."""
    if to != "csv":
        return [], Message(ExportCode.RAW_POSSIBLE, error.figures)
    reason = str(error.figures["reason"])
    return write_raw(path, output / path.stem, reason), Message(ExportCode.RAW_ONLY, error.figures)


def _tables(separator: str, suffix: str, trial: SynchronisedRecording, stem: Path) -> Iterable[Path]:
    """One table per rate: force, markers, EMG and further inputs. Markers in .tsv have the format of QTM."""
    force, markers = _beside(stem, f"_force{suffix}"), _beside(stem, f"_markers{suffix}")
    write_whole(force, write_columns({"time_s": trial.line.force_time, "force_n": trial.line.force}, separator))
    is_qtm = suffix == ".tsv"
    write_whole(
        markers,
        write_qtm_tsv(trial.markers, trial.edge) if is_qtm else write_columns(_marker_columns(trial), separator),
    )
    files = [force, markers]
    for name, signals in trial.signals.items():
        files.append(_beside(stem, f"_{name.strip('/')}{suffix}"))
        write_whole(files[-1], write_columns(_signal_columns(signals), separator))
    return [*files, _sidecar(trial, stem, suffix, "mm" if is_qtm else "m", files)]


def _parquet(trial: SynchronisedRecording, stem: Path) -> Iterable[Path]:
    notes = {"station": json.dumps(_description(trial, "m"))}
    tables = {
        "_force": {"time_s": trial.line.force_time, "force_n": trial.line.force},
        "_markers": _marker_columns(trial),
        **{f"_{name.strip('/')}": _signal_columns(signals) for name, signals in trial.signals.items()},
    }
    from recordings.exchange.sample_tables import write_parquet

    for name, columns in tables.items():
        path = _beside(stem, f"{name}.parquet")
        with drafted(path) as draft:
            units = {column: column.rpartition("_")[2] for column in columns} | {"force_n": "N"}
            units |= {column: "V" for column in columns if column.endswith("_v")}
            write_parquet(draft, columns, units, notes)
        yield path


def _trc(trial: SynchronisedRecording, stem: Path) -> Iterable[Path]:
    path = _beside(stem, ".trc")
    write_whole(path, write_trc(trial.markers, path.name))
    return [path, _sidecar(trial, stem, path.suffix, "mm", [path])]


def _c3d(trial: SynchronisedRecording, stem: Path) -> Iterable[Path]:
    """Resample all signals to an integer multiple of the frame rate, the only analog clock of the format.

    Force is interpolated linearly. EMG and other inputs take the nearest sample, because linear interpolation would
    attenuate their highest frequencies.
    """
    from recordings.exchange.c3d import write_c3d

    line, markers = trial.line, trial.markers
    fastest = max([_rate(line.force_time), *(signals.rate for signals in trial.signals.values())])
    per_frame = max(1, int(np.ceil(fastest / trial.frame_rate - 1e-3)))
    time = markers.time_s[0] + np.arange(len(markers.time_s) * per_frame) / (trial.frame_rate * per_frame)
    channels, units = {"force_n": np.interp(time, line.force_time, line.force)}, {"force_n": "N"}
    for signals in trial.signals.values():
        nearest = signals.values[nearest_samples(signals.time, time)]
        channels |= dict(zip(signals.labels, nearest.T, strict=True))
        units |= dict.fromkeys(signals.labels, signals.unit)
    path = _beside(stem, ".c3d")
    with drafted(path) as draft:
        write_c3d(draft, markers, channels, units)
    return [path, _sidecar(trial, stem, path.suffix, "mm", [path])]


def _foxglove(trial: SynchronisedRecording, stem: Path) -> Iterable[Path]:
    """Write to the subfolder foxglove: in the session folder, the file would count as a recording."""
    from recordings.exchange.foxglove import Curve, write_foxglove

    path = stem.parent / "foxglove" / f"{stem.name}.mcap"
    curves = {"/force": Curve(trial.line.force_time, trial.line.force)}
    for name, signals in trial.signals.items():
        columns = zip(signals.labels, signals.values.T, strict=True)
        curves |= {f"{name}/{label}": Curve(signals.time, values) for label, values in columns}
    events = [item for item in open_recording(trial.path).items() if isinstance(item, Event)]
    notes = {"station": json.dumps(_description(trial, "m"))}
    with drafted(path) as draft:
        write_foxglove(draft, trial.edge_utc_ns, curves, trial.markers, events, notes)
    return [path]


WRITERS: dict[str, Callable[[SynchronisedRecording, Path], Iterable[Path]]] = {
    "csv": partial(_tables, ",", ".csv"),
    "tsv": partial(_tables, "\t", ".tsv"),
    "parquet": _parquet,
    "trc": _trc,
    "c3d": _c3d,
    "foxglove": _foxglove,
}


def _beside(stem: Path, ending: str) -> Path:
    return stem.with_name(stem.name + ending)


def _marker_columns(trial: SynchronisedRecording) -> dict[str, NDArray[np.float64]]:
    columns = {"time_s": trial.line.marker_time}
    for i, label in enumerate(trial.labels):
        columns |= {f"{label}_{axis}_m": trial.line.markers[:, i, j] for j, axis in enumerate("xyz")}
    return columns


def _signal_columns(signals: AnalogSignals) -> dict[str, NDArray[np.float64]]:
    unit = f"_{signals.unit.lower()}" if signals.unit else ""
    columns = {f"{label}{unit}": signals.values[:, i] for i, label in enumerate(signals.labels)}
    return {"time_s": signals.time, **columns}


def _sidecar(
    trial: SynchronisedRecording,
    stem: Path,
    suffix: str,
    length_unit: str,
    files: Sequence[Path],
    more: Mapping[str, Any] = MappingProxyType({}),
) -> Path:
    path = _beside(stem, f"{suffix}.json")
    content = {"files": [file.name for file in files], **more, **_description(trial, length_unit)}
    write_whole(path, json.dumps(content, indent=2, ensure_ascii=False) + "\n")
    return path


def _description(trial: SynchronisedRecording, length_unit: str) -> dict[str, Any]:
    """Units, rates, calibration, clock and missing samples, for a reader who has only the exported files."""
    manifest, line = trial.manifest, trial.line
    missing = np.isnan(line.markers[..., 0])
    return {
        "recording": trial.path.name,
        "sha256": trial.sha256,
        "checked": check_hash(trial.path),
        "origin": manifest.origin,
        "devices": [vars(device) for device in manifest.devices],
        "cuff": None if manifest.cuff is None else vars(manifest.cuff),
        "body": None if manifest.body is None else vars(manifest.body),
        "condition": manifest.condition,
        "test": manifest.test,
        "repeat": manifest.repeat,
        "run": manifest.run,
        "donning": manifest.donning,
        "clock": {
            "unit": "s",
            "zero": "the sync edge" if manifest.begins_at_edge else "the first frame of the imported files",
            "zero_utc": trial.edge.isoformat(),
            "force_lag_s": line.lag.value,
            "force_lag_sd_s": line.lag.total(float(line.marker_time[-1]) / 2),
        },
        "force": {
            "unit": "N",
            "rate_hz": _rate(line.force_time),
            "samples": len(line.force),
            "calibration": vars(manifest.load_cell) | {"zero": "not removed", "positive": "tension"},
            "lost_s": line.force_gaps,
        },
        "markers": {
            "unit": length_unit,
            "frame": "of the mocap system",
            "rate_hz": trial.frame_rate,
            "frames": len(line.marker_time),
            "missing_frames": dict(zip(trial.labels, missing.sum(axis=0).tolist(), strict=True)),
            "lost_s": line.frame_gaps,
        },
        **{name.strip("/"): _described(signals) for name, signals in trial.signals.items()},
        "cycles": _cycles(trial),
        "notes": [*map(str, line.notes), *trial.signal_notes],
        "versions": manifest.versions,
    }


def _described(signals: AnalogSignals) -> dict[str, Any]:
    return {
        "unit": signals.unit,
        "labels": signals.labels,
        "rate_hz": signals.rate,
        "samples": len(signals.time),
        "time_sd_s": signals.time_sd,
        "lost_s": signals.gaps(),
    }


def _cycles(trial: SynchronisedRecording) -> list[dict[str, float]]:
    """Cycles of the arm in a motion: times [s] and elevations [deg]."""
    body = trial.manifest.body
    angle = elevation_from_markers(trial.line.markers, trial.labels, body.arm, body.trunk) if body is not None else None
    if angle is None or trial.manifest.test != "motion":
        return []
    return [
        {
            "start_s": cycle.start,
            "peak_s": cycle.peak,
            "end_s": cycle.end,
            "lowest_deg": float(np.degrees(cycle.lowest)),
            "highest_deg": float(np.degrees(cycle.highest)),
        }
        for cycle in find_cycles(trial.line.marker_time, angle)
    ]


def _rate(time: NDArray[np.float64]) -> float:
    return float(f"{1 / np.median(np.diff(time)):.9g}")


def write_raw(path: Path, stem: Path, reason: str) -> list[Path]:
    """Write the tables and their sidecar, which gives the reason why there is no common clock."""
    recording = open_recording(path)
    tables = {}
    for stream in recording.streams:
        track = recording.load(stream.name)
        table = stem.with_name(f"{stem.name}_{stream.name.strip('/')}_raw.csv")
        names, values = _columns(track)
        columns = [
            track.sample_numbers.tolist(),
            (1e-9 * track.device_time_ns).round(9).tolist(),
            track.host_time_ns.tolist(),
            *values.T.tolist(),
        ]
        titles = ("sample_number", "device_time_s", "arrived_utc_ns", *names)
        rows = (",".join(map(_text, row)) for row in zip(*columns, strict=True))
        write_whole(table, "\n".join((",".join(titles), *rows)) + "\n")
        tables[table] = {"unit": stream.unit, "device": stream.source, "samples": len(track.sample_numbers)}
    sidecar = stem.with_name(f"{stem.name}_raw.csv.json")
    content = {
        "recording": path.name,
        "clock": f"each device's own: {reason}",
        "files": {table.name: description for table, description in tables.items()},
    }
    write_whole(sidecar, json.dumps(content, indent=2, ensure_ascii=False) + "\n")
    return [*tables, sidecar]


def _text(number: float) -> str:
    return "" if math.isnan(number) else repr(number)


def _columns(track: Track) -> tuple[list[str], np.ndarray]:
    """Names, and values (n, names) in the unit of the device."""
    unit, labels = track.stream.unit, track.stream.labels
    if track.values.ndim == 2:
        return [f"{track.stream.name.strip('/')}_{unit.lower()}"], track.values
    names = [f"{label}_{axis}_{unit}" for label in labels for axis in AXES]
    return names, track.values[:, :, : len(AXES)].reshape(len(track.values), len(names)).astype(np.float64)


def write_bids(trials: Sequence[SynchronisedRecording], output: Path, subject: str) -> Iterator[Path]:
    """Write the files of the trials, and the summary with the rows of earlier exports. Yields every path.

    Subject and session are taken from sub- and ses- in the file name; subject is used for a name without sub-.
    """
    named = [_named(trial, subject) for trial in trials]
    for trial in named:
        for name, content in bids_files(trial).items():
            write_whole(output / name, content)
            yield output / name
    for name, content in bids_summary(named, "cuffstation", metadata.version("cuffstation")).items():
        path = output / name
        write_whole(path, _with_earlier_rows(path, content) if path.suffix == ".tsv" else content)
        yield path


def _named(trial: SynchronisedRecording, subject: str) -> BidsTrial:
    manifest, line = trial.manifest, trial.line
    entities = dict(re.findall(r"(sub|ses)-([0-9A-Za-z]+)", trial.path.stem))
    start, rate, force = _regular(line.force_time, line.force)
    return BidsTrial(
        subject=entities.get("sub", bids_label(subject)),
        session=entities.get("ses", ""),
        task=manifest.test,
        acquisition=bids_label(manifest.cuff.name if manifest.cuff else manifest.condition or ""),
        run=manifest.run,
        markers=trial.markers,
        force=force,
        force_start=start,
        force_rate=rate,
        signals=tuple(_bids_signals(name, signals) for name, signals in trial.signals.items() if len(signals.time) > 1),
        edge_utc_ns=trial.edge_utc_ns,
        description={
            "TaskDescription": _task(manifest),
            "SourceRecording": trial.path.name,
            "SourceSHA256": trial.sha256,
            "DataOrigin": manifest.origin,
            "ForceLagUncertainty": line.lag.total(float(line.marker_time[-1]) / 2),
        },
    )


def _task(manifest: Manifest) -> str:
    if manifest.body is None:
        return f"{manifest.test} test, repeat {manifest.repeat} of donning {manifest.donning}"
    worn = f", {CONDITION_NAMES[manifest.condition]}" if manifest.condition else ""
    return f"{manifest.test} of the wearer{worn}, repeat {manifest.repeat}"


def _bids_signals(name: str, signals: AnalogSignals) -> BidsSignals:
    index = signals.numbers - signals.numbers[0]
    grid = np.full((int(index[-1]) + 1, len(signals.labels)), np.nan)
    grid[index] = signals.values
    rate = float(f"{index[-1] / (signals.time[-1] - signals.time[0]):.9g}")
    return BidsSignals(name.strip("/"), signals.labels, signals.unit, float(signals.time[0]), rate, grid)


def _regular(time: NDArray[np.float64], values: NDArray[np.float64]) -> tuple[float, float, NDArray[np.float64]]:
    """Start [s], rate [Hz] and samples on a regular grid, NaN for lost ones: physio files of BIDS have no times."""
    step = float(np.median(np.diff(time)))
    index = np.rint((time - time[0]) / step).astype(np.int64)
    grid = np.full(int(index[-1]) + 1, np.nan)
    grid[index] = values
    return float(time[0]), float(f"{index[-1] / (time[-1] - time[0]):.9g}"), grid


def _with_earlier_rows(path: Path, content: bytes) -> bytes:
    """Add the rows of the file on the disk whose first field is not in the new table."""
    if not path.exists():
        return content
    header, *rows = content.decode().splitlines()
    known = {row.split("\t")[0] for row in rows}
    kept = [row for row in path.read_text(encoding="utf-8").splitlines()[1:] if row.split("\t")[0] not in known]
    return ("\n".join([header, *sorted(kept + rows)]) + "\n").encode()

"""Recordings → files of other programs: both streams on the common clock, in SI or in the format's own unit."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recordings.errors import RecordingError
from recordings.exchange.c3d_writer import write_c3d
from recordings.exchange.foxglove import Curve, write_foxglove
from recordings.exchange.parquet import write_parquet
from recordings.exchange.qtm_tsv import write_qtm_tsv
from recordings.exchange.signal_csv import write_columns
from recordings.exchange.trc import write_trc
from recordings.reader import open_recording
from recordings.samples import Event
from station.checksums import changed_files, standing_of
from station.files.export_bids import write_bids
from station.files.export_loads import write_loads
from station.files.export_raw import write_raw
from station.files.one_clock import ExportRefused, NoCommonClock, OneClock, read_on_one_clock
from station.progress import Progress, silent
from station.whole_file import drafted, write_whole


@dataclass(frozen=True)
class Exported:
    """The files that were written; in sentences, what a reader should know, and why recordings were left out."""

    paths: tuple[Path, ...]
    notes: tuple[str, ...]
    refused: tuple[str, ...]


def export_recordings(
    paths: Sequence[Path], to: str, output: Path, subject: str, progress: Progress = silent, *, fills_gaps: bool = False
) -> Exported:
    """Write every recording that can be exported; fills_gaps is for mot and sto, which else come in gap-free pieces.

    Raises ExportRefused where there is none.
    """
    written: list[Path] = []
    notes: list[str] = []
    refused: list[str] = []
    for_bids: list[OneClock] = []
    for done, path in enumerate(paths):
        progress("exporting recordings", done, len(paths))
        try:
            trial = read_on_one_clock(path)
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
            raw, sentence = _without_clock(path, to, output, error)
            written, refused = [*written, *raw], [*refused, sentence]
        except (ExportRefused, RecordingError) as error:
            refused.append(str(error))
    progress("exporting recordings", len(paths), len(paths))
    if for_bids:
        written += write_bids(for_bids, output, subject)
    if not written:
        raise ExportRefused("; ".join(refused) or "there is no recording to export")
    return Exported(tuple(written), (*changed_files(paths), *notes), tuple(refused))


def _without_clock(path: Path, to: str, output: Path, error: NoCommonClock) -> tuple[list[Path], str]:
    """What can be written of a recording whose streams have no common clock, and what there is to say of it."""
    if to != "csv":
        return [], f"{error}; --to csv gives the raw samples"
    raw = write_raw(path, output / path.stem, str(error.__cause__))
    return raw, f"{path.name} has no common clock, each stream is exported raw: {error.__cause__}"


def _tables(separator: str, suffix: str, trial: OneClock, stem: Path) -> Iterable[Path]:
    """Force and markers in two tables, as their rates differ; markers in .tsv as QTM itself exports them."""
    force, markers = _beside(stem, f"_force{suffix}"), _beside(stem, f"_markers{suffix}")
    write_whole(force, write_columns({"time_s": trial.line.force_time, "force_n": trial.line.force}, separator))
    is_qtm = suffix == ".tsv"
    write_whole(
        markers,
        write_qtm_tsv(trial.markers, trial.edge) if is_qtm else write_columns(_marker_columns(trial), separator),
    )
    return [force, markers, _sidecar(trial, stem, suffix, "mm" if is_qtm else "m", [force, markers])]


def _parquet(trial: OneClock, stem: Path) -> Iterable[Path]:
    notes = {"station": json.dumps(_description(trial, "m"))}
    tables = {
        "_force": {"time_s": trial.line.force_time, "force_n": trial.line.force},
        "_markers": _marker_columns(trial),
    }
    for name, columns in tables.items():
        path = _beside(stem, f"{name}.parquet")
        with drafted(path) as draft:
            units = {column: column.rpartition("_")[2] for column in columns} | {"force_n": "N"}
            write_parquet(draft, columns, units, notes)
        yield path


def _trc(trial: OneClock, stem: Path) -> Iterable[Path]:
    path = _beside(stem, ".trc")
    write_whole(path, write_trc(trial.markers, path.name))
    return [path, _sidecar(trial, stem, path.suffix, "mm", [path])]


def _c3d(trial: OneClock, stem: Path) -> Iterable[Path]:
    """Force interpolated to a whole multiple of the frame rate: the format has no other analog clock."""
    line, markers = trial.line, trial.markers
    per_frame = max(1, int(np.ceil(_rate(line.force_time) / trial.frame_rate - 1e-3)))
    time = markers.time_s[0] + np.arange(len(markers.time_s) * per_frame) / (trial.frame_rate * per_frame)
    path = _beside(stem, ".c3d")
    with drafted(path) as draft:
        write_c3d(draft, markers, {"force_n": np.interp(time, line.force_time, line.force)}, {"force_n": "N"})
    return [path, _sidecar(trial, stem, path.suffix, "mm", [path])]


def _foxglove(trial: OneClock, stem: Path) -> Iterable[Path]:
    """In a folder of its own: beside the recordings it would be taken for one."""
    path = stem.parent / "foxglove" / f"{stem.name}.mcap"
    curves = {"/force": Curve(trial.line.force_time, trial.line.force)}
    events = [item for item in open_recording(trial.path).items() if isinstance(item, Event)]
    notes = {"station": json.dumps(_description(trial, "m"))}
    with drafted(path) as draft:
        write_foxglove(draft, trial.edge_utc_ns, curves, trial.markers, events, notes)
    return [path]


LOADS = ("mot", "sto")
WRITERS: dict[str, Callable[[OneClock, Path], Iterable[Path]]] = {
    "csv": partial(_tables, ",", ".csv"),
    "tsv": partial(_tables, "\t", ".tsv"),
    "parquet": _parquet,
    "trc": _trc,
    "c3d": _c3d,
    "foxglove": _foxglove,
}


def _beside(stem: Path, ending: str) -> Path:
    return stem.with_name(stem.name + ending)


def _marker_columns(trial: OneClock) -> dict[str, NDArray[np.float64]]:
    columns = {"time_s": trial.line.marker_time}
    for i, label in enumerate(trial.labels):
        columns |= {f"{label}_{axis}_m": trial.line.markers[:, i, j] for j, axis in enumerate("xyz")}
    return columns


def _sidecar(
    trial: OneClock,
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


def _description(trial: OneClock, length_unit: str) -> dict[str, Any]:
    """Units, rates, calibration, clock and what is missing, for whoever has nothing but the exported files."""
    manifest, line = trial.manifest, trial.line
    missing = np.isnan(line.markers[..., 0])
    return {
        "recording": trial.path.name,
        "sha256": trial.sha256,
        "checked": standing_of(trial.path, trial.sha256),
        "origin": manifest.origin,
        "devices": [vars(device) for device in manifest.devices],
        "cuff": None if manifest.cuff is None else vars(manifest.cuff),
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
        "notes": line.notes,
        "versions": manifest.versions,
    }


def _rate(time: NDArray[np.float64]) -> float:
    return float(f"{1 / np.median(np.diff(time)):.9g}")

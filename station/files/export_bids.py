"""Write trials as a Motion-BIDS data set; trials of earlier exports are kept."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from importlib import metadata
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fitting.trial.analog_signals import AnalogSignals
from recordings.exchange.motion_bids import BidsSignals, BidsTrial, bids_files, bids_label, bids_summary
from recordings.manifest import Manifest
from station.files.synchronised import SynchronisedRecording
from station.protocol import CONDITION_NAMES
from station.whole_file import write_whole


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

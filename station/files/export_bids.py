"""Trials → a Motion-BIDS data set; what another export has already put there stays."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from importlib import metadata
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recordings.exchange.motion_bids import BidsTrial, bids_files, bids_label, bids_summary
from station.files.one_clock import OneClock
from station.whole_file import write_whole


def write_bids(trials: Sequence[OneClock], output: Path, subject: str) -> Iterator[Path]:
    """The trials' files, and the summary with the rows of those that were there before.

    subject is taken where the recording's name has no sub-; ses- is taken from there too.
    """
    named = [_named(trial, subject) for trial in trials]
    for trial in named:
        for name, content in bids_files(trial).items():
            write_whole(output / name, content)
            yield output / name
    for name, content in bids_summary(named, "cuffstation", metadata.version("cuffstation")).items():
        path = output / name
        write_whole(path, _with_rows_of(path, content) if path.suffix == ".tsv" else content)
        yield path


def _named(trial: OneClock, subject: str) -> BidsTrial:
    manifest, line = trial.manifest, trial.line
    entities = dict(re.findall(r"(sub|ses)-([0-9A-Za-z]+)", trial.path.stem))
    start, rate, force = _regular(line.force_time, line.force)
    return BidsTrial(
        subject=entities.get("sub", bids_label(subject)),
        session=entities.get("ses", ""),
        task=manifest.test,
        acquisition=bids_label(manifest.cuff.name) if manifest.cuff else "",
        run=manifest.run,
        markers=trial.markers,
        force=force,
        force_start=start,
        force_rate=rate,
        edge_utc_ns=trial.edge_utc_ns,
        description={
            "TaskDescription": f"{manifest.test} test, repeat {manifest.repeat} of donning {manifest.donning}",
            "SourceRecording": trial.path.name,
            "SourceSHA256": trial.sha256,
            "DataOrigin": manifest.origin,
            "ForceLagUncertainty": line.lag.total(float(line.marker_time[-1]) / 2),
        },
    )


def _regular(time: NDArray[np.float64], values: NDArray[np.float64]) -> tuple[float, float, NDArray[np.float64]]:
    """Start [s], rate [Hz] and the samples on a regular grid, NaN where they were lost: BIDS gives physio no times."""
    step = float(np.median(np.diff(time)))
    index = np.rint((time - time[0]) / step).astype(np.int64)
    grid = np.full(int(index[-1]) + 1, np.nan)
    grid[index] = values
    return float(time[0]), float(f"{index[-1] / (time[-1] - time[0]):.9g}"), grid


def _with_rows_of(path: Path, content: bytes) -> bytes:
    """The table with those rows of the one on the disk whose first field it does not have itself."""
    if not path.exists():
        return content
    header, *rows = content.decode().splitlines()
    known = {row.split("\t")[0] for row in rows}
    kept = [row for row in path.read_text(encoding="utf-8").splitlines()[1:] if row.split("\t")[0] not in known]
    return ("\n".join([header, *sorted(kept + rows)]) + "\n").encode()

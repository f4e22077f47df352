"""One trial as files of a Motion-BIDS data set: markers as motion, the force as physio.

After bids-specification.readthedocs.io, Motion (BIDS 1.8 and later): motion.tsv has no header, its columns are the rows
of channels.tsv; what is recorded beside the motion at a rate of its own is physio, with its StartTime against it.
"""

from __future__ import annotations

import gzip
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recordings.exchange.sample_tables import MarkerTable
from recordings.exchange.text import write_row

VERSION = "1.10.0"
MISSING = "n/a"


@dataclass(frozen=True)
class BidsSignals:
    """Channels that were sampled together: values (n, labels) every 1/rate s from start [s] after the edge on.

    name of the recording, "emg"; a lost sample is NaN.
    """

    name: str
    labels: tuple[str, ...]
    unit: str
    start: float
    rate: float
    values: NDArray[np.float64]


@dataclass(frozen=True)
class BidsTrial:
    """Name of one trial, and the signals measured in it.

    markers   in the mocap frame; its times count from the sync edge [s]
    force     (n,) N sampled every 1/force_rate s from force_start [s] after the edge on, NaN where samples are lost
    edge_utc_ns  when the sync edge was, by the station's clock
    """

    subject: str
    session: str
    task: str
    acquisition: str
    run: int
    markers: MarkerTable
    force: NDArray[np.float64]
    force_start: float
    force_rate: float
    edge_utc_ns: int
    description: Mapping[str, Any]
    signals: Sequence[BidsSignals] = ()


def bids_files(trial: BidsTrial) -> dict[PurePosixPath, bytes]:
    """The trial's own files by their path in the data set; the same trial gives the same bytes."""
    folder = _folder(trial) / "motion"
    name = folder / _name(trial)
    first = float(trial.markers.time_s[0])
    flat = trial.markers.positions.reshape(len(trial.markers.time_s), -1) * 1e-3
    columns = [(f"{label}_{axis}", axis, label) for label in trial.markers.labels for axis in "xyz"]
    channels = [f"{channel}\t{axis}\tPOS\t{point}\tm\tlab" for channel, axis, point in columns]
    physio = "\n".join(write_row((value,), "\t", MISSING) for value in trial.force.tolist()) + "\n"
    force = {
        "SamplingFrequency": trial.force_rate,
        "StartTime": trial.force_start - first,
        "Columns": ["force"],
        "force": {"Description": "force in the rope, tension positive, zero not removed", "Units": "N"},
    }
    frame = {"lab": {"SpatialAxes": MISSING, "RotationRule": "right-hand", "Description": "frame of the mocap system"}}
    events = f"onset\tduration\ttrial_type\n{_number(-first)}\t0\tsync_edge\n"
    return {
        _suffixed(name, "motion.tsv"): _lines(write_row(row, "\t", MISSING) for row in flat.tolist()),
        _suffixed(name, "motion.json"): _json(_sidecar(trial)),
        _suffixed(name, "channels.tsv"): _lines(
            ["name\tcomponent\ttype\ttracked_point\tunits\treference_frame", *channels]
        ),
        _suffixed(name, "channels.json"): _json({"reference_frame": {"Levels": frame}}),
        _suffixed(name, "events.tsv"): events.encode(),
        _suffixed(name, "recording-loadcell_physio.tsv.gz"): gzip.compress(physio.encode(), mtime=0),
        _suffixed(name, "recording-loadcell_physio.json"): _json(force),
        **_physio(name, first, trial.signals),
    }


def bids_summary(trials: Sequence[BidsTrial], generator: str, version: str) -> dict[PurePosixPath, bytes]:
    """Metadata of a data set of these trials: description, participants, start of each scan."""
    description = {
        "Name": "Cuff compliance: markers on the body and on the cuff, and the force in the rope that pulls it",
        "BIDSVersion": VERSION,
        "DatasetType": "raw",
        "GeneratedBy": [{"Name": generator, "Version": version}],
    }
    subjects = sorted({trial.subject for trial in trials})
    files = {
        PurePosixPath("dataset_description.json"): _json(description),
        PurePosixPath("participants.tsv"): _lines(["participant_id", *(f"sub-{subject}" for subject in subjects)]),
        PurePosixPath("README"): b"Trials exported from recordings of a load cell and a motion capture system.\n",
    }
    for folder in sorted({_folder(trial) for trial in trials}):
        here = [trial for trial in trials if _folder(trial) == folder]
        scans = [f"motion/{_name(trial)}_motion.tsv\t{_moment(trial)}" for trial in here]
        files[folder / f"{'_'.join(folder.parts)}_scans.tsv"] = _lines(["filename\tacq_time", *scans])
    return files


def bids_label(text: str) -> str:
    """The letters and digits of a text: BIDS allows nothing else in a label."""
    return re.sub(r"[^0-9A-Za-z]", "", text)


def _physio(name: PurePosixPath, first: float, recorded: Sequence[BidsSignals]) -> dict[PurePosixPath, bytes]:
    """first [s] is the time of the first frame after the edge."""
    files: dict[PurePosixPath, bytes] = {}
    for signals in recorded:
        sidecar: dict[str, Any] = {"SamplingFrequency": signals.rate, "StartTime": signals.start - first}
        sidecar |= {"Columns": list(signals.labels), **{label: {"Units": signals.unit} for label in signals.labels}}
        rows = "\n".join(write_row(row, "\t", MISSING) for row in signals.values.tolist()) + "\n"
        stem = f"recording-{bids_label(signals.name)}_physio"
        files[_suffixed(name, f"{stem}.tsv.gz")] = gzip.compress(rows.encode(), mtime=0)
        files[_suffixed(name, f"{stem}.json")] = _json(sidecar)
    return files


def _folder(trial: BidsTrial) -> PurePosixPath:
    folder = PurePosixPath(f"sub-{trial.subject}")
    return folder / f"ses-{trial.session}" if trial.session else folder


def _name(trial: BidsTrial) -> str:
    acquisition = f"_acq-{trial.acquisition}" if trial.acquisition else ""
    return f"{'_'.join(_folder(trial).parts)}_task-{trial.task}_tracksys-omc{acquisition}_run-{trial.run}"


def _sidecar(trial: BidsTrial) -> dict[str, Any]:
    frames = len(trial.markers.time_s)
    return {
        "TaskName": trial.task,
        "SamplingFrequency": trial.markers.rate_hz,
        "TrackingSystemName": "omc",
        "MotionChannelCount": 3 * len(trial.markers.labels),
        "POSChannelCount": 3 * len(trial.markers.labels),
        "TrackedPointsCount": len(trial.markers.labels),
        "RecordingDuration": frames / trial.markers.rate_hz,
        "RecordingType": "continuous",
        "MissingValues": MISSING,
        **trial.description,
    }


def _moment(trial: BidsTrial) -> str:
    """UTC of the first frame, with microseconds."""
    nanoseconds = trial.edge_utc_ns + round(1e9 * float(trial.markers.time_s[0]))
    moment = datetime.fromtimestamp(nanoseconds // 1000 / 1e6, UTC)
    return moment.strftime("%Y-%m-%dT%H:%M:%S.%fZ")


def _suffixed(name: PurePosixPath, suffix: str) -> PurePosixPath:
    return name.with_name(f"{name.name}_{suffix}")


def _number(value: float) -> str:
    return repr(value + 0.0)  # no minus before a zero


def _lines(lines: Any) -> bytes:
    return ("\n".join(lines) + "\n").encode()


def _json(content: Any) -> bytes:
    return (json.dumps(content, indent=2, ensure_ascii=False) + "\n").encode()

"""EMG of a trial, from a file of another program or from a recording: channels at an even sample rate, in volts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fitting.emg.envelopes import EmgTrial
from fitting.wearer.wearer_trial import WearerTrial, read_wearer_trial
from recordings.exchange.c3d import read_c3d_signals
from recordings.exchange.delimited_emg import read_delimited_emg
from recordings.exchange.exp import read_exp
from recordings.exchange.sample_tables import SignalTable, count_samples
from station.emg.setup import EmgSetup
from station.errors import StationError
from station.messages.emg_codes import EmgCode
from station.messages.message import Figures, Message

Array = NDArray[np.float64]

VOLTS = {"V": 1.0, "mV": 1e-3, "uV": 1e-6}
SUFFIXES = (".exp", ".csv", ".tsv", ".txt", ".c3d", ".mcap")
SPARSEST = 2.0
"""Largest ratio of sample numbers to received samples; above it, the times are not those of a sampled signal."""


class EmgFileError(StationError):
    """The file has no EMG, or not on a usable clock."""


def read_emg_trial(path: Path, setup: EmgSetup) -> EmgTrial:
    """EMG of any kind of file. Raises ForeignFile, RecordingError, UnusableTrial or EmgFileError."""
    match path.suffix.lower():
        case ".exp":
            table = read_exp(path, setup.file.rate_hz, setup.file.labels)
        case ".csv" | ".tsv" | ".txt":
            table = read_delimited_emg(path, setup.file.rate_hz, setup.file.labels)
        case ".c3d":
            table = _read_c3d(path, setup)
        case ".mcap":
            return emg_of(read_wearer_trial(path))
        case suffix:
            figures = {"path": str(path), "suffix": suffix or "no suffix", "expected": ", ".join(SUFFIXES)}
            raise EmgFileError(Message(EmgCode.FILE_FORMAT, figures))
    return _of_table(path, table, setup)


def _read_c3d(path: Path, setup: EmgSetup) -> SignalTable:
    """Read the analog channels that are in the set-up."""
    table = read_c3d_signals(path, list(setup.channels))
    if not table.signals:
        figures = {"path": str(path), "recorded": ", ".join(table.names)}
        raise EmgFileError(Message(EmgCode.NO_ANALOG_CHANNEL, figures))
    return table


def _of_table(path: Path, table: SignalTable, setup: EmgSetup) -> EmgTrial:
    labels = tuple(table.signals)
    units = {label: table.units[label] or setup.file.unit or "" for label in labels}
    if not set(units.values()) <= {"", *VOLTS} or len({unit == "" for unit in units.values()}) > 1:
        found = ", ".join(f"{label} in {unit or 'no unit'}" for label, unit in units.items())
        raise EmgFileError(Message(EmgCode.CHANNEL_UNITS, {"path": str(path), "found": found}))
    columns = [table.signals[label] * VOLTS.get(units[label], 1.0) for label in labels]
    numbers, rate = count_samples(table.time_s)
    values = _on_grid(numbers, np.column_stack(columns), str(path))
    unit = "" if "" in units.values() else "V"
    unread = tuple(name for name in table.names if name in setup.channels and name not in labels)
    return EmgTrial(path.stem, labels, float(table.time_s[0]), rate, values, unit, unread=unread)


def emg_of(trial: WearerTrial) -> EmgTrial:
    """EMG of a recorded pose or motion: time 0 is the sync edge, volts are those at the electrodes.

    Raises EmgFileError without EMG on the clock of the markers.
    """
    signals = trial.emg
    if signals is None or signals.unit != "V":
        reasons = "; ".join(map(str, trial.notes)) or "no EMG was recorded"
        found = f"no EMG on the clock of the markers ({reasons})" if signals is None else f"EMG in {signals.unit}"
        raise EmgFileError(Message(EmgCode.NO_EMG, {"file": trial.file, "found": found}))
    numbers = signals.numbers - signals.numbers[0]
    rate = float(numbers[-1] / (signals.time[-1] - signals.time[0]))
    values = _on_grid(numbers, signals.values, trial.file)
    return EmgTrial(
        Path(trial.file).stem,
        signals.labels,
        float(signals.time[0]),
        rate,
        values,
        "V",
        trial.manifest.origin,
        tuple((cycle.start, cycle.end) for cycle in trial.cycles),
    )


def _on_grid(numbers: NDArray[np.int64], values: Array, file: str) -> Array:
    """Values (n, channels) at their sample numbers (n,) from 0; NaN where a number is missing."""
    length = int(numbers[-1]) + 1
    if length > SPARSEST * len(values):
        figures: Figures = {"file": file, "found": len(values), "expected": length}
        raise EmgFileError(Message(EmgCode.SAMPLES_MISSING, figures))
    grid = np.full((length, values.shape[1]), np.nan)
    grid[numbers] = values
    return grid

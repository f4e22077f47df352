"""EMG of a trial, from a file of another program or from a recording: channels at an even sample rate, in volts.

The set-up of `station emg`, a TOML file, has the processing of EMG, and the muscles of every channel.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_serializer, model_validator

from documents.message import Figures, Message, because
from documents.plain_data import read_toml
from documents.validation import DOCUMENT_ERRORS, Positive, Section, invalid_because
from fitting.emg.envelopes import MVC_WINDOW_S, PUBLISHED, EmgTrial, EnvelopeSettings
from fitting.emg.shape import MAX_LAG_S
from fitting.wearer.wearer_trial import WearerTrial, read_wearer_trial
from recordings.exchange.c3d import read_c3d_signals
from recordings.exchange.delimited_emg import read_delimited_emg, read_exp
from recordings.exchange.sample_tables import SignalTable, count_samples
from station.config import ConfigError
from station.errors import StationError
from station.messages.emg_messages import EmgCode

Array = NDArray[np.float64]

VOLTS = {"V": 1.0, "mV": 1e-3, "uV": 1e-6}
SUFFIXES = (".exp", ".csv", ".tsv", ".txt", ".c3d", ".mcap")
SPARSEST = 2.0
"""Largest ratio of sample numbers to received samples; above it, the times are not those of a sampled signal."""
DEFAULT_SETUP = Path(__file__).with_name("setup.toml")
_KEYS_OF_METHOD = {
    "linear_envelope": {"band_hz", "low_pass_hz"},
    "rms": {"band_hz", "window_s"},
    "seth_2019": set[str](),
}


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
            return extract_emg(read_wearer_trial(path))
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


def extract_emg(trial: WearerTrial) -> EmgTrial:
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


class FileSection(Section):
    """Properties that an EMG file does not declare."""

    rate_hz: Positive | None = None
    labels: tuple[str, ...] = ()
    unit: Literal["V", "mV", "uV"] | None = None


class EnvelopeSection(Section):
    """Method of the envelope; a key that the method does not use is an error."""

    method: Literal["linear_envelope", "rms", "seth_2019"] = "linear_envelope"
    band_hz: tuple[Positive, Positive] = (20.0, 450.0)
    low_pass_hz: Positive = 6.0
    window_s: Positive = 0.1

    @model_validator(mode="after")
    def _ensure_used(self) -> Self:
        unused = sorted(self.model_fields_set - {"method"} - _KEYS_OF_METHOD[self.method])
        if unused:
            raise ValueError(f"{', '.join(unused)} is not used by the method {self.method}; leave it out")
        if self.band_hz[0] >= self.band_hz[1]:
            raise ValueError(f"band_hz is {list(self.band_hz)}, expected the lower cut-off first")
        return self

    @model_serializer
    def _used(self) -> dict[str, object]:
        return {"method": self.method, **{key: getattr(self, key) for key in sorted(_KEYS_OF_METHOD[self.method])}}

    def settings(self) -> EnvelopeSettings:
        if self.method == "seth_2019":
            return PUBLISHED
        smoothing: Literal["low_pass", "rms"] = "rms" if self.method == "rms" else "low_pass"
        return EnvelopeSettings(self.band_hz, smoothing=smoothing, low_pass_hz=self.low_pass_hz, window_s=self.window_s)


class MvcSection(Section):
    window_s: Positive = MVC_WINDOW_S


class ComparisonSection(Section):
    max_lag_s: Positive = MAX_LAG_S


class ChannelSection(Section):
    """Muscles of the model at the electrodes of a channel, and their combination to one activation."""

    muscles: Annotated[tuple[str, ...], Field(min_length=1)]
    combine: Literal["mean", "max"] = "mean"
    weights: tuple[Annotated[float, Field(ge=0, allow_inf_nan=False)], ...] | None = None
    maximum: Positive | None = None
    subtract_minimum: bool = False

    @model_validator(mode="after")
    def _ensure_weights(self) -> Self:
        if self.weights is None:
            return self
        if self.combine == "max" or len(self.weights) != len(self.muscles) or sum(self.weights) == 0:
            raise ValueError("weights need one value for each muscle, not all zero, and combine = 'mean'")
        return self

    def combined(self, activations: Array) -> Array:
        """Combined activation (n,) of activations (n, muscles), in the order of `muscles`."""
        if self.combine == "max":
            return np.asarray(activations.max(axis=1))
        return np.asarray(np.average(activations, axis=1, weights=self.weights))


class EmgSetup(Section):
    """The set-up file. Other channels are processed and shown without muscles."""

    file: FileSection = FileSection()
    envelope: EnvelopeSection = EnvelopeSection()
    mvc: MvcSection = MvcSection()
    comparison: ComparisonSection = ComparisonSection()
    channels: Mapping[str, ChannelSection]

    @property
    def maxima(self) -> dict[str, float]:
        """Channel → envelope at maximum voluntary contraction, for channels with a maximum in the set-up."""
        return {label: section.maximum for label, section in self.channels.items() if section.maximum is not None}

    def require_channels(self, labels: Iterable[str], file: str) -> None:
        """Raise ConfigError for a channel of the set-up that the file does not have, with similar names."""
        labels = tuple(labels)
        for name in self.channels:
            if name not in labels:
                figures = {"name": name, "file": file, "known": _similar(name, labels)}
                raise ConfigError(Message(EmgCode.UNKNOWN_CHANNEL, figures))

    def require_muscles(self, labels: Iterable[str], muscles: Iterable[str], file: str) -> None:
        """Raise ConfigError for a muscle of one of these channels that the file of the model does not have."""
        muscles = tuple(muscles)
        for label in labels:
            for name in self.channels[label].muscles if label in self.channels else ():
                if name not in muscles:
                    figures = {"name": name, "channel": label, "file": file, "known": _similar(name, muscles)}
                    raise ConfigError(Message(EmgCode.UNKNOWN_MUSCLE, figures))


def read_emg_setup(path: Path | None) -> EmgSetup:
    """Read a set-up; without a path, the bundled one, whose channels also replace missing ones. Raises ConfigError."""
    default = read_toml(DEFAULT_SETUP)
    if path is None:
        return EmgSetup.model_validate(default)
    try:
        return EmgSetup.model_validate({"channels": default["channels"], **read_toml(path)})
    except OSError as error:
        figures = {"path": str(path), **because(error)}
        raise ConfigError(Message(EmgCode.SETUP_UNREADABLE, figures)) from error
    except DOCUMENT_ERRORS as error:
        figures = {"path": str(path), **invalid_because(error)}
        raise ConfigError(Message(EmgCode.SETUP_WRONG, figures)) from error


def _similar(name: str, known: tuple[str, ...]) -> str:
    similar = get_close_matches(name, known, n=3, cutoff=0.5)
    return f"similar names are {', '.join(similar)}" if similar else f"it has {', '.join(known)}"

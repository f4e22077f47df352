"""Set-up of `station emg`, a TOML file: processing of EMG, and the muscles of every channel."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError, model_serializer, model_validator

from documents.plain_data import PlainDataError, read_toml
from documents.validation import Positive, Section, describe_error
from fitting.emg.envelope import PUBLISHED, EnvelopeSettings
from fitting.emg.maximum import MVC_WINDOW_S
from fitting.emg.shape import MAX_LAG_S
from station.config import ConfigError
from station.messages.emg_codes import EmgCode
from station.messages.message import Message

Array = NDArray[np.float64]
DEFAULT_SETUP = Path(__file__).with_suffix(".toml")

_KEYS_OF_METHOD = {
    "linear_envelope": {"band_hz", "low_pass_hz"},
    "rms": {"band_hz", "window_s"},
    "seth_2019": set[str](),
}


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
        figures = {"path": str(path), "reason": str(error.strerror or error)}
        raise ConfigError(Message(EmgCode.SETUP_UNREADABLE, figures)) from error
    except PlainDataError as error:
        raise ConfigError(Message(EmgCode.SETUP_WRONG, {"path": str(path), "reason": str(error)})) from error
    except ValidationError as error:
        raise ConfigError(Message(EmgCode.SETUP_WRONG, {"path": str(path), "reason": describe_error(error)})) from error


def _similar(name: str, known: tuple[str, ...]) -> str:
    similar = get_close_matches(name, known, n=3, cutoff=0.5)
    return f"similar names are {', '.join(similar)}" if similar else f"it has {', '.join(known)}"

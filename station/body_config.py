"""Sections of station.toml for pose and motion trials: markers of the wearer, EMG, further analog inputs."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from documents.validation import Section
from recordings.manifest import BodyMarkers, EmgAmplifier, TrialCondition
from station.protocol import SUITED

Positive = Annotated[float, Field(gt=0)]


class BodySection(Section):
    """Markers on the wearer's body and on the suit, and how long a pose and a motion trial last.

    The elevation of the arm is the angle between arm (shoulder, elbow) and trunk (from top to bottom), both
    defined by the labels of two markers.
    """

    markers: tuple[str, ...] = Field(min_length=3)
    suit_markers: tuple[str, ...] = ()
    arm: tuple[str, ...] = ()
    trunk: tuple[str, ...] = ()
    pose_s: Positive = 5.0
    cycles: int = Field(default=5, ge=1, le=1000)  # arm raises in a motion trial
    conditions: tuple[TrialCondition, ...] = (
        "unsuited",
        "slack",
        "tight",
    )  # of a session's motion trials, in this order
    is_cord_measured: bool = False  # the load cell is in the suit's cord where the suit is worn

    @field_validator("markers", "suit_markers", "conditions")
    @classmethod
    def _is_named_once(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"{', '.join(twice)} is named twice")
        return names

    @model_validator(mode="after")
    def _elevation_has_markers(self) -> BodySection:
        unknown = [label for label in (*self.arm, *self.trunk) if label not in self.markers]
        if unknown:
            raise ValueError(f"{', '.join(unknown)} is in arm or trunk and not in markers; add it to markers")
        if (len(self.arm), len(self.trunk)) not in ((0, 0), (2, 2)):
            raise ValueError(
                "arm and trunk need two labels each, or none: the elevation of the arm is the angle between them"
            )
        return self

    def markers_in(self, condition: TrialCondition | None) -> BodyMarkers:
        """The markers that a trial in this condition needs."""
        is_suited = condition in SUITED
        suit = self.suit_markers if is_suited else ()
        return BodyMarkers(self.markers, suit, self.arm, self.trunk, is_suited and self.is_cord_measured)


class EmgChannelSection(Section):
    """One channel of EMG: an input of the DAQ or a channel's label in the outlet, and the gain of its amplifier."""

    input: str = Field(min_length=1)
    gain: Positive = 1.0  # volts at the input = gain × volts at the electrodes


class EmgSection(Section):
    """EMG of pose and motion trials: from the DAQ's spare inputs, or from an outlet of the Lab Streaming Layer.

    Without a list of channels, all channels of an outlet are recorded under their own labels.
    """

    source: Literal["daq", "lsl"] = "daq"
    channels: dict[str, EmgChannelSection] = Field(default_factory=dict)
    range_v: Positive = 10.0  # of the DAQ's inputs
    stream: str = ""  # name of the outlet
    unit: Literal["V", "mV", "uV"] | None = None  # of an outlet that declares none
    sync_channel: str = ""  # label of the outlet's channel that records the sync line
    sync_threshold: float = 0.5  # of that channel, in its own unit
    lag_s: float = 0.0  # an EMG sample stamped t was taken at t + lag_s by the markers' clock
    lag_sd_s: float = Field(default=0.0005, ge=0)

    @model_validator(mode="after")
    def _source_is_named(self) -> EmgSection:
        if self.source == "daq" and not self.channels:
            raise ValueError('source is "daq" and no channel is given; add [emg.channels.NAME] with its input')
        if self.source == "lsl" and not self.stream:
            raise ValueError('source is "lsl" and no stream is given; add stream = the name of the outlet')
        if self.source == "daq" and (self.stream or self.unit or self.sync_channel):
            raise ValueError('stream, unit and sync_channel are for source = "lsl"; leave them out or set the source')
        return self

    @property
    def daq_channels(self) -> dict[str, EmgChannelSection]:
        """The channels at inputs of the DAQ."""
        return self.channels if self.source == "daq" else {}

    def amplifier(self) -> EmgAmplifier:
        """The section as it is stored in a recording."""
        gains = {name: channel.gain for name, channel in self.channels.items()}
        threshold = self.sync_threshold if self.sync_channel else None
        return EmgAmplifier(self.source, gains, threshold, self.lag_s, self.lag_sd_s)


class AnalogSection(Section):
    """A further differential input of the DAQ, recorded in volts with every pose and motion trial."""

    input: str = Field(min_length=1)
    range_v: Positive = 10.0

"""Sentences on EMG files, their set-up and emg.json."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum

from station.messages.emg_codes import EmgCode

EMG: Mapping[StrEnum, str] = {
    EmgCode.UNREADABLE: "{path} cannot be read: {reason}",
    EmgCode.WRONG_DOCUMENT: "{path}: {reason}; write it again with `station emg`",
    EmgCode.SETUP_UNREADABLE: "the set-up {path} cannot be read: {reason}",
    EmgCode.SETUP_WRONG: "{path}: {reason}",
    EmgCode.UNKNOWN_CHANNEL: "the set-up names the channel {name}, which {file} does not have; {known}",
    EmgCode.UNKNOWN_MUSCLE: "the set-up names the muscle {name} for {channel}, which {file} does not have; {known}",
    EmgCode.ACTIVATIONS_COUNT: (
        "{trials} trials of EMG have {activations} files of activations, expected one for each trial"
    ),
    EmgCode.SAME_NAME: "two trials are named {name}, expected different names; rename a file",
    EmgCode.MIXED_UNITS: "{in_volts} is in volts and {unknown} has no unit, expected the same unit; set unit in [file]",
    EmgCode.NO_COMMON_CHANNEL: (
        "the set-up has muscles for {configured}, and {trial} has the channels {recorded}; add these to [channels]"
    ),
    EmgCode.NO_TIME_COLUMN: "{file} has the columns {columns}, expected a column named time; add it",
    EmgCode.TIMES_NOT_RISING: "the times of {file} do not increase from row to row; correct them",
    EmgCode.FILE_FORMAT: "{path} ends in {suffix}, expected EMG in {expected}",
    EmgCode.NO_ANALOG_CHANNEL: (
        "{path} has the analog channels {recorded}, and none of them is in the set-up; add them to [channels]"
    ),
    EmgCode.CHANNEL_UNITS: "{path} has {found}, expected all channels in V, mV or uV; set unit in [file]",
    EmgCode.NO_EMG: "{file} contains {found}, expected EMG in volts",
    EmgCode.SAMPLES_MISSING: "{file} contains {found} of {expected} samples; export the signal with all samples",
}

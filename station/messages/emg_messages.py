"""Messages on EMG files, their set-up and emg.json."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum


class EmgCode(StrEnum):
    """Reason why EMG is not read, processed or compared."""

    UNREADABLE = "emg_json.unreadable"
    WRONG_DOCUMENT = "emg_json.wrong_document"
    SETUP_UNREADABLE = "emg_setup.unreadable"
    SETUP_WRONG = "emg_setup.wrong"
    UNKNOWN_CHANNEL = "emg_setup.unknown_channel"
    UNKNOWN_MUSCLE = "emg_setup.unknown_muscle"
    ACTIVATIONS_COUNT = "emg_files.activations_count"
    SAME_NAME = "emg_files.same_name"
    MIXED_UNITS = "emg_files.mixed_units"
    NO_COMMON_CHANNEL = "emg_files.no_common_channel"
    NO_TIME_COLUMN = "activations.no_time_column"
    TIMES_NOT_RISING = "activations.times_not_rising"
    FEW_TIMES = "activations.few_times"
    ROW_COUNTS = "activations.row_counts"
    PARTLY_COMMON = "activations.partly_common"
    FILE_FORMAT = "emg_file.format"
    NO_ANALOG_CHANNEL = "emg_file.no_analog_channel"
    CHANNEL_UNITS = "emg_file.channel_units"
    UNREAD_CHANNELS = "emg_file.unread_channels"
    NO_EMG = "emg_file.no_emg"
    SAMPLES_MISSING = "emg_file.samples_missing"


EMG: Mapping[StrEnum, str] = {
    EmgCode.UNREADABLE: "{path} cannot be read: {reason}",
    EmgCode.WRONG_DOCUMENT: "{path}: {reason}; write it again with `station emg`",
    EmgCode.SETUP_UNREADABLE: "the set-up {path} cannot be read: {reason}",
    EmgCode.SETUP_WRONG: "{path}: {reason}",
    EmgCode.UNKNOWN_CHANNEL: "the set-up names the channel {name}, which {file} does not have; {known}",
    EmgCode.UNKNOWN_MUSCLE: "the set-up names the muscle {name} for {channel}, which {file} does not have; {known}",
    EmgCode.ACTIVATIONS_COUNT: (
        "{trials:trial} of EMG and {activations:file} of activations, expected one for each trial"
    ),
    EmgCode.SAME_NAME: "two trials are named {name}, expected different names; rename a file",
    EmgCode.MIXED_UNITS: "{in_volts} is in volts and {unknown} has no unit, expected the same unit; set unit in [file]",
    EmgCode.NO_COMMON_CHANNEL: (
        "the set-up has muscles for {configured}, and {trial} has the channels {recorded}; add these to [channels]"
    ),
    EmgCode.NO_TIME_COLUMN: "{file} has the columns {columns}, expected a column named time; add it",
    EmgCode.TIMES_NOT_RISING: "the times of {file} do not increase from row to row; correct them",
    EmgCode.FEW_TIMES: (
        "the times of {file} are {step_s:g} s apart, expected at most {longest_s:g} s; are they in milliseconds?"
    ),
    EmgCode.ROW_COUNTS: (
        "{file} does not have as many rows as its header states (nRows {stated:.0f}, found {found:.0f}), and all its "
        "rows are compared; if the file was cut, write it again"
    ),
    EmgCode.PARTLY_COMMON: (
        "EMG lasts from {emg_start_s:.2f} to {emg_end_s:.2f} s and {file} from {model_start_s:.2f} to "
        "{model_end_s:.2f} s, so that {common_s:.2f} s are compared; check that both are of one trial and begin at the "
        "same moment"
    ),
    EmgCode.FILE_FORMAT: "{path} ends in {suffix}, expected EMG in {expected}",
    EmgCode.NO_ANALOG_CHANNEL: (
        "{path} has the analog channels {recorded}, and none of them is in the set-up; add them to [channels]"
    ),
    EmgCode.CHANNEL_UNITS: "{path} has {found}, expected all channels in V, mV or uV; set unit in [file]",
    EmgCode.UNREAD_CHANNELS: (
        "{channels} of the set-up are in another unit than V, mV or uV, or on another clock than the first channel, "
        "and are left out; correct their titles, or export them at one rate"
    ),
    EmgCode.NO_EMG: "{file} contains {found}, expected EMG in volts",
    EmgCode.SAMPLES_MISSING: "{file} contains {found} of {expected} samples; export the signal with all samples",
}

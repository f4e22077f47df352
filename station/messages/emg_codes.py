"""Codes of messages on EMG files, their set-up and emg.json."""

from __future__ import annotations

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

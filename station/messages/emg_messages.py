"""Messages on EMG files, their set-up and emg.json."""

from __future__ import annotations

from documents.message import Code
from fitting.emg.channels import ChannelFinding
from fitting.emg.shape import ShapeOutcome

FINDING_TEXT = {
    ChannelFinding.FLAT: "flat: no electrode, or the amplifier was off",
    ChannelFinding.CLIPPED: "clipped by the converter's range; lower the gain, or remove an offset",
    ChannelFinding.RECTIFIED: "rectified or smoothed already; give the raw signal",
    ChannelFinding.GAP: "samples are missing for more than 10 ms",
    ChannelFinding.HUM: "mains hum is more than half of the power; check electrodes and ground",
    ChannelFinding.ABOVE_MVC: "above the MVC, which was not maximal",
    ChannelFinding.NO_MVC: "no MVC is known; the shape is compared, and the level is unknown",
}
OUTCOME_TEXT = {
    ShapeOutcome.COMPARED: "",
    ShapeOutcome.LAG_NOT_IDENTIFIED: "lag not identified",
    ShapeOutcome.MODEL_AT_REST: "the model's muscles are at rest",
    ShapeOutcome.CONSTANT_EMG: "EMG does not change",
    ShapeOutcome.TOO_SHORT: "the trial is too short",
}
"""Codes as text, for terminal and report."""


class EmgCode(Code):
    """Reason why EMG is not read, processed or compared."""

    UNREADABLE = "emg_json.unreadable", "{path} cannot be read: {reason}"
    WRONG_DOCUMENT = "emg_json.wrong_document", "{path}: {reason}; write it again with `station emg`"
    SETUP_UNREADABLE = "emg_setup.unreadable", "the set-up {path} cannot be read: {reason}"
    SETUP_WRONG = "emg_setup.wrong", "{path}: {reason}"
    UNKNOWN_CHANNEL = (
        "emg_setup.unknown_channel",
        "the set-up names the channel {name}, which {file} does not have; {known}",
    )
    UNKNOWN_MUSCLE = (
        "emg_setup.unknown_muscle",
        "the set-up names the muscle {name} for {channel}, which {file} does not have; {known}",
    )
    ACTIVATIONS_COUNT = (
        "emg_files.activations_count",
        "{trials:trial} of EMG and {activations:file} of activations, expected one for each trial",
    )
    SAME_NAME = "emg_files.same_name", "two trials are named {name}, expected different names; rename a file"
    MIXED_UNITS = (
        "emg_files.mixed_units",
        "{in_volts} is in volts and {unknown} has no unit, expected the same unit; set unit in [file]",
    )
    NO_COMMON_CHANNEL = (
        "emg_files.no_common_channel",
        "the set-up has muscles for {configured}, and {trial} has the channels {recorded}; add these to [channels]",
    )
    NO_TIME_COLUMN = (
        "activations.no_time_column",
        "{file} has the columns {columns}, expected a column named time; add it",
    )
    TIMES_NOT_RISING = (
        "activations.times_not_rising",
        "the times of {file} do not increase from row to row; correct them",
    )
    FEW_TIMES = (
        "activations.few_times",
        "the times of {file} are {step_s:g} s apart, expected at most {longest_s:g} s; are they in milliseconds?",
    )
    ROW_COUNTS = (
        "activations.row_counts",
        "{file} does not have as many rows as its header states (nRows {stated:.0f}, found {found:.0f}), and all its "
        "rows are compared; if the file was cut, write it again",
    )
    PARTLY_COMMON = (
        "activations.partly_common",
        "EMG lasts from {emg_start_s:.2f} to {emg_end_s:.2f} s and {file} from {model_start_s:.2f} to "
        "{model_end_s:.2f} s, so that {common_s:.2f} s are compared; check that both are of one trial and begin at the "
        "same moment",
    )
    FILE_FORMAT = "emg_file.format", "{path} ends in {suffix}, expected EMG in {expected}"
    NO_ANALOG_CHANNEL = (
        "emg_file.no_analog_channel",
        "{path} has the analog channels {recorded}, and none of them is in the set-up; add them to [channels]",
    )
    CHANNEL_UNITS = (
        "emg_file.channel_units",
        "{path} has {found}, expected all channels in V, mV or uV; set unit in [file]",
    )
    UNREAD_CHANNELS = (
        "emg_file.unread_channels",
        "{channels} of the set-up are in another unit than V, mV or uV, or on another clock than the first channel, "
        "and are left out; correct their titles, or export them at one rate",
    )
    NO_EMG = "emg_file.no_emg", "{file} contains {found}, expected EMG in volts"
    SAMPLES_MISSING = (
        "emg_file.samples_missing",
        "{file} contains {found} of {expected} samples; export the signal with all samples",
    )

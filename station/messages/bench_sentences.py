"""Sentences on trials, refused trials and the check of the bench."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum

from station.messages.codes import CheckCode, RefusalCode, TrialCode

_POLARITY = "set the sync output of the mocap system to active high (or swap the two wires)"
_NO_EDGE = "no sync edge came within {timeout_s:g} s"
_FELL = "the sync line fell from {from_v:.2f} V to {to_v:.2f} V where a rise was expected; " + _POLARITY
_TOO_SLOW = "this computer is too slow: "
_FASTER = "; close other programs or use a faster computer"
_CERTIFICATE = "certificate {serial_number}of {calibrated_on}, {age_days:day} old, due on {due_on}"
_FORCE = "{mean_n:+.2f} N, standard deviation {sd_n:.2f} N"
_DISK = "{free_gb:.1f} GB free for {folder}, the plan needs {needed_gb:.2f} GB"
_MASS = "{found_n:.2f} ± {sd_n:.2f} N, expected {expected_n:.2f} ± {tolerance_n:.2f} N"

_TRIAL: Mapping[StrEnum, str] = {
    TrialCode.OPENING: "opening the devices",
    TrialCode.ARMED: "armed, waiting for the sync edge",
    TrialCode.CAPTURE_RUNNING: (
        "armed, but the sync line is high: stop the running capture, or check the polarity of the line"
    ),
    TrialCode.RECORDING: "recording",
    TrialCode.CAPTURE_ENDED: "the mocap capture ended",
    TrialCode.CAPTURE_ENDED_RENUMBERED: "the mocap capture ended: its frame numbers restarted",
    TrialCode.CAPTURE_ENDED_NO_FRAMES: "the mocap capture ended: the sync line is low and no more frames arrive",
    TrialCode.CAPTURE_REPLACED: "{text}",
    TrialCode.DURATION_REACHED: "{duration_s:g} s recorded after the sync edge",
    TrialCode.OPERATOR_STOP: "stopped by the operator",
    TrialCode.CANCELLED: "cancelled by the operator before the sync edge; nothing was recorded",
    TrialCode.DEVICE_LOST: "{text} [{code}]",
    TrialCode.DEVICE_SILENT: (
        "{source} sent nothing on {stream} for {silence_s:.1f} s, expected {rate_hz:g} samples per second; check the "
        "device and its cable"
    ),
    TrialCode.NO_SYNC_EDGE_LOW: (
        _NO_EDGE + ": the sync line is at {level_v:z.2f} V, expected a rise above {threshold_v:g} V when the capture "
        "starts; check that the capture was started and that the sync cable is plugged in"
    ),
    TrialCode.NO_SYNC_EDGE_HIGH: (
        _NO_EDGE + ": the sync line has been at {level_v:z.2f} V since arming, expected below {threshold_v:g} V until "
        "the capture starts; stop the running capture or check the polarity of the line"
    ),
    TrialCode.NO_SYNC_EDGE_NO_SAMPLES: _NO_EDGE + ": the DAQ sent no sample of the sync line; check the device",
    TrialCode.NO_SYNC_EDGE_FELL: _NO_EDGE + "; " + _FELL,
    TrialCode.WRONG_POLARITY: _FELL,
    TrialCode.DISK_NEARLY_FULL: (
        "the disk of {folder} has {free_mb:.0f} MB left, expected at least {reserve_mb:.0f} MB: the trial was closed, "
        "and the samples so far are kept; free some space and record it again"
    ),
    TrialCode.WRITE_FAILED: "{text}",
    TrialCode.RECORDING_MOVED: (
        "{path} is no longer the file that was being recorded: it or its folder was renamed, removed or replaced by a "
        "copy during the trial, and the samples are under the new name; restore the old name, and record it again"
    ),
    TrialCode.NOT_STARTED: "{text}",
    TrialCode.RECORDER_KILLED: "the recorder was killed during the trial; {text}",
    TrialCode.UNREADABLE: "{text}",
    TrialCode.NOT_ALIGNED: "force and markers have no common time: {reason}; record the trial again",
    TrialCode.FRAMES_RENUMBERED: (
        "the mocap system restarted its frame numbers {after_s:.2f} s after the start of the capture, so frames cannot "
        "be counted; check that it streams one capture with numbered frames, and record again"
    ),
    TrialCode.STAMPS_JUMPED: (
        "the time stamps of the mocap system jumped {after_s:.2f} s after the start of the capture, and its frame "
        "numbers went on, so the time of the later frames is unknown; check its time base, and record again"
    ),
    TrialCode.SECOND_START: (
        "the sync line rose a second time {after_s:.2f} s after the first, so the start of the capture is ambiguous; "
        "set the output of the mocap system to one pulse for the whole capture and record again"
    ),
    TrialCode.EMPTY_CAPTURE: (
        "{source} sent no frame of the capture; check that it tracks the markers and streams 3D data in real time"
    ),
    TrialCode.END_MISSING: "{source} sent nothing on {stream} in the last {missing_s:.1f} s of the trial",
    TrialCode.NO_STOP_EDGE: (
        "the sync line is still high where the recording ends, so only the start edge relates the clocks"
    ),
    TrialCode.CLOCK_SET_BACK: (
        "the clock of this computer shows {now_utc}, and the last file of the session was written at {last_utc}: the "
        "clock was set back. This trial is dated after the others to keep their order; check date and time"
    ),
    TrialCode.OVERWRITTEN: _TOO_SLOW + "{samples:sample} overwritten before being read" + _FASTER,
    TrialCode.LATE: _TOO_SLOW + "samples waited {late_s:.1f} s before they were recorded" + _FASTER,
    TrialCode.STATION_PAUSED: (
        "the station itself was suspended for {stall_s:.1f} s; make sure that its computer does not sleep or swap"
    ),
    TrialCode.GLITCH_UP: (
        "the sync line spiked to {to_v:z.2f} V for less than {glitch_ms:g} ms at sample {sample}; ignored"
    ),
    TrialCode.GLITCH_DOWN: (
        "the sync line dipped to {to_v:z.2f} V for less than {glitch_ms:g} ms at sample {sample}; ignored"
    ),
}

_REFUSALS: Mapping[StrEnum, str] = {
    RefusalCode.CANCELLED_OPENING: "cancelled by the operator while the devices were opening; nothing was recorded",
    RefusalCode.SIMULATED_DEVICES: (
        "simulated devices ({devices}) cannot be recorded into {folder}, which is not below a folder called "
        "{simulated_folder}; record into {place}, or practise with --simulated"
    ),
    RefusalCode.MIXED_ORIGIN: (
        "{folder} contains {present} data ({file}), and this trial would be {origin}; record into another "
        "session folder"
    ),
    RefusalCode.FOLDER_NOT_MADE: (
        "the session folder {folder} cannot be created ({reason}); use another session folder"
    ),
    RefusalCode.FOLDER_READ_ONLY: "the session folder {folder} is not writable; use another session folder",
    RefusalCode.DISK_FULL: (
        "the disk of {folder} has {free_mb:.0f} MB free, expected at least {needed_mb:.0f} MB for the planned trials; "
        "free some space"
    ),
    RefusalCode.FOLDER_IN_USE: "another trial is being recorded into {folder}; wait for its end",
    RefusalCode.NO_LOCKS: "files in {folder} cannot be locked ({reason}); record onto a local disk",
    RefusalCode.RECORDER_ENDED: (
        "the recorder ended with code {exit_code} during the trial; what it had written is kept"
    ),
    RefusalCode.PATH_TOO_LONG: (
        "{path} is {excess:character} too long for Windows, which allows {longest}; use a session folder with a "
        "shorter path"
    ),
}

_CHECKS: Mapping[StrEnum, str] = {
    CheckCode.ANSWERS: "answers{identity}",
    CheckCode.ANSWERS_SIMULATED: "answers{identity}; the device is SIMULATED",
    CheckCode.NO_ANSWER: "{device} did not answer within {timeout_s:g} s; check its power and its cable",
    CheckCode.DEVICE_ERROR: "{text} [{code}]",
    CheckCode.UNREADABLE: "{text}",
    CheckCode.RATE: "{rate_hz:.1f} samples/s, nominal {nominal_hz:g}; {source}",
    CheckCode.WRONG_RATE: (
        "{rate_hz:.1f} samples/s, expected {nominal_hz:g}; {source}; check the rate that is set at the device"
    ),
    CheckCode.NO_CAPTURE: "no frames: no capture is running; start one to check rate ({nominal_hz:g} Hz) and labels",
    CheckCode.AT_REST: _FORCE,
    CheckCode.SATURATED: _FORCE + "; saturated at {limit:.4g} {unit}, check the wiring",
    CheckCode.LOADED: (
        _FORCE + ", expected within ±{limit_n:.1f} N with the hook empty; unload the rope or correct the zero of the "
        "amplifier"
    ),
    CheckCode.CALIBRATION_VALID: _CERTIFICATE,
    CheckCode.CALIBRATION_DUE: _CERTIFICATE + "; have the load cell calibrated",
    CheckCode.CALIBRATION_IN_FUTURE: _CERTIFICATE + ": the date is in the future; correct it in the configuration",
    CheckCode.CALIBRATION_UNKNOWN: "date unknown; enter that of the certificate in the configuration",
    CheckCode.SYNC_LOW: "{level_v:z.2f} V, threshold {threshold_v:g} V",
    CheckCode.SYNC_HIGH: (
        "{level_v:z.2f} V, threshold {threshold_v:g} V; expected low until a capture starts: stop the capture or check "
        "the polarity"
    ),
    CheckCode.LABELS_PRESENT: "all labels present",
    CheckCode.LABELS_MISSING: "missing {missing}; present {present}; label them in the mocap system",
    CheckCode.DISK: _DISK,
    CheckCode.DISK_LOW: _DISK + "; free some space",
    CheckCode.MASS_RIGHT: _MASS,
    CheckCode.MASS_WRONG: (
        _MASS + "; check that the mass hangs freely on the cell. If it does, correct capacity, full scale and "
        "polarity of the cell in the configuration"
    ),
    CheckCode.MASS_WITHOUT_ZERO: (
        _MASS + "; the reading includes the zero, run with --known-mass 0 on the empty cell first"
    ),
    CheckCode.MASS_UNREAD: "not read; hang one on the cell, enter it and read it",
}

BENCH: Mapping[StrEnum, str] = {**_TRIAL, **_REFUSALS, **_CHECKS}

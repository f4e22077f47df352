"""Sentences on trials, the check of the bench and a session: journal, cues, alarms, commands, verdicts, pages."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum

from station.messages.codes import (
    AlarmCode,
    CheckCode,
    CommandCode,
    CueCode,
    JournalCode,
    ReasonCode,
    RefusalCode,
    ServeCode,
    TerminalCode,
    TrialCode,
    VerdictCode,
)

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
    TrialCode.MOSTLY_LOST: (
        "{source} lost {lost_percent:.1f} % of the samples on {stream}, expected at most {limit_percent:g} %; check "
        "its connection and its rate, and record again"
    ),
    TrialCode.END_MISSING: "{source} sent nothing on {stream} in the last {missing_s:.1f} s of the trial",
    TrialCode.NO_STOP_EDGE: (
        "the sync line is still high where the recording ends, so only the start edge relates the clocks"
    ),
    TrialCode.CLOCK_SET_BACK: (
        "the clock of this computer shows {now_utc}, and the last file of the session was written at {last_utc}: the "
        "clock was set back. This trial is dated after the others to keep their order; check date and time"
    ),
    TrialCode.OVERWRITTEN: _TOO_SLOW + "its buffer overwrote {samples:sample} before the station read it" + _FASTER,
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

_JOURNAL: Mapping[StrEnum, str] = {
    JournalCode.UNREADABLE: "{path} cannot be read: {reason}",
    JournalCode.WRONG_LINE: "{path}, line {line}: expected an entry of the journal, found {found}",
    JournalCode.NOT_WRITTEN: "{path} cannot be written: {reason}; the entry of the journal is not stored",
    JournalCode.GONE: (
        "{path} is gone: the folder of the open session was moved, renamed or deleted. Resume the session where it is "
        "now, or begin a new one"
    ),
    JournalCode.NO_REASON: "{file} is to be repeated without a reason; enter what was wrong with it",
}

_CUES: Mapping[StrEnum, str] = {
    CueCode.EMPTY_HOOK: "leave the hook empty and stand still",
    CueCode.ADD_WEIGHT: "hang weight {weight} of {weights}: {mass_kg:g} kg ({target_n:.0f} N in all)",
    CueCode.REMOVE_WEIGHT: "take weight {weight} off: {mass_kg:g} kg ({target_n:.0f} N left)",
    CueCode.WRONG_FORCE: "{force_n:.1f} N, expected {target_n:.1f} N: check the weight, and that the rope runs freely",
    CueCode.STATIC_DONE: "all weights are off and held: end the capture",
    CueCode.FIRST_LEVEL: "add a weight or take one off, and hold it for {hold_s:g} s",
    CueCode.HOLD: "hold it at {force_n:.0f} N",
    CueCode.NEXT_LEVEL: "levels held: {levels:.0f}; add a weight or take one off, and hold it for {hold_s:g} s",
    CueCode.STAND_STILL: "stand still",
    CueCode.HANG_STILL: "let the weight hang still",
    CueCode.PULL_SPRING: "pull the spring, about once a second",
    CueCode.BOUNCE: "bounce the weight, about once a second",
    CueCode.KEEP_SWINGING: "keep it swinging: {frequency_hz:.2f} Hz, ±{amplitude_n:.0f} N",
    CueCode.LET_REST: "let it come to rest",
    CueCode.SWING_DONE: "it rests: end the capture",
    AlarmCode.OVERLOAD: (
        "STOP: overload, {force_n:.0f} N on a load cell of {capacity_n:.0f} N; unload the rope and check the cell"
    ),
    AlarmCode.FORCE: "STOP: {force_n:.0f} N at the cuff, at most {limit_n:.0f} N are allowed; unload the rope",
    AlarmCode.FORCE_RATE: (
        "STOP: the force rose by more than {limit_n_per_s:.0f} N per second; unload the rope and check cuff and skin"
    ),
}

_COMMANDS: Mapping[StrEnum, str] = {
    CommandCode.NO_SUBJECT: "no subject is given; enter a code of letters and digits, such as P01",
    CommandCode.WRONG_SUBJECT: (
        "the subject is {subject}, expected a code of letters and digits, such as P01: it becomes part of file names"
    ),
    CommandCode.WRONG_NUMBER: "the session is {number}, expected letters and digits, such as 1 or monday",
    CommandCode.NO_CUFF_CHOSEN: "no cuff is chosen; choose from {known}",
    CommandCode.UNKNOWN_CUFF: "the configuration has no cuff {unknown}; it has {known}",
    CommandCode.REPEATED_CUFF: (
        "the plan names {repeated} more than once; name every cuff once, and set the number of repeats instead"
    ),
    CommandCode.WRONG_MASSES: "the load steps are {masses} kg, expected masses above 0",
    CommandCode.NO_MASSES: "the load steps are empty; enter the weights in the order of loading, such as 1.53 1.53",
    CommandCode.WRONG_REPEATS: "the repeats are {repeats}, expected a whole number from 1 to {most}",
    CommandCode.WRONG_QUANTITY: (
        "the {quantity} is {text}, expected {lowest:g} to {highest:g} {unit}; leave the field empty if it is not known"
    ),
    CommandCode.WRONG_KNOWN_MASS: "the known mass is {text}, expected kilograms above 0, such as 2.5",
    CommandCode.MASSES_NOT_NUMBERS: (
        "the load steps are {text}, expected kilograms separated by spaces, such as 1.53 1.53"
    ),
    CommandCode.OTHER_PLAN: (
        "session {number} of {subject} was planned with {plan}; resume it with that plan, or use another session number"
    ),
    CommandCode.NO_PLAN: "{folder} contains no session to resume: its {file} has no plan",
    CommandCode.NO_SESSION: "no session is open; begin or resume one first",
    CommandCode.COMPLETE: "every trial of the plan is accepted; the session is complete",
    CommandCode.SUMMARY_RUNNING: "the report is already being written; wait for its end",
    CommandCode.NOTHING_TO_SKIP: "no trial of the plan is left to skip",
    CommandCode.NOT_LEFT: "{trial} is not left in the plan; redo it to record it again",
    CommandCode.NOT_DONE: "{trial} has no recording that is kept, so there is none to redo",
    CommandCode.TRIAL_RUNNING: "a trial is running; stop it or wait for its end",
    CommandCode.UNDECIDED: "{file} waits for a decision; keep or redo it first",
    CommandCode.NO_TRIAL: "no trial is running",
    CommandCode.NO_MARK_YET: "a mark refers to the recording, which begins at the sync edge; wait for it",
    CommandCode.UNKNOWN_MARK: "the running trial has no mark {number}; a mark can also be named with the verdict",
    CommandCode.NO_FORCE: "no force has arrived yet; tare once the force is shown",
    CommandCode.NOTHING_TO_DECIDE: "no recording waits for a decision",
    CommandCode.NOTHING_TO_UNDO: "there is no decision to undo in this session",
    CommandCode.UNKNOWN_RECORDING: "{file} is not a recording of this session",
    CommandCode.BOUNCE_NOT_ASSIGNABLE: "{file} is not a trial of a cuff; it cannot be assigned to one",
    CommandCode.NOT_IN_PLAN: "the plan has no {cuff}, {test}, repeat {repeat}; it has {plan}",
    CommandCode.PRESSED_LATE: (
        "{name} was pressed {late_s:.0f} s ago, while the console did not answer, and is not executed; press it again"
    ),
    CommandCode.PRESS_UNDATED: (
        "{name} arrived without the time of its press and is not executed; reload the page and press it again"
    ),
    CommandCode.NOT_NOW: "{action} is not possible now",
    CommandCode.NOT_WHILE_RUNNING: "{action} is not possible while a trial runs",
    CommandCode.BEING_RECORDED: "this trial is being recorded; stop it, or redo it and give the reason",
    CommandCode.TOO_LATE: "{action} arrived after the recording had begun; keep or redo the trial",
    CommandCode.WAITS_FOR_DECISION: "{file} waits for a decision: {commands}",
    CommandCode.REASON_MISSING: "the reason is missing; add what was wrong, for example: {action} the wearer coughed",
    CommandCode.NOTHING_TO_REDO: "the last decision kept no recording, so there is none to redo",
    CommandCode.BOUNCE_NOT_DONNED: "this trial has no cuff to don anew; redo it",
    CommandCode.LOSES_MIGRATION: (
        "{file} is the first static trial of its donning, and the cuff may have migrated in it: unless the cuff is "
        "donned anew, migration stays unknown; enter redon, or redo again to accept that"
    ),
    CommandCode.UNKNOWN_COMMAND: "{line} is not a command; commands are {known}",
    CommandCode.UNEXPECTED_ARGUMENT: "{action} takes no argument, found {argument}",
    CommandCode.TRIAL_NUMBER_EXPECTED: (
        "{action} expects the number of a trial, such as #5, found {argument}; trials lists the numbers"
    ),
    CommandCode.NO_SUCH_TRIAL: "the plan has no trial #{number}; it has #1 to #{most}",
    CommandCode.UNKNOWN_KEY: "the key {key} is not used; ? lists the keys",
    CommandCode.NEW_SESSION: "{folder} is a new session; give --subject, a code of letters and digits, such as P01",
}

_REASONS: Mapping[StrEnum, str] = {
    VerdictCode.GOOD: "no problems found",
    VerdictCode.DOUBTFUL: "usable, with doubts",
    VerdictCode.BAD: "redo advised",
    ReasonCode.NOT_ACCEPTED: "{text}",
    ReasonCode.LOST_SAMPLES: "samples lost during the transfer: {samples}",
    ReasonCode.UNUSABLE: "{text}",
    ReasonCode.NO_STATIC_RESULT: (
        "this static trial yields neither stiffness nor damping; load the cuff with every step of the plan"
    ),
    ReasonCode.NO_DYNAMIC_RESULT: (
        "this dynamic trial yields neither stiffness nor damping; pull the spring about once a second throughout"
    ),
    ReasonCode.WEIGHTS_MISSING: (
        "stopped after {found:.0f} of {planned:weight}; redo the trial, and hang all of them one by one"
    ),
    ReasonCode.UNLOADING_MISSING: (
        "stopped after {found:.0f} of {planned:weight} were taken off; redo the trial, and take all of them off "
        "one by one"
    ),
    ReasonCode.SWING_SHORT: (
        "stopped after {found_s:.0f} of {planned_s:.0f} s of swinging; redo the trial, and keep the weight swinging"
    ),
    ReasonCode.SLIPPED: (
        "the cuff slipped by {slip_mm:.0f} mm in this trial, expected at most {limit_mm:.0f} mm; tighten its straps, "
        "don it anew and redo the trial"
    ),
    ReasonCode.OUTLIER: (
        "{symbol} is {value} {unit}, the mean of the earlier repeats is {mean} {unit}: {distance:.0f} standard errors "
        "apart"
    ),
    ReasonCode.ZERO_DRIFT: "{text}",
    ReasonCode.NOT_USED: "the fit does not use this recording",
    ReasonCode.FIT_FAILED: "the fit failed ({text}); the recording is stored: keep it, and report this error",
    ReasonCode.FIT_KILLED: (
        "the operating system killed the fit twice, probably because memory is short; close other programs. The "
        "recording is stored"
    ),
}

_KEEP_MIGRATION = ". The cuff may have migrated in this trial: only redon keeps migration measurable"
_TERMINAL: Mapping[StrEnum, str] = {
    TerminalCode.CAPTURE_NOT_RECORDED: (
        "the sync line is high: a capture is running that began before this trial was armed, and it is not recorded; "
        "stop that capture, then start the capture of this trial"
    ),
    TerminalCode.PAUSED: "paused; arm to continue",
    TerminalCode.START: "arm when this is done",
    TerminalCode.DECIDE: "keep it, or redo it",
    TerminalCode.DECIDE_OR_REDON: "keep it, or redo it" + _KEEP_MIGRATION,
    TerminalCode.REDO_ADVISED: "redo advised: {reasons}",
    TerminalCode.REDON_ADVISED: "redo advised: {reasons}" + _KEEP_MIGRATION,
    TerminalCode.PAUSE_AFTER_TRIAL: "the session pauses after this trial",
    TerminalCode.PAUSE_AFTER_DECISION: "the session pauses after this decision",
    TerminalCode.MARKED: "mark {number}",
    TerminalCode.SUMMARY_STARTED: "fitting, assessing and writing the report",
    TerminalCode.TRIALS_LEFT: "{left} left to record; resume with {command}",
    TerminalCode.REPORT_MISSING: "the report is not written; {command} writes it",
    TerminalCode.SUMMARY_FAILED: (
        "fit, assessment or report failed ({error}); the recordings are complete: keep them, and report this error"
    ),
    TerminalCode.NOTE_AFTER_REPORT: "the note is stored; the report does not have it until it is written again",
    TerminalCode.COMPLETE: "the session is complete",
}

_SERVE: Mapping[StrEnum, str] = {
    ServeCode.WRONG_HOST: (
        "the console cannot listen at {host}: {reason}; give an address of this computer by --host, such as 127.0.0.1"
    ),
    ServeCode.CANNOT_LISTEN: (
        "the console cannot listen at {host}, port {port}: {reason}; end the program that listens there, or give "
        "another --host or --port"
    ),
}

SESSION: Mapping[StrEnum, str] = {
    **_TRIAL,
    **_REFUSALS,
    **_CHECKS,
    **_JOURNAL,
    **_CUES,
    **_COMMANDS,
    **_REASONS,
    **_TERMINAL,
    **_SERVE,
}

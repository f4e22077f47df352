"""Messages on trials, cues of a trial, and the check of the bench."""

from __future__ import annotations

from documents.message import Code

_POLARITY = "set the sync output of the mocap system to active high (or swap the two wires)"
_NO_EDGE = "no sync edge came within {timeout_s:g} s"
_FELL = "the sync line fell from {from_v:.2f} V to {to_v:.2f} V where a rise was expected; " + _POLARITY
_TOO_SLOW = "this computer is too slow: "
_FASTER = "; close other programs or use a faster computer"
_CERTIFICATE = "certificate {serial_number}of {calibrated_on}, {age_days:day} old, due on {due_on}"
_FORCE = "{mean_n:+.2f} N, standard deviation {sd_n:.2f} N"
_DISK = "{free_gb:.1f} GB free for {folder}, the plan needs {needed_gb:.2f} GB"
_MASS = "{found_n:.2f} ± {sd_n:.2f} N, expected {expected_n:.2f} ± {tolerance_n:.2f} N"


class TrialCode(Code, prefix=""):
    """State of a trial, the reason of its end, and what a reader of its recording should know."""

    OPENING = "opening the devices"
    ARMED = "armed, waiting for the sync edge"
    CAPTURE_RUNNING = "armed, but the sync line is high: stop the running capture, or check the polarity of the line"
    RECORDING = "recording"

    CAPTURE_ENDED = "the mocap capture ended"
    CAPTURE_ENDED_RENUMBERED = "capture_ended.frames_renumbered", "the mocap capture ended: its frame numbers restarted"
    CAPTURE_ENDED_NO_FRAMES = (
        "capture_ended.no_frames",
        "the mocap capture ended: the sync line is low and no more frames arrive",
    )
    CAPTURE_REPLACED = "{reason}"
    DURATION_REACHED = "{duration_s:g} s recorded after the sync edge"
    OPERATOR_STOP = "stopped by the operator"
    CANCELLED = "cancelled by the operator before the sync edge; nothing was recorded"
    DEVICE_LOST = "{reason} [{reason_code}]"
    DEVICE_SILENT = (
        "device_lost.silent",
        "{source} sent nothing on {stream} for {silence_s:.1f} s, expected {rate_hz:g} samples per second; check the "
        "device and its cable",
    )
    NO_SYNC_EDGE_LOW = (
        "no_sync_edge.low",
        _NO_EDGE + ": the sync line is at {level_v:z.2f} V, expected a rise above {threshold_v:g} V when the capture "
        "starts; check that the capture was started and that the sync cable is plugged in",
    )
    NO_SYNC_EDGE_HIGH = (
        "no_sync_edge.high",
        _NO_EDGE + ": the sync line has been at {level_v:z.2f} V since arming, expected below {threshold_v:g} V until "
        "the capture starts; stop the running capture or check the polarity of the line",
    )
    NO_SYNC_EDGE_NO_SAMPLES = (
        "no_sync_edge.no_samples",
        _NO_EDGE + ": the DAQ sent no sample of the sync line; check the device",
    )
    NO_SYNC_EDGE_FELL = "no_sync_edge.fell", _NO_EDGE + "; " + _FELL
    WRONG_POLARITY = _FELL
    DISK_NEARLY_FULL = (
        "the disk of {folder} has {free_mb:.0f} MB left, expected at least {reserve_mb:.0f} MB: the trial was closed, "
        "and the samples so far are kept; free some space and record it again"
    )
    WRITE_FAILED = "{reason}"
    RECORDING_MOVED = (
        "{path} is no longer the file that was being recorded: it or its folder was renamed, removed or replaced by a "
        "copy during the trial, and the samples are under the new name; restore the old name, and record it again"
    )
    NOT_STARTED = "{reason}"
    RECORDER_KILLED = "the recorder was killed during the trial; {kept_s:.0f} s of it are kept"
    UNREADABLE = "{reason}"

    NOT_ALIGNED = "force and markers have no common time: {reason}; record the trial again"
    FRAMES_RENUMBERED = (
        "the mocap system restarted its frame numbers {after_s:.2f} s after the start of the capture, so frames cannot "
        "be counted; check that it streams one capture with numbered frames, and record again"
    )
    STAMPS_JUMPED = (
        "time_stamps_jumped",
        "the time stamps of the mocap system jumped {after_s:.2f} s after the start of the capture, and its frame "
        "numbers went on, so the time of the later frames is unknown; check its time base, and record again",
    )
    SECOND_START = (
        "sync_double_edge",
        "the sync line rose a second time {after_s:.2f} s after the first, so the start of the capture is ambiguous; "
        "set the output of the mocap system to one pulse for the whole capture and record again",
    )
    EMPTY_CAPTURE = (
        "{source} sent no frame of the capture; check that it tracks the markers and streams 3D data in real time"
    )
    END_MISSING = "{source} sent nothing on {stream} in the last {missing_s:.1f} s of the trial"
    LITTLE_IN_COMMON = (
        "force and markers were both received in {common_s:.1f} s of {duration_s:.1f} s, expected at least "
        "{limit_percent:g} %; check the connections of both devices, and record again"
    )
    MOSTLY_LOST = (
        "{source} lost {lost_percent:.1f} % of the samples on {stream}, expected at most {limit_percent:g} %; check "
        "its connection and its rate, and record again"
    )
    NO_STOP_EDGE = "the sync line is still high where the recording ends, so only the start edge relates the clocks"
    CLOCK_SET_BACK = (
        "the clock of this computer shows {now_utc}, and the last file of the session was written at {last_utc}: the "
        "clock was set back. This trial is dated after the others to keep their order; check date and time"
    )
    OVERWRITTEN = (
        "overloaded.samples_overwritten",
        _TOO_SLOW + "its buffer overwrote {samples:sample} before the station read it" + _FASTER,
    )
    LATE = "overloaded.samples_late", _TOO_SLOW + "samples waited {late_s:.1f} s before they were recorded" + _FASTER
    STATION_PAUSED = (
        "the station itself was suspended for {stall_s:.1f} s; make sure that its computer does not sleep or swap"
    )
    GLITCH_UP = (
        "sync_glitch.up",
        "the sync line spiked to {to_v:z.2f} V for less than {glitch_ms:g} ms at sample {sample}; ignored",
    )
    GLITCH_DOWN = (
        "sync_glitch.down",
        "the sync line dipped to {to_v:z.2f} V for less than {glitch_ms:g} ms at sample {sample}; ignored",
    )


class RefusalCode(Code, prefix="refused."):
    """Reason why a trial is not started."""

    CANCELLED_OPENING = (
        "refused.cancelled",
        "cancelled by the operator while the devices were opening; nothing was recorded",
    )
    SIMULATED_DEVICES = (
        "simulated devices ({devices}) cannot be recorded into {folder}, which is not below a folder called "
        "{simulated_folder}; record into {place}, or practise with --simulated"
    )
    MIXED_ORIGIN = (
        "{folder} contains {present} data ({file}), and this trial would be {origin}; record into another "
        "session folder"
    )
    FOLDER_NOT_MADE = "the session folder {folder} cannot be created ({reason}); use another session folder"
    FOLDER_READ_ONLY = "the session folder {folder} is not writable; use another session folder"
    DISK_FULL = (
        "the disk of {folder} has {free_mb:.0f} MB free, expected at least {needed_mb:.0f} MB for the planned trials; "
        "free some space"
    )
    FOLDER_IN_USE = "another trial is being recorded into {folder}; wait for its end"
    NO_LOCKS = "files in {folder} cannot be locked ({reason}); record onto a local disk"
    PATH_TOO_LONG = (
        "{path} is {excess:character} too long for Windows, which allows {longest}; use a session folder with a "
        "shorter path"
    )
    RECORDER_ENDED = "the recorder ended with code {exit_code} during the trial; what it had written is kept"
    UNREADABLE_MESSAGE = (
        "a message of the recorder cannot be read ({reason}); the recording is not affected. Restart the console after "
        "this trial"
    )


class CheckCode(Code):
    """Result of one check of the bench."""

    ANSWERS = "device.answers", "answers{identity}"
    ANSWERS_SIMULATED = "device.answers_simulated", "answers{identity}; the device is SIMULATED"
    NO_ANSWER = "device.no_answer", "{device} did not answer within {timeout_s:g} s; check its power and its cable"
    DEVICE_ERROR = "device.error", "{reason} [{reason_code}]"
    UNREADABLE = "device.unreadable", "{reason}"
    RATE = "stream.rate", "{rate_hz:.1f} samples/s, nominal {nominal_hz:g}; {source}"
    WRONG_RATE = (
        "stream.wrong_rate",
        "{rate_hz:.1f} samples/s, expected {nominal_hz:g}; {source}; check the rate that is set at the device",
    )
    NO_CAPTURE = (
        "stream.no_capture",
        "no frames: no capture is running; start one to check rate ({nominal_hz:g} Hz) and labels",
    )
    AT_REST = "force.at_rest", _FORCE
    SATURATED = "force.saturated", _FORCE + "; saturated at {limit:.4g} {unit}, check the wiring"
    LOADED = (
        "force.loaded",
        _FORCE + ", expected within ±{limit_n:.1f} N with the hook empty; unload the rope or correct the zero of the "
        "amplifier",
    )
    CALIBRATION_VALID = "calibration.valid", _CERTIFICATE
    CALIBRATION_DUE = "calibration.due", _CERTIFICATE + "; have the load cell calibrated"
    CALIBRATION_IN_FUTURE = (
        "calibration.in_future",
        _CERTIFICATE + ": the date is in the future; correct it in the configuration",
    )
    CALIBRATION_UNKNOWN = "calibration.unknown", "date unknown; enter that of the certificate in the configuration"
    SYNC_LOW = "sync.low", "{level_v:z.2f} V, threshold {threshold_v:g} V"
    SYNC_HIGH = (
        "sync.high",
        "{level_v:z.2f} V, threshold {threshold_v:g} V; expected low until a capture starts: stop the capture or check "
        "the polarity",
    )
    LABELS_PRESENT = "markers.present", "all labels present"
    LABELS_MISSING = "markers.missing", "missing {missing}; present {present}; label them in the mocap system"
    DISK = "disk.free", _DISK
    DISK_LOW = "disk.low", _DISK + "; free some space"
    MASS_RIGHT = "mass.right", _MASS
    MASS_WRONG = (
        "mass.wrong",
        _MASS + "; check that the mass hangs freely on the cell. If it does, correct capacity, full scale and "
        "polarity of the cell in the configuration",
    )
    MASS_WITHOUT_ZERO = (
        "mass.zero_missing",
        _MASS + "; the reading includes the zero, run with --known-mass 0 on the empty cell first",
    )
    MASS_UNREAD = "mass.unread", "not read; hang one on the cell, enter it and read it"


class CueCode(Code, prefix="cue."):
    """Instruction of the guide during a trial."""

    EMPTY_HOOK = "leave the hook empty and stand still"
    ADD_WEIGHT = "hang weight {weight} of {weights}: {mass_kg:g} kg ({target_n:.0f} N in all)"
    REMOVE_WEIGHT = "take weight {weight} off: {mass_kg:g} kg ({target_n:.0f} N left)"
    WRONG_FORCE = "{force_n:.1f} N, expected {target_n:.1f} N: check the weight, and that the rope runs freely"
    STATIC_DONE = "all weights are off and held: end the capture"
    FIRST_LEVEL = "add a weight or take one off, and hold it for {hold_s:g} s"
    HOLD = "hold it at {force_n:.0f} N"
    NEXT_LEVEL = "levels held: {levels:.0f}; add a weight or take one off, and hold it for {hold_s:g} s"
    STAND_STILL = "stand still"
    HANG_STILL = "let the weight hang still"
    PULL_SPRING = "pull the spring, about once a second"
    BOUNCE = "bounce the weight, about once a second"
    KEEP_SWINGING = "keep it swinging: {frequency_hz:.2f} Hz, ±{amplitude_n:.0f} N"
    LET_REST = "let it come to rest"
    SWING_DONE = "it rests: end the capture"
    HOLD_POSE = "stand upright with the arm hanging, and keep still"
    POSE_DONE = "pose held; end the capture"
    RAISE_ARM = "raise the arm: cycle {cycle:.0f} of {cycles:.0f}"
    LOWER_ARM = "lower the arm: cycle {cycle:.0f} of {cycles:.0f}"
    MOTION_DONE = "{cycles:cycle} counted: let the arm hang, then end the capture"
    MOVE_UNCOUNTED = (
        "raise and lower the arm {cycles:time}, then end the capture; cycles are counted only with arm and trunk "
        "under [body]"
    )
    CONTRACT = "contract as strongly as possible for 3 to 5 s, with rests between; then end the capture"


class AlarmCode(Code, prefix="alarm."):
    """A force limit was exceeded."""

    OVERLOAD = (
        "STOP: overload, {force_n:.0f} N on a load cell of {capacity_n:.0f} N; unload the rope and check the cell"
    )
    FORCE = "STOP: {force_n:.0f} N at the cuff, at most {limit_n:.0f} N are allowed; unload the rope"
    FORCE_RATE = (
        "STOP: the force rose by more than {limit_n_per_s:.0f} N per second; unload the rope and check cuff and skin"
    )

"""Messages on a session: its journal, commands, verdicts, terminal and page."""

from __future__ import annotations

from documents.message import Code

_KEEP_MIGRATION = ". The cuff may have migrated in this trial: only redon keeps migration measurable"


class JournalCode(Code, prefix="journal."):
    """Reason why session.jsonl cannot be read or written."""

    UNREADABLE = "{path} cannot be read: {reason}"
    WRONG_LINE = "{path}, line {line}: expected an entry of the journal, found {found}"
    NOT_WRITTEN = "{path} cannot be written: {reason}; the entry of the journal is not stored"
    NO_REASON = "{file} is to be repeated without a reason; enter what was wrong with it"
    GONE = (
        "{path} is gone: the folder of the open session was moved, renamed or deleted. Resume the session where it is "
        "now, or begin a new one"
    )


class CommandCode(Code, prefix="command."):
    """Reason why a command of the operator is refused."""

    NO_SUBJECT = "setup.no_subject", "no subject is given; enter a code of letters and digits, such as P01"
    WRONG_SUBJECT = (
        "setup.subject",
        "the subject is {subject}, expected a code of letters and digits, such as P01: it becomes part of file names",
    )
    WRONG_NUMBER = "setup.number", "the session is {number}, expected letters and digits, such as 1 or monday"
    NO_CUFF_CHOSEN = "setup.no_cuff", "no cuff is chosen; choose from {known}"
    UNKNOWN_CUFF = "setup.unknown_cuff", "the configuration has no cuff {unknown}; it has {known}"
    REPEATED_CUFF = (
        "setup.repeated_cuff",
        "the plan names {repeated} more than once; name every cuff once, and set the number of repeats instead",
    )
    WRONG_MASSES = "setup.masses", "the load steps are {masses} kg, expected masses above 0"
    NO_MASSES = (
        "setup.no_masses",
        "the load steps are empty; enter the weights in the order of loading, such as 1.53 1.53",
    )
    WRONG_REPEATS = "setup.repeats", "the repeats are {repeats}, expected a whole number from 1 to {most}"
    WRONG_QUANTITY = (
        "setup.quantity",
        "the {quantity} is {text}, expected {lowest:g} to {highest:g} {unit}; leave the field empty if it is not known",
    )
    WRONG_KNOWN_MASS = "setup.known_mass", "the known mass is {text}, expected kilograms above 0, such as 2.5"
    NO_BODY = (
        "setup.no_body",
        "motions are planned, but the configuration names no markers of the wearer; add [body] with its markers",
    )
    MASSES_NOT_NUMBERS = (
        "setup.masses_not_numbers",
        "the load steps are {text}, expected kilograms separated by spaces, such as 1.53 1.53",
    )
    OTHER_PLAN = (
        "session.other_plan",
        "session {number} of {subject} was planned with {plan}; resume it with that plan, or use another session "
        "number",
    )
    NO_PLAN = "session.no_plan", "{folder} contains no session to resume: its {file} has no plan"
    NO_SESSION = "session.none", "no session is open; begin or resume one first"
    COMPLETE = "session.complete", "every trial of the plan is accepted; the session is complete"
    SUMMARY_RUNNING = "session.summary_running", "the report is already being written; wait for its end"
    NOTHING_TO_SKIP = "no trial of the plan is left to skip"
    NOT_LEFT = "{trial} is not left in the plan; redo it to record it again"
    NOT_DONE = "{trial} has no recording that is kept, so there is none to redo"
    TRIAL_RUNNING = "a trial is running; stop it or wait for its end"
    UNDECIDED = "{file} waits for a decision; keep or redo it first"
    NO_TRIAL = "no trial is running"
    NO_MARK_YET = "a mark refers to the recording, which begins at the sync edge; wait for it"
    UNKNOWN_MARK = "the running trial has no mark {number}; a mark can also be named with the verdict"
    NO_FORCE = "no force has arrived yet; tare once the force is shown"
    NOTHING_TO_DECIDE = "no recording waits for a decision"
    NOTHING_TO_UNDO = "there is no decision to undo in this session"
    UNKNOWN_RECORDING = "{file} is not a recording of this session"
    BOUNCE_NOT_ASSIGNABLE = "{file} is not a trial of a cuff; it cannot be assigned to one"
    NOT_IN_PLAN = "the plan has no {cuff}, {test}, repeat {repeat}; it has {plan}"
    NOT_NOW = "{action} is not possible now"
    PRESSED_LATE = (
        "{name} was pressed {late_s:.0f} s ago, while the console did not answer, and is not executed; press it again"
    )
    PRESS_UNDATED = (
        "{name} arrived without the time of its press and is not executed; reload the page and press it again"
    )
    NOT_WHILE_RUNNING = "{action} is not possible while a trial runs"
    BEING_RECORDED = "this trial is being recorded; stop it, or redo it and give the reason"
    TOO_LATE = "{action} arrived after the recording had begun; keep or redo the trial"
    WAITS_FOR_DECISION = "{file} waits for a decision: {commands}"
    REASON_MISSING = "the reason is missing; add what was wrong, for example: {action} the wearer coughed"
    NOTHING_TO_REDO = "the last decision kept no recording, so there is none to redo"
    BOUNCE_NOT_DONNED = "this trial has no cuff to don anew; redo it"
    LOSES_MIGRATION = (
        "{file} is the first static trial of its donning, and the cuff may have migrated in it: unless the cuff is "
        "donned anew, migration stays unknown; enter redon, or redo again to accept that"
    )
    UNKNOWN_COMMAND = "command.unknown", "{line} is not a command; commands are {known}"
    UNEXPECTED_ARGUMENT = "{action} takes no argument, found {argument}"
    TRIAL_NUMBER_EXPECTED = (
        "{action} expects the number of a trial, such as #5, found {argument}; trials lists the numbers"
    )
    NO_SUCH_TRIAL = "the plan has no trial #{number}; it has #1 to #{most}"
    UNKNOWN_KEY = "the key {key} is not used; ? lists the keys"
    NEW_SESSION = (
        "session.subject_missing",
        "{folder} is a new session; give --subject, a code of letters and digits, such as P01",
    )


class ReasonCode(Code, prefix="reason."):
    """Reason to repeat a trial, or to doubt it."""

    NOT_ACCEPTED = "{reason}"
    LOST_SAMPLES = "samples lost during the transfer: {samples}"
    UNUSABLE = "{reason}"
    NO_STATIC_RESULT = (
        "this static trial yields neither stiffness nor damping; load the cuff with every step of the plan"
    )
    NO_DYNAMIC_RESULT = (
        "this dynamic trial yields neither stiffness nor damping; pull the spring about once a second throughout"
    )
    WEIGHTS_MISSING = "stopped after {found:.0f} of {planned:weight}; redo the trial, and hang all of them one by one"
    LOADS_HIDDEN = (
        "force or markers are missing while loads are held; check the load cell and the view of the cameras, and redo "
        "the trial"
    )
    UNLOADING_MISSING = (
        "stopped after {found:.0f} of {planned:weight} were taken off; redo the trial, and take all of them off "
        "one by one"
    )
    SWING_CUT = (
        "force or markers end after {found_s:.0f} of {planned_s:.0f} s of swinging, before the capture ends; check the "
        "load cell and the mocap system, and redo the trial"
    )
    SWING_SHORT = (
        "stopped after {found_s:.0f} of {planned_s:.0f} s of swinging; redo the trial, and keep the weight swinging"
    )
    SLIPPED = (
        "the cuff slipped by {slip_mm:.0f} mm in this trial, expected at most {limit_mm:.0f} mm; tighten its straps, "
        "don it anew and redo the trial"
    )
    OUTLIER = (
        "{symbol} is {value} {unit}, the mean of the earlier repeats is {mean} {unit}: {distance:.0f} standard errors "
        "apart"
    )
    ZERO_DRIFT = "{reason}"
    NOT_USED = "the fit does not use this recording"
    FIT_FAILED = "the fit failed ({reason}); the recording is stored: keep it, and report this error"
    FIT_KILLED = (
        "the operating system killed the fit twice, probably because memory is short; close other programs. The "
        "recording is stored"
    )
    MARKERS_HIDDEN = (
        "hidden in more than {limit_percent:.0f} % of the frames: {markers}; turn the cameras or replace the markers"
    )
    POSE_MOVES = (
        "marker {marker} moves by {range_mm:.0f} mm within the static pose, expected less than {highest_mm:.0f} mm"
    )
    CYCLES_MISSING = "{found:arm cycle} found, expected {planned:.0f}"
    EMG_UNUSABLE = "EMG {channel}: {reason}"
    NO_EMG_CLOCK = "{reason}"


class VerdictCode(Code, prefix="verdict."):
    """Headline of the verdict on a recording, by its grade."""

    GOOD = "no problems found"
    DOUBTFUL = "usable, with doubts"
    BAD = "redo advised"


class TerminalCode(Code, prefix="terminal."):
    """Messages of a session between and during trials."""

    CAPTURE_NOT_RECORDED = (
        "the sync line is high: a capture is running that began before this trial was armed, and it is not recorded; "
        "stop that capture, then start the capture of this trial"
    )
    PAUSED = "paused; arm to continue"
    START = "arm when this is done"
    DECIDE = "keep it, or redo it"
    DECIDE_OR_REDON = "keep it, or redo it" + _KEEP_MIGRATION
    REDO_ADVISED = "redo advised: {reasons}"
    REDON_ADVISED = "redo advised: {reasons}" + _KEEP_MIGRATION
    PAUSE_AFTER_TRIAL = "the session pauses after this trial"
    PAUSE_AFTER_DECISION = "the session pauses after this decision"
    MARKED = "mark {number}"
    SUMMARY_STARTED = "fitting, assessing and writing the report"
    TRIALS_LEFT = "{left} left to record; resume with {command}"
    REPORT_MISSING = "the report is not written; {command} writes it"
    SUMMARY_FAILED = (
        "fit, assessment or report failed ({error}); the recordings are complete: keep them, and report this error"
    )
    MVC_NOT_READ = (
        "EMG stays in µV, because the process that reads {file} was killed twice; check the computer's free memory"
    )
    NOTE_AFTER_REPORT = "the note is stored; the report does not have it until it is written again"
    COMPLETE = "the session is complete"


class ServeCode(Code, prefix="serve."):
    """Reason why the console does not start."""

    CANNOT_LISTEN = (
        "the console cannot listen at {host}, port {port}: {reason}; end the program that listens there, or give "
        "another --host or --port"
    )
    WRONG_HOST = (
        "the console cannot listen at {host}: {reason}; give an address of this computer by --host, such as 127.0.0.1"
    )

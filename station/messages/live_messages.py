"""Messages of live operation, which a view shows beside the values."""

from __future__ import annotations

from documents.message import Code


class LiveCode(Code):
    """Finding on the live values, or reason why there are none."""

    GENERIC_BODY = (
        "live.generic_body",
        "generic body {model}, not scaled to the wearer ({reason}): effort and forces are those of an average person",
    )
    NO_SUBJECT = "live.no_subject", "the session has no {file}"
    NO_EARLIER_TRIAL = "live.no_earlier_trial", "the session has no earlier pose or motion trial"
    NO_GLENOID = (
        "live.no_glenoid",
        "{model} has no glenoid markers: muscles are solved without the constraint that keeps the joint force in the "
        "socket",
    )
    NO_JOINT = "live.no_joint", "{model} has no glenohumeral joint: no joint force is shown"
    NO_CUFFS = "live.no_cuffs", "only rigid cuffs are solved ({reason})"
    NO_FIT = "live.no_fit", "the markers do not fit the body: {reason}"
    NO_BODY = (
        "live.no_body",
        "{path} is a {test} test, expected a pose or a motion, with markers on the wearer; choose such a recording",
    )
    UNKNOWN_MARKERS = (
        "live.unknown_markers",
        "the cameras send the markers {labels}, of which the body {body} has {known:.0f}, expected at least 3; list "
        "the labels under [markers] in subject.toml",
    )
    WAITING = "live.waiting", "waiting for the first frame of the cameras"
    WEARER_LEFT = (
        "live.wearer_left",
        "no marker of the body has been seen for {seconds:.1f} s: the wearer is outside the volume; values resume "
        "when the markers are back",
    )
    MARKERS_EXCHANGED = (
        "live.markers_exchanged",
        "the labels of {markers} are exchanged: the live values use the corrected labels; the recording keeps those "
        "that QTM sent, so correct them there",
    )
    MARKERS_LEFT_OUT = (
        "live.markers_left_out",
        "{markers} jumped and are left out; check their labels and reflections in QTM",
    )
    NOT_HELD = "live.not_held", "hidden markers leave {coordinates} undetermined; the values there are estimates"
    UNSOLVED = "live.unsolved", "{frames:.0f} of the last {of:frame} have no solution ({outcome})"
    DECIMATED = (
        "live.decimated",
        "the cameras send {rate_hz:.0f} frames per second: one in {every:.0f} is solved ({solved_hz:.0f} per second)",
    )
    OVERLOADED = (
        "live.overloaded",
        "this computer is too slow: one frame in {every:.0f} is solved ({solved_hz:.0f} per second), and the view has "
        "left out {dropped:frame} so far; the recording is not affected; fewer scenarios need less time",
    )
    WRITTEN = "live.written", "live result: {path}"
    NO_OUTLET = "live.no_outlet", "no live outlet: {reason}"
    NO_INTERFACE = (
        "live.no_interface",
        'live.outlet is "{interface}", expected "loopback", "any" or an interface of this computer: {known}',
    )
    OUTLET_NOT_CONFINED = (
        "live.outlet_not_confined",
        'this computer cannot confine an LSL outlet to "{interface}"; set live.outlet = "any" to serve every '
        "interface, and let the firewall decide who may connect",
    )
    NO_FILE = "live.no_file", "the live result is not written ({reason}); the recording is not affected"
    NOT_STARTED = "live.not_started", "the live process does not start ({reason}); the recording is not affected"
    ENDED = "live.ended", "the live process has ended (exit code {exit_code}); the recording is not affected"
    UNREACHABLE = (
        "live.unreachable",
        "no live process answers; it runs while a trial is recorded with [live] enabled = true",
    )
    WRONG_ADDRESS = "live.wrong_address", "{path} is ignored, it is no address of a live process: {reason}; delete it"
    NO_PORT = "live.no_port", "it has no port from 1 to 65535 with a token"
    NOT_ANNOUNCED = (
        "live.not_announced",
        "no view can show the live values: {path} cannot be written ({reason}); remove it before the next trial; the "
        "recording is not affected",
    )

"""Messages of live operation, which a view shows beside the values."""

from __future__ import annotations

from documents.message import Code


class LiveCode(Code, prefix="live."):
    """Finding on the live values, or reason why there are none."""

    GENERIC_BODY = (
        "generic body {model}, not scaled to the wearer ({reason}): effort and forces are those of an average person"
    )
    NO_SUBJECT = "the session has no {file}"
    NO_EARLIER_TRIAL = "the session has no earlier pose or motion trial"
    NO_GLENOID = (
        "{model} has no glenoid markers: muscles are solved without the constraint that keeps the joint force in the "
        "socket"
    )
    NO_JOINT = "{model} has no glenohumeral joint: no joint force is shown"
    NO_CUFFS = "only rigid cuffs are solved ({reason})"
    NO_FIT = "the markers do not fit the body: {reason}"
    NO_BODY = (
        "{path} is a {test} test, expected a pose or a motion, with markers on the wearer; choose such a recording"
    )
    UNKNOWN_MARKERS = (
        "the cameras send the markers {labels}, of which the body {body} has {known:.0f}, expected at least 3; list "
        "the labels under [markers] in subject.toml"
    )
    WAITING = "waiting for the first frame of the cameras"
    WEARER_LEFT = (
        "no marker of the body has been seen for {seconds:.1f} s: the wearer is outside the volume; values resume "
        "when the markers are back"
    )
    MARKERS_EXCHANGED = (
        "the labels of {markers} are exchanged: the live values use the corrected labels; the recording keeps those "
        "that QTM sent, so correct them there"
    )
    MARKERS_LEFT_OUT = "{markers} jumped and are left out; check their labels and reflections in QTM"
    NOT_HELD = "hidden markers leave {coordinates} undetermined; the values there are estimates"
    UNSOLVED = "{frames:.0f} of the last {of:frame} have no solution ({outcome})"
    DECIMATED = (
        "the cameras send {rate_hz:.0f} frames per second: one in {every:.0f} is solved ({solved_hz:.0f} per second)"
    )
    OVERLOADED = (
        "this computer is too slow: one frame in {every:.0f} is solved ({solved_hz:.0f} per second), and the view has "
        "left out {dropped:frame} so far; the recording is not affected; fewer scenarios need less time"
    )
    WRITTEN = "live result: {path}"
    NO_OUTLET = "no live outlet: {reason}"
    NO_INTERFACE = 'live.outlet is "{interface}", expected "loopback", "any" or an interface of this computer: {known}'
    OUTLET_NOT_CONFINED = (
        'this computer cannot confine an LSL outlet to "{interface}"; set live.outlet = "any" to serve every '
        "interface, and let the firewall decide who may connect"
    )
    NO_FILE = "the live result is not written ({reason}); the recording is not affected"
    NOT_STARTED = "the live process does not start ({reason}); the recording is not affected"
    ENDED = "the live process has ended (exit code {exit_code}); the recording is not affected"
    UNREACHABLE = "no live process answers; it runs while a trial is recorded with [live] enabled = true"
    WRONG_ADDRESS = "{path} is ignored, it is no address of a live process: {reason}; delete it"
    NO_PORT = "it has no port from 1 to 65535 with a token"
    NOT_ANNOUNCED = (
        "no view can show the live values: {path} cannot be written ({reason}); remove it before the next trial; the "
        "recording is not affected"
    )

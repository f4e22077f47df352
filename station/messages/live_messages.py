"""Messages of live operation, which a view shows beside the values."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum


class LiveCode(StrEnum):
    """Finding on the live values, or reason why there are none."""

    GENERIC_BODY = "live.generic_body"
    NO_GLENOID = "live.no_glenoid"
    NO_JOINT = "live.no_joint"
    NO_CUFFS = "live.no_cuffs"
    NO_FIT = "live.no_fit"
    NO_BODY = "live.no_body"
    UNKNOWN_MARKERS = "live.unknown_markers"
    WAITING = "live.waiting"
    STARTING = "live.starting"
    WEARER_LEFT = "live.wearer_left"
    MARKERS_EXCHANGED = "live.markers_exchanged"
    MARKERS_LEFT_OUT = "live.markers_left_out"
    NOT_HELD = "live.not_held"
    UNSOLVED = "live.unsolved"
    DECIMATED = "live.decimated"
    OVERLOADED = "live.overloaded"
    WRITTEN = "live.written"
    NO_OUTLET = "live.no_outlet"
    NO_INTERFACE = "live.no_interface"
    OUTLET_NOT_CONFINED = "live.outlet_not_confined"
    NO_FILE = "live.no_file"
    NOT_STARTED = "live.not_started"
    ENDED = "live.ended"
    UNREACHABLE = "live.unreachable"
    WRONG_ADDRESS = "live.wrong_address"
    NOT_ANNOUNCED = "live.not_announced"


LIVE: Mapping[StrEnum, str] = {
    LiveCode.GENERIC_BODY: (
        "generic body {model}, not scaled to the wearer ({reason}): effort and forces are those of an average person"
    ),
    LiveCode.NO_GLENOID: (
        "{model} has no glenoid markers: muscles are solved without the constraint that keeps the joint force in the "
        "socket"
    ),
    LiveCode.NO_JOINT: "{model} has no glenohumeral joint: no joint force is shown",
    LiveCode.NO_CUFFS: "only rigid cuffs are solved ({reason})",
    LiveCode.NO_FIT: "the markers do not fit the body: {reason}",
    LiveCode.NO_BODY: (
        "{path} is a {test} test, expected a pose or a motion, with markers on the wearer; choose such a recording"
    ),
    LiveCode.UNKNOWN_MARKERS: (
        "the cameras send the markers {labels}, of which the body {body} has {known:.0f}, expected at least 3; list "
        "the labels under [markers] in subject.toml"
    ),
    LiveCode.WAITING: "waiting for the first frame of the cameras",
    LiveCode.STARTING: "preparing the body and its muscles; frames before that are not solved",
    LiveCode.WEARER_LEFT: (
        "no marker of the body has been seen for {seconds:.1f} s: the wearer is outside the volume; values resume "
        "when the markers are back"
    ),
    LiveCode.MARKERS_EXCHANGED: (
        "the labels of {markers} are exchanged: the live values use the corrected labels; the recording keeps those "
        "that QTM sent, so correct them there"
    ),
    LiveCode.MARKERS_LEFT_OUT: "{markers} jumped and are left out; check their labels and reflections in QTM",
    LiveCode.NOT_HELD: "hidden markers leave {coordinates} undetermined; the values there are estimates",
    LiveCode.UNSOLVED: "{frames:.0f} of the last {of:frame} have no solution ({outcome})",
    LiveCode.DECIMATED: (
        "the cameras send {rate_hz:.0f} frames per second: one in {every:.0f} is solved ({solved_hz:.0f} per second)"
    ),
    LiveCode.OVERLOADED: (
        "this computer is too slow: one frame in {every:.0f} is solved ({solved_hz:.0f} per second), and the view has "
        "left out {dropped:frame} so far; the recording is not affected; fewer scenarios need less time"
    ),
    LiveCode.WRITTEN: "live result: {path}",
    LiveCode.NO_OUTLET: "no live outlet: {reason}",
    LiveCode.NO_INTERFACE: (
        'live.outlet is "{interface}", expected "loopback", "any" or an interface of this computer: {known}'
    ),
    LiveCode.OUTLET_NOT_CONFINED: (
        'this computer cannot confine an LSL outlet to "{interface}"; set live.outlet = "any" to serve every '
        "interface, and let the firewall decide who may connect"
    ),
    LiveCode.NO_FILE: "the live result is not written ({reason}); the recording is not affected",
    LiveCode.WRONG_ADDRESS: "{path} is ignored, it is no address of a live process: {reason}; delete it",
    LiveCode.NOT_ANNOUNCED: (
        "no view can show the live values: {path} cannot be written ({reason}); remove it before the next trial; the "
        "recording is not affected"
    ),
    LiveCode.NOT_STARTED: "the live process does not start ({reason}); the recording is not affected",
    LiveCode.ENDED: "the live process has ended (exit code {exit_code}); the recording is not affected",
    LiveCode.UNREACHABLE: "no live process answers; it runs while a trial is recorded with [live] enabled = true",
}

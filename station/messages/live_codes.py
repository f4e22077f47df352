"""Codes of live operation: what a view shows beside the values."""

from __future__ import annotations

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

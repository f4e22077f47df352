"""Sentences on poses and motions of the wearer: instructions during a trial, reasons to repeat it."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum

from station.messages.codes import CommandCode, CueCode, ReasonCode

WEARER_SENTENCES: Mapping[StrEnum, str] = {
    CommandCode.NO_BODY: (
        "motions are planned, but the configuration names no markers of the wearer; add [body] with its markers"
    ),
    CueCode.HOLD_POSE: "stand upright with the arm hanging, and keep still",
    CueCode.POSE_DONE: "pose held; end the capture",
    CueCode.RAISE_ARM: "raise the arm: cycle {cycle:.0f} of {cycles:.0f}",
    CueCode.LOWER_ARM: "lower the arm: cycle {cycle:.0f} of {cycles:.0f}",
    CueCode.MOTION_DONE: "{cycles:.0f} cycles counted: let the arm hang, then end the capture",
    CueCode.MOVE_UNCOUNTED: (
        "raise and lower the arm {cycles:.0f} times, then end the capture; cycles are counted only with arm and trunk "
        "under [body]"
    ),
    CueCode.CONTRACT: "contract as strongly as possible for 3 to 5 s, with rests between; then end the capture",
    ReasonCode.MARKERS_HIDDEN: (
        "hidden in more than {limit_percent:.0f} % of the frames: {markers}; turn the cameras or replace the markers"
    ),
    ReasonCode.POSE_MOVES: (
        "marker {marker} moves by {range_mm:.0f} mm within the static pose, expected less than {highest_mm:.0f} mm"
    ),
    ReasonCode.CYCLES_MISSING: "{found:.0f} arm cycles found, expected {planned:.0f}",
    ReasonCode.EMG_UNUSABLE: "EMG {channel}: {text}",
    ReasonCode.NO_EMG_CLOCK: "{text}",
}

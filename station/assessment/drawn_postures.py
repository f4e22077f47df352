"""Three postures of the assessed motion for the picture of the body: bones, muscle paths, cord and cuffs."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from solver.drawing import BoneKind, bone_lines, path_lines, skeleton
from solver.model import Array, Model
from solver.motion import Kinematics
from solver.multibody.postures import Postures, points_in_ground, postures
from solver.suit.suit import PARTS, Suit, SuitPoint
from station.assessment.assessment_json import KnownNumberEntry, StrictEntry, exact_number

RING_POINTS = 24
DECIMALS = 3
"""Of a place [m]: a pixel of the picture is 2 to 3 mm."""


class LineEntry(StrictEntry):
    """Points of a line in ground, x y z in metres."""

    value: Annotated[list[Annotated[list[float], Field(min_length=3, max_length=3)]], Field(min_length=1)]
    ci95: None = None


class BoneEntry(StrictEntry):
    """A bone: "shaft", "plate" (closed outline) or "cage" (ring of the thorax)."""

    kind: BoneKind
    line_m: LineEntry


class PostureEntry(StrictEntry):
    """Body and suit at one time of the motion. Elevation of the arm, or of another limb with the arm cuff, is from the
    direction of gravity. chosen_by is what is least, middle and greatest in the three postures.
    """

    time_s: KnownNumberEntry
    elevation_deg: KnownNumberEntry
    cord_length_m: KnownNumberEntry | None = None
    chosen_by: Literal["elevation", "cord_length"] = "elevation"
    bones: list[BoneEntry]
    muscles_m: dict[str, LineEntry]
    cord_m: LineEntry
    cuffs_m: dict[str, LineEntry] = Field(description="rings of waist and arm cuff about their bodies, if they weigh")


def drawn_postures(model: Model, kinematics: Kinematics, suit: Suit, times: Array) -> list[PostureEntry]:
    """Of the postures at times (n,) [s]: with the lowest arm, at the middle elevation, with the highest arm. Of a suit
    on another limb: with the shortest cord, at the middle length, with the longest cord.
    """
    positions = kinematics.positions[np.searchsorted(kinematics.time, times).clip(max=len(kinematics.time) - 1)]
    whole = postures(model, positions, np.zeros_like(positions))
    elevation = arm_elevation(model, suit, whole)
    length = np.linalg.norm(np.diff(_cord(model, whole, suit), axis=1), axis=-1).sum(axis=1)
    is_arm = suit.names["arm"] == "arm"
    frames = _least_middle_greatest(elevation if is_arm else length)
    state = postures(model, positions[frames], np.zeros_like(positions[frames]))
    bones, muscles = skeleton(model), path_lines(model, state)
    lines = bone_lines(bones, state)
    cord = _cord(model, state, suit)
    worn = {part for part, mass in zip(PARTS, suit.masses, strict=True) if mass.mass > 0.0} | {"arm"}
    rings = {part: _ring(model, state, getattr(suit, part)) for part in ("waist", "arm") if part in worn}
    return [
        PostureEntry(
            time_s=exact_number(float(times[frame])),
            elevation_deg=exact_number(float(np.degrees(elevation[frame]))),
            cord_length_m=exact_number(float(length[frame])),
            chosen_by="elevation" if is_arm else "cord_length",
            bones=[
                BoneEntry(kind=bone.kind, line_m=_line(line[shown])) for bone, line in zip(bones, lines, strict=True)
            ],
            muscles_m={name: _line(line) for name, line in zip(model.muscle_names, muscles[shown], strict=True)},
            cord_m=_line(cord[shown]),
            cuffs_m={part: _line(ring[shown]) for part, ring in rings.items()},
        )
        for shown, frame in enumerate(frames)
    ]


def arm_elevation(model: Model, suit: Suit, state: Postures) -> Array:
    """Angle (frames,) [rad] between gravity and the arm: from the joint of the arm cuff's body to the next joint, or
    to the cuff where there is none.
    """
    body = model.body_index(suit.arm.body)
    start = next(joint.frame_in_child.translation for joint in model.joints if joint.child == body)
    ends = [joint.frame_in_parent.translation for joint in model.joints if joint.parent == body]
    along = state.rotation_to_ground[:, body] @ ((ends[0] if ends else suit.arm.location) - start)
    cosine = along @ model.gravity / (np.linalg.norm(along, axis=1) * np.linalg.norm(model.gravity))
    return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)))


def _least_middle_greatest(values: Array) -> list[int]:
    """Indices of the least value, of that nearest to the mean of both ends, and of the greatest."""
    least, greatest = int(np.argmin(values)), int(np.argmax(values))
    return [least, int(np.argmin(np.abs(values - (values[least] + values[greatest]) / 2))), greatest]


def _cord(model: Model, state: Postures, suit: Suit) -> Array:
    """(frames, points, 3) in ground."""
    return np.stack([_in_ground(model, state, point) for point in suit.line], axis=1)


def _in_ground(model: Model, state: Postures, point: SuitPoint) -> Array:
    return points_in_ground(state, model.body_index(point.body), point.location)


def _ring(model: Model, state: Postures, point: SuitPoint) -> Array:
    """(frames, points, 3) circle through the cord's point about the y axis of its body, as the suit's masses."""
    angle = np.linspace(0.0, 2.0 * np.pi, RING_POINTS + 1)
    x, height, z = point.location
    radius = np.hypot(x, z)
    circle = np.column_stack([radius * np.cos(angle), np.full_like(angle, height), radius * np.sin(angle)])
    body = model.body_index(point.body)
    return np.stack([points_in_ground(state, body, place) for place in circle], axis=1)


def _line(points: Array) -> LineEntry:
    return LineEntry(value=np.round(points, DECIMALS).tolist(), ci95=None)

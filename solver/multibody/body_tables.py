"""Bodies, joints and functions of a model as records for the compiled code."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from solver.functions.coordinate_functions import Function, Sine, polynomial
from solver.model import NO_COORDINATE, Array, AxisMotion, BallMotion, Joint, Model, ScapulothoracicMotion

Indices = NDArray[np.int64]
Record = np.void
Records = NDArray[np.void]

AXES, BALL, SCAPULOTHORACIC = 0, 1, 2

# Functions are polynomials in pieces, to which a sine may be added.
FUNCTION = np.dtype(
    [("first_piece", np.int64), ("amplitude", np.float64), ("omega", np.float64), ("phase", np.float64)]
)

BODY = np.dtype([("mass", np.float64), ("mass_center", np.float64, (3,)), ("inertia", np.float64, (3, 3))])

# A body in a posture, as in postures.Postures; bias is that of its screw.
POSE = np.dtype(
    [
        ("rotation", np.float64, (3, 3)),
        ("origin", np.float64, (3,)),
        ("angular_velocity", np.float64, (3,)),
        ("origin_velocity", np.float64, (3,)),
        ("bias", np.float64, (6,)),
    ]
)

# A joint as in model.Joint: its frames in parent and child, and the coordinates that move it, `count` of them.
# AXES: six axes, of each the place of its driver among the joint's coordinates (−1: none), and the first of six
# functions. SCAPULOTHORACIC: radii, and pivot and axis of the winging, in the frame that rolls.
JOINT = np.dtype(
    [
        ("kind", np.int64),
        ("parent", np.int64),
        ("child", np.int64),
        ("rotation_in_parent", np.float64, (3, 3)),
        ("translation_in_parent", np.float64, (3,)),
        ("rotation_from_child", np.float64, (3, 3)),
        ("translation_in_child", np.float64, (3,)),
        ("count", np.int64),
        ("coordinates", np.int64, (6,)),
        ("axes", np.float64, (6, 3)),
        ("drivers", np.int64, (6,)),
        ("first_function", np.int64),
        ("radii", np.float64, (3,)),
        ("pivot", np.float64, (3,)),
        ("winging_axis", np.float64, (3,)),
    ]
)


class Functions(NamedTuple):
    """Function k (FUNCTION) has the pieces from its first to that of the next; the last row only ends them.

    ends          (pieces,) where each piece ends, the last of a function at infinity
    origins       (pieces,);  coefficients (pieces, degree + 1) the lowest power first
    """

    functions: Records
    ends: Array
    origins: Array
    coefficients: Array


class Tables(NamedTuple):
    """Bodies (BODY), the ground first, joints (JOINT), parents first, and the functions that move them.

    moves  (bodies, coordinates) is 1 where a coordinate lies between a body and the ground
    """

    bodies: Records
    joints: Records
    functions: Functions
    moves: Indices


@lru_cache(maxsize=32)
def pack_bodies(model: Model) -> Tables:
    """Tables of a model; cached, because a model is frozen."""
    moving = [f for joint in model.joints if isinstance(joint.motion, AxisMotion) for f in joint.motion.functions]
    joints = np.zeros(len(model.joints), JOINT)
    first_function = 0
    for row, joint in zip(joints, model.joints, strict=True):
        _place(row, joint)
        if isinstance(joint.motion, AxisMotion):
            row["first_function"] = first_function
            first_function += len(joint.motion.functions)
    bodies = np.array([(body.mass, body.mass_center, body.inertia) for body in model.bodies], BODY)
    return Tables(bodies, joints, pack_functions(moving), bodies_moved(model))


def bodies_moved(model: Model) -> Indices:
    """(bodies, coordinates): 1 where a coordinate moves a body, that is, lies between it and the ground, else 0."""
    moves = np.zeros((len(model.bodies), len(model.coordinates)), dtype=np.int64)
    for joint in model.joints:
        moves[joint.child] = moves[joint.parent]
        moves[joint.child, list(joint.motion.coordinates)] = 1
    return moves


def pack_functions(functions: Sequence[Function]) -> Functions:
    rows = np.zeros(len(functions) + 1, FUNCTION)
    pieces: list[tuple[float, float, Array]] = []
    for row, function in zip(rows, functions, strict=False):
        row["first_piece"] = len(pieces)
        if isinstance(function, Sine):
            row["amplitude"], row["omega"], row["phase"] = function.amplitude, function.omega, function.phase
        p = polynomial([function.offset]) if isinstance(function, Sine) else function
        pieces += zip([*p.breaks, np.inf], p.origins, p.coefficients, strict=True)
    rows[-1]["first_piece"] = len(pieces)
    coefficients = np.zeros((len(pieces), max((len(powers) for _, _, powers in pieces), default=1)))
    for padded, (_, _, powers) in zip(coefficients, pieces, strict=True):
        padded[: len(powers)] = powers
    ends, origins = np.array([piece[:2] for piece in pieces]).reshape(-1, 2).T
    return Functions(rows, np.array(ends), np.array(origins), coefficients)


def _place(row: Record, joint: Joint) -> None:
    in_parent, in_child = joint.frame_in_parent.rotation, joint.frame_in_child.rotation
    motion = joint.motion
    row["parent"], row["child"] = joint.parent, joint.child
    row["count"] = len(motion.coordinates)
    row["coordinates"][: row["count"]] = motion.coordinates
    if isinstance(motion, AxisMotion):
        row["kind"], row["axes"] = AXES, motion.axes
        row["drivers"] = [-1 if c == NO_COORDINATE else motion.coordinates.index(c) for c in motion.coordinate.tolist()]
    elif isinstance(motion, BallMotion):
        row["kind"] = BALL
    else:
        in_parent, in_child = in_parent @ _QUARTER_TURN, in_child @ _QUARTER_TURN
        _place_scapula(row, motion)
    row["rotation_in_parent"], row["translation_in_parent"] = in_parent, joint.frame_in_parent.translation
    row["rotation_from_child"], row["translation_in_child"] = in_child.T, joint.frame_in_child.translation


_QUARTER_TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def _place_scapula(row: Record, motion: ScapulothoracicMotion) -> None:
    """OpenSim's ellipsoid lies a quarter turn about z away from the joint's frames: its first radii trade places."""
    (x, y), direction = motion.winging_origin, motion.winging_direction
    row["kind"], row["radii"] = SCAPULOTHORACIC, motion.radii[[1, 0, 2]]
    row["pivot"], row["winging_axis"] = (y, -x, 0.0), (np.cos(direction), np.sin(direction), 0.0)

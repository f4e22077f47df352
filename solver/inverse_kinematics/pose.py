"""Poses and their derivatives with respect to the coordinates q, for one frame; compiled.

Columns of a Jacobian are screws (w, v) about the ground origin, as in multibody/postures.py, but per rate of a
coordinate, not per speed: a unit of q̇ moves a point p of a body beyond the joint by v + w × p. The difference matters
for the three angles of a scapula, ball or free joint. The screw of a distal joint is carried along by a proximal one;
within a joint its derivatives are exact for axes, and central differences for the scapula, which glides on its
ellipsoid.
"""

from __future__ import annotations

from math import cos, sin
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from solver.compiled import compiled
from solver.model import Model
from solver.multibody.body_tables import AXES, POSE, SCAPULOTHORACIC, Functions, Indices, Record, Records, pack_bodies
from solver.multibody.joints import MOVE, UNIT, derivatives, move_joint, place_child, screw_in_ground
from solver.vectors import ORIGIN, Vector, add, along, cross, read, turn, write

Array = NDArray[np.float64]

DIFFERENCE_STEP = 1e-5  # rad or m; error of a derivative about 1e-10

# A rotation about an axis of a joint, or a translation along it: by its slope per unit of its driver, which is the
# place of a coordinate among the joint's, −1 for none.
AXIS = np.dtype([("driver", np.int64), ("slope", np.float64), ("axis", np.float64, (3,))])


class Skeleton(NamedTuple):
    """joints (JOINT), parents first; joint_indices (coordinates,) the joint that a coordinate moves, −1 for none, and
    axis_indices (coordinates,) its place among that joint's; moves (bodies, coordinates) as in Tables.
    """

    joints: Records
    functions: Functions
    joint_indices: Indices
    axis_indices: Indices
    moves: Indices


class PoseWorkspace(NamedTuple):
    """Results of `evaluate_pose`, and working memory.

    poses    (bodies,) of POSE, of which rotation and origin are filled
    screws   (coordinates, 6) per rate of each coordinate, in ground
    changes  (coordinates, 6, 6) derivative of the screw of the joint's k-th coordinate with respect to a coordinate of
             the same joint; filled by `differentiate_screws`
    """

    poses: Records
    screws: Array
    changes: Array
    bases: Array
    base_places: Array
    local: Array
    shifted: Array
    at: Array
    still: Array
    moves: Records
    axes: Records
    places: Array


def build_skeleton(model: Model) -> Skeleton:
    tables = pack_bodies(model)
    joint_indices = np.full(len(model.coordinates), -1, dtype=np.int64)
    axis_indices = np.zeros(len(model.coordinates), dtype=np.int64)
    for index, joint in enumerate(model.joints):
        moved = list(joint.motion.coordinates)
        joint_indices[moved], axis_indices[moved] = index, range(len(moved))
    return Skeleton(tables.joints, tables.functions, joint_indices, axis_indices, tables.moves)


def allocate_pose(model: Model) -> PoseWorkspace:
    poses = np.zeros(len(model.bodies), POSE)
    poses["rotation"][0] = np.eye(3)
    count, joints = len(model.coordinates), len(model.joints)
    return PoseWorkspace(
        poses,
        np.zeros((count, 6)),
        np.zeros((count, 6, 6)),
        np.zeros((joints, 3, 3)),
        np.zeros((joints, 3)),
        np.zeros((6, 6)),
        np.zeros((2, 6, 6)),
        np.zeros(count),
        np.zeros(count),
        np.zeros(1, MOVE),
        np.zeros((joints, 6), AXIS),
        np.zeros((joints, 3)),
    )


@compiled
def evaluate_pose(skeleton: Skeleton, q: Array, work: PoseWorkspace) -> None:
    """Fill poses and screws at q (coordinates,)."""
    for j in range(len(skeleton.joints)):
        joint, move = skeleton.joints[j], work.moves[0]
        move_joint(joint, skeleton.functions, q, work.still, move)
        place_child(joint, move, work.poses[joint["parent"]], work.poses[joint["child"]])
        if joint["kind"] == SCAPULOTHORACIC:
            _screws_of_scapula(joint, move, q, work.local)
        else:
            _read_axes(joint, move, q, work.axes[j])
            _screws_of_axes(joint, work.axes[j], read(move["place"]), work.local)
        write(work.places[j], read(move["place"]))
        for a in range(3):
            work.base_places[j, a] = move["base_place"][a]
            for b in range(3):
                work.bases[j, a, b] = move["base"][a, b]
        for k in range(joint["count"]):
            w, v = screw_in_ground(work.bases[j], read(work.base_places[j]), work.local[k])
            write(work.screws[joint["coordinates"][k]], w)
            write(work.screws[joint["coordinates"][k], 3:], v)


@compiled
def differentiate_screws(skeleton: Skeleton, q: Array, work: PoseWorkspace) -> None:
    """Fill changes, after evaluate_pose at the same q."""
    for i in range(len(q)):
        work.at[i] = q[i]
    for j in range(len(skeleton.joints)):
        joint = skeleton.joints[j]
        for k in range(joint["count"]):
            if joint["kind"] == SCAPULOTHORACIC:
                _difference_of_scapula(joint, skeleton.functions, q, k, work)
            else:
                _change_of_axes(joint, skeleton.functions, work.axes[j], read(work.places[j]), q, k, work.local)
            moved = joint["coordinates"][k]
            for i in range(joint["count"]):
                w, v = screw_in_ground(work.bases[j], read(work.base_places[j]), work.local[i])
                write(work.changes[moved, i], w)
                write(work.changes[moved, i, 3:], v)


@compiled
def _read_axes(joint: Record, move: Record, q: Array, axes: Records) -> None:
    """Three rotations and three translations of a joint as the pose has them, after move_joint at q; move_joint's own
    are those of OpenSim's velocities, which differ where an axis that nothing drives has a constant angle.
    """
    if joint["kind"] == AXES:
        for i in range(6):
            axes[i]["driver"], axes[i]["slope"] = joint["drivers"][i], move["slope"][i]
            write(axes[i]["axis"], read(move["turned_axes"][i]) if i < 3 else read(joint["axes"][i]))
        return
    turning = _axes_of_angles(joint, q)
    for i in range(3):
        axes[i]["driver"], axes[i + 3]["driver"] = i, (i + 3 if joint["count"] == 6 else -1)
        axes[i]["slope"] = axes[i + 3]["slope"] = 1.0
        write(axes[i]["axis"], turning[i])
        write(axes[i + 3]["axis"], UNIT[i])


@compiled
def _screws_of_axes(joint: Record, axes: Records, place: Vector, screws: Array) -> None:
    """Fill screws (6, 6) with those of the joint's coordinates, about its parent frame's origin."""
    for k in range(joint["count"]):
        w, v = ORIGIN, ORIGIN
        for i in range(6):
            if axes[i]["driver"] == k and i < 3:
                w = along(w, axes[i]["slope"], read(axes[i]["axis"]))
            elif axes[i]["driver"] == k:
                v = along(v, axes[i]["slope"], read(axes[i]["axis"]))
        write(screws[k], w)
        write(screws[k, 3:], add(v, cross(place, w)))


@compiled
def _change_of_axes(
    joint: Record, functions: Functions, axes: Records, place: Vector, q: Array, moved: int, local: Array
) -> None:
    """Fill local with the derivatives of these screws with respect to the joint's coordinate `moved`: a rotation turns
    the axes after it, a translation moves the place about which they turn.
    """
    shift = ORIGIN
    for i in range(3, 6):
        if axes[i]["driver"] == moved:
            shift = along(shift, axes[i]["slope"], read(axes[i]["axis"]))
    for k in range(joint["count"]):
        w, change, sliding = ORIGIN, ORIGIN, ORIGIN
        for i in range(6):
            if axes[i]["driver"] != k:
                continue
            axis, bend = read(axes[i]["axis"]), 0.0
            if k == moved and joint["kind"] == AXES:
                _, _, bend = derivatives(functions, joint["first_function"] + i, q[joint["coordinates"][k]])
            if i >= 3:
                sliding = along(sliding, bend, axis)
                continue
            w, change = along(w, axes[i]["slope"], axis), along(change, bend, axis)
            for before in range(i):
                if axes[before]["driver"] == moved:
                    rate = axes[before]["slope"] * axes[i]["slope"]
                    change = along(change, rate, cross(read(axes[before]["axis"]), axis))
        write(local[k], change)
        write(local[k, 3:], add(sliding, add(cross(place, change), cross(shift, w))))


@compiled
def _difference_of_scapula(joint: Record, functions: Functions, q: Array, moved: int, work: PoseWorkspace) -> None:
    """Fill local with central differences of the screws with respect to the joint's coordinate `moved`."""
    coordinate, move = joint["coordinates"][moved], work.moves[0]
    for side in range(2):
        work.at[coordinate] = q[coordinate] + (DIFFERENCE_STEP if side else -DIFFERENCE_STEP)
        move_joint(joint, functions, work.at, work.still, move)
        _screws_of_scapula(joint, move, work.at, work.shifted[side])
    work.at[coordinate] = q[coordinate]
    for k in range(joint["count"]):
        for a in range(6):
            work.local[k, a] = (work.shifted[1, k, a] - work.shifted[0, k, a]) / (2.0 * DIFFERENCE_STEP)


@compiled
def _screws_of_scapula(joint: Record, move: Record, q: Array, screws: Array) -> None:
    """As _screws_of_axes; the first three screws of move are those of a unit of angular velocity about x, y and z."""
    axes = _axes_of_angles(joint, q)
    for k in range(3):
        for a in range(6):
            screws[k, a] = 0.0
            for i in range(3):
                screws[k, a] += axes[k][i] * move["screws"][i, a]
    for a in range(6):
        screws[3, a] = move["screws"][3, a]


@compiled
def _axes_of_angles(joint: Record, q: Array) -> tuple[Vector, Vector, Vector]:
    """Axes about which the rates of body-fixed x-y-z angles turn: the columns of E in w = E q̇."""
    first, second = q[joint["coordinates"][0]], q[joint["coordinates"][1]]
    s1, c1, s2, c2 = sin(first), cos(first), sin(second), cos(second)
    return (1.0, 0.0, 0.0), (0.0, c1, s1), (s2, -s1 * c2, c1 * c2)


@compiled
def point_in_ground(pose: Record, location: Array) -> Vector:
    """Where a point of a body, location (3,) in it, is in ground."""
    return add(read(pose["origin"]), turn(pose["rotation"], read(location)))

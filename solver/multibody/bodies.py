"""Forward kinematics: poses and velocities of the bodies, and the columns of their Jacobians; compiled.

Velocities are screws (w, v) about the ground's origin, as in postures.py.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from solver.compiled import compiled, compiled_for_python
from solver.multibody.joints import MOVE, move_joint, product
from solver.multibody.tables import Functions, Record, Records
from solver.vectors import ORIGIN, Vector, add, along, cross, read, subtract, turn, write

Array = NDArray[np.float64]


@compiled_for_python
def move_bodies(
    joints: Records, functions: Functions, coordinates: Array, speeds: Array, poses: Records, screws: Array
) -> None:
    """Fill poses (frames, bodies) of POSE and screws (frames, coordinates, 6) for coordinates and speeds (frames,
    coordinates), as in postures.Postures. A body without a joint to its parent, as the ground, is left as it is.
    """
    bodies = poses.shape[1]
    moves, velocity = np.zeros(1, MOVE), np.zeros((bodies, 6))
    for frame in range(len(coordinates)):
        for joint in joints:
            move = moves[0]  # taken from the array in every frame: a record alone does not keep its memory
            parent, child = poses[frame, joint["parent"]], poses[frame, joint["child"]]
            move_joint(joint, functions, coordinates[frame], speeds[frame], move)
            place_child(joint, move, parent, child)
            _propagate(joint, move, speeds[frame], parent["bias"], child["bias"], velocity, screws[frame])
        for body in range(bodies):
            pose, spin = poses[frame, body], read(velocity[body])
            write(pose["angular_velocity"], spin)
            write(pose["origin_velocity"], add(read(velocity[body, 3:]), cross(spin, read(pose["origin"]))))


@compiled
def place_child(joint: Record, move: Record, parent: Record, child: Record) -> None:
    """Set the pose of the child, and in move the axes ("base") and origin ("base_place") of the joint's frame."""
    base, turned = move["base"], move["product"]
    product(parent["rotation"], joint["rotation_in_parent"], base)
    product(base, move["rotation"], turned)
    product(turned, joint["rotation_from_child"], child["rotation"])
    place = add(read(parent["origin"]), turn(parent["rotation"], read(joint["translation_in_parent"])))
    end = add(place, turn(base, read(move["place"])))
    write(child["origin"], subtract(end, turn(child["rotation"], read(joint["translation_in_child"]))))
    write(move["base_place"], place)


@compiled
def _propagate(
    joint: Record, move: Record, u: Array, carried: Array, bias: Array, velocity: Array, screws: Array
) -> None:
    """Velocity and bias of the child: those of its parent (bias: carried) and what the joint adds."""
    base, place = move["base"], read(move["base_place"])
    spin, glide = ORIGIN, ORIGIN
    for k in range(joint["count"]):
        coordinate = joint["coordinates"][k]
        w, v = screw_in_ground(base, place, move["screws"][k])
        write(screws[coordinate], w)
        write(screws[coordinate, 3:], v)
        spin, glide = along(spin, u[coordinate], w), along(glide, u[coordinate], v)
    before, after = velocity[joint["parent"]], velocity[joint["child"]]
    w, v = read(before), read(before[3:])
    write(after, add(w, spin))
    write(after[3:], add(v, glide))
    turning, pushing = screw_in_ground(base, place, move["bias"])
    write(bias, add(add(read(carried), turning), cross(w, spin)))
    write(bias[3:], add(add(read(carried[3:]), pushing), add(cross(w, glide), cross(v, spin))))


@compiled
def screw_in_ground(base: Array, place: Vector, screw: Array) -> tuple[Vector, Vector]:
    """A screw in a frame and about its origin, expressed in the axes and about the origin of the ground."""
    w, v = turn(base, read(screw)), turn(base, read(screw[3:]))
    return w, add(v, cross(place, w))

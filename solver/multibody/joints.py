"""Forward kinematics: poses and velocities of the bodies, and the columns of their Jacobians; compiled.

Velocities are screws (w, v) about the ground's origin, as in postures.py.

Of a joint: the pose of its child frame in its parent frame, a screw for each speed, and their bias. Equations:
Featherstone, Rigid Body Dynamics Algorithms (2008), ch. 4; the scapulothoracic joint: Seth, Matias, Veloso, Delp, PLoS
ONE 11(1):e0141028 (2016). Screws (w, v) are about the parent frame's origin.
"""

from __future__ import annotations

from math import cos, inf, sin

import numpy as np
from numpy.typing import NDArray

from solver.compiled import compiled, compiled_for_python
from solver.multibody.body_tables import AXES, BALL, Functions, Record, Records
from solver.vectors import ORIGIN, Vector, add, along, cross, multiply, read, scale, subtract, turn, write

Array = NDArray[np.float64]
# State of a joint: rotation and position of the child frame in the parent frame, screws of the joint's speeds,
# the bias (α, v̇) with u̇ = 0, and the parent frame itself in ground. Intermediate: of six axes value, slope, rate and
# bend (f, f′, f′ u and f″ u²), and the axes of rotation as Simbody rotates them for poses and for velocities.
MOVE = np.dtype(
    [
        ("rotation", np.float64, (3, 3)),
        ("place", np.float64, (3,)),
        ("screws", np.float64, (6, 6)),
        ("bias", np.float64, (6,)),
        ("value", np.float64, (6,)),
        ("slope", np.float64, (6,)),
        ("rate", np.float64, (6,)),
        ("bend", np.float64, (6,)),
        ("turned_axes", np.float64, (3, 3)),
        ("spin_axes", np.float64, (3, 3)),
        ("base", np.float64, (3, 3)),
        ("base_place", np.float64, (3,)),
        ("product", np.float64, (3, 3)),
    ]
)

UNIT = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


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


@compiled
def move_joint(joint: Record, functions: Functions, q: Array, u: Array, move: Record) -> None:
    """Fill move at coordinates q and speeds u of the whole model, both (coordinates,)."""
    move["screws"][:] = 0.0
    if joint["kind"] == AXES:
        _move_along_axes(joint, functions, q, u, move)
    elif joint["kind"] == BALL:
        _move_ball(joint, q, u, move)
    else:
        _move_scapulothoracic(joint, q, u, move)


@compiled
def product(a: Array, b: Array, into: Array) -> None:
    """a b of matrices (3, 3)."""
    for i in range(3):
        for j in range(3):
            into[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@compiled
def _move_along_axes(joint: Record, functions: Functions, q: Array, u: Array, move: Record) -> None:
    """Body-fixed rotations about a₁, a₂, a₃, then a translation along a₄, a₅, a₆, all axes of the parent frame."""
    value, slope, rate, bend = move["value"], move["slope"], move["rate"], move["bend"]
    for i in range(6):
        x, speed = 0.0, 0.0
        if joint["drivers"][i] >= 0:
            driver = joint["coordinates"][joint["drivers"][i]]
            x, speed = q[driver], u[driver]
        value[i], slope[i], curvature = derivatives(functions, joint["first_function"] + i, x)
        rate[i], bend[i] = slope[i] * speed, curvature * speed * speed
    _turn_about_axes(joint, move)
    place, sliding, pushing = ORIGIN, ORIGIN, ORIGIN
    for i in range(3, 6):
        axis = read(joint["axes"][i])
        place, sliding, pushing = (
            along(place, value[i], axis),
            along(sliding, rate[i], axis),
            along(pushing, bend[i], axis),
        )
    write(move["place"], place)
    screws = move["screws"]
    for i in range(6):
        if joint["drivers"][i] >= 0:
            axis = read(move["spin_axes"][i]) if i < 3 else read(joint["axes"][i])
            _add(screws[joint["drivers"][i]], 0 if i < 3 else 3, scale(slope[i], axis))
    spinning, first, others = ORIGIN, ORIGIN, ORIGIN
    for k in range(joint["count"]):
        spin = read(screws[k])
        _add(screws[k], 3, cross(place, spin))
        spin = scale(u[joint["coordinates"][k]], spin)
        spinning = add(spinning, spin)
        first = spin if k == 0 else first
        others = others if k == 2 else add(others, spin)
    change = _spin_change(move, first, others)
    write(move["bias"], change)
    # d/dt of v = p′ − w × p, the velocity of the child's point at the parent frame's origin
    write(move["bias"][3:], subtract(subtract(pushing, cross(change, place)), cross(spinning, sliding)))


@compiled
def _turn_about_axes(joint: Record, move: Record) -> None:
    """As in Simbody: for velocities the angle of an undriven axis is zero, even if its function is another constant."""
    rotation, spinning = move["rotation"], move["product"]
    _set_identity(rotation)
    _set_identity(spinning)
    for i in range(3):
        axis, angle = read(joint["axes"][i]), move["value"][i]
        write(move["turned_axes"][i], turn(rotation, axis))
        write(move["spin_axes"][i], turn(spinning, axis))
        if angle != 0.0:
            _turn_on(rotation, axis, angle)
            if joint["drivers"][i] >= 0:
                _turn_on(spinning, axis, angle)


@compiled
def _spin_change(move: Record, first: Vector, others: Vector) -> Vector:
    """Angular acceleration at u̇ = 0, as of Simbody's function-based mobilizer.

    It rotates the second axis with the spin of the first coordinate, the third with that of all but the third.
    That is exact where coordinates drive one rotation each, in order, and what OpenSim computes where they do not.
    """
    axes, rate, bend = move["turned_axes"], move["rate"], move["bend"]
    change = scale(bend[0], read(axes[0]))
    change = along(along(change, bend[1], read(axes[1])), bend[2], read(axes[2]))
    change = along(change, rate[1], cross(first, read(axes[1])))
    return along(change, rate[2], cross(others, read(axes[2])))


@compiled
def _move_ball(joint: Record, q: Array, u: Array, move: Record) -> None:
    """Body-fixed x-y-z angles with the angular velocity for speeds, and a place with its velocity, if it slides."""
    coordinates, screws = joint["coordinates"], move["screws"]
    _turn_by_angles(coordinates, q, move)
    place, velocity = ORIGIN, ORIGIN
    if joint["count"] == 6:
        place = (q[coordinates[3]], q[coordinates[4]], q[coordinates[5]])
        velocity = (u[coordinates[3]], u[coordinates[4]], u[coordinates[5]])
    for k in range(3):
        screws[k, k] = screws[3 + k, 3 + k] = 1.0
        write(screws[k, 3:], cross(place, UNIT[k]))
    spin = (u[coordinates[0]], u[coordinates[1]], u[coordinates[2]])
    write(move["place"], place)
    write(move["bias"], ORIGIN)
    write(move["bias"][3:], cross(velocity, spin))


@compiled
def _move_scapulothoracic(joint: Record, q: Array, u: Array, move: Record) -> None:
    """A frame with z along the normal n of an ellipsoid at its origin, then winging about an axis in its xy plane."""
    coordinates, screws, radii = joint["coordinates"], move["screws"], read(joint["radii"])
    spin, winging = (u[coordinates[0]], u[coordinates[1]], u[coordinates[2]]), u[coordinates[3]]
    _turn_by_angles(coordinates, q, move)
    rotation = move["rotation"]
    normal = (rotation[0, 2], rotation[1, 2], rotation[2, 2])
    contact = multiply(radii, normal)
    for k in range(3):
        screws[k, k] = 1.0
        write(screws[k, 3:], add(multiply(radii, cross(UNIT[k], normal)), cross(contact, UNIT[k])))
    gliding = cross(spin, normal)
    bias = subtract(multiply(radii, cross(spin, gliding)), cross(spin, multiply(radii, gliding)))
    rolling = subtract(multiply(radii, gliding), cross(spin, contact))

    axis = turn(rotation, read(joint["winging_axis"]))
    pivot = add(contact, turn(rotation, read(joint["pivot"])))
    moment = cross(pivot, axis)
    write(screws[3], axis)
    write(screws[3, 3:], moment)
    write(move["bias"], scale(winging, cross(spin, axis)))
    write(move["bias"][3:], along(bias, winging, add(cross(spin, moment), cross(rolling, axis))))
    _turn_on(rotation, read(joint["winging_axis"]), q[coordinates[3]])
    write(move["place"], subtract(pivot, turn(rotation, read(joint["pivot"]))))


@compiled
def _turn_by_angles(coordinates: Array, q: Array, move: Record) -> None:
    """Rotation Rx Ry Rz by the first three coordinates."""
    _set_identity(move["rotation"])
    for k in range(3):
        _turn_on(move["rotation"], UNIT[k], q[coordinates[k]])


@compiled
def _turn_on(rotation: Array, axis: Vector, angle: float) -> None:
    """rotation (I + sin θ [a]× + (1 − cos θ) [a]×²): each of its rows r becomes r − sin θ a × r − (1 − cos θ) …"""
    s, c = sin(angle), 1.0 - cos(angle)
    for i in range(3):
        row = read(rotation[i])
        across = cross(row, axis)
        write(rotation[i], along(along(row, s, across), c, cross(across, axis)))


@compiled
def _set_identity(rotation: Array) -> None:
    for k in range(3):
        write(rotation[k], UNIT[k])


@compiled
def _add(screw: Array, first: int, part: Vector) -> None:
    for i in range(3):
        screw[first + i] += part[i]


@compiled
def derivatives(functions: Functions, k: int, x: float) -> tuple[float, float, float]:
    """Value, slope and curvature of function k, as functions.Function."""
    function = functions.functions[k]
    piece = function["first_piece"]
    while x >= functions.ends[piece] and functions.ends[piece] < inf:
        piece += 1
    local, powers = x - functions.origins[piece], functions.coefficients[piece]
    value, slope, curvature = 0.0, 0.0, 0.0
    for degree in range(len(powers) - 1, -1, -1):
        curvature = curvature * local + 2.0 * slope
        slope = slope * local + value
        value = value * local + powers[degree]
    amplitude, omega = function["amplitude"], function["omega"]
    if amplitude != 0.0:
        swing = amplitude * sin(omega * x + function["phase"])
        value, curvature = swing + value, curvature - omega * omega * swing
        slope += amplitude * omega * cos(omega * x + function["phase"])
    return value, slope, curvature

"""Mass matrix, bias force, and the reaction between two parts of the body; compiled.

    M = Σ Jwᵀ I Jw + m Jcᵀ Jc      c = Σ Jwᵀ (I α + w × I w) + Jcᵀ m (a − g)

over the bodies, with the inertia I about the mass centre; Jw and Jc are what each speed turns the body and moves its
mass centre by, w its angular velocity, α and a the accelerations with u̇ = 0. All in ground.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from solver.compiled import compiled, compiled_for_python
from solver.multibody.joints import product
from solver.multibody.tables import Indices, Record, Records
from solver.vectors import Vector, add, cross, dot, read, scale, subtract, turn, write

Array = NDArray[np.float64]

# A body's mass, inertia I and mass centre in ground, the moment I α + w × I w about it and the force m (a − g).
WEIGHT = np.dtype(
    [
        ("mass", np.float64),
        ("inertia", np.float64, (3, 3)),
        ("center", np.float64, (3,)),
        ("moment", np.float64, (3,)),
        ("force", np.float64, (3,)),
        ("room", np.float64, (3, 3)),
    ]
)


@compiled_for_python
def mass_matrix_and_bias(
    bodies: Records,
    moves: Indices,
    gravity: Array,
    poses: Records,
    screws: Array,
    mass_matrix: Array,
    bias_force: Array,
    beyond: Indices,
    point: Array,
    per_acceleration: Array,
    reaction_bias: Array,
) -> None:
    """Add to M (frames, coordinates, coordinates) and c (frames, coordinates) what the bodies (BODY) contribute in
    their poses (frames, bodies) of POSE, with screws as kinematics.Postures and moves as tables.Tables have them.

    Adds to R_a (frames, 6, coordinates) and R_b (frames, 6) minus the rate of momentum of the bodies `beyond`
    (bodies,), 1 or 0, about `point` (frames, 3), as in dynamics.EquationsOfMotion.
    """
    weights, columns = np.zeros(1, WEIGHT), np.empty((screws.shape[1], 3, 3))
    for frame in range(len(poses)):
        for body in range(len(bodies)):
            weight = weights[0]  # taken anew each time: a record alone does not keep its memory
            _weigh_body(bodies[body], poses[frame, body], gravity, weight)
            _fill_columns(moves[body], screws[frame], weight, columns)
            _add_to_equations(moves[body], weight, columns, mass_matrix[frame], bias_force[frame])
            if beyond[body]:
                lever = subtract(read(weight["center"]), read(point[frame]))
                _add_to_reaction(moves[body], weight, columns, lever, per_acceleration[frame], reaction_bias[frame])


@compiled
def _weigh_body(body: Record, pose: Record, gravity: Array, weight: Record) -> None:
    rotation, room = pose["rotation"], weight["room"]
    product(rotation, body["inertia"], room)
    product(room, rotation.T, weight["inertia"])
    spin, alpha = read(pose["angular_velocity"]), read(pose["bias"])
    lever = turn(rotation, read(body["mass_center"]))
    center = add(read(pose["origin"]), lever)
    velocity = add(read(pose["origin_velocity"]), cross(spin, lever))
    acceleration = add(read(pose["bias"][3:]), add(cross(alpha, center), cross(spin, velocity)))
    inertia = weight["inertia"]
    weight["mass"] = body["mass"]
    write(weight["center"], center)
    write(weight["moment"], add(turn(inertia, alpha), cross(spin, turn(inertia, spin))))
    write(weight["force"], scale(body["mass"], subtract(acceleration, read(gravity))))


@compiled
def _fill_columns(moved: Indices, screws: Array, weight: Record, columns: Array) -> None:
    """(coordinates, 3, 3) of each speed that moves the body: its columns of Jw, I Jw and Jc."""
    for j in range(len(moved)):
        if moved[j]:
            w = read(screws[j])
            write(columns[j, 0], w)
            write(columns[j, 1], turn(weight["inertia"], w))
            write(columns[j, 2], add(read(screws[j, 3:]), cross(w, read(weight["center"]))))


@compiled
def _add_to_equations(moved: Indices, weight: Record, columns: Array, mass_matrix: Array, bias_force: Array) -> None:
    moment, force, mass = read(weight["moment"]), read(weight["force"]), weight["mass"]
    for j in range(len(moved)):
        if not moved[j]:
            continue
        turned, shifted = read(columns[j, 1]), scale(mass, read(columns[j, 2]))
        bias_force[j] += dot(read(columns[j, 0]), moment) + dot(read(columns[j, 2]), force)
        for k in range(j + 1):
            if moved[k]:
                entry = dot(read(columns[k, 0]), turned) + dot(read(columns[k, 2]), shifted)
                mass_matrix[j, k] += entry
                if k < j:
                    mass_matrix[k, j] += entry


@compiled
def _add_to_reaction(
    moved: Indices, weight: Record, columns: Array, lever: Vector, per_acceleration: Array, reaction_bias: Array
) -> None:
    for j in range(len(moved)):
        if moved[j]:
            momentum = scale(weight["mass"], read(columns[j, 2]))
            moment = add(read(columns[j, 1]), cross(lever, momentum))
            for i in range(3):
                per_acceleration[i, j] += moment[i]
                per_acceleration[3 + i, j] += momentum[i]
    force = read(weight["force"])
    moment = add(read(weight["moment"]), cross(lever, force))
    for i in range(3):
        reaction_bias[i] -= moment[i]
        reaction_bias[3 + i] -= force[i]

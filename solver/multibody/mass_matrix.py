"""Mass matrix, bias force, joint reaction, and the response of accelerations to loads; compiled.

    M = Σ Jwᵀ I Jw + m Jcᵀ Jc      c = Σ Jwᵀ (I α + w × I w) + Jcᵀ m (a − g)

over the bodies, with the inertia I about the mass centre; Jw and Jc are what each speed turns the body and moves its
mass centre by, w its angular velocity, α and a the accelerations with u̇ = 0. All in ground.

A load's wrench on a body acts on every joint between that body and the ground, so wrenches are summed from the
outermost bodies inwards, and a coordinate's force is the power of its screw with the sum of the wrenches beyond it.
With these forces f, u̇ = P f and R = wrench − R_a u̇, as in dynamics.EquationsOfMotion.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from solver.compiled import compiled, compiled_for_python
from solver.dense import LANES, inner_product, invert_part, matrix_times
from solver.multibody.body_tables import Indices, Record, Records, Tables
from solver.multibody.joints import product
from solver.vectors import Vector, add, cross, dot, read, scale, subtract, turn, write

Array = NDArray[np.float64]

# A body's mass, inertia tensor I and mass centre in ground, the moment I α + w × I w about it, the force m (a − g), and
# the product of rotation and tensor on the way to I.
INERTIA = np.dtype(
    [
        ("mass", np.float64),
        ("tensor", np.float64, (3, 3)),
        ("center", np.float64, (3,)),
        ("moment", np.float64, (3,)),
        ("force", np.float64, (3,)),
        ("product", np.float64, (3, 3)),
    ]
)


class DynamicsTerms(NamedTuple):
    """Terms of the equations of motion, with constraints G, and of the reaction that carries some of the bodies.

    mass_matrix  M (frames, coordinates, coordinates);  bias_force  c (frames, coordinates)
    inverse      M⁻¹ (frames, coordinates, coordinates), huge or not finite where M is singular
    inverse_times  M⁻¹ Gᵀ (frames, coordinates, rows);  compliance  G M⁻¹ Gᵀ (frames, rows, rows)
    reaction_per_acceleration  R_a (frames, 6, coordinates);  reaction_bias  R_b (frames, 6)
    """

    mass_matrix: Array
    bias_force: Array
    inverse: Array
    inverse_times: Array
    compliance: Array
    reaction_per_acceleration: Array
    reaction_bias: Array


@compiled_for_python
def mass_matrix_and_bias(
    tables: Tables,
    gravity: Array,
    poses: Records,
    screws: Array,
    carried: Indices,
    point: Array,
    jacobian: Array,
    terms: DynamicsTerms,
) -> None:
    """Add to the terms what the bodies contribute in their poses (frames, bodies) of POSE, with screws (frames,
    coordinates, 6) as in postures.Postures, and fill the inverses, with G (frames, rows, coordinates).

    The reaction is that on the bodies `carried` (bodies,), 1 or 0, about `point` (frames, 3): R_b − R_a u̇ is minus the
    rate of change of their momentum, as in dynamics.EquationsOfMotion.
    """
    bodies, moves = tables.bodies, tables.moves
    inertias, columns = np.empty(1, INERTIA), np.empty((screws.shape[1], 3, 3))
    size = screws.shape[1] + jacobian.shape[1]
    system = np.empty((size + 1, size + -size % LANES))  # and a row of working memory
    for frame in range(len(poses)):
        for body in range(len(bodies)):
            inertia = inertias[0]  # taken from the array in every frame: a record alone does not keep its memory
            _set_inertia(bodies[body], poses[frame, body], gravity, inertia)
            _fill_columns(moves[body], screws[frame], inertia, columns)
            _add_to_equations(moves[body], inertia, columns, terms.mass_matrix[frame], terms.bias_force[frame])
            if carried[body]:
                lever = subtract(read(inertia["center"]), read(point[frame]))
                per_acceleration, bias = terms.reaction_per_acceleration[frame], terms.reaction_bias[frame]
                _add_to_reaction(moves[body], inertia, columns, lever, per_acceleration, bias)
        _invert(jacobian[frame], system, terms, frame)


@compiled
def _set_inertia(body: Record, pose: Record, gravity: Array, inertia: Record) -> None:
    rotation, tensor = pose["rotation"], inertia["tensor"]
    product(rotation, body["inertia"], inertia["product"])
    product(inertia["product"], rotation.T, tensor)
    spin, alpha = read(pose["angular_velocity"]), read(pose["bias"])
    lever = turn(rotation, read(body["mass_center"]))
    center = add(read(pose["origin"]), lever)
    velocity = add(read(pose["origin_velocity"]), cross(spin, lever))
    acceleration = add(read(pose["bias"][3:]), add(cross(alpha, center), cross(spin, velocity)))
    inertia["mass"] = body["mass"]
    write(inertia["center"], center)
    write(inertia["moment"], add(turn(tensor, alpha), cross(spin, turn(tensor, spin))))
    write(inertia["force"], scale(body["mass"], subtract(acceleration, read(gravity))))


@compiled
def _fill_columns(moved: Indices, screws: Array, inertia: Record, columns: Array) -> None:
    """(coordinates, 3, 3) of each speed that moves the body: its columns of Jw, I Jw and Jc."""
    for j in range(len(moved)):
        if moved[j]:
            w = read(screws[j])
            write(columns[j, 0], w)
            write(columns[j, 1], turn(inertia["tensor"], w))
            write(columns[j, 2], add(read(screws[j, 3:]), cross(w, read(inertia["center"]))))


@compiled
def _add_to_equations(moved: Indices, inertia: Record, columns: Array, mass_matrix: Array, bias_force: Array) -> None:
    moment, force, mass = read(inertia["moment"]), read(inertia["force"]), inertia["mass"]
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
    moved: Indices, inertia: Record, columns: Array, lever: Vector, per_acceleration: Array, reaction_bias: Array
) -> None:
    for j in range(len(moved)):
        if moved[j]:
            momentum = scale(inertia["mass"], read(columns[j, 2]))
            moment = add(read(columns[j, 1]), cross(lever, momentum))
            for i in range(3):
                per_acceleration[i, j] += moment[i]
                per_acceleration[3 + i, j] += momentum[i]
    force = read(inertia["force"])
    moment = add(read(inertia["moment"]), cross(lever, force))
    for i in range(3):
        reaction_bias[i] -= moment[i]
        reaction_bias[3 + i] -= force[i]


@compiled
def _invert(jacobian: Array, system: Array, terms: DynamicsTerms, frame: int) -> None:
    """The inverses of a frame, from its mass matrix M: part by part of ( M  Gᵀ ; G  0 )."""
    mass_matrix, rows = terms.mass_matrix[frame], len(jacobian)
    count = len(mass_matrix)
    system[:] = 0.0
    for i in range(count):
        for j in range(count):
            system[i, j] = mass_matrix[i, j]
        for j in range(rows):
            system[i, count + j] = system[count + j, i] = jacobian[j, i]
    invert_part(system[:-1], count, system[-1])
    for i in range(count):
        for j in range(count):
            terms.inverse[frame, i, j] = system[i, j]
        for j in range(rows):
            terms.inverse_times[frame, i, j] = system[i, count + j]
    for i in range(rows):
        for j in range(rows):
            terms.compliance[frame, i, j] = -system[count + i, count + j]


class Mobility(NamedTuple):
    """State on which the response depends besides the loads, as in dynamics.EquationsOfMotion: screws (frames,
    coordinates, 6), mobility P, reaction_per_acceleration R_a, and the reaction's body and point (frames, 3).
    """

    joints: Records
    screws: Array
    mobility: Array
    per_acceleration: Array
    body: int
    point: Array


class Loads(NamedTuple):
    """Loads, whose responses are multiplied by factors (frames, loads), and added up with shares (frames, loads).

    wrenches  (frames, wrenches, 6), load and body (wrenches,), and the number of bodies, as in LoadWrenches
    forces    (frames, loads, coordinates), or no frames without such forces
    driven    (actuators,) coordinates on which further loads of this strength (actuators,) act
    """

    wrenches: Array
    load: Indices
    body: Indices
    bodies: int
    forces: Array
    factors: Array
    shares: Array
    driven: Indices
    strength: Array


class Responses(NamedTuple):
    """acceleration (frames, coordinates, loads and actuators), reaction (frames, 6, loads and actuators), and those of
    the sum of the loads, total_acceleration (frames, coordinates) and total_reaction (frames, 6).
    """

    acceleration: Array
    reaction: Array
    total_acceleration: Array
    total_reaction: Array


@compiled_for_python
def fill_responses(mobility: Mobility, loads: Loads, responses: Responses) -> None:
    """Fill the responses in all frames."""
    count, coordinates = loads.factors.shape[1], mobility.screws.shape[1]
    beyond, forces, total = np.empty((loads.bodies, 6, count)), np.empty((coordinates, count)), np.empty(coordinates)
    for frame in range(len(loads.wrenches)):
        _place(loads, frame, beyond)
        _sum_inwards(mobility.joints, mobility.screws[frame], beyond, forces)
        if len(loads.forces):
            for load in range(count):
                for i in range(coordinates):
                    forces[i, load] += loads.forces[frame, load, i]
        direct = beyond[mobility.body]
        _refer_to(mobility.point[frame], direct)
        _respond(mobility, loads, frame, forces, total, direct, responses)


@compiled
def _place(loads: Loads, frame: int, beyond: Array) -> None:
    """Fill (bodies, 6, loads) with the wrenches on each body."""
    beyond[:] = 0.0
    wrenches = loads.wrenches[frame]
    for k in range(len(wrenches)):
        body, load = loads.body[k], loads.load[k]
        for i in range(6):
            beyond[body, i, load] = wrenches[k, i]


@compiled
def _sum_inwards(joints: Records, screws: Array, beyond: Array, forces: Array) -> None:
    """Fill forces; beyond (bodies, 6, loads) becomes the sum of the wrenches on a body and all bodies beyond it."""
    forces[:] = 0.0
    for k in range(len(joints) - 1, -1, -1):
        joint = joints[k]
        parent, child = beyond[joint["parent"]], beyond[joint["child"]]
        for j in range(joint["count"]):
            coordinate = joint["coordinates"][j]
            _add_row_times(screws[coordinate], child, forces[coordinate])
        for i in range(6):
            for load in range(parent.shape[1]):
                parent[i, load] += child[i, load]


@compiled
def _add_row_times(screw: Array, wrenches: Array, forces: Array) -> None:
    a, b, c, d, e, f = screw[0], screw[1], screw[2], screw[3], screw[4], screw[5]
    for load in range(len(forces)):
        turning = a * wrenches[0, load] + b * wrenches[1, load] + c * wrenches[2, load]
        forces[load] += turning + (d * wrenches[3, load] + e * wrenches[4, load] + f * wrenches[5, load])


@compiled
def _refer_to(point: Array, wrenches: Array) -> None:
    """Moments about the point in place of those about the origin."""
    x, y, z = point[0], point[1], point[2]
    for load in range(wrenches.shape[1]):
        wrenches[0, load] -= y * wrenches[5, load] - z * wrenches[4, load]
        wrenches[1, load] -= z * wrenches[3, load] - x * wrenches[5, load]
        wrenches[2, load] -= x * wrenches[4, load] - y * wrenches[3, load]


@compiled
def _respond(
    mobility: Mobility, loads: Loads, frame: int, forces: Array, total: Array, direct: Array, responses: Responses
) -> None:
    P, R_a = mobility.mobility[frame], mobility.per_acceleration[frame]
    acceleration, reaction = responses.acceleration[frame], responses.reaction[frame]
    total_acceleration, factors, shares = responses.total_acceleration[frame], loads.factors[frame], loads.shares[frame]
    for i in range(len(P)):
        total[i] = inner_product(forces[i], shares)
        _multiply(forces[i], factors)
    for i in range(len(P)):
        total_acceleration[i] = inner_product(P[i], total)
    matrix_times(P, forces, acceleration)
    for i in range(len(P)):
        for k in range(len(loads.driven)):
            acceleration[i, len(factors) + k] = P[i, loads.driven[k]] * loads.strength[k]
    matrix_times(R_a, acceleration, reaction)
    for i in range(6):
        responses.total_reaction[frame, i] = inner_product(direct[i], shares) - inner_product(
            R_a[i], total_acceleration
        )
        row, own = reaction[i], direct[i]
        for j in range(len(row)):
            row[j] = -row[j]
        for j in range(len(factors)):
            row[j] += own[j] * factors[j]


@compiled
def _multiply(row: Array, factors: Array) -> None:
    for j in range(len(row)):
        row[j] *= factors[j]

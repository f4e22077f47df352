"""Cost, gradient and Hessian of the least squares of markers, and rows of the constraints; one frame, compiled.

    f(q) = ½ Σ w_m |p_m(q) − x_m|² + ½ Σ w_k (q_k − v_k − s_k q_l)²,   g(q) = 0,   L = f + λ·g

with w_m divided by the sum over the markers that are visible. Σ w JᵀJ is the mass matrix of point masses w at the
markers, so it comes from composite bodies (Featherstone 2008, ch. 6.2); what it lacks of the Hessian of L is

    Σ_m f_m · ∂²p_m/∂q_k∂q_l,   f = w r at the markers, ± λ at the two points of a constraint,

which needs no more of the bodies beyond a joint than F = Σ f and N = Σ f pᵀ.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from solver.compiled import compiled, compiled_for_python
from solver.constraint import WeldConstraint
from solver.errors import SolverCode
from solver.inverse_kinematics.pose import PoseWorkspace, Skeleton, differentiate_screws, evaluate_pose, point_in_ground
from solver.model import Constraint, CoordinateCoupler, CoordinateLock, Model, ModelError, PointConstraint
from solver.multibody.body_tables import Functions, Indices, pack_functions
from solver.multibody.joints import derivatives
from solver.vectors import Vector, add, cross, dot, read, scale, subtract, turn_back, write

Array = NDArray[np.float64]

WELDED_APART = 0.1  # m; from the origin of a welded frame to the points on its axes, so that an angle counts as a gap


class TrackedMarkers(NamedTuple):
    """Body, location (3,) [m] in it, and weight of every marker."""

    body: Indices
    location: Array
    weight: Array


class CoordinatePull(NamedTuple):
    """weight (coordinates,) w_k [m²/rad²];  slope (coordinates,) s_k, 0 for a target of its own, and for leader, l."""

    weight: Array
    slope: Array
    leader: int


class Targets(NamedTuple):
    """Targets of the postures of a frame.

    seen   (markers, 3) x;  share (markers,) w_m over their sum, 0 for a marker that is hidden
    value  (coordinates,) v_k;  pull of the coordinates to it
    """

    seen: Array
    share: Array
    value: Array
    pull: CoordinatePull


class ConstraintTable(NamedTuple):
    """Point constraints, three rows each, then couplers, a row each: q_dependent = Σ function(q_independent) over the
    terms from first_term of the coupler to that of the next.
    """

    body: Indices
    location: Array
    dependent: Indices
    first_term: Indices
    independent: Indices
    functions: Functions


class LeastSquares(NamedTuple):
    """Results of `linearise`.

    points       (markers, 3) in ground [m]
    hessian      (coordinates, coordinates): Gauss–Newton's part, Σ w JᵀJ + Σ w_k c cᵀ, c = ∂(q_k − s_k q_l)/∂q
    gradient     (coordinates,) of f
    gap          (rows,) g(q);  rows (rows, coordinates) its derivatives
    mass, first, second   (bodies,) Σ w, (bodies, 3) Σ w p, (bodies, 3, 3) Σ w p pᵀ over the markers of each body
    force, turned         (bodies, 3) F and (bodies, 3, 3) N
    """

    points: Array
    hessian: Array
    gradient: Array
    gap: Array
    rows: Array
    mass: Array
    first: Array
    second: Array
    force: Array
    turned: Array


class LinearisedFrames(NamedTuple):
    """Least squares and constraints about given postures.

    hessian   (frames, coordinates, coordinates) Σ w JᵀJ + diag(w_k), with multipliers also the curvature of L
    gradient  (frames, coordinates) Σ w Jᵀ (p − x);  points (frames, markers, 3) p in ground [m]
    gap       (frames, rows) of the constraints;  rows (frames, rows, coordinates) its derivatives
    """

    hessian: Array
    gradient: Array
    points: Array
    gap: Array
    rows: Array


def build_constraints(model: Model) -> ConstraintTable:
    """Locks are no rows: their coordinates are given. A weld is three points of two frames, whose rows are redundant.

    Raises ModelError for a constraint without a row here.
    """
    supported = PointConstraint | WeldConstraint | CoordinateCoupler | CoordinateLock
    others = [constraint.name for constraint in model.constraints if not isinstance(constraint, supported)]
    if others:
        raise ModelError(
            f"{model.name} has the constraints {', '.join(others)}, which inverse kinematics does not support; remove "
            "them, or replace them by points, welds, couplers and locked coordinates",
            SolverCode.UNSUPPORTED,
        )
    points = [point for constraint in model.constraints for point in _points_held(constraint)]
    couplers = [coupler for coupler in model.constraints if isinstance(coupler, CoordinateCoupler)]
    return ConstraintTable(
        np.array([[constraint.body_1, constraint.body_2] for constraint in points], dtype=np.int64).reshape(-1, 2),
        np.array([[constraint.location_1, constraint.location_2] for constraint in points]).reshape(-1, 2, 3),
        np.array([coupler.dependent for coupler in couplers], dtype=np.int64),
        np.cumsum([0, *(len(coupler.functions) for coupler in couplers)], dtype=np.int64),
        np.array([k for coupler in couplers for k in coupler.independents], dtype=np.int64),
        pack_functions([function for coupler in couplers for function in coupler.functions]),
    )


def allocate_least_squares(model: Model, markers: int, constraints: ConstraintTable) -> LeastSquares:
    count, bodies = len(model.coordinates), len(model.bodies)
    rows = 3 * len(constraints.body) + len(constraints.dependent)
    return LeastSquares(
        np.zeros((markers, 3)),
        np.zeros((count, count)),
        np.zeros(count),
        np.zeros(rows),
        np.zeros((rows, count)),
        np.zeros(bodies),
        np.zeros((bodies, 3)),
        np.zeros((bodies, 3, 3)),
        np.zeros((bodies, 3)),
        np.zeros((bodies, 3, 3)),
    )


def _points_held(constraint: Constraint) -> list[PointConstraint]:
    if isinstance(constraint, PointConstraint):
        return [constraint]
    if not isinstance(constraint, WeldConstraint):
        return []
    one, two = constraint.body_1, constraint.body_2
    first, second = (
        location + WELDED_APART * rotation.T
        for location, rotation in (
            (constraint.location_1, constraint.rotation_1),
            (constraint.location_2, constraint.rotation_2),
        )
    )
    return [PointConstraint(constraint.name, one, two, *ends) for ends in zip(first, second, strict=True)]


@compiled_for_python
def fill_linearised(
    tables: tuple[Skeleton, TrackedMarkers, ConstraintTable],
    weighted: tuple[Array, Array, CoordinatePull],
    multipliers: Array,
    coordinates: Array,
    work: PoseWorkspace,
    system: LeastSquares,
    filled: LinearisedFrames,
) -> None:
    """Fill every frame of coordinates (frames, coordinates) that does not begin with NaN.

    weighted: x (frames, markers, 3), w (frames, markers) and the pull; multipliers λ (frames, rows), or of no
    frame, without the curvature of L.
    """
    (skeleton, markers, constraints), (observed, weights, pull) = tables, weighted
    for frame in range(len(coordinates)):
        q = coordinates[frame]
        if not np.isfinite(q[0]):
            continue
        evaluate_pose(skeleton, q, work)
        linearise(skeleton, markers, Targets(observed[frame], weights[frame], q, pull), q, work, system)
        evaluate_gap(constraints, q, work, system.gap)
        fill_constraint_rows(skeleton, constraints, q, work, system)
        filled.gradient[frame] = system.gradient
        if len(multipliers):
            differentiate_screws(skeleton, q, work)
            add_curvature(skeleton, constraints, multipliers[frame], q, work, system)
        filled.hessian[frame] = system.hessian
        filled.points[frame] = system.points
        filled.gap[frame] = system.gap
        filled.rows[frame] = system.rows


@compiled
def evaluate_cost(markers: TrackedMarkers, targets: Targets, q: Array, work: PoseWorkspace) -> float:
    """f at the pose of `work`."""
    seen, share, _, pull = targets
    cost = 0.0
    for m in range(len(share)):
        if share[m] > 0.0:
            point = point_in_ground(work.poses[markers.body[m]], markers.location[m])
            left = subtract(point, read(seen[m]))
            cost += share[m] * dot(left, left)
    for k in range(len(q)):
        cost += pull.weight[k] * _away(targets, q, k) ** 2
    return 0.5 * cost


@compiled
def evaluate_gap(constraints: ConstraintTable, q: Array, work: PoseWorkspace, gap: Array) -> float:
    """Fill gap (rows,) and return Σ |g|."""
    row, total = 0, 0.0
    for c in range(len(constraints.body)):
        one = point_in_ground(work.poses[constraints.body[c, 0]], constraints.location[c, 0])
        two = point_in_ground(work.poses[constraints.body[c, 1]], constraints.location[c, 1])
        write(gap[row:], subtract(one, two))
        row += 3
    for c in range(len(constraints.dependent)):
        gap[row] = q[constraints.dependent[c]]
        for term in range(constraints.first_term[c], constraints.first_term[c + 1]):
            wanted, _, _ = derivatives(constraints.functions, term, q[constraints.independent[term]])
            gap[row] -= wanted
        row += 1
    for i in range(row):
        total += abs(gap[i])
    return total


@compiled
def linearise(
    skeleton: Skeleton, markers: TrackedMarkers, targets: Targets, q: Array, work: PoseWorkspace, system: LeastSquares
) -> None:
    """Fill points, hessian and gradient, and force and turned with f = w r, at the pose of `work`."""
    seen, share, _, pull = targets
    _clear(system)
    for m in range(len(share)):
        body = markers.body[m]
        point = point_in_ground(work.poses[body], markers.location[m])
        write(system.points[m], point)
        if share[m] > 0.0:
            _add_mass(system, body, share[m], point)
            add_force(system, body, scale(share[m], subtract(point, read(seen[m]))), point)
    add_to_parents(skeleton, system)
    for k in range(len(q)):
        joint = skeleton.joint_indices[k]
        if joint < 0:
            continue
        body = skeleton.joints[joint]["child"]
        w, v = read(work.screws[k]), read(work.screws[k, 3:])
        moment = _moment(system.turned[body])
        system.gradient[k] = dot(w, moment) + dot(v, read(system.force[body]))
        linear, angular = _momentum(system, body, w, v)
        for j in range(len(q)):
            if skeleton.moves[body, j]:
                entry = dot(read(work.screws[j]), angular) + dot(read(work.screws[j, 3:]), linear)
                system.hessian[j, k] = system.hessian[k, j] = entry
    for k in range(len(q)):
        away = pull.weight[k] * _away(targets, q, k)
        system.gradient[k] += away
        system.hessian[k, k] += pull.weight[k]
        if pull.slope[k] != 0.0:
            leader, along = pull.leader, pull.weight[k] * pull.slope[k]
            system.gradient[leader] -= pull.slope[k] * away
            system.hessian[k, leader] -= along
            system.hessian[leader, k] -= along
            system.hessian[leader, leader] += pull.slope[k] * along


@compiled
def _away(targets: Targets, q: Array, k: int) -> float:
    """q_k − v_k − s_k q_l."""
    away: float = q[k] - targets.value[k] - targets.pull.slope[k] * q[targets.pull.leader]
    return away


@compiled
def fill_constraint_rows(
    skeleton: Skeleton, constraints: ConstraintTable, q: Array, work: PoseWorkspace, system: LeastSquares
) -> None:
    """Fill rows: each body is taken at its own point, for the gap may still be open."""
    row = 0
    for c in range(len(constraints.body)):
        for k in range(len(q)):
            column = (0.0, 0.0, 0.0)
            w, v = read(work.screws[k]), read(work.screws[k, 3:])
            for side in range(2):
                body = constraints.body[c, side]
                if skeleton.moves[body, k]:
                    point = point_in_ground(work.poses[body], constraints.location[c, side])
                    moved = add(v, cross(w, point))
                    column = add(column, moved) if side == 0 else subtract(column, moved)
            for a in range(3):
                system.rows[row + a, k] = column[a]
        row += 3
    for c in range(len(constraints.dependent)):
        for k in range(len(q)):
            system.rows[row, k] = 0.0
        system.rows[row, constraints.dependent[c]] = 1.0
        for term in range(constraints.first_term[c], constraints.first_term[c + 1]):
            independent = constraints.independent[term]
            _, slope, _ = derivatives(constraints.functions, term, q[independent])
            system.rows[row, independent] -= slope
        row += 1


@compiled
def add_curvature(
    skeleton: Skeleton,
    constraints: ConstraintTable,
    multipliers: Array,
    q: Array,
    work: PoseWorkspace,
    system: LeastSquares,
) -> None:
    """Add to the Hessian what makes it that of L; after linearise and differentiate_screws at the same pose."""
    row = 0
    for c in range(len(constraints.body)):
        pushed = read(multipliers[row:])
        for side in range(2):
            body = constraints.body[c, side]
            point = point_in_ground(work.poses[body], constraints.location[c, side])
            _push(skeleton, system, body, pushed if side == 0 else scale(-1.0, pushed), point)
        row += 3
    for c in range(len(constraints.dependent)):
        for term in range(constraints.first_term[c], constraints.first_term[c + 1]):
            independent = constraints.independent[term]
            _, _, curvature = derivatives(constraints.functions, term, q[independent])
            system.hessian[independent, independent] -= multipliers[row] * curvature
        row += 1
    for k in range(len(q)):
        joint = skeleton.joint_indices[k]
        if joint < 0:
            continue
        body = skeleton.joints[joint]["child"]
        force, moment = read(system.force[body]), _moment(system.turned[body])
        carried = _carried(system.turned[body], force, read(work.screws[k]), read(work.screws[k, 3:]))
        for j in range(len(q)):
            if not skeleton.moves[body, j]:
                continue
            entry = dot(read(work.screws[j]), carried)
            if skeleton.joint_indices[j] == joint:  # both orders of a pair come by, and each adds its half
                change = work.changes[k, skeleton.axis_indices[j]]
                entry = 0.5 * (entry + dot(read(change), moment) + dot(read(change[3:]), force))
            system.hessian[j, k] += entry
            system.hessian[k, j] += entry


@compiled
def _carried(turned: Array, force: Vector, w: Vector, v: Vector) -> Vector:
    """t in Σ f·(w′ × (v + w × p)) = w′·t: how a screw (w, v) changes when a rotation w′ nearer to the ground carries it
    along.
    """
    trace = turned[0, 0] + turned[1, 1] + turned[2, 2]
    return subtract(add(cross(v, force), turn_back(turned, w)), scale(trace, w))


@compiled
def add_to_parents(skeleton: Skeleton, system: LeastSquares) -> None:
    """Add the quantity of a body to that of its parent, from the outermost bodies inwards."""
    for j in range(len(skeleton.joints) - 1, -1, -1):
        child, parent = skeleton.joints[j]["child"], skeleton.joints[j]["parent"]
        system.mass[parent] += system.mass[child]
        for a in range(3):
            system.first[parent, a] += system.first[child, a]
            system.force[parent, a] += system.force[child, a]
            for b in range(3):
                system.second[parent, a, b] += system.second[child, a, b]
                system.turned[parent, a, b] += system.turned[child, a, b]


@compiled
def _push(skeleton: Skeleton, system: LeastSquares, body: int, force: Vector, point: Vector) -> None:
    """A force on a body, after gather: on all that carry it too."""
    add_force(system, body, force, point)
    for j in range(len(skeleton.joints) - 1, -1, -1):
        if skeleton.joints[j]["child"] == body:
            body = skeleton.joints[j]["parent"]
            add_force(system, body, force, point)


@compiled
def add_force(system: LeastSquares, body: int, force: Vector, point: Vector) -> None:
    for a in range(3):
        system.force[body, a] += force[a]
        for b in range(3):
            system.turned[body, a, b] += force[a] * point[b]


@compiled
def _add_mass(system: LeastSquares, body: int, mass: float, point: Vector) -> None:
    system.mass[body] += mass
    for a in range(3):
        system.first[body, a] += mass * point[a]
        for b in range(3):
            system.second[body, a, b] += mass * point[a] * point[b]


@compiled
def _momentum(system: LeastSquares, body: int, w: Vector, v: Vector) -> tuple[Vector, Vector]:
    """Linear and angular momentum about the ground origin of the masses beyond a joint that move by a screw (w, v)."""
    first, second = read(system.first[body]), system.second[body]
    linear = add(scale(system.mass[body], v), cross(w, first))
    trace = second[0, 0] + second[1, 1] + second[2, 2]
    turned = (
        second[0, 0] * w[0] + second[0, 1] * w[1] + second[0, 2] * w[2],
        second[1, 0] * w[0] + second[1, 1] * w[1] + second[1, 2] * w[2],
        second[2, 0] * w[0] + second[2, 1] * w[1] + second[2, 2] * w[2],
    )
    return linear, add(cross(first, v), subtract(scale(trace, w), turned))


@compiled
def _moment(turned: Array) -> Vector:
    """Σ p × f out of N = Σ f pᵀ."""
    return (turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0], turned[1, 0] - turned[0, 1])


@compiled
def _clear(system: LeastSquares) -> None:
    system.hessian[:] = 0.0
    system.gradient[:] = 0.0
    system.mass[:] = 0.0
    system.first[:] = 0.0
    system.second[:] = 0.0
    system.force[:] = 0.0
    system.turned[:] = 0.0

"""Variants of body, posture and contact with which the joint force of a lift is predicted, and their errors.

A lift is three repeats. Postures are our own inverse kinematics of the whole trial, since the published motion ends
with the first repeat. Errors are RMSE of the force's size to the measured one, in percent of body weight.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from recordings.exchange.joint_force import read_joint_force
from recordings.exchange.trc import read_trc
from solver.inverse_kinematics.solve import TrackingTasks, solve_inverse_kinematics
from solver.model import CoordinateLock, Model, Muscle
from solver.motion import Kinematics, Motion, differentiate, read_motion
from solver.multibody.dynamics import EquationsOfMotion, equations_of_motion
from solver.multibody.postures import Postures, postures
from solver.muscle import muscle_forces
from solver.osim.ik_setup import read_ik_setup
from solver.osim.reader import read_osim
from solver.paths import PathState, evaluate_paths
from solver.personalisation.anthropometry import ARM_SEGMENTS
from solver.personalisation.tendons import fit_tendons
from solver.redundancy.force_agreement import force_agreement, glenoid_axes
from solver.redundancy.glenoid import JOINT, GlenoidCone, cone_rows, glenoid_cone
from solver.redundancy.mechanics import Mechanics
from solver.redundancy.problem import RedundancyProblem, build_redundancy
from solver.redundancy.response_maps import response_maps
from solver.redundancy.scenarios import solve_redundancy
from station.validation.variants import CUTOFF_HZ, GIRDLE_AND_SHOULDER, published_options

Array = NDArray[np.float64]
T = TypeVar("T")

GRAVITY = 9.80665
HELD_MASS = 2.4
GIRDLE = (
    "clav_prot",
    "clav_elev",
    "scapula_abduction",
    "scapula_elevation",
    "scapula_upward_rot",
    "scapula_winging",
)
ROTATION, PLANE, FOREARM = "scapula_upward_rot", "plane_elv", ("elbow_flexion", "pro_sup")
ANGLE_OF_SCAPULA, BESIDE = "AI", "AA"
TO_FINGERS = np.array([0.0, -1.0, 0.0])
"""Direction in the model's hand."""
STIFF = 1.0  # m²/rad²: the coordinate takes the value of its task
CONTACT_SCALE = 1e-3  # 1/N


@dataclass(frozen=True)
class ContactVariant:
    """One set of assumptions; the defaults are those of the published circle.

    rim            (along, across) tangents of the glenoid's rim; None for no cone
    tilt           (up, forward) of the cone's axis [deg]
    weighting      of muscles: equal, or by strength or volume (maximum isometric force, or its product with the optimal
                   fibre length, over the mean)
    exponent       of the activations in the effort
    reserve        weight of the actuators of girdle and shoulder
    arm_masses     published, or own: those of the patient's body mass (de Leva 1996)
    held           mass in the hand beside that of the model [kg]
    grip           distance by which the load is nearer to the fingers than the hand's mass centre in the model [m]
    passive        factor on the passive force of all muscles
    fibres         least and greatest normalised fibre length in the person's lift, kept by tendon slack lengths
    is_plane_free  plane_elv is not locked
    is_forearm_free  elbow_flexion and pro_sup are not locked
    is_angle_tracked the inferior angle of the scapula (AI) is tracked with the weight of its other markers
    girdle         weight of coordinate tasks that hold the girdle near its default posture [m²/rad²]
    rotation       added to the upward rotation of the scapula [deg]
    subscapularis  factor on its strength, as after its release in surgery
    shear, force   weights of the squared shear or contact force of the glenoid [1/kN²]
    """

    rim: tuple[float, float] | None = (0.5, 0.5)
    tilt: tuple[float, float] = (0.0, 0.0)
    weighting: Literal["equal", "strength", "volume"] = "equal"
    exponent: Literal[2, 3] = 2
    reserve: float = 10.0
    arm_masses: Literal["published", "own"] = "published"
    held: float = 0.0
    grip: float = 0.0
    passive: float = 1.0
    fibres: tuple[float, float] | None = None
    is_plane_free: bool = False
    is_forearm_free: bool = False
    is_angle_tracked: bool = False
    girdle: float = 0.0
    rotation: float = 0.0
    subscapularis: float = 1.0
    shear: float = 0.0
    force: float = 0.0


class PosedBody(NamedTuple):
    """The assumptions of ContactVariant that decide the posture."""

    is_plane_free: bool
    is_forearm_free: bool
    is_angle_tracked: bool
    girdle: float
    rotation: float


class Lift:
    """Files of a lift, and what variants have in common: postures, muscle paths, equations of motion."""

    def __init__(self, data: Path, name: str) -> None:
        self.name = name
        self.model = read_osim(data / f"{name}_as_solved.osim")
        setup = read_ik_setup(data / f"{name}_ik_setup.xml")
        table = read_trc(data / f"{name}.trc", tracked=setup.markers)
        self.tasks = setup.tasks(self.model, table.labels, table.time_s)
        angle = self.model.marker(ANGLE_OF_SCAPULA)
        beside = next(k for k, marker in enumerate(self.tasks.markers) if marker.name == BESIDE)
        self.tasks_with_angle = replace(
            self.tasks,
            markers=(*self.tasks.markers, angle),
            weights=np.append(self.tasks.weights, self.tasks.weights[beside]),
        )
        labels = [marker.name for marker in self.tasks_with_angle.markers]
        self.observed = 1e-3 * table.positions[:, [table.labels.index(label) for label in labels]]
        self.time = table.time_s - table.time_s[0]
        weight = read_joint_force(data / f"{name}_measured_force.txt").body_weight
        if weight is None:
            raise SystemExit(f"{name}_measured_force.txt has no BodyWeight [N]; add the line")
        self.body_weight = weight
        record = read_joint_force(data / f"{name}_measured_force_glenoid.txt")
        self.measured = record.at(self.time)[1]
        self.repeats = self._repeats(float(read_motion(data / f"{name}.mot", self.model).time[-1]))
        self._cache: dict[Hashable, object] = {}

    def errors(self, variant: ContactVariant) -> Array:
        """RMSE of each repeat (3,) [% of body weight]."""
        return self.errors_of(self.predicted(variant))

    def errors_of(self, force: Array) -> Array:
        """RMSE of a force (frames,) [N] in each repeat (3,) [% of body weight]."""
        errors = [force_agreement(force[part], self.measured[part]).rmse for part in self.repeats]
        return 100.0 * np.array(errors) / self.body_weight

    def predicted(self, variant: ContactVariant) -> Array:
        """Size of the force (frames,) [N], NaN where a frame has no solution."""
        model, mechanics = self._mechanics(variant)
        options = replace(published_options(model), has_glenoid_cone=False, exponent=variant.exponent)
        weights = {name: variant.reserve for name in options.weights if name in GIRDLE_AND_SHOULDER}
        if variant.weighting != "equal":
            sizes = np.array([_size(muscle, variant.weighting) for muscle in model.muscles])
            weights |= dict(zip(model.muscle_names, (sizes / sizes.mean()).tolist(), strict=True))
        problem = build_redundancy(model, mechanics, replace(options, weights=weights))
        cone = tilted(glenoid_cone(model), *variant.tilt)
        rotation = mechanics.state.rotation_to_ground[:, cone.body]
        if variant.rim is not None:
            along, across = variant.rim
            rim = replace(cone, half_angle=float(np.arctan(along)), aspect=across / along)
            problem = replace(problem, cone=cone_rows(rim, rotation))
        if variant.shear:
            in_plane = np.vstack([cone.edge, np.cross(cone.axis, cone.edge)])
            problem = with_penalty(problem, in_plane @ rotation.swapaxes(1, 2), variant.shear)
        if variant.force:
            problem = with_penalty(problem, np.tile(np.eye(3), (len(rotation), 1, 1)), variant.force)
        solution = solve_redundancy(problem, workers=1)
        is_lost = np.isnan(solution.controls[0]).any(axis=1)
        return np.where(is_lost, np.nan, np.linalg.norm(solution.reaction[0, :, 3:], axis=1))

    def posed_motion(self, posture: PosedBody) -> Motion:
        """Inverse kinematics of the whole trial, with these assumptions of ContactVariant."""
        model = self._base(posture)
        tasks = self.tasks_with_angle if posture.is_angle_tracked else self.tasks
        observed = self.observed[:, : len(tasks.markers)]
        held = {name: max(tasks.coordinate_weights.get(name, 0.0), posture.girdle) for name in GIRDLE if posture.girdle}
        tasks = replace(tasks, coordinate_weights={**tasks.coordinate_weights, **held})
        coordinates = solve_inverse_kinematics(model, observed, tasks).coordinates
        if posture.rotation:
            target = coordinates[:, model.coordinate_index(ROTATION)] + np.radians(posture.rotation)
            coordinates = solve_inverse_kinematics(model, observed, _turned(tasks, target)).coordinates
        return Motion(model.coordinate_names, self.time, coordinates)

    def _base(self, posture: PosedBody) -> Model:
        """The model as solved; without a lock, muscles have to produce the moment that it carried."""
        freed = (PLANE,) * posture.is_plane_free + FOREARM * posture.is_forearm_free
        kept = (c for c in self.model.constraints if not (isinstance(c, CoordinateLock) and c.name in freed))
        return replace(self.model, constraints=tuple(kept))

    def _repeats(self, first_end: float) -> list[slice]:
        """The first ends with the published motion; the others part where the measured force is least between them."""
        first = int(np.searchsorted(self.time, first_end))
        rest = len(self.time) - first
        middle = slice(first + int(0.3 * rest), first + int(0.7 * rest))
        split = middle.start + int(np.nanargmin(self.measured[middle]))
        return [slice(0, first), slice(first, split), slice(split, len(self.time))]

    def _mechanics(self, variant: ContactVariant) -> tuple[Model, Mechanics]:
        posture = PosedBody(*(getattr(variant, name) for name in PosedBody._fields))
        motion = self._cached(("motion", posture), lambda: self.posed_motion(posture))
        base = self._base(posture)
        kinematics, state, paths = self._cached(("paths", posture), lambda: _evaluated(base, motion))
        body = (variant.arm_masses, variant.held, variant.grip, variant.fibres, variant.subscapularis)

        def bodied() -> tuple[Model, EquationsOfMotion]:
            model = with_masses(base, variant, self.body_weight / GRAVITY)
            if variant.fibres is not None:
                model, _ = fit_tendons(model, [motion.coordinates], variant.fibres)
            model = replace(model, muscles=tuple(_weakened(muscle, variant) for muscle in model.muscles))
            return model, equations_of_motion(model, state, JOINT)

        model, equations = self._cached(("body", posture, body), bodied)

        def mechanics() -> Mechanics:
            forces = muscle_forces(model, paths.lengths, paths.speeds)
            forces = replace(forces, passive=variant.passive * forces.passive)
            return Mechanics(
                kinematics, state, paths, forces, equations, response_maps(model, state, equations, paths, forces)
            )

        return model, self._cached(("maps", posture, body, variant.passive), mechanics)

    def _cached(self, key: tuple[str, *tuple[Hashable, ...]], make: Callable[[], T]) -> T:
        """All postures and paths are kept; of bodies the last, so that variants are best tried in their order."""
        place: Hashable = key if key[0] in ("motion", "paths") else key[0]
        kept: tuple[Hashable, T] | None = self._cache.get(place)  # type: ignore[assignment]
        if kept is None or kept[0] != key:
            kept = key, make()
            self._cache[place] = kept
        return kept[1]


def tilted(cone: GlenoidCone, up: float, forward: float) -> GlenoidCone:
    """The cone with its axis turned by these angles [deg] towards up and forward in the glenoid."""
    axes = glenoid_axes(cone.axis, cone.edge)
    axis = cone.axis + np.tan(np.radians(up)) * axes[1] + np.tan(np.radians(forward)) * axes[0]
    axis /= np.linalg.norm(axis)
    edge = cone.edge - (cone.edge @ axis) * axis
    return replace(cone, axis=axis, edge=edge / np.linalg.norm(edge))


def with_penalty(problem: RedundancyProblem, directions: Array, weight: float) -> RedundancyProblem:
    """Σ weight (d·F)² [kN²] in the objective, for each of directions d (frames, k, 3) in ground.

    d·F = s are further equalities, and s further unbounded controls with this weight, so that the problem stays convex.
    """
    rows = CONTACT_SCALE * directions
    frames, tracked, controls = problem.acceleration_matrix.shape
    count = rows.shape[1]
    matrix = np.zeros((frames, tracked + count, controls + count))
    matrix[:, :tracked, :controls] = problem.acceleration_matrix
    matrix[:, tracked:, :controls] = rows @ problem.reaction_matrix[:, 3:]
    matrix[:, tracked:, controls:] = -np.eye(count)
    at_rest = np.einsum("fij,fj->fi", rows, problem.reaction_at_rest[:, 3:])
    limits = problem.control_limits
    unbounded = np.tile([[-np.inf], [np.inf]], (1, count))
    return replace(
        problem,
        weights=np.append(problem.weights, np.full(count, weight)),
        acceleration_matrix=matrix,
        acceleration_target=np.concatenate([problem.acceleration_target, -at_rest], axis=1),
        tracked=np.ones(tracked + count, dtype=bool),
        reaction_matrix=np.concatenate([problem.reaction_matrix, np.zeros((frames, 6, count))], axis=2),
        control_limits=None if limits is None else np.concatenate([limits, unbounded], axis=1),
    )


def with_masses(model: Model, variant: ContactVariant, body_mass: float) -> Model:
    """The model with the arm masses and the load of the variant; its hand holds HELD_MASS [kg] already."""
    ratios = {body.name: 1.0 for body in model.bodies}
    bare = {body.name: body.mass - (HELD_MASS if body.name == "hand" else 0.0) for body in model.bodies}
    if variant.arm_masses == "own":
        for segment in ARM_SEGMENTS.values():
            ratio = segment.mass_fraction * body_mass / sum(bare[name] for name in segment.bodies)
            ratios |= dict.fromkeys(segment.bodies, ratio)
    bodies = []
    for body in model.bodies:
        added = (ratios[body.name] - 1.0) * bare[body.name] + (variant.held if body.name == "hand" else 0.0)
        mass = body.mass + added
        factor = mass / body.mass if body.mass else 1.0
        held = HELD_MASS + variant.held if body.name == "hand" else 0.0
        centre = body.mass_center + (held * variant.grip / mass * TO_FINGERS if held else 0.0)
        bodies.append(replace(body, mass=mass, mass_center=centre, inertia=factor * body.inertia))
    return replace(model, bodies=tuple(bodies))


def _evaluated(model: Model, motion: Motion) -> tuple[Kinematics, Postures, PathState]:
    kinematics = differentiate(motion, CUTOFF_HZ)
    state = postures(model, kinematics.positions, kinematics.speeds)
    return kinematics, state, evaluate_paths(model, state)


def _weakened(muscle: Muscle, variant: ContactVariant) -> Muscle:
    factor = variant.subscapularis if muscle.name.startswith("Subscapularis") else 1.0
    return replace(muscle, max_isometric_force=factor * muscle.max_isometric_force)


def _size(muscle: Muscle, weighting: Literal["strength", "volume"]) -> float:
    strength = muscle.max_isometric_force
    return strength if weighting == "strength" else strength * muscle.optimal_fiber_length


def _turned(tasks: TrackingTasks, target: Array) -> TrackingTasks:
    return replace(
        tasks,
        coordinate_weights={**tasks.coordinate_weights, ROTATION: STIFF},
        coordinate_targets={**tasks.coordinate_targets, ROTATION: target},
    )

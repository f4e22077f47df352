"""The glenoid cone: directions of the joint reaction for which the humeral head stays in the socket.

A model in a motion: the inputs of the redundancy problem.

Accelerations and joint reaction respond to activations and controls by affine maps. With x = (activations of the
muscles, controls of the actuators), q̈ = q̈₀ + A x and F = F₀ + A_F x. The response to a muscle is that to its path's
tension of 1 N times its active force.

Loads of forces that are left out of a model are computed as far as possible. The load of a force that the solver has is
computed. That of one it does not have is not known; the result shows how much of the forces that the motion needs is
left to reserve actuators.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from solver.errors import MotionError, SolverCode
from solver.model import Array, CoordinateActuator, Model, ModelError
from solver.motion import Kinematics
from solver.multibody.dynamics import (
    EquationsOfMotion,
    equations_of_motion,
    is_bypassed,
    response_to_loads,
    responses_to,
)
from solver.multibody.loads import ExternalForce, full_loads, load_wrenches, total_loads
from solver.multibody.postures import Postures, jacobians, postures
from solver.muscle import (
    MuscleForceModel,
    MuscleForces,
    PathMode,
    PathState,
    evaluate_paths,
    join_outcomes,
    modelled_forces,
)

if TYPE_CHECKING:
    from solver.multibody.mass_matrix import Responses


JOINT = "GlenoHumeral"
CENTER_MARKER, HEAD_MARKER, EDGE_MARKER = "Glenoid_Center", "HumHead_Center", "Glenoid_Edge"


@dataclass(frozen=True)
class GlenoidCone:
    """A cone fixed to the scapula, with its tip in the centre of the humeral head; its cross section is an ellipse.

    body        index of the scapula in Model.bodies
    axis        (3,) unit vector in the scapula, from the head to the centre of the glenoid
    half_angle  between axis and rim, towards the edge marker [rad]
    edge        (3,) unit vector across the axis towards the edge marker
    aspect      width of the rim across axis and edge, over that along the edge; 1 is a circle
    distance    from the head's centre to the glenoid's [m]
    """

    body: int
    axis: Array
    half_angle: float
    edge: Array
    aspect: float
    distance: float

    @property
    def rim(self) -> tuple[float, float]:
        """Half the glenoid's width [m] along the edge's direction and across it, in the plane through its centre."""
        along = self.distance * float(np.tan(self.half_angle))
        return along, self.aspect * along

    @cached_property
    def frame(self) -> Array:
        """(3, 3) axis, edge and the direction across both, as rows."""
        return np.vstack([self.axis, self.edge, np.cross(self.axis, self.edge)])


@lru_cache(maxsize=32)  # both are frozen
def glenoid_cone(model: Model, aspect: float = 1.0, joint_name: str = JOINT) -> GlenoidCone:
    """The cone that the markers of head, glenoid centre and glenoid edge span (Belli et al. 2023, where aspect is 1).

    Raises ModelError where a marker is missing or on the wrong body, or the aspect is not positive.
    """
    if not aspect > 0:
        sentence = f"the glenoid's aspect should be positive and is {aspect:g}; 1 makes the rim a circle"
        raise ModelError(sentence, SolverCode.WRONG_GLENOID)
    joint = model.joint(joint_name)
    center, head, edge = (model.marker(name) for name in (CENTER_MARKER, HEAD_MARKER, EDGE_MARKER))
    if is_bypassed(model, joint):
        raise ModelError(
            f"the joint {joint_name} of {model.name} should carry the body beyond it alone, and a constraint "
            "holds that body, too; solve without the cone",
            SolverCode.WRONG_GLENOID,
        )
    is_on_socket = center.body == edge.body == joint.parent
    is_on_head = head.body == joint.child and np.allclose(head.location, joint.frame_in_child.translation, atol=1e-6)
    if not (is_on_socket and is_on_head):
        raise ModelError(
            f"the markers {CENTER_MARKER} and {EDGE_MARKER} should be on {model.bodies[joint.parent].name} and "
            f"{HEAD_MARKER} at the centre of the joint {joint_name}, and are not; move them or solve without the cone",
            SolverCode.WRONG_GLENOID,
        )
    head_in_scapula = joint.frame_in_parent.translation
    axis, rim = _unit(center.location - head_in_scapula), _unit(edge.location - head_in_scapula)
    along = float(axis @ rim)
    return GlenoidCone(
        body=joint.parent,
        axis=axis,
        half_angle=float(np.arccos(along)),
        edge=_unit(rim - along * axis),
        aspect=aspect,
        distance=float(np.linalg.norm(center.location - head_in_scapula)),
    )


def is_shoulder(model: Model, joint_name: str = JOINT) -> bool:
    """Whether a model has the joint GlenoHumeral, and the reaction is that joint's, or any marker of a glenoid."""
    if joint_name == JOINT and any(joint.name == JOINT for joint in model.joints):
        return True
    names = {marker.name for marker in model.markers}
    return not names.isdisjoint((CENTER_MARKER, HEAD_MARKER, EDGE_MARKER))


def with_rim(model: Model, tangent: float) -> Model:
    """The model with its edge marker moved along the edge's direction, so that tan θ of the cone is this tangent.

    Raises ModelError as glenoid_cone does.
    """
    cone, center = glenoid_cone(model), model.marker(CENTER_MARKER)
    edge = center.location + cone.distance * tangent * cone.edge
    markers = (replace(marker, location=edge) if marker.name == EDGE_MARKER else marker for marker in model.markers)
    return replace(model, markers=tuple(markers))


def cone_rows(cone: GlenoidCone, rotation_to_ground: Array) -> Array:
    """Rows (frames, 3, 3) that turn a reaction F [N] in ground into (s, v): F lies in the cone where s ≥ |v|.

    rotation_to_ground (frames, 3, 3) of the scapula; s = tan θ (d·F) and v the parts of F across the axis d, that
    across the edge's direction over the aspect.
    """
    sizes = np.array([[np.tan(cone.half_angle)], [1.0], [1.0 / cone.aspect]])
    return (sizes * cone.frame) @ np.swapaxes(rotation_to_ground, -1, -2)


def contact_points(cone: GlenoidCone, rotation_to_ground: Array, force: Array) -> Array:
    """(frames, 2) contact point: where a reaction (frames, 3) in ground through the head's centre meets the glenoid.

    In metres from the glenoid's centre, along the edge's direction and across it; NaN where the reaction points away.
    """
    depth, along, across = np.einsum("fij,fj->if", cone.frame @ np.swapaxes(rotation_to_ground, -1, -2), force)
    scale = cone.distance / np.where(depth > 0, depth, np.nan)
    return np.stack([scale * along, scale * across], axis=-1)


def _unit(vector: Array) -> Array:
    return np.asarray(vector / np.linalg.norm(vector))


@dataclass(frozen=True)
class ForceAgreement:
    """Size of a predicted force beside that of a reference, over the frames in which both are known.

    rmse         root mean square difference [N]
    correlation  Pearson's r
    peak_ratio   largest predicted over largest reference
    """

    rmse: float
    correlation: float
    peak_ratio: float


def force_agreement(predicted: Array, reference: Array) -> ForceAgreement:
    """Compare sizes (frames,) [N]. A frame with NaN in either is left out; without two frames all figures are NaN."""
    is_known = np.isfinite(predicted) & np.isfinite(reference)
    ours, theirs = predicted[is_known], reference[is_known]
    if len(ours) < 2:
        return ForceAgreement(np.nan, np.nan, np.nan)
    deviations = ours - ours.mean(), theirs - theirs.mean()
    spread = float(np.linalg.norm(deviations[0]) * np.linalg.norm(deviations[1]))
    return ForceAgreement(
        rmse=float(np.sqrt(np.mean((ours - theirs) ** 2))),
        correlation=float(deviations[0] @ deviations[1]) / spread if spread > 0 else np.nan,
        peak_ratio=float(ours.max() / theirs.max()),
    )


def angle_between(first: Array, second: Array) -> Array:
    """Angle (frames,) [rad] between forces (frames, 3) in the same axes."""
    across = np.linalg.norm(np.cross(first, second), axis=-1)
    return np.asarray(np.arctan2(across, (first * second).sum(axis=-1)))


def glenoid_axes(axis: Array, edge: Array) -> Array:
    """Rows (3, 3) forward, up, lateral of the measured force, in the scapula, from the cone.

    axis points from the head to the glenoid's centre, edge to its edge marker at the back.
    """
    lateral, forward = -axis, -edge
    return np.vstack([forward, np.cross(lateral, forward), lateral])


@dataclass(frozen=True, eq=False)
class Mechanics:
    """A model in a motion, with its external loads: everything that does not depend on the activations."""

    kinematics: Kinematics
    state: Postures
    paths: PathState
    forces: MuscleForces
    equations: EquationsOfMotion
    loads: tuple[ExternalForce, ...]

    @property
    def muscle_outcomes(self) -> NDArray[np.object_]:
        """(frames, muscles) of MuscleOutcome."""
        return join_outcomes(self.paths, self.forces)

    def maps(self, model: Model) -> ResponseMaps:
        """The maps of this model in the motion, NaN in a posture in which it cannot be evaluated.

        Raises MotionError if there is no other posture.
        """
        wrenches = load_wrenches(self.loads, self.state) if self.loads else None
        maps = response_maps(model, self.state, self.equations, self.paths, self.forces, wrenches)
        is_finite = maps.is_finite
        if not is_finite.any():
            raise MotionError(
                f"the model {model.name} should have finite accelerations and has them in none of {len(is_finite)} "
                f"postures, the first at {self.kinematics.time[0]:g} s; use another motion",
                SolverCode.NO_ACCELERATIONS,
            )
        return maps.cleared(is_finite)


def evaluate_motion(
    model: Model,
    kinematics: Kinematics,
    paths: PathState | None = None,
    loads: Sequence[ExternalForce] = (),
    joint: str = JOINT,
    path_mode: PathMode = "opensim",
    muscle_force_model: MuscleForceModel = "rigid_tendon",
) -> Mechanics:
    """Evaluate a motion; `paths` are those of another model with the same geometry, if already computed."""
    state = postures(model, kinematics.positions, kinematics.speeds, kinematics.time)
    paths = paths or evaluate_paths(model, state, mode=path_mode)
    forces = modelled_forces(model, paths.lengths, paths.speeds, muscle_force_model)
    equations = equations_of_motion(model, state, joint)
    return Mechanics(kinematics, state, paths, forces, equations, tuple(loads))


@dataclass(frozen=True, eq=False)
class ResponseMaps:
    """Accelerations and reaction as affine functions of x = (activations of the muscles, controls of the actuators).

    acceleration_at_rest      (frames, coordinates) at x = 0, with the passive forces of the muscles [rad/s², m/s²]
    acceleration_per_control  (frames, coordinates, controls)
    reaction_at_rest          (frames, 6) moment [N m] and force [N] on the reaction joint's parent, in ground
    reaction_per_control      (frames, 6, controls)
    """

    acceleration_at_rest: Array
    acceleration_per_control: Array
    reaction_at_rest: Array
    reaction_per_control: Array

    @property
    def is_finite(self) -> NDArray[np.bool_]:
        """(frames,) False in a posture in which the model cannot be evaluated."""
        parts = (getattr(self, field.name) for field in fields(self))
        sums = [part.reshape(len(part), -1).sum(axis=1) for part in parts]  # finite only if all their terms are
        return np.asarray(np.isfinite(np.array(sums)).all(axis=0))

    def cleared(self, is_finite: NDArray[np.bool_]) -> ResponseMaps:
        """With NaN in the frames that are not finite: infinities would cause warnings in later products."""
        if is_finite.all():
            return self
        maps = replace(self, **{field.name: getattr(self, field.name).copy() for field in fields(self)})
        for field in fields(self):
            getattr(maps, field.name)[~is_finite] = np.nan
        return maps


def response_maps(
    model: Model,
    state: Postures,
    equations: EquationsOfMotion,
    paths: PathState,
    forces: MuscleForces,
    wrenches: Array | None = None,
) -> ResponseMaps:
    """The maps of the redundancy problem; wrenches (frames, bodies, 6) are loads besides the muscles, as of a suit."""
    driven = [one.coordinate if isinstance(one, CoordinateActuator) else 0 for one in model.actuators]
    strength = [one.optimal_force if isinstance(one, CoordinateActuator) else 0.0 for one in model.actuators]
    responses = responses_to(
        equations,
        paths.wrenches,
        paths.mobility_per_tension if paths.has_moving_points else None,  # else zero, and 4 kB per frame to read
        factors=forces.active,
        shares=forces.passive,
        driven=driven,
        strength=strength,
    )
    _set_bodily_actuators(model, state, equations, responses)
    acceleration = equations.acceleration_unloaded + responses.total_acceleration
    reaction = equations.reaction_unloaded + responses.total_reaction
    if wrenches is not None:
        loads = response_to_loads(equations, wrenches[:, None])
        acceleration, reaction = acceleration + loads.acceleration[:, 0], reaction + loads.reaction[:, 0]
    return ResponseMaps(
        acceleration_at_rest=acceleration,
        acceleration_per_control=responses.acceleration,
        reaction_at_rest=reaction,
        reaction_per_control=responses.reaction,
    )


def _set_bodily_actuators(model: Model, state: Postures, equations: EquationsOfMotion, responses: Responses) -> None:
    """Fill the columns of actuators that act on bodies, and not on a coordinate."""
    bodily = [(index, one) for index, one in enumerate(model.actuators) if not isinstance(one, CoordinateActuator)]
    if not bodily:
        return
    on_bodies = response_to_loads(equations, *full_loads([one for _, one in bodily], model, state))
    for found, (index, _) in enumerate(bodily):
        responses.acceleration[:, :, len(model.muscles) + index] = on_bodies.acceleration[:, found]
        responses.reaction[:, :, len(model.muscles) + index] = on_bodies.reaction[:, found]


def without_forces(model: Model, names: Sequence[str]) -> Model:
    """The model without its passive forces of these names; left_out names them. ModelError for a name it lacks."""
    known = [force.name for force in (*model.coordinate_forces, *model.forces)]
    unknown = sorted(set(names) - set(known))
    if unknown:
        raise ModelError(
            f"{model.name} has no spring, ligament, contact or other passive force {', '.join(unknown)} to leave out; "
            f"it has {', '.join(known) or 'none'}",
            SolverCode.UNKNOWN_NAME,
        )
    return replace(
        model,
        coordinate_forces=tuple(force for force in model.coordinate_forces if force.name not in names),
        forces=tuple(force for force in model.forces if force.name not in names),
        left_out=(*model.left_out, *dict.fromkeys(names)),
    )


def passive_force_on_coordinates(model: Model, kinematics: Kinematics, name: str) -> Array:
    """(frames, coordinates) generalised force [N, N m] of the passive forces of that name in a motion."""
    state = postures(model, kinematics.positions, kinematics.speeds)
    chosen = replace(model, forces=tuple(force for force in model.forces if force.name == name))
    wrenches, forces = total_loads(chosen, state)
    forces = forces + _generalised(model, state, wrenches)
    for force in model.coordinate_forces:
        if force.name == name:
            q, u = state.coordinates[:, force.coordinate], state.speeds[:, force.coordinate]
            forces[:, force.coordinate] += force.at(q, u)
    return forces


def actuator_forces(model: Model, kinematics: Kinematics, forces: Array) -> Array:
    """(frames, coordinates) generalised force [N m, N] of all actuators, on coordinates and on bodies, in a motion.

    forces (frames, actuators) are those of Model.actuators [N m, N].
    """
    generalised = np.zeros((len(forces), len(model.coordinates)))
    state = postures(model, kinematics.positions, kinematics.speeds)
    for actuator, values in zip(model.actuators, forces.T, strict=True):
        if isinstance(actuator, CoordinateActuator):
            generalised[:, actuator.coordinate] += values
        elif actuator.optimal_force:
            control = (values / actuator.optimal_force)[:, None]
            wrenches, on_coordinates = full_loads([actuator], model, state)
            generalised += control * (on_coordinates[:, 0] + _generalised(model, state, wrenches[:, 0]))
    return generalised


def _generalised(model: Model, state: Postures, wrenches: Array) -> Array:
    return np.asarray(np.einsum("fbi,fbij->fj", wrenches, jacobians(model, state)))

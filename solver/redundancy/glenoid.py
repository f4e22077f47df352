"""The glenoid cone: directions of the joint reaction for which the humeral head stays in the socket."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from solver.errors import SolverCode
from solver.model import Model, ModelError
from solver.multibody.joint_reactions import is_bypassed

Array = NDArray[np.float64]

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


def with_rim(model: Model, tangent: float, joint_name: str = JOINT) -> Model:
    """The model with its edge marker moved along the edge's direction, so that tan θ of the cone is this tangent.

    Raises ModelError as glenoid_cone does.
    """
    cone, center = glenoid_cone(model, joint_name=joint_name), model.marker(CENTER_MARKER)
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


def angle_to_axis(cone: GlenoidCone, rotation_to_ground: Array, force: Array) -> Array:
    """Angle (frames,) [rad] between a reaction (frames, 3) in ground and the cone's axis."""
    axis = rotation_to_ground @ cone.axis
    across = np.linalg.norm(np.cross(axis, force), axis=-1)
    angle: Array = np.arctan2(across, (axis * force).sum(axis=-1))
    return angle


def _unit(vector: Array) -> Array:
    unit: Array = vector / np.linalg.norm(vector)
    return unit


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
    angle: Array = np.arctan2(across, (first * second).sum(axis=-1))
    return angle


def glenoid_axes(axis: Array, edge: Array) -> Array:
    """Rows (3, 3) forward, up, lateral of the measured force, in the scapula, from the cone of glenoid.py.

    axis points from the head to the glenoid's centre, edge to its edge marker at the back.
    """
    lateral, forward = -axis, -edge
    return np.vstack([forward, np.cross(lateral, forward), lateral])

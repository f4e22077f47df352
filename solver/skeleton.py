"""Bones as lines and outlines, from the geometry of the model alone, for drawings."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from solver.model import GROUND, Model, PathPoint, PointConstraint, WrapSurface
from solver.multibody.postures import Postures, points_in_ground

Array = NDArray[np.float64]
BoneKind = Literal["shaft", "plate", "cage"]

RING_POINTS = 24
RIB_HEIGHTS = (-0.85, -0.6, -0.3, 0.0, 0.3, 0.6, 0.85)
"""Of the parallels, as a share of the half axis."""
ONE_SIDED = 0.02
"""Distance of an ellipsoid's centre from the sagittal plane [m] from which on it is that of one side of the thorax."""
FLATNESS = 0.5
"""Of the attachments of a flat bone: least second spread over the first; those of a long bone lie along a line."""
FEWEST_ATTACHMENTS = 6


@dataclass(frozen=True, eq=False)
class Bone:
    """A line (points, 3) [m] in its body.

    kind  "shaft": from a joint to the next one; "plate": closed outline of the muscle attachments of a flat bone;
          "cage": a ring of the thorax, which is its largest ellipsoid
    """

    body: int
    kind: BoneKind
    points: Array


def skeleton(model: Model) -> tuple[Bone, ...]:
    """Bones of all bodies: what the joints, constraints, muscle attachments and surfaces of the model show of them."""
    cage = _thorax(model)
    bones = list(_rings(cage)) if cage is not None else []
    for body in range(1, len(model.bodies)):
        if cage is not None and body == cage.body:
            continue
        outline = _plate(model, body)
        bones += [Bone(body, "plate", outline)] if outline is not None else _shafts(model, body)
    return tuple(bones)


def bone_lines(bones: tuple[Bone, ...], postures: Postures) -> list[Array]:
    """Every bone as (frames, points, 3) [m] in ground."""
    return [np.stack([points_in_ground(postures, b.body, point) for point in b.points], axis=1) for b in bones]


def _thorax(model: Model) -> WrapSurface | None:
    """The largest ellipsoid, if a body beyond a joint has it."""
    ellipsoids = [surface for surface in model.surfaces if surface.kind == "ellipsoid" and surface.body != GROUND]
    return max(ellipsoids, key=lambda surface: float(np.prod(surface.dimensions)), default=None)


def _rings(surface: WrapSurface) -> Iterator[Bone]:
    """Ribs: parallels about the long axis of the ellipsoid.

    Of an ellipsoid that is one side of the thorax, the outer halves, joined with their mirror images in z.
    """
    rotation, centre = surface.placement.rotation, surface.placement.translation
    long = int(np.argmax(surface.dimensions))
    across = max((axis for axis in range(3) if axis != long), key=lambda axis: abs(rotation[2, axis]))
    depth = 3 - long - across
    is_one_sided = abs(centre[2]) > ONE_SIDED
    outward = np.sign(centre[2] * rotation[2, across]) if is_one_sided else 1.0
    angle = np.linspace(-0.5, 0.5 if is_one_sided else 1.5, RING_POINTS) * np.pi
    for height in RIB_HEIGHTS:
        ring = np.full((len(angle), 3), height)
        ring[:, across] = outward * np.cos(angle) * np.sqrt(1.0 - height**2)
        ring[:, depth] = np.sin(angle) * np.sqrt(1.0 - height**2)
        points = (ring * surface.dimensions) @ rotation.T + centre
        if is_one_sided:
            points = np.concatenate([points, points[::-1] * np.array([1.0, 1.0, -1.0]), points[:1]])
        yield Bone(surface.body, "cage", points)


def _plate(model: Model, body: int) -> Array | None:
    """Convex outline of the attachments in their plane, closed; None if they are few or along a line."""
    places = [
        point.location
        for muscle in model.muscles
        for point in (muscle.path.points[0], muscle.path.points[-1])
        if isinstance(point, PathPoint) and point.body == body
    ]
    if len(places) < FEWEST_ATTACHMENTS:
        return None
    points = np.array(places)
    _, spread, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    if spread[1] < FLATNESS * spread[0]:
        return None
    corners = scipy.spatial.ConvexHull((points - points.mean(axis=0)) @ axes[:2].T).vertices
    return np.asarray(points[np.append(corners, corners[0])])


def _shafts(model: Model, body: int) -> list[Bone]:
    """From the body's joint to those beyond it, to a point that a constraint holds, or else to the mass centre."""
    start = next(joint.frame_in_child.translation for joint in model.joints if joint.child == body)
    ends = [joint.frame_in_parent.translation for joint in model.joints if joint.parent == body]
    for held in model.constraints:
        if isinstance(held, PointConstraint):
            ends += [at for of, at in ((held.body_1, held.location_1), (held.body_2, held.location_2)) if of == body]
    ends = [end for end in ends if np.linalg.norm(end - start) > 1e-3] or [model.bodies[body].mass_center]
    return [Bone(body, "shaft", np.stack([start, end])) for end in ends]

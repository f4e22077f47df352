"""Bones and muscle paths as lines, for drawings. Bones follow from the geometry of the model alone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from solver.model import GROUND, Array, Model, PathPoint, PointConstraint, WrapSurface
from solver.multibody.postures import Postures, points_in_ground
from solver.wrapping.path_tables import NO_SURFACE, pack_paths

BoneKind = Literal["shaft", "plate", "cage"]

RING_POINTS = 24
RIB_HEIGHTS = (-0.85, -0.6, -0.3, 0.0, 0.3, 0.6, 0.85)
"""Of the parallels, as a share of the half axis."""
ONE_SIDED = 0.02
"""Distance of an ellipsoid's centre from the sagittal plane [m] from which on it is that of one side of the thorax."""
FLATNESS = 0.5
"""Of the attachments of a flat bone: least second spread over the first; those of a long bone lie along a line."""
FEWEST_ATTACHMENTS = 6
ARC_POINTS = 4
"""Points between two tangent points: a quarter turn is drawn 0.5 % too short."""


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
    """Bones of all bodies, drawn between the joints, constraints, muscle attachments and surfaces of the model."""
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


def path_lines(model: Model, postures: Postures) -> list[list[Array]]:
    """Every path of the model's muscles in every frame: points (n, 3) [m] in ground.

    The nodes are those of `evaluate_paths` in mode "opensim". Between two tangent points the line is the chord
    projected onto the surface, which differs from OpenSim's curve there; lengths are those of evaluate_paths.
    Raises ModelError as evaluate_paths.
    """
    from solver.wrapping.wrapped_paths import allocate_nodes, allocate_wrap, pack_moving_points, place_path_nodes

    chosen = tuple(muscle.path for muscle in model.muscles)
    tables = pack_paths(model, chosen)
    work = allocate_wrap(tables)
    nodes = allocate_nodes(len(postures.coordinates), len(chosen), work)
    place_path_nodes(tables, postures.poses, pack_moving_points(chosen, postures), work, nodes)
    return [
        [
            _line(model, postures, frame, nodes.places[frame, path, :count], nodes.surfaces[frame, path, :count])
            for path, count in enumerate(counts)
        ]
        for frame, counts in enumerate(nodes.counts)
    ]


def _line(model: Model, postures: Postures, frame: int, places: Array, surfaces: NDArray[np.int64]) -> Array:
    parts = [places[:1]]
    for k in range(1, len(places)):
        if surfaces[k] != NO_SURFACE and surfaces[k] == surfaces[k - 1]:
            surface = model.surfaces[surfaces[k]]
            rotation = postures.rotation_to_ground[frame, surface.body] @ surface.placement.rotation
            origin = postures.origin_in_ground[frame, surface.body]
            centre = origin + postures.rotation_to_ground[frame, surface.body] @ surface.placement.translation
            ends = (places[k - 1 : k + 1] - centre) @ rotation
            parts.append(_arc(surface, *ends) @ rotation.T + centre)
        parts.append(places[k : k + 1])
    return np.concatenate(parts)


def _arc(surface: WrapSurface, start: Array, end: Array) -> Array:
    """ARC_POINTS between two points of the surface, in its frame: of the chord, projected onto the surface."""
    share = np.linspace(0.0, 1.0, ARC_POINTS + 2)[1:-1, None]
    chord = (1 - share) * start + share * end
    size = np.array(surface.dimensions)
    if surface.kind == "torus":
        ring = chord * np.array([1.0, 1.0, 0.0])
        ring *= size[1] / np.linalg.norm(ring, axis=1, keepdims=True)
        outward = chord - ring
        return np.asarray(ring + size[0] * outward / np.linalg.norm(outward, axis=1, keepdims=True))
    if surface.kind == "cylinder":
        size = np.array([size[0], size[0], np.inf])
    points: Array = chord / np.maximum(np.linalg.norm(chord / size, axis=1, keepdims=True), 1e-6)
    if surface.kind == "cylinder":
        points[:, 2] = chord[:, 2]
    return points

"""Paths of muscles as lines in ground, for drawings: over their surfaces where they wrap."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from solver.model import Model, Path, WrapSurface
from solver.multibody.postures import Postures
from solver.wrapping.path_tables import NO_SURFACE, pack_bodies, pack_paths

Array = NDArray[np.float64]
ARC_POINTS = 4
"""Points between two tangent points: a quarter turn is drawn 0.5 % too short."""


def path_lines(model: Model, postures: Postures, paths: Sequence[Path] | None = None) -> list[list[Array]]:
    """Every path of the model's muscles, or other paths, in every frame: points (n, 3) [m] in ground.

    The nodes are those of `evaluate_paths` in mode "opensim". Between two tangent points the line is the chord
    projected onto the surface, which differs from OpenSim's curve there; lengths are those of evaluate_paths.
    Raises ModelError as evaluate_paths.
    """
    from solver.wrapping.moving_points import pack_moving_points
    from solver.wrapping.path_nodes import allocate_nodes, place_path_nodes
    from solver.wrapping.workspace import allocate_wrap

    chosen = tuple(muscle.path for muscle in model.muscles) if paths is None else tuple(paths)
    tables = pack_paths(model, chosen)
    work = allocate_wrap(tables)
    nodes = allocate_nodes(len(postures.coordinates), len(chosen), work)
    place_path_nodes(tables, pack_bodies(postures), pack_moving_points(chosen, postures), work, nodes)
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

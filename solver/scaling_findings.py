"""Findings on a scaled model: unequal factors move path points linearly and surfaces by mean factors."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from solver.inverse_kinematics.solve import assemble
from solver.model import Model, Muscle, PathPoint, WrapSurface
from solver.multibody.postures import Postures, postures
from solver.paths import evaluate_paths

Array = NDArray[np.float64]

FIBRE_RANGE = (0.5, 1.45)
"""Of the normalised fibre length, where the generic muscle is within it; beyond it passive force decides."""
LENGTH_RANGE = (0.9, 1.15)
"""Of a path's length ratio over the median of all."""


class ScalingCode(StrEnum):
    """What a finding is of."""

    POINT_INSIDE_SURFACE = "point_inside_surface"
    FIBRE_LENGTH = "fibre_length"
    PATH_LENGTH = "path_length"


@dataclass(frozen=True)
class ScalingFinding:
    """A muscle that does not fit the scaled body, with the figure that shows it.

    figure  POINT_INSIDE_SURFACE: depth as part of the surface's size; FIBRE_LENGTH: normalised fibre length in the
            default posture; PATH_LENGTH: the path's length ratio over the median of all
    """

    code: ScalingCode
    muscle: str
    figure: float
    surface: str = ""


def check_scaling(generic: Model, scaled: Model) -> tuple[ScalingFinding, ...]:
    """Findings on a model that was scaled from a generic one; both with the same muscles and surfaces."""
    before, after = _in_default_posture(generic), _in_default_posture(scaled)
    lengths = [evaluate_paths(model, state).lengths[0] for model, state in ((generic, before), (scaled, after))]
    ratios = lengths[1] / lengths[0]
    ratios = ratios / np.median(ratios)
    found = []
    for index, muscle in enumerate(scaled.muscles):
        if not LENGTH_RANGE[0] <= ratios[index] <= LENGTH_RANGE[1]:
            found.append(ScalingFinding(ScalingCode.PATH_LENGTH, muscle.name, float(ratios[index])))
        old, fibre = (
            _normalised_fibre(model.muscles[index], length[index])
            for model, length in zip((generic, scaled), lengths, strict=True)
        )
        if _is_usual(old) and not _is_usual(fibre):
            found.append(ScalingFinding(ScalingCode.FIBRE_LENGTH, muscle.name, fibre))
        found += _inside(generic, scaled, index, before, after)
    return tuple(found)


def _in_default_posture(model: Model) -> Postures:
    posture = assemble(model)[None]
    return postures(model, posture, np.zeros_like(posture))


def _normalised_fibre(muscle: Muscle, length: float) -> float:
    """Fibre length over the optimal one, at a length [m] of the path; the tendon is rigid."""
    height = muscle.optimal_fiber_length * np.sin(muscle.pennation_at_optimal)
    return float(np.hypot(length - muscle.tendon_slack_length, height) / muscle.optimal_fiber_length)


def _is_usual(fibre: float) -> bool:
    return FIBRE_RANGE[0] <= fibre <= FIBRE_RANGE[1]


def _inside(generic: Model, scaled: Model, index: int, before: Postures, after: Postures) -> list[ScalingFinding]:
    """Points that lie in a surface of their path, and did not before."""
    found = []
    muscle, old = scaled.muscles[index], generic.muscles[index]
    for wrap in muscle.path.wraps:
        surface, old_surface = scaled.surfaces[wrap.surface], generic.surfaces[wrap.surface]
        for point, old_point in zip(muscle.path.points, old.path.points, strict=True):
            if not (isinstance(point, PathPoint) and isinstance(old_point, PathPoint)):
                continue
            level = _level(surface, point, after)
            if level < 1.0 <= _level(old_surface, old_point, before):
                code = ScalingCode.POINT_INSIDE_SURFACE
                found.append(ScalingFinding(code, muscle.name, 1.0 - level, surface.name))
    return found


def _level(surface: WrapSurface, point: PathPoint, state: Postures) -> float:
    """Below 1 inside, 1 on the surface: distance from its middle or axis over its size in that direction."""
    rotations, origins = state.rotation_to_ground[0], state.origin_in_ground[0]
    in_ground = origins[point.body] + rotations[point.body] @ point.location
    in_body = rotations[surface.body].T @ (in_ground - origins[surface.body])
    local = surface.placement.rotation.T @ (in_body - surface.placement.translation)
    if surface.kind == "cylinder":
        if abs(local[2]) > surface.dimensions[2] / 2:
            return float("inf")
        local = local * [1.0, 1.0, 0.0]
    return float(np.linalg.norm(local / surface.dimensions))

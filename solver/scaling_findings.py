"""Findings on a scaled model: unequal factors move path points linearly and surfaces by mean factors, and a girdle in a
wrong posture stretches muscles. Marker residuals show neither.

Markers of a static pose: how still they are, and a model's markers moved to where they were seen (the last step of
OpenSim's ScaleTool).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from solver.coded_findings import ScalingCode
from solver.inverse_kinematics.solve import TrackingTasks, assemble, solve_inverse_kinematics
from solver.model import Model, PathPoint, WrapSurface
from solver.multibody.postures import Postures, postures
from solver.muscle import muscle_forces
from solver.paths import evaluate_paths

Array = NDArray[np.float64]

FIBRE_RANGE = (0.5, 1.45)
"""Of the normalised fibre length; beyond it passive force dominates, below it there is no active force."""
ROUND_OFF = 1e-6
LENGTH_RANGE = (0.9, 1.15)
"""Of a path's length ratio over the median of all."""
LARGEST_JUMP = 0.010  # m, of a path's length from one frame to the next, beyond the mean of its neighbours
LARGEST_PASSIVE_FORCE = 0.5
"""Over the maximum isometric force."""


@dataclass(frozen=True)
class ScalingFinding:
    """A muscle that does not fit the scaled body, with the figure that shows it.

    figure  POINT_INSIDE_SURFACE: depth as part of the surface's size; FIBRE_LENGTH: normalised fibre length in the
            default posture; PATH_LENGTH: the path's length ratio over the median of all; FIBRE_LENGTH_IN_MOTION: the
            normalised fibre length farthest outside FIBRE_RANGE; PASSIVE_FORCE: over the maximum isometric force;
            PATH_JUMP [m]
    """

    code: ScalingCode
    muscle: str
    figure: float
    surface: str = ""


def check_scaling(generic: Model, scaled: Model) -> tuple[ScalingFinding, ...]:
    """Findings in the default posture on a model that was scaled from a generic one; both with the same muscles."""
    before, after = _in_default_posture(generic), _in_default_posture(scaled)
    lengths = [evaluate_paths(model, state).lengths for model, state in ((generic, before), (scaled, after))]
    ratios = lengths[1][0] / lengths[0][0]
    ratios = ratios / np.median(ratios)
    old_fibres, fibres = (
        _normalised_fibres(model, length)[0] for model, length in zip((generic, scaled), lengths, strict=True)
    )
    found = []
    for index, muscle in enumerate(scaled.muscles):
        if not LENGTH_RANGE[0] <= ratios[index] <= LENGTH_RANGE[1]:
            found.append(ScalingFinding(ScalingCode.PATH_LENGTH, muscle.name, float(ratios[index])))
        if _is_usual(old_fibres[index]) and not _is_usual(fibres[index]):
            found.append(ScalingFinding(ScalingCode.FIBRE_LENGTH, muscle.name, float(fibres[index])))
        found += _inside(generic, scaled, index, before, after)
    return tuple(found)


@dataclass(frozen=True, eq=False)
class MuscleRanges:
    """Ranges of the muscles of a model in a motion, each (muscles,).

    shortest, longest  normalised fibre length;  passive  greatest passive force [N]
    jump               of the path's length between neighbouring frames, beyond the mean of the steps about it [m]
    """

    muscles: tuple[str, ...]
    max_isometric_forces: Array
    shortest: Array
    longest: Array
    passive: Array
    jump: Array

    @property
    def findings(self) -> tuple[ScalingFinding, ...]:
        """Muscles outside FIBRE_RANGE, pulled passively, or whose path jumps."""
        found = []
        for index, name in enumerate(self.muscles):
            outside = [fibre for fibre in (self.longest[index], self.shortest[index]) if not _is_usual(fibre)]
            if outside:
                found.append(ScalingFinding(ScalingCode.FIBRE_LENGTH_IN_MOTION, name, float(outside[0])))
            ratio = self.passive[index] / self.max_isometric_forces[index]
            if ratio > LARGEST_PASSIVE_FORCE:
                found.append(ScalingFinding(ScalingCode.PASSIVE_FORCE, name, float(ratio)))
            if self.jump[index] > LARGEST_JUMP:
                found.append(ScalingFinding(ScalingCode.PATH_JUMP, name, float(self.jump[index])))
        return tuple(found)


def muscle_ranges(model: Model, coordinates: Array) -> MuscleRanges:
    """In postures (frames, coordinates) that follow one another in time, as they were recorded."""
    state = postures(model, coordinates, np.zeros_like(coordinates))
    lengths = evaluate_paths(model, state).lengths
    fibres = _normalised_fibres(model, lengths)
    return MuscleRanges(
        model.muscle_names,
        np.array([muscle.max_isometric_force for muscle in model.muscles]),
        fibres.min(axis=0),
        fibres.max(axis=0),
        muscle_forces(model, lengths, np.zeros_like(lengths)).passive.max(axis=0),
        _jumps(lengths),
    )


def _jumps(lengths: Array) -> Array:
    steps = np.diff(lengths, axis=0)
    if len(steps) < 3:
        return np.zeros(lengths.shape[1])
    padded = np.concatenate([steps[1:2], steps, steps[-2:-1]])
    jumps: Array = np.abs(steps - 0.5 * (padded[:-2] + padded[2:])).max(axis=0)
    return jumps


def _in_default_posture(model: Model) -> Postures:
    posture = assemble(model)[None]
    return postures(model, posture, np.zeros_like(posture))


def _normalised_fibres(model: Model, lengths: Array) -> Array:
    """Fibre length over the optimal one (frames, muscles), at lengths of the paths [m]; the tendons are rigid."""
    optimal, slack, pennation = np.array(
        [
            (muscle.optimal_fiber_length, muscle.tendon_slack_length, muscle.pennation_at_optimal)
            for muscle in model.muscles
        ]
    ).T
    along = np.maximum(lengths - slack, 0.0)
    fibres: Array = np.hypot(along, optimal * np.sin(pennation)) / optimal
    return fibres


def _is_usual(fibre: float) -> bool:
    return bool(FIBRE_RANGE[0] - ROUND_OFF <= fibre <= FIBRE_RANGE[1] + ROUND_OFF)


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
    if surface.kind == "torus":
        tube, ring, _ = surface.dimensions
        return float(np.hypot(np.hypot(local[0], local[1]) - ring, local[2]) / tube)
    if surface.kind == "cylinder":
        if abs(local[2]) > surface.dimensions[2] / 2:
            return float("inf")
        local = local * [1.0, 1.0, 0.0]
    return float(np.linalg.norm(local / surface.dimensions))


def place_markers(model: Model, labels: Sequence[str], static: Array, tasks: TrackingTasks) -> Model:
    """The model with every marker that is seen and not fixed at its place in the body, in the posture of the tasks.

    static (labels, 3) [m] is the mean of the frames of a static pose, NaN where a marker is hidden.
    """
    columns = [list(labels).index(marker.name) for marker in tasks.markers]
    posture = solve_inverse_kinematics(model, static[None, columns], tasks).coordinates
    state = postures(model, posture, np.zeros_like(posture))
    places = dict(zip(labels, static, strict=True))
    moved = []
    for marker in model.markers:
        place = places.get(marker.name)
        if marker.is_fixed or place is None or not np.isfinite(place).all():
            moved.append(marker)
            continue
        rotation, origin = state.rotation_to_ground[0, marker.body], state.origin_in_ground[0, marker.body]
        moved.append(replace(marker, location=rotation.T @ (place - origin)))
    return replace(model, markers=tuple(moved))


def largest_motion(labels: Sequence[str], observed: Array) -> tuple[str, float]:
    """Label of the marker that moves most along an axis in (frames, labels, 3) [m], and its range [m]."""
    hidden = ~np.isfinite(observed).any(axis=(0, 2))
    filled = np.where(np.isfinite(observed), observed, np.nan)
    filled[:, hidden] = 0.0
    ranges = (np.nanmax(filled, axis=0) - np.nanmin(filled, axis=0)).max(axis=1)
    index = int(np.argmax(ranges))
    return labels[index], float(ranges[index])

"""Paths and forces of muscles in many postures.

Paths: lengths, lengthening speeds, and forces per tension. Force with a rigid tendon: active force per activation, and
passive force.

The fibre as in OpenSim's MuscleFixedWidthPennationModel; its forces by the curves of Millard (2013) or Thelen (2003).

`modelled_forces` also gives the forces of OpenSim's StaticOptimization. It asks every muscle for its active force on a
rigid tendon and lets nothing else of the muscle act. Two classes answer with another pennation than that of their
fibre. Millard2012EquilibriumMuscle computes the angle from the fibre length over the optimal one as if that were
metres, which makes the cosine nearly 1; DeGrooteFregly2016Muscle leaves the cosine out. Their forces are too large by 1
/ cos(pennation), 10 % at 25 degrees.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from solver.errors import SolverCode
from solver.functions.muscle_curves import Curves, DeGrooteFreglyCurves, MillardCurves
from solver.model import Array, Model, ModelError, Muscle, Path
from solver.multibody.loads import LoadWrenches
from solver.multibody.postures import Postures
from solver.wrapping.path_tables import PathResults, PathTables, pack_paths

PathMode = Literal["opensim", "geodesic"]


class PathOutcome(StrEnum):
    """Outcome of the iterations for a path in a posture.

    NOT_CONVERGED  one of them reached its limit of rounds and its last point is used. In mode "opensim" the length is
                   still that of OpenSim, whose rules have the same limits
    """

    CONVERGED = "converged"
    NOT_CONVERGED = "not_converged"


OUTCOMES = np.array([PathOutcome.CONVERGED, PathOutcome.NOT_CONVERGED], dtype=object)
"""In the order of the codes of wrapping/path_tables.py."""


@dataclass(frozen=True, eq=False)
class PathState:
    """Paths in a batch of postures.

    lengths               (frames, paths) [m]
    speeds                (frames, paths) [m/s], positive while the path lengthens
    wrenches              on the bodies that each path touches, for a tension of 1 N
    mobility_per_tension  (frames, paths, coordinates) generalised force for a tension of 1 N that is in no wrench: what
                          the path does to the coordinates that move its points in their bodies [m]
    has_moving_points     False where no coordinate moves a point in its body, so that mobility_per_tension is zero
    outcomes              (frames, paths) of PathOutcome
    """

    lengths: Array
    speeds: Array
    wrenches: LoadWrenches
    mobility_per_tension: Array
    has_moving_points: bool
    outcomes: NDArray[np.object_]

    @property
    def wrench_per_tension(self) -> Array:
        """(frames, paths, bodies, 6) the wrenches as a dense array: moment about the ground's origin [m], force [1]."""
        return self.wrenches.dense()


def evaluate_paths(
    model: Model, postures: Postures, paths: Sequence[Path] | None = None, mode: PathMode = "opensim"
) -> PathState:
    """Evaluate the paths of the model's muscles, or other paths over the model's bodies, coordinates and surfaces.

    `opensim` follows OpenSim 4.6's GeometryPath: lengths jump by up to 1 mm where the number of its iterations changes,
    and moment arms differ from the derivative of the length by up to 0.02 m. `geodesic` uses straight lines and
    geodesics with exact tangents; its moment arms are that derivative. docs/paths.md says when to use which.
    Raises ModelError where a path refers to a body, coordinate or surface that the model does not have, and for
    geodesics over a torus.
    """
    # The compiler behind this takes a third of a second to import, which reading a model does not need.
    from solver.geodesics.geodesic_paths import evaluate_geodesic_paths
    from solver.geodesics.shortest_path import allocate_geodesic
    from solver.wrapping.wrapped_paths import (
        allocate_wrap,
        evaluate_wrapped_paths,
        has_moving_points,
        pack_moving_points,
    )

    chosen = tuple(muscle.path for muscle in model.muscles) if paths is None else tuple(paths)
    if mode == "geodesic":
        _ensure_geodesic(model, chosen)
    tables, poses, rates = pack_paths(model, chosen), postures.poses, np.array(postures.speeds, order="C")
    shape, is_moving = (len(poses), len(chosen)), has_moving_points(chosen)
    results = allocate_results(tables, len(poses), len(model.coordinates) if is_moving else 0)
    changes = pack_moving_points(chosen, postures, stops_at_ends=mode == "geodesic")
    if mode == "geodesic":
        evaluate_geodesic_paths(tables, poses, changes, rates, allocate_geodesic(tables), results)
    else:
        evaluate_wrapped_paths(tables, poses, changes, rates, allocate_wrap(tables), results)
    for values in results:
        values.flags.writeable = False
    return PathState(
        results.lengths,
        results.speeds,
        _load_wrenches(model, tables, results.wrenches),
        results.mobilities if is_moving else np.broadcast_to(0.0, (*shape, len(model.coordinates))),
        is_moving,
        OUTCOMES[results.codes],
    )


def allocate_results(tables: PathTables, frames: int, coordinates: int) -> PathResults:
    """coordinates is 0 where none moves a point of the paths."""
    paths = len(tables.first_point) - 1
    return PathResults(
        lengths=np.empty((frames, paths)),
        speeds=np.empty((frames, paths)),
        wrenches=np.empty((frames, len(tables.bodies), 6)),
        mobilities=np.zeros((frames, paths, coordinates)),
        codes=np.zeros((frames, paths), np.int8),
    )


def _load_wrenches(model: Model, tables: PathTables, wrenches: Array) -> LoadWrenches:
    touched = np.diff(tables.first_body)
    path = np.repeat(np.arange(len(touched)), touched)
    return LoadWrenches(wrenches, path, tables.bodies, len(touched), len(model.bodies))


def _ensure_geodesic(model: Model, paths: Sequence[Path]) -> None:
    for path in paths:
        for wrap in path.wraps:
            if model.surfaces[wrap.surface].kind == "torus":
                raise ModelError(
                    f"{model.surfaces[wrap.surface].name} is a torus, over which the solver has no geodesics; use the "
                    "path mode opensim",
                    SolverCode.UNSUPPORTED,
                )


MuscleForceModel = Literal["rigid_tendon", "active", "opensim_static"]
"""Active and passive force; active force alone; that with the pennation of OpenSim's StaticOptimization."""


class MuscleOutcome(StrEnum):
    """Outcome of the iterations for the path and the force of a muscle in a posture.

    PATH_NOT_CONVERGED   as PathOutcome.NOT_CONVERGED
    CURVE_NOT_CONVERGED  Newton's method on a curve of the fibre reached its limit of steps; its last point is used
    FIBER_NOT_CONVERGED  the balance of the fibre and its elastic tendon did not converge; its last point is used
    """

    CONVERGED = "converged"
    PATH_NOT_CONVERGED = "path_not_converged"
    CURVE_NOT_CONVERGED = "curve_not_converged"
    FIBER_NOT_CONVERGED = "fiber_not_converged"


_OUTCOME_OF_CODE = np.array([MuscleOutcome.CONVERGED, MuscleOutcome.CURVE_NOT_CONVERGED], dtype=object)
"""In the order of the codes of functions/bezier.py."""


@dataclass(frozen=True, eq=False)
class MuscleForces:
    """Forces along each muscle's tendon, all (frames, muscles): tension = active · activation + passive [N].

    active is F_max times the curves of active force-length and force-velocity times cos(pennation), passive F_max times
    that of passive force-length times cos(pennation). outcomes are of MuscleOutcome, of the curves alone.
    """

    active: Array
    passive: Array
    cos_pennation: Array
    outcomes: NDArray[np.object_]


def muscle_forces(model: Model, lengths: Array, lengthening_speeds: Array) -> MuscleForces:
    """Forces at path lengths [m] and lengthening speeds [m/s], both (frames, muscles)."""
    groups = _groups_by_curves(model)
    if len(groups) == 1:
        return _forces(groups[0], lengths, lengthening_speeds)
    names = MuscleForces.__dataclass_fields__
    values: dict[str, Any] = {name: np.empty_like(lengths) for name in names}
    values["outcomes"] = np.empty(lengths.shape, dtype=object)
    for group in groups:
        forces = _forces(group, lengths[:, group.indices], lengthening_speeds[:, group.indices])
        for name in names:
            values[name][:, group.indices] = getattr(forces, name)
    return MuscleForces(**values)


def join_outcomes(paths: PathState, forces: MuscleForces) -> NDArray[np.object_]:
    """(frames, muscles) of MuscleOutcome, of the muscles' paths and of their forces."""
    joined: NDArray[np.object_] = forces.outcomes.copy()
    joined[paths.outcomes == PathOutcome.NOT_CONVERGED] = MuscleOutcome.PATH_NOT_CONVERGED
    return joined


@dataclass(frozen=True, eq=False)
class _Group:
    """Muscles with the same curves: indices (muscles,) and parameters (6, muscles)."""

    curves: Curves
    indices: NDArray[np.int64]
    parameters: Array


@lru_cache(maxsize=32)
def _groups_by_curves(model: Model) -> tuple[_Group, ...]:
    """Computed once for a model, which is frozen."""
    by_curves: dict[Curves, list[int]] = {}
    for index, muscle in enumerate(model.muscles):
        by_curves.setdefault(muscle.curves, []).append(index)
    return tuple(
        _Group(curves, np.array(indices), _parameters([model.muscles[index] for index in indices]))
        for curves, indices in by_curves.items()
    )


def _forces(group: _Group, lengths: Array, lengthening_speeds: Array) -> MuscleForces:
    curves = group.curves
    optimal, slack, pennation, steepest, strength, fastest = group.parameters
    height = optimal * np.sin(pennation)
    shortest_pennate = height / np.sin(steepest)
    along = lengths - slack
    is_too_short = along < shortest_pennate * np.cos(steepest)
    shortest = np.maximum(curves.shortest * optimal, shortest_pennate)
    fiber = np.maximum(np.where(is_too_short, shortest_pennate, np.sqrt(height**2 + along**2)), shortest)
    sine = np.minimum(height / np.maximum(fiber, 1e-16), np.sin(steepest))
    cos_pennation = np.sqrt((1.0 - sine) * (1.0 + sine))
    fiber_speed = lengthening_speeds * cos_pennation
    is_slack = lengths - fiber * cos_pennation < slack - 1e-14
    is_shortest = fiber <= shortest
    is_held = is_shortest & (fiber_speed <= 0.0)
    codes = np.zeros(fiber.shape, np.int8)
    at_speed = np.where(is_slack | is_held, 1.0, curves.force_velocity(fiber_speed / (fastest * optimal), codes))
    is_idle = is_shortest & curves.is_idle_when_shortest
    at_length = np.where(is_idle, 0.0, curves.active_force_length(fiber / optimal, codes))
    return MuscleForces(
        active=strength * at_length * at_speed * cos_pennation,
        passive=strength * curves.passive_force_length(fiber / optimal, codes) * cos_pennation,
        cos_pennation=cos_pennation,
        outcomes=_OUTCOME_OF_CODE[codes],
    )


def _parameters(muscles: Sequence[Muscle]) -> Array:
    """(6, muscles) parameters of the fibre, in the order in which _forces unpacks them."""
    rows = [
        (
            muscle.optimal_fiber_length,
            muscle.tendon_slack_length,
            muscle.pennation_at_optimal,
            muscle.maximum_pennation,
            muscle.max_isometric_force,
            muscle.max_contraction_velocity,
        )
        for muscle in muscles
    ]
    return np.array(rows).reshape(len(muscles), 6).T


def modelled_forces(model: Model, lengths: Array, speeds: Array, kind: MuscleForceModel) -> MuscleForces:
    """Forces at path lengths [m] and lengthening speeds [m/s], both (frames, muscles)."""
    forces = muscle_forces(model, lengths, speeds)
    if kind == "rigid_tendon":
        return forces
    active = forces.active
    if kind == "opensim_static":
        columns = [_cos_in_opensim(muscle, lengths[:, i]) for i, muscle in enumerate(model.muscles)]
        cosines = [forces.cos_pennation[:, i] if column is None else column for i, column in enumerate(columns)]
        active = active / forces.cos_pennation * np.column_stack(cosines)
    return replace(forces, active=active, passive=np.zeros_like(forces.passive))


def _cos_in_opensim(muscle: Muscle, lengths: Array) -> Array | None:
    """(frames,) at path lengths; None for that of the fibre."""
    if isinstance(muscle.curves, DeGrooteFreglyCurves):
        return np.ones_like(lengths)
    if not isinstance(muscle.curves, MillardCurves):
        return None
    height = muscle.optimal_fiber_length * np.sin(muscle.pennation_at_optimal)
    normalised = np.hypot(height, lengths - muscle.tendon_slack_length) / muscle.optimal_fiber_length
    angle = np.minimum(np.arcsin(np.minimum(height / np.maximum(normalised, 1e-16), 1.0)), muscle.maximum_pennation)
    return np.asarray(np.cos(angle))

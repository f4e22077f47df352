"""Paths of muscles and tendons in many postures: lengths, lengthening speeds, and forces per tension."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from solver.errors import SolverCode
from solver.model import Model, ModelError, Path
from solver.multibody.loads import LoadWrenches
from solver.multibody.postures import Postures
from solver.wrapping.path_tables import PathTables, allocate_results, pack_paths

Array = NDArray[np.float64]
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

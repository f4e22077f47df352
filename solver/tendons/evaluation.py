"""Muscle forces with elastic tendons at given activations and path lengths: fibre lengths by implicit integration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.errors import SolverCode
from solver.model import Model, ModelError
from solver.muscle import MuscleForces, muscle_forces
from solver.tendons.fiber import (
    AT_SHORTEST,
    NOT_CONVERGED,
    FiberHistory,
    FiberTables,
    SettledFibers,
    allocate_settled,
    fiber_tables,
    fill_given,
    fill_settled,
)

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ElasticForces:
    """Forces and fibres of all muscles of a model in a motion, all (frames, muscles).

    A muscle with a rigid tendon (ignore_tendon_compliance, or a slack length of 0) has the forces of muscle_forces.

    tension         along the tendon [N]
    passive         passive force of the fibre along the tendon, without damping [N]
    fiber_lengths   [m];  tendon_strain 0 at the slack length; both NaN with a rigid tendon
    is_shortest     whether the fibre is held at its least length
    is_converged    whether the balance of forces converged
    """

    tension: Array
    passive: Array
    fiber_lengths: Array
    tendon_strain: Array
    is_shortest: NDArray[np.bool_]
    is_converged: NDArray[np.bool_]

    @property
    def elastic(self) -> NDArray[np.int64]:
        """Indices of the muscles with elastic tendons."""
        return np.flatnonzero(~np.isnan(self.tendon_strain).all(axis=0))


def elastic_forces(
    model: Model,
    lengths: Array,
    lengthening_speeds: Array,
    activations: Array,
    interval: float,
    initial_fibers: Array | None = None,
) -> ElasticForces:
    """Forces at path lengths [m], lengthening speeds [m/s] and activations, all (frames, muscles), `interval` s apart.

    Of the speeds, elastic tendons need those of the first frame only: there the tendon keeps its length, which at rest
    is OpenSim's equilibrium. Or the first frame has initial_fibers (muscles,), lengths of the fibres [m]. The error
    falls with the square of the interval. Raises ModelError without an elastic tendon, or for other shapes.
    """
    tables = fiber_tables(model)
    _ensure_shapes(model, lengths, lengthening_speeds, activations)
    chosen = tables.muscle
    forces = with_rigid_tendons(muscle_forces(model, lengths, lengthening_speeds), activations)
    history, settled = FiberHistory(tables, interval), allocate_settled(len(chosen))
    for frame, path in enumerate(np.ascontiguousarray(lengths[:, chosen])):
        if frame == 0 and initial_fibers is not None:
            settled.length[:] = np.maximum(initial_fibers[chosen] / tables.scales[:, 0], tables.scales[:, 6])
            fill_given(tables, path, settled)
        else:
            start = history.start(lengthening_speeds[frame, chosen])
            fill_settled(tables, path, activations[frame, chosen], start, settled)
        history.keep(settled)
        fill_frame(forces, frame, tables, path, settled)
    return forces


def with_rigid_tendons(forces: MuscleForces, activations: Array) -> ElasticForces:
    """All muscles with rigid tendons, to be filled frame by frame where they are elastic."""
    shape = activations.shape
    return ElasticForces(
        tension=forces.active * activations + forces.passive,
        passive=forces.passive.copy(),
        fiber_lengths=np.full(shape, np.nan),
        tendon_strain=np.full(shape, np.nan),
        is_shortest=np.zeros(shape, bool),
        is_converged=np.ones(shape, bool),
    )


def fill_frame(forces: ElasticForces, frame: int, tables: FiberTables, paths: Array, settled: SettledFibers) -> None:
    """Fill the elastic muscles of a frame; paths (n,) [m] are those of the tables' muscles."""
    chosen, (optimal, slack, height, strength, *_) = tables.muscle, tables.scales.T
    fiber = settled.length * optimal
    forces.tension[frame, chosen] = settled.force * strength
    forces.passive[frame, chosen] = settled.passive * strength
    forces.fiber_lengths[frame, chosen] = fiber
    forces.tendon_strain[frame, chosen] = (paths - np.sqrt(np.maximum(fiber**2 - height**2, 0.0))) / slack - 1.0
    forces.is_shortest[frame, chosen] = settled.codes == AT_SHORTEST
    forces.is_converged[frame, chosen] = settled.codes != NOT_CONVERGED


def _ensure_shapes(model: Model, *arrays: Array) -> None:
    expected = (len(arrays[0]), len(model.muscles))
    for array in arrays:
        if array.shape != expected:
            raise ModelError(
                f"path lengths, speeds and activations should have shape {expected}, a column for each muscle of "
                f"{model.name}, and one has {array.shape}; give all of them",
                SolverCode.WRONG_SHAPE,
            )

"""Muscle forces as OpenSim's StaticOptimization takes them: active forces alone, with its pennation.

OpenSim asks every muscle for its active force on a rigid tendon and lets nothing else of the muscle act. Two classes
answer with another pennation than that of their fibre. Millard2012EquilibriumMuscle computes the angle from the fibre
length over the optimal one as if that were metres, which makes the cosine nearly 1; DeGrooteFregly2016Muscle leaves the
cosine out. Their forces are too large by 1 / cos(pennation), 10 % at 25 degrees.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from solver.functions.fibre import DeGrooteFreglyCurves, MillardCurves
from solver.model import Model, Muscle
from solver.muscle import MuscleForces, muscle_forces

Array = NDArray[np.float64]
MuscleForceModel = Literal["rigid_tendon", "active", "opensim_static"]
"""Active and passive force; active force alone; that with the pennation of OpenSim's StaticOptimization."""


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
    cosine: Array = np.cos(angle)
    return cosine

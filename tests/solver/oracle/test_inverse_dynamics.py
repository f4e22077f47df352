"""Forces that a motion needs, with springs of the model acting, against OpenSim's inverse dynamics."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from solver.motion import Kinematics
from solver.multibody.dynamics import inverse_dynamics
from tests.solver.oracle.test_force_elements import lay
from tests.solver.oracle.two_bodies import given, model_with, opensim, random_states, read_back
from tests.solver.references import relative_difference

pytestmark = pytest.mark.oracle


@pytest.mark.parametrize(
    ("joint", "mass"),
    [("UniversalJoint", 1.3), ("FreeJoint", 0.0)],  # a free body without mass has no inverse of the mass matrix
)
def test_needed_forces_are_opensim_s_inverse_dynamics(joint: str, mass: float, tmp_path: Path) -> None:
    osim = model_with(getattr(opensim, joint))
    upper = osim.getBodySet().get("upper")
    upper.setMass(mass)
    upper.setInertia(opensim.Inertia(mass * 0.02, mass * 0.015, mass * 0.018))
    spring = opensim.PathSpring("spring", 0.5, 800.0, 0.3)
    osim.addForce(given(spring))
    lay(osim, spring)
    ours = read_back(osim, tmp_path)
    q, u = random_states(ours)
    accelerations = 3.0 * np.random.default_rng(8).normal(size=q.shape)
    motion = Kinematics(np.arange(len(q)) / 100.0, 0.01, q, u, accelerations, None)
    state = osim.initSystem()
    for muscle in osim.getMuscles():
        muscle.set_appliesForce(False)
        muscle.setAppliesForce(state, False)
    coordinates = [osim.getCoordinateSet().get(name) for name in ours.coordinate_names]
    solver, theirs = opensim.InverseDynamicsSolver(osim), []
    for values, speeds, rates in zip(q, u, accelerations, strict=True):
        for coordinate, value, speed in zip(coordinates, values, speeds, strict=True):
            coordinate.setValue(state, float(value), False)
            coordinate.setSpeedValue(state, float(speed))
        theirs.append(solver.solve(state, opensim.Vector(rates.tolist())).to_numpy())
    assert relative_difference(inverse_dynamics(ours, motion), np.array(theirs)) < 1e-10

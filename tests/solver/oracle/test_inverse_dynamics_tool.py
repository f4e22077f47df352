"""Inverse dynamics of a leg on the ground beside OpenSim's InverseDynamicsTool, from the same files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solver.time_series_table import read_table
from station.assessment.given_motion import MotionCut, MuscleInputs
from station.assessment.inverse_dynamics import solve_inverse_dynamics
from tests.solver.legs import LEG, PELVIS, Step, step_in, write_motion

opensim: Any = pytest.importorskip("opensim", reason="needs OpenSim: install the extra oracle")
opensim.Logger.setLevelString("error")
pytestmark = pytest.mark.oracle


@pytest.mark.parametrize("cutoff", [None, 6.0])
def test_generalised_forces_are_those_of_opensim(cutoff: float | None, tmp_path: Path) -> None:
    step = step_in(tmp_path)
    ours = solved(step, cutoff)
    theirs = opensims(step, cutoff)
    assert set(ours) == set(theirs)
    for column, values in theirs.items():
        np.testing.assert_allclose(ours[column], values, atol=1e-6, err_msg=column)
    assert np.abs(ours["knee_angle_moment"]).max() > 20.0
    assert np.abs(ours["patella_angle_moment"]).max() > 1e-4  # its constraint does not act


def test_a_coordinate_without_data_keeps_its_default_as_in_opensim(tmp_path: Path) -> None:
    step = step_in(tmp_path)
    write_motion(step.motion, tuple(name for name in (*PELVIS, *LEG, "patella_angle") if name != "hip_rotation"))
    ours, theirs = solved(step, None), opensims(step, None)
    for column, values in theirs.items():
        np.testing.assert_allclose(ours[column], values, atol=1e-6, err_msg=column)


def test_a_coupled_coordinate_without_data_follows_its_leader(tmp_path: Path) -> None:
    step = step_in(tmp_path)
    complete = solved(step, None)
    write_motion(step.motion, (*PELVIS, *LEG))
    found = solve_inverse_dynamics(MuscleInputs(step.motion, str(step.model), step.loads), splines(None))
    assert found.notes["without_data"] == "toe_angle, patella_angle"
    for column, values in zip(found.columns, found.values.T, strict=True):
        np.testing.assert_allclose(values[5:-5], complete[column][5:-5], atol=1e-4, err_msg=column)


def splines(cutoff: float | None) -> MotionCut:
    return MotionCut(cutoff, 0.1, 0.7, derivatives="splines")


def solved(step: Step, cutoff: float | None) -> dict[str, Any]:
    found = solve_inverse_dynamics(MuscleInputs(step.motion, str(step.model), step.loads), splines(cutoff))
    return dict(zip(found.columns, found.values.T, strict=True))


def opensims(step: Step, cutoff: float | None) -> dict[str, Any]:
    tool = opensim.InverseDynamicsTool()
    tool.setModelFileName(str(step.model))
    tool.setCoordinatesFileName(str(step.motion))
    tool.setExternalLoadsFileName(str(step.loads))
    tool.setStartTime(0.1)
    tool.setEndTime(0.7)
    tool.setLowpassCutoffFrequency(cutoff or -1.0)
    without = opensim.ArrayStr()
    without.append("Muscles")
    tool.setExcludedForces(without)
    tool.setResultsDir(str(step.model.parent))
    tool.setOutputGenForceFileName("opensim_id.sto")
    assert tool.run()
    columns, table, _ = read_table(step.model.parent / "opensim_id.sto")
    return dict(zip(columns[1:], table.T[1:], strict=True))

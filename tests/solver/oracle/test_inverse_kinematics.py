"""Inverse kinematics against OpenSim's own tool, at an accuracy at which it comes near the optimum."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from numpy.typing import NDArray

from solver.inverse_kinematics.solve import PostureOutcome, TrackingTasks, solve_inverse_kinematics
from solver.model import Model
from solver.motion import read_table
from solver.osim.reader import read_osim
from tests.solver.inverse_kinematics.marked import cost_of, gaps_of
from tests.solver.oracle.two_bodies import opensim
from tests.solver.references import NO_WEIGHT, SHARED

pytestmark = [pytest.mark.oracle, pytest.mark.shared]
Array = NDArray[np.float64]

ACCURACY = 1e-9
MARKERS, SUBJECT = SHARED / "markers", SHARED / "subject"


@dataclass(frozen=True)
class Trial:
    """A model, its markers over time, a set-up, and until when [s] OpenSim solves it."""

    model: Path
    markers: Path
    setup: Path
    end: float


TRIALS = {
    "flexion": Trial(NO_WEIGHT, MARKERS / "FLX01.trc", MARKERS / "ik_setup.xml", 0.3),
    "shrug": Trial(NO_WEIGHT, MARKERS / "SHRUG01.trc", MARKERS / "ik_setup.xml", 0.3),
    "lift, some coordinates locked": Trial(
        SUBJECT / "S8R_side_as_solved.osim", SUBJECT / "S8R_side.trc", SUBJECT / "S8R_side_ik_setup.xml", 0.4
    ),
    "lift to the back": Trial(
        SUBJECT / "S8R_back_as_solved.osim", SUBJECT / "S8R_back.trc", SUBJECT / "S8R_back_ik_setup.xml", 0.4
    ),
}


@pytest.mark.parametrize("name", TRIALS)
def test_the_optimum_is_that_of_opensim_and_not_above_it(name: str, tmp_path: Path) -> None:
    trial = TRIALS[name]
    model = read_osim(trial.model)
    theirs = solved_by_opensim(trial, model, tmp_path)
    tasks, observed = tracked(trial, model)
    found = solve_inverse_kinematics(model, observed[: len(theirs)], tasks)
    assert set(found.outcomes) == {PostureOutcome.SOLVED}
    away = np.abs(found.coordinates - theirs).max(axis=1)
    assert away.max() < 2e-5
    assert np.median(away) < 1e-6
    assert found.gap.max() < 1e-10
    assert (found.cost - cost_of(model, tasks, observed[: len(theirs)], theirs)).max() < 1e-8
    assert np.abs(gaps_of(model, found.coordinates)).max() < 1e-10


def tracked(trial: Trial, model: Model) -> tuple[TrackingTasks, Array]:
    """The tasks of the set-up whose markers model and file have, and the markers (frames, markers, 3) [m]."""
    table = opensim.TimeSeriesTableVec3(str(trial.markers))
    columns, scale = list(table.getColumnLabels()), 1e-3
    weights = {
        task.get("name"): float(task.findtext("weight") or 0)
        for task in ElementTree.parse(trial.setup).iter("IKMarkerTask")  # noqa: S314  (a file of the public data)
        if (task.findtext("apply") or "true").strip() == "true"
    }
    known = {marker.name for marker in model.markers}
    names = [name for name in weights if name in columns and name in known]
    values = table.getMatrix()
    observed = [
        [[values.getElt(frame, columns.index(name)).get(axis) for axis in range(3)] for name in names]
        for frame in range(table.getNumRows())
    ]
    markers = tuple(model.marker(name) for name in names)
    return TrackingTasks(markers, np.array([weights[name] for name in names])), scale * np.array(observed)


def solved_by_opensim(trial: Trial, model: Model, folder: Path) -> Array:
    """q (frames, coordinates) of OpenSim's InverseKinematicsTool."""
    tool = opensim.InverseKinematicsTool(str(trial.setup))
    theirs = opensim.Model(str(trial.model))
    tool.setModel(theirs)
    tool.setMarkerDataFileName(str(trial.markers))
    tool.setStartTime(0.0)
    tool.setEndTime(trial.end)
    tool.setOutputMotionFileName(str(folder / "theirs.mot"))
    tool.setResultsDir(str(folder))
    tool.set_accuracy(ACCURACY)
    tool.set_report_errors(False)
    assert tool.run()
    columns, table, _ = read_table(folder / "theirs.mot")
    scale = [np.pi / 180 if coordinate.motion == "rotation" else 1.0 for coordinate in model.coordinates]
    coordinates: Array = table[:, [columns.index(name) for name in model.coordinate_names]] * scale
    return coordinates

"""Inverse kinematics against OpenSim's own tool, at an accuracy at which it comes near the optimum."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from solver.inverse_kinematics.posture_uncertainty import posture_uncertainty
from solver.inverse_kinematics.solve import PostureOutcome
from tests.solver.inverse_kinematics.marked import cost_of, gaps_of
from tests.solver.oracle.varied_trials import TRIALS, count_bounds, solved_by_opensim, tracked, varied

pytestmark = [pytest.mark.oracle, pytest.mark.shared]

ACCURACY = 1e-9
BARRIER = 1e-10
"""m²; what OpenSim's interior point leaves of the cost for each coordinate at its bound."""


@pytest.mark.parametrize("name", ["FLX01", "SHRUG01", "S8R side", "S8R back"])
def test_the_optimum_is_that_of_opensim_and_not_above_it(name: str, tmp_path: Path) -> None:
    trial = tracked(TRIALS[name], end=0.3)
    theirs = solved_by_opensim(TRIALS[name], trial.model, tmp_path, ACCURACY, end=0.3)
    found = trial.solve()
    assert set(found.outcomes) == {PostureOutcome.SOLVED}
    away = np.abs(found.coordinates - theirs).max(axis=1)
    assert away.max() < 2e-5
    assert np.median(away) < 1e-6
    assert found.gap.max() < 1e-10
    assert (found.cost - cost_of(trial.model, trial.tasks, trial.observed, theirs)).max() < 1e-8
    assert np.abs(gaps_of(trial.model, found.coordinates)).max() < 1e-10


@pytest.mark.parametrize("seed", [1, 3, 9, 13])
def test_the_optimum_of_a_varied_trial_is_not_above_opensims(seed: int, tmp_path: Path) -> None:
    """OpenSim stays off a bound: where a coordinate is at one, costs are compared, and postures elsewhere."""
    files, _ = varied(seed, tmp_path)
    trial = tracked(files)
    theirs = solved_by_opensim(files, trial.model, tmp_path, ACCURACY)
    found = trial.solve()
    assert set(found.outcomes) == {PostureOutcome.SOLVED}
    assert found.gap.max() < 1e-10
    above = cost_of(trial.model, trial.tasks, trial.observed, theirs) - found.cost
    assert above.min() > -1e-12
    at_bound = count_bounds(trial.model, found.coordinates)
    assert (above < 1e-12 + 2 * BARRIER * at_bound).all()
    is_held = posture_uncertainty(trial.model, trial.observed, trial.tasks, found, 1e-3).is_held
    away = np.where(is_held, np.abs(found.coordinates - theirs), 0.0).max(axis=1)
    assert away[at_bound == 0].max(initial=0.0) < 2e-5
    assert away.max() < 1e-3

"""Activations beside EMG in benchmarks.emg: static optimisation is the optimum of each frame by itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from benchmarks.emg import activation_files
from solver.motion import differentiate, read_motion
from solver.osim.model_reader import read_osim
from solver.redundancy.mechanics import evaluate_motion
from solver.time_series_table import read_table
from tests.conftest import SHARED

pytestmark = pytest.mark.shared

ROW_WEIGHT = 1e4


def test_static_optimisation_is_the_least_sum_of_squares_of_each_frame(tmp_path: Path) -> None:
    """Against SciPy's bounded least squares."""
    _, published, static = activation_files(tmp_path, "SHRUG01", ("plane_elv", "axial_rot"))
    names, table, _ = read_table(static)
    model = read_osim(SHARED / "models" / "TSM_subject_noWeight.osim")
    assert tuple(names[1:]) == model.muscle_names
    kinematics = differentiate(read_motion(SHARED / "motions" / "SHRUG01.mot", model))
    maps = evaluate_motion(model, kinematics).maps
    tracked = [name not in ("plane_elv", "axial_rot") for name in model.coordinate_names]
    for frame in (50, 230, 400):
        A = maps.acceleration_per_control[frame][tracked]
        b = (kinematics.accelerations - maps.acceleration_at_rest)[frame][tracked]
        left, sizes, right = np.linalg.svd(A, full_matrices=False)
        kept = sizes > 1e-9 * sizes[0]
        rows, target = right[kept], (left.T @ b)[kept] / sizes[kept]
        np.testing.assert_allclose(_least_squares(rows, target, len(model.muscles)), table[frame, 1:], atol=2e-4)
    assert published == SHARED / "published" / "SHRUG01_gh.csv"


def _least_squares(rows: np.ndarray, target: np.ndarray, bounded: int) -> np.ndarray:
    """Activations of min |x|² with rows x = target and x[:bounded] in [0, 1], by SciPy with heavily weighted rows."""
    unknowns = rows.shape[1]
    lower, upper = np.full(unknowns, -np.inf), np.full(unknowns, np.inf)
    lower[:bounded], upper[:bounded] = 0.0, 1.0
    weighted = np.vstack([ROW_WEIGHT * rows, np.eye(unknowns)])
    goal = np.append(ROW_WEIGHT * target, np.zeros(unknowns))
    found = lsq_linear(weighted, goal, (lower, upper), method="bvls", tol=1e-14)
    assert np.abs(rows @ found.x - target).max() < 1e-4
    return found.x[:bounded]

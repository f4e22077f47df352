"""The joint angles of the simulated person come back through export and `station ik` within the noise of his skin.

The person's markers are a product of exponentials on the published joints (drivers/simulators/shoulder.py), with random
movement of the soft tissue; the solver shares neither that derivation nor the motion.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from solver.bundled import bundled_model
from solver.motion import read_motion
from station.kinematics.ik import IkInputs, solve_postures
from tests.station.command import Ran
from tests.station.wearer import SOFT_TISSUE_MM, SPECS, WearerSession

POSE, FREE, TIGHT = SPECS
MOST_RMS_DEG = 3.0  # of axial rotation, which upper-arm markers alone hold worst; the others reach 1.3


@pytest.mark.parametrize("spec", [POSE, TIGHT], ids=["pose", "motion"])
def test_known_joint_angles_come_back_within_the_soft_tissue_noise(
    station: Callable[..., Ran], wearer: WearerSession, spec: object, tmp_path: Path
) -> None:
    recording = wearer.path(spec)  # type: ignore[arg-type]
    assert station("export", recording, "--to", "trc", "--output", tmp_path).code == 0
    markers, output = (tmp_path / recording.name).with_suffix(".trc"), tmp_path / "postures.mot"
    ran = station("ik", "--model", "bundled", "--markers", markers, "--output", output)
    assert ran.code == 0, ran.err

    model = bundled_model()
    motion = read_motion(output, model)
    start = wearer.starts[recording.name]
    names = wearer.person.coordinate_names[6:]  # the thorax stands otherwise in the laboratory
    true = wearer.person.coordinates(start + motion.time)[:, 6:]
    found = motion.coordinates[:, [model.coordinate_index(name) for name in names]]
    rms = np.degrees(np.sqrt(np.mean((found - true) ** 2, axis=0)))
    assert rms.max() < MOST_RMS_DEG, dict(zip(names, rms, strict=True))
    assert np.median(rms) < MOST_RMS_DEG / 2

    solved = solve_postures(IkInputs("bundled", markers, None, noise=1e-3 * SOFT_TISSUE_MM))
    columns = [model.coordinate_index(name) for name in names]
    surprise = (found - true) / solved.uncertainty.standard_deviation[:, columns]
    assert 0.3 < np.mean(surprise**2) < 2.0, "the errors are those that the solver expects of this noise"

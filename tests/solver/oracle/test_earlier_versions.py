"""A document of OpenSim 2 or 3, opened by OpenSim 4 and by the reader."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from solver.osim.reader import read_osim
from tests.solver.oracle.two_bodies import difference_to, opensim
from tests.solver.osim.opensim_3 import opensim_3_document

pytestmark = pytest.mark.oracle


@pytest.mark.parametrize(
    ("version", "pennation"),
    [(30000, "pennation_angle_at_optimal"), (20303, "pennation_angle_at_optimal"), (20001, "pennation_angle")],
)
def test_a_model_of_an_earlier_version_is_the_one_that_opensim_opens(
    tmp_path: Path, version: int, pennation: str
) -> None:
    file = tmp_path / "earlier.osim"
    file.write_text(opensim_3_document(version, pennation), encoding="utf-8")
    theirs, ours = opensim.Model(str(file)), read_osim(file)
    found = difference_to(theirs, ours)
    assert found.is_nought(), found
    muscle = theirs.getMuscles().get("pull")
    assert ours.muscles[0].pennation_at_optimal == muscle.get_pennation_angle_at_optimal() == 0.1
    marker = theirs.getMarkerSet().get("m")
    np.testing.assert_allclose(ours.markers[0].location, marker.get_location().to_numpy())

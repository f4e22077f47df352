"""A document of OpenSim 2 or 3, opened by OpenSim 4 and by the reader."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from solver.errors import SolverCode
from solver.osim.model_reader import read_osim
from tests.solver.oracle.two_bodies import difference_to, opensim
from tests.solver.osim.opensim_3 import opensim_3_document
from tests.solver.refusals import raises_refusal

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


@pytest.mark.parametrize("lacking", [("rotation2",), ("translation3",), ("rotation2", "translation3")])
def test_an_axis_that_the_file_does_not_list_stands_still(tmp_path: Path, lacking: tuple[str, ...]) -> None:
    file = tmp_path / "earlier.osim"
    text = opensim_3_document()
    for name in lacking:
        text, count = re.subn(rf'<TransformAxis name="{name}">.*?</TransformAxis>', "", text, flags=re.DOTALL)
        assert count == 1
    file.write_text(text, encoding="utf-8")
    assert difference_to(opensim.Model(str(file)), read_osim(file)).is_nought()


def test_a_scapulothoracic_joint_keeps_its_winging(tmp_path: Path) -> None:
    own = """<thoracic_ellipsoid_radii_x_y_z>0.08 0.2 0.09</thoracic_ellipsoid_radii_x_y_z>
<scapula_winging_axis_origin>0.03 -0.02</scapula_winging_axis_origin>
<scapula_winging_axis_direction>0.4</scapula_winging_axis_direction>"""
    others = "".join(f'<Coordinate name="{name}"/>' for name in ("d", "e", "f"))
    text = opensim_3_document().replace('<PinJoint name="second">', f'<ScapulothoracicJoint name="second">{own}')
    text = text.replace("</PinJoint>", "</ScapulothoracicJoint>")
    text = text.replace('<Coordinate name="c">', f'{others}<Coordinate name="c">')
    file = tmp_path / "earlier.osim"
    file.write_text(text, encoding="utf-8")
    assert difference_to(opensim.Model(str(file)), read_osim(file)).is_nought()


def test_a_coordinate_that_moves_no_axis_leaves_opensim_without_accelerations(tmp_path: Path) -> None:
    # where this fails, OpenSim has mended it, and the solver can read it
    file = tmp_path / "earlier.osim"
    idle = '<Coordinate name="b"/><Coordinate name="idle"/>'
    file.write_text(opensim_3_document().replace('<Coordinate name="b"/>', idle), encoding="utf-8")
    model = opensim.Model(str(file))
    state = model.initSystem()
    model.realizeAcceleration(state)
    assert np.isnan([c.getAccelerationValue(state) for c in model.getCoordinateSet()]).all()
    with raises_refusal(SolverCode.UNSUPPORTED, naming="idle, which moves no axis"):
        read_osim(file)

"""Files of markers, of OpenSim 4 and 3, and tasks in a file of their own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from solver.bundled import bundled_model
from solver.errors import SolverCode
from solver.osim.model_writer import read_marker_set, with_markers
from solver.osim.tool_setups import read_ik_setup
from tests.solver.refusals import raises_refusal

MODEL = bundled_model()
DOCUMENT = "<OpenSimDocument Version='{version}'><MarkerSet><objects>{markers}</objects></MarkerSet></OpenSimDocument>"
OLD = "<Marker name='C7'><body> thorax </body><location> 0 0.1 0 </location><fixed> true </fixed></Marker>"
NEW = (
    "<Marker name='C7'><socket_parent_frame>/bodyset/thorax</socket_parent_frame><location>0 0.1 0</location></Marker>"
)


@pytest.mark.parametrize(("version", "marker", "is_fixed"), [(30000, OLD, True), (40500, NEW, False)])
def test_a_marker_of_either_format_is_read(tmp_path: Path, version: int, marker: str, is_fixed: bool) -> None:
    path = tmp_path / "markers.xml"
    path.write_text(DOCUMENT.format(version=version, markers=marker), encoding="utf-8")
    (found,), unattached = read_marker_set(path, MODEL)
    assert unattached == ()
    assert (found.name, found.body, found.is_fixed) == ("C7", MODEL.body_index("thorax"), is_fixed)
    assert found.location.tolist() == [0.0, 0.1, 0.0]
    model = with_markers(MODEL, [found])
    assert len(model.markers) == len(MODEL.markers) + 1
    np.testing.assert_array_equal(model.marker("C7").location, found.location)


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("<OpenSimDocument><Model/></OpenSimDocument>", SolverCode.WRONG_DOCUMENT),
        (
            DOCUMENT.format(version=30000, markers="<Marker name='C7'><location>0 0 0</location></Marker>"),
            SolverCode.UNKNOWN_NAME,
        ),
    ],
)
def test_a_file_that_does_not_fit_the_model_is_refused_with_its_line(
    tmp_path: Path, text: str, code: SolverCode
) -> None:
    path = tmp_path / "markers.xml"
    path.write_text(text, encoding="utf-8")
    with raises_refusal(code):
        read_marker_set(path, MODEL)


@pytest.mark.parametrize(("version", "marker"), [(30000, OLD), (40500, NEW)])
def test_a_marker_on_a_body_that_the_model_lacks_is_left_out_and_named(
    tmp_path: Path, version: int, marker: str
) -> None:
    other = marker.replace("C7", "ASIS").replace("thorax", "pelvis")
    path = tmp_path / "markers.xml"
    path.write_text(DOCUMENT.format(version=version, markers=marker + other), encoding="utf-8")
    (found,), unattached = read_marker_set(path, MODEL)
    assert (found.name, unattached) == ("C7", ("ASIS",))


def test_tasks_may_be_in_a_file_of_their_own(tmp_path: Path) -> None:
    task = "<IKMarkerTask name='C7'><apply>true</apply><weight>2</weight></IKMarkerTask>"
    tasks = f"<OpenSimDocument><IKTaskSet><objects>{task}</objects></IKTaskSet></OpenSimDocument>"
    (tmp_path / "tasks.xml").write_text(tasks, encoding="utf-8")
    tool = "<InverseKinematicsTool><IKTaskSet file='tasks.xml'/></InverseKinematicsTool>"
    (tmp_path / "setup.xml").write_text(f"<OpenSimDocument>{tool}</OpenSimDocument>", encoding="utf-8")
    assert read_ik_setup(tmp_path / "setup.xml").markers == {"C7": 2.0}

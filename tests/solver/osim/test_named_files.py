"""Elements that a document takes from other files, as OpenSim reads them."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from solver.errors import SolverCode
from solver.osim.document import read_document
from solver.osim.model_reader import read_osim
from solver.osim.tool_setups import read_scale_setup
from tests.solver.refusals import raises_refusal

LEG = Path("examples/leg/leg.osim")
HEAD = '<?xml version="1.0" encoding="UTF-8"?>\n<OpenSimDocument Version="40000">'


def write(path: Path, content: str) -> Path:
    path.write_text(f"{HEAD}{content}</OpenSimDocument>", encoding="utf-8")
    return path


@pytest.fixture
def divided(tmp_path: Path) -> Path:
    """The example leg, with its forces and the path of one muscle in files of their own."""
    whole = LEG.read_text(encoding="utf-8")
    forces = re.search(r"<ForceSet.*</ForceSet>", whole, re.DOTALL)
    assert forces is not None
    path = re.search(r"<GeometryPath.*?</GeometryPath>", forces[0], re.DOTALL)
    assert path is not None
    write(tmp_path / "path.xml", path[0])
    (tmp_path / "sets").mkdir()
    write(tmp_path / "sets" / "forces.xml", forces[0].replace(path[0], '<GeometryPath file="path.xml"/>'))
    divided = tmp_path / "leg.osim"
    divided.write_text(whole.replace(forces[0], '<ForceSet file="sets/forces.xml"/>'), encoding="utf-8")
    return divided


def test_a_model_has_the_muscles_of_a_file_that_it_names(divided: Path) -> None:
    ours, whole = read_osim(divided), read_osim(LEG)
    assert ours.muscle_names == whole.muscle_names != ()
    first, expected = ours.muscles[0].path.points[0], whole.muscles[0].path.points[0]
    np.testing.assert_array_equal(first.location, expected.location)


@pytest.mark.oracle
def test_opensim_has_the_same_muscles(divided: Path) -> None:
    opensim = pytest.importorskip("opensim")
    model = opensim.Model(str(divided))
    model.initSystem()
    assert tuple(muscle.getName() for muscle in model.getMuscleList()) == read_osim(divided).muscle_names


def test_measurements_of_scaling_may_be_in_another_file(tmp_path: Path) -> None:
    pair = "<MarkerPairSet><objects><MarkerPair><markers>hip knee</markers></MarkerPair></objects></MarkerPairSet>"
    scale = "<BodyScaleSet><objects><BodyScale name='thigh'><axes>Y</axes></BodyScale></objects></BodyScaleSet>"
    measurement = f"<Measurement name='length'><apply>true</apply>{pair}{scale}</Measurement>"
    write(tmp_path / "lengths.xml", f"<MeasurementSet><objects>{measurement}</objects></MeasurementSet>")
    scaler = "<ModelScaler><apply>true</apply><MeasurementSet file='lengths.xml'/></ModelScaler>"
    setup = read_scale_setup(write(tmp_path / "setup.xml", f"<ScaleTool>{scaler}</ScaleTool>"))
    assert [measurement.pairs for measurement in setup.measurements] == [(("hip", "knee"),)]


@pytest.mark.parametrize(
    ("content", "code"),
    [
        ("<MarkerSet/>", SolverCode.WRONG_DOCUMENT),  # not the element that is looked for
        ("<ForceSet file='forces.xml'/>", SolverCode.MALFORMED),  # itself
        (None, SolverCode.UNREADABLE_FILE),
    ],
)
def test_a_named_file_without_the_element_is_refused(tmp_path: Path, content: str | None, code: SolverCode) -> None:
    if content is not None:
        write(tmp_path / "forces.xml", content)
    model = write(tmp_path / "model.osim", "<Model><ForceSet file='forces.xml'/></Model>")
    with raises_refusal(code):
        read_document(model)

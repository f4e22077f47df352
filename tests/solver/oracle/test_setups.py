"""Set-ups that we write, opened and run by OpenSim itself."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from numpy.typing import NDArray

from recordings.exchange.tables import MarkerTable
from recordings.exchange.trc import read_trc, write_trc
from solver.bundled import bundled_model
from solver.inverse_kinematics.solve import solve_inverse_kinematics
from solver.model import Marker
from solver.osim.ik_setup import CoordinateTask, IkSetup, ik_setup_document, read_ik_setup
from solver.osim.marker_set import marker_set_document, read_marker_set
from solver.osim.model_reader import read_osim
from solver.osim.model_writer import osim_document
from solver.osim.scale_setup import Measurement, ScaleSetup, read_scale_setup, scale_setup_document
from solver.scaling import Scaling, scale_model
from solver.time_series_table import read_table
from tests.solver.inverse_kinematics.marked import random_postures, seen_from
from tests.solver.oracle.two_bodies import opensim

pytestmark = pytest.mark.oracle
MODEL = bundled_model()
NAMES = [marker.name for marker in MODEL.markers]


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """A folder with generic.osim and trial.trc, whose markers are displaced by centimetres."""
    write(tmp_path / "generic.osim", osim_document(MODEL))
    first, last = random_postures(MODEL, 2, 0.1, 3)
    part = np.linspace(0.0, 1.0, 6)[:, None]
    displaced = np.random.default_rng(4).uniform(-0.01, 0.01, (1, len(NAMES), 3))
    positions = 1e3 * (seen_from(MODEL, first + part * (last - first)) + displaced)
    table = MarkerTable(tuple(NAMES), 100.0, np.arange(6) / 100, positions, np.zeros(positions.shape[:2]))
    (tmp_path / "trial.trc").write_text(write_trc(table, "trial.trc"), encoding="utf-8")
    return tmp_path


def markers_of(folder: Path) -> NDArray[np.float64]:
    return 1e-3 * read_trc(folder / "trial.trc").positions


def write(path: Path, root: ElementTree.Element) -> Path:
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
    return path


def test_opensim_solves_our_set_up_of_inverse_kinematics_to_our_optimum(
    files: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(files)  # OpenSim seeks the model of this tool, unlike that of others, in the working folder
    weights = {name: 1.0 + k % 3 for k, name in enumerate(NAMES)}
    tasks = {
        "clav_elev": CoordinateTask(1e-3, 0.1),
        "scapula_winging": CoordinateTask(1e-4, None, is_default=True),
    }
    setup = IkSetup((0.0, 0.05), weights, tasks, files / "generic.osim", files / "trial.trc", None)
    path = write(files / "ik.xml", ik_setup_document(setup, files, "theirs.mot"))
    assert read_ik_setup(path) == setup

    tool = opensim.InverseKinematicsTool(str(path))
    tool.setResultsDir(str(files))
    tool.set_accuracy(1e-9)
    tool.set_report_errors(False)
    assert tool.run()
    columns, table, _ = read_table(files / "theirs.mot")
    scale = [np.pi / 180 if each.motion == "rotation" else 1.0 for each in MODEL.coordinates]
    theirs = table[:, [columns.index(name) for name in MODEL.coordinate_names]] * scale
    followed = setup.tasks(MODEL, NAMES, np.arange(6) / 100)
    ours = solve_inverse_kinematics(MODEL, markers_of(files), followed)
    assert ours.unsolved == 0
    held = [k for k, name in enumerate(MODEL.coordinate_names) if name not in ("elbow_flexion", "pro_sup")]
    np.testing.assert_allclose(theirs[:, held], ours.coordinates[:, held], atol=2e-5)


def test_opensim_scales_by_our_set_up_as_we_do(files: Path) -> None:
    measurement = Measurement("arm", (("EpL", "gu"), ("EpM", "gu")), {"humerus": (1,), "ulna": (0, 1)})
    setup = ScaleSetup(
        (measurement,),
        {"clavicle": np.array([1.1, 1.0, 0.9]), "scapula": np.array([1.05, 1.05, 1.05])},
        ("measurements", "manualScale"),
        None,
        False,
        (0.0, 0.05),
        files / "trial.trc",
        files / "generic.osim",
        None,
    )
    path = write(files / "scale.xml", scale_setup_document(setup, files, "theirs.osim"))
    back = read_scale_setup(path)
    assert replace(back, manual={}) == replace(setup, manual={})
    assert {body: factors.tolist() for body, factors in back.manual.items()} == {
        body: factors.tolist() for body, factors in setup.manual.items()
    }

    assert opensim.ScaleTool(str(path)).run()
    theirs = read_osim(files / "theirs.osim")
    factors = setup.factors(MODEL, NAMES, markers_of(files))
    ours = scale_model(MODEL, Scaling(factors, scales_joined_points=False))
    for body in ("humerus", "ulna", "clavicle", "scapula"):
        k = MODEL.body_index(body)
        np.testing.assert_allclose(theirs.bodies[k].mass_center, ours.bodies[k].mass_center, atol=1e-12)
        np.testing.assert_allclose(theirs.bodies[k].inertia, ours.bodies[k].inertia, rtol=1e-9, atol=1e-15)
    humerus = [marker.location[1] for marker in theirs.markers if marker.name == "EpL"]
    assert humerus == pytest.approx([ours.marker("EpL").location[1]], abs=1e-9)


def test_opensim_takes_over_our_marker_set_and_reads_it_as_we_do(files: Path) -> None:
    added = (
        Marker("ACv", MODEL.body_index("scapula"), np.array([-0.02, 0.01, 0.003]), is_fixed=True),
        Marker("c7", MODEL.body_index("thorax"), np.array([-0.1, 0.03, 0.0])),
    )
    path = write(files / "markers.xml", marker_set_document(MODEL, added))
    model = opensim.Model(str(files / "generic.osim"))
    model.updateMarkerSet(opensim.MarkerSet(str(path)))
    model.initSystem()
    theirs = model.getMarkerSet().get("ACv")
    assert theirs.getParentFrame().getName() == "scapula"
    assert [theirs.get_location()[axis] for axis in range(3)] == added[0].location.tolist()
    assert model.getMarkerSet().getSize() == len(NAMES) + 1

    opensim.MarkerSet(str(path)).printToXML(str(files / "printed.xml"))
    for file in (path, files / "printed.xml"):
        back, _ = read_marker_set(file, MODEL)
        assert [(each.name, each.body, each.location.tolist(), each.is_fixed) for each in back] == [
            (each.name, each.body, each.location.tolist(), each.is_fixed) for each in added
        ]

"""Marker sets by name: their bodies and places, and a lab's own."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from recordings.exchange.trc import read_trc
from solver.bundled import bundled_model
from solver.findings import CoverageCode
from solver.osim.ik_setup import read_ik_setup
from solver.osim.model_reader import read_osim
from station.kinematics.ik import IkInputs, solve_postures
from station.kinematics.marker_sets import MarkerSetError, place_marker_set, read_marker_set
from station.messages.codes import KinematicsCode
from tests.solver.references import SHARED
from tests.station.kinematics.test_bad_markers import written
from tests.station.kinematics.test_ik import run, trial

MODEL = bundled_model()
OWN = """
title = "ours"
source = "the lab's protocol, 2026"
[markers]
STRN = { body = "thorax", location_m = [0.02, -0.05, 0.0] }
ELBL = { body = "humerus", same_as = ["EpL"] }
KNEE = { body = "humerus" }
"""


@pytest.mark.parametrize("name", ["isb", "thoracoscapular", "qualisys_sports"])
def test_every_published_set_names_its_source_and_bodies_of_the_model(name: str) -> None:
    marker_set = read_marker_set(name)
    assert marker_set.source
    assert all(site.landmark for site in marker_set.markers.values())
    placed = place_marker_set(MODEL, name)
    assert placed.elsewhere == ()
    assert len(placed.names) >= 9
    for label in placed.names:
        body = MODEL.bodies[placed.model.marker(label).body].name
        assert body == marker_set.markers[label].body


def test_labels_of_isb_are_at_the_landmarks_of_the_model() -> None:
    model = place_marker_set(MODEL, "isb").model
    for label, name in (("IJ", "ij"), ("AA", "aa"), ("EL", "EpL")):
        np.testing.assert_array_equal(model.marker(label).location, MODEL.marker(name).location)


@pytest.mark.shared
def test_a_wrist_marker_that_a_published_model_has_on_the_ulna_stays_there_and_is_reported(tmp_path: Path) -> None:
    own = tmp_path / "own.toml"
    own.write_text('[markers]\nRS2 = { body = "radius" }\nEL = { body = "humerus" }', encoding="utf-8")
    patient = read_osim(SHARED / "subject" / "S8R_side_as_solved.osim")
    placed = place_marker_set(patient, str(own))
    assert placed.elsewhere == ("RS2",)
    assert patient.bodies[placed.model.marker("RS2").body].name == "ulna"


def test_a_labs_own_set_is_followed_and_a_marker_without_a_place_is_a_finding(tmp_path: Path) -> None:
    trial(tmp_path, frames=6)
    own = tmp_path / "own.toml"
    own.write_text(OWN, encoding="utf-8")
    names = {"ij": "STRN", "EpL": "ELBL", "EpM": "KNEE"}
    path = written(
        tmp_path, lambda table: replace(table, labels=tuple(names.get(label, label) for label in table.labels))
    )
    whole = own.read_text(encoding="utf-8")
    others = [marker for marker in MODEL.markers if marker.name not in names]
    lines = [f'"{marker.name}" = {{ body = "{MODEL.bodies[marker.body].name}" }}' for marker in others]
    own.write_text(whole + "\n".join(lines), encoding="utf-8")
    solved = solve_postures(IkInputs("bundled", path, None, marker_set=str(own)))
    followed = [marker.name for marker in solved.tasks.markers]
    assert "ELBL" in followed and "KNEE" not in followed
    (found,) = [each for each in solved.findings if each.code is KinematicsCode.WITHOUT_PLACE]
    assert found.figures["markers"] == "KNEE"


@pytest.mark.parametrize(
    ("name", "text", "code"),
    [
        ("vicon", None, KinematicsCode.UNKNOWN_SET),
        ("own.toml", None, KinematicsCode.WRONG_SET),
        ("own.toml", "markers = 3", KinematicsCode.WRONG_SET),
        ("own.toml", '[markers]\nKNEE = { body = "femur" }', KinematicsCode.NO_BODY),
    ],
)
def test_a_set_that_is_none_is_refused_with_a_code(
    name: str, text: str | None, code: KinematicsCode, tmp_path: Path
) -> None:
    path = str(tmp_path / name) if name.endswith(".toml") else name
    if text is not None:
        Path(path).write_text(text, encoding="utf-8")
    with pytest.raises(MarkerSetError) as refused:
        place_marker_set(MODEL, path)
    assert refused.value.code == code


def test_one_marker_on_the_scapula_is_a_finding(tmp_path: Path) -> None:
    trial(tmp_path, frames=6)
    names = {"ac": "RShoulderTop", "EpL": "RElbowOut", "EpM": "RElbowIn"}
    kept = ["ij", "c7", "t8", *names]
    table = read_trc(tmp_path / "trial.trc", tracked=["ij"])
    columns = [table.labels.index(label) for label in kept]
    path = written(
        tmp_path,
        lambda whole: replace(
            whole,
            labels=tuple(names.get(label, label) for label in kept),
            positions=whole.positions[:, columns],
            residuals=whole.residuals[:, columns],
        ),
    )
    own = tmp_path / "own.toml"
    sites = {"ij": "thorax", "c7": "thorax", "t8": "thorax"}
    lines = [f'{label} = {{ body = "{body}" }}' for label, body in sites.items()]
    lines += [f'{ours} = {{ body = "{body}", same_as = ["{model}"] }}' for model, ours, body in BODIES]
    own.write_text("[markers]\n" + "\n".join(lines), encoding="utf-8")
    solved = solve_postures(IkInputs("bundled", path, None, marker_set=str(own)))
    assert CoverageCode.NO_SCAPULA_MARKERS in {finding.code for finding in solved.findings}


BODIES = [("ac", "RShoulderTop", "scapula"), ("EpL", "RElbowOut", "humerus"), ("EpM", "RElbowIn", "humerus")]


def test_what_was_solved_is_written_as_a_set_up_that_solves_the_same(tmp_path: Path, capsys, monkeypatch) -> None:
    trial(tmp_path, frames=6)
    words = ("--model", "bundled", "--markers", tmp_path / "trial.trc", "--output", tmp_path / "q.csv")
    code, _ = run(capsys, monkeypatch, *words, "--from", "0.01", "--write-setup", tmp_path / "ik.xml")
    assert code == 0
    setup = read_ik_setup(tmp_path / "ik.xml")
    assert setup.time_range == (0.01, 0.05)
    assert setup.marker_file == tmp_path / "trial.trc"
    assert set(setup.markers) == {marker.name for marker in MODEL.markers}
    again = solve_postures(IkInputs("bundled", None, tmp_path / "ik.xml"))
    assert len(again.time) == 5

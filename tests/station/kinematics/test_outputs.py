"""station ik and station scale write over no file that they read, and no output over another."""

from __future__ import annotations

import xml.etree.ElementTree as Xml
from pathlib import Path

import pytest

from solver.osim.model_writer import osim_document
from station.exit_code import DONE, WRONG_USAGE
from tests.station.kinematics.test_ik import MODEL, SETUP, TASK, trial
from tests.station.kinematics.test_scale import PAIR, on_humerus
from tests.station.kinematics.test_scale import SETUP as SCALE_SETUP


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A trial, a model, and both set-ups, which name them, in the working directory."""
    monkeypatch.chdir(tmp_path)
    trial(tmp_path, frames=5)
    Xml.ElementTree(osim_document(MODEL)).write(tmp_path / "generic.osim")
    tasks = "".join(TASK.format(name=marker.name, weight=1) for marker in MODEL.markers)
    coordinate = '<IKCoordinateTask name="elbow_flexion"><value_type>from_file</value_type><weight>0.1</weight>'
    text = SETUP.format(range="-1 9", tasks=f"{tasks}{coordinate}</IKCoordinateTask>")
    named = "<model_file>generic.osim</model_file><coordinate_file>elbow.sto</coordinate_file>"
    (tmp_path / "ik.xml").write_text(text.replace("<IKTaskSet>", f"{named}<IKTaskSet>"))
    rows = "".join(f"{0.01 * k:.2f}\t0.5\n" for k in range(6))
    (tmp_path / "elbow.sto").write_text(f"elbow\nversion=1\ninDegrees=no\nendheader\ntime\telbow_flexion\n{rows}")
    one, other = on_humerus()[:2]
    text = SCALE_SETUP.format(pairs=PAIR.format(one=one, other=other), axes="Y", range="-1 9")
    maker = "<GenericModelMaker><model_file>generic.osim</model_file></GenericModelMaker><ModelScaler>"
    (tmp_path / "scale.xml").write_text(text.replace("<ModelScaler>", maker))
    return tmp_path


def files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


@pytest.mark.parametrize(
    "words",
    [
        ("ik", "--setup", "ik.xml", "--output", "q.mot", "--write-setup", "q.mot"),
        ("ik", "--setup", "ik.xml", "--output", "q.mot", "--write-setup", "./q_ik.json"),
        ("ik", "--setup", "ik.xml", "--output", "q.mot", "--write-setup", "generic.osim"),
        ("ik", "--setup", "ik.xml", "--output", "elbow.sto"),
        ("ik", "--setup", "ik.xml", "--output", "folder.mot"),
        ("ik", "--setup", "ik.xml", "--output", "ik.xml/q.mot"),
        ("scale", "--setup", "scale.xml", "--output", "generic.osim"),
        ("scale", "--setup", "scale.xml", "--output", "p.osim", "--write-setup", "p.osim"),
    ],
)
def test_an_output_that_would_replace_a_file_is_wrong_usage(station, lab: Path, words: tuple[str, ...]) -> None:
    (lab / "folder.mot").mkdir()
    before = files(lab)
    ran = station(*words)
    assert (ran.code, ran.out) == (WRONG_USAGE, ""), ran.err
    assert files(lab) == before


@pytest.mark.parametrize("words", [("ik", "--output", "q.mot", "--setup"), ("scale", "--output", "p.osim", "--setup")])
def test_outputs_of_their_own_are_written_and_over_those_of_the_last_run(
    station, lab: Path, words: tuple[str, ...]
) -> None:
    for _ in range(2):
        ran = station(*words, f"{words[0]}.xml", "--write-setup", "used.xml")
        assert ran.code == DONE, ran.err
    assert (lab / "used.xml").exists() and (lab / words[2]).exists()

"""station scale, on the command line."""

import xml.etree.ElementTree as Xml
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from recordings.exchange.trc import read_trc, write_trc
from solver.bundled import bundled_model
from solver.errors import SolverCode
from solver.forces.passive_forces import PathSpring
from solver.osim.model_reader import read_osim
from solver.osim.model_writer import osim_document
from solver.osim.tool_setups import read_scale_setup
from station.exit_code import DONE, WRONG_USAGE
from station.kinematics.ik import IkInputs, solve_postures
from station.kinematics.marker_checks import KinematicsError, mass_findings
from station.kinematics.scale import ScaledBody, ScaleInputs, scale_body
from station.messages.kinematics_messages import KinematicsCode, PersonCode
from tests.refusals import raises_refusal
from tests.solver.references import SHARED
from tests.station.command import Station
from tests.station.kinematics.test_ik import SETUP as IK_SETUP
from tests.station.kinematics.test_ik import TASK, trial
from tests.station.kinematics.test_ik import run as run_verb

MODEL = bundled_model()
SETUP = """<?xml version="1.0"?>
<OpenSimDocument Version="40000"><ScaleTool><mass>-1</mass><ModelScaler>
<MeasurementSet><objects><Measurement name="arm"><MarkerPairSet><objects>{pairs}</objects></MarkerPairSet>
<BodyScaleSet><objects><BodyScale name="humerus"><axes>{axes}</axes></BodyScale></objects></BodyScaleSet>
</Measurement></objects></MeasurementSet>
<ScaleSet><objects><Scale><scales>1.1 1 1</scales><segment>clavicle</segment></Scale></objects></ScaleSet>
<marker_file>trial.trc</marker_file><time_range>{range}</time_range>
</ModelScaler></ScaleTool></OpenSimDocument>"""
PAIR = "<MarkerPair><markers>{one} {other}</markers></MarkerPair>"
PLACER = """<MarkerPlacer><apply>true</apply><IKTaskSet><objects>{tasks}</objects></IKTaskSet>
<marker_file>{file}</marker_file><time_range>{range}</time_range>{more}</MarkerPlacer></ScaleTool>"""
TASKS = "".join(f'<IKMarkerTask name="{marker.name}"><weight>1</weight></IKMarkerTask>' for marker in MODEL.markers)


def on_humerus() -> list[str]:
    return [marker.name for marker in MODEL.markers if marker.body == MODEL.body_index("humerus")]


def own_setup(range_s: str = "-1 9") -> str:
    """Scales the humerus by two of its markers."""
    one, other = on_humerus()[:2]
    return SETUP.format(pairs=PAIR.format(one=one, other=other), axes="Y", range=range_s)


def run(folder: Path, station: Station, **parts: str) -> tuple[int, str]:
    names = on_humerus()
    given = {"pairs": PAIR.format(one=names[0], other=names[1]), "axes": "Y", "range": "-1 9"} | parts
    (folder / "scale.xml").write_text(SETUP.format(**given), encoding="utf-8")
    files = ("--setup", folder / "scale.xml", "--output", folder / "scaled.osim")
    return run_verb(station, *files, "--model", given.pop("model", "bundled"), verb="scale")


def scaled(folder: Path, setup: str, model: str = "bundled") -> ScaledBody:
    """By this set-up and a trial of five frames."""
    trial(folder, frames=5)
    (folder / "scale.xml").write_text(setup, encoding="utf-8")
    return scale_body(ScaleInputs(folder / "scale.xml", model))


def test_markers_of_the_models_own_size_leave_it_as_it_is(tmp_path: Path, station: Station) -> None:
    trial(tmp_path, frames=5)
    code, printed = run(tmp_path, station)
    assert code == 0, printed
    assert "humerus: 1.0000 × 1.0000 × 1.0000" in printed
    scaled = read_osim(tmp_path / "scaled.osim")
    clavicle = MODEL.body_index("clavicle")
    assert scaled.bodies[clavicle].mass == pytest.approx(1.1 * MODEL.bodies[clavicle].mass)


def test_forces_are_scaled_and_written_and_those_left_out_are_named(tmp_path: Path, station: Station) -> None:
    trial(tmp_path, frames=5)
    spring = PathSpring("band", MODEL.muscles[0].path, 0.1, 100.0, 0.0)
    lost = "<ElasticFoundationForce name='mesh'/></objects></ForceSet>"
    text = Xml.tostring(osim_document(replace(MODEL, forces=(spring,))), encoding="unicode")
    (tmp_path / "generic.osim").write_text(text.replace("</objects></ForceSet>", lost), encoding="utf-8")
    code, printed = run(tmp_path, station, model=str(tmp_path / "generic.osim"))
    assert code == 0, printed
    assert "left out of the model, and not in the scaled one: ElasticFoundationForce mesh" in printed
    (band,) = read_osim(tmp_path / "scaled.osim").forces
    muscle, generic = (model.muscles[0] for model in (read_osim(tmp_path / "scaled.osim"), MODEL))
    ratio = muscle.tendon_slack_length / generic.tendon_slack_length
    assert ratio != 1.0
    assert (band.name, band.stiffness) == ("band", 100.0)
    assert band.resting_length == pytest.approx(0.1 * ratio, rel=1e-12)


def test_the_time_range_that_opensim_writes_unset_is_the_whole_trial(tmp_path: Path) -> None:
    """OpenSim's ScaleTool prints −1 −1 for both of its ranges by default."""
    placer = PLACER.format(tasks=TASKS, file="trial.trc", range=" -1 -1", more="")
    text = own_setup(" -1 -1").replace("</ScaleTool>", placer)
    (tmp_path / "scale.xml").write_text(text, encoding="utf-8")
    setup = read_scale_setup(tmp_path / "scale.xml")
    assert setup.placement is not None
    assert setup.time_range == setup.placement.time_range == (-np.inf, np.inf)


@pytest.mark.parametrize(
    ("parts", "said"),
    [
        ({"axes": "Q"}, "should name axes of X, Y and Z"),
        ({"pairs": ""}, "has no pair of markers"),
        ({"pairs": PAIR.format(one="missing", other="absent")}, "needs the marker missing"),
        ({"pairs": PAIR.format(one="missing", other="missing")}, "should name two markers"),
        ({"range": "5 9"}, "no frame from 5 to 9 s"),
    ],
)
def test_a_wrong_set_up_is_one_sentence(parts: dict[str, str], said: str, tmp_path: Path, station: Station) -> None:
    trial(tmp_path, frames=5)
    code, printed = run(tmp_path, station, **parts)
    assert (code, (tmp_path / "scaled.osim").exists()) == (1, False)
    assert said in printed
    assert len(printed.strip().splitlines()) == 1


def test_a_wrong_manual_factor_is_not_attributed_to_markers(tmp_path: Path) -> None:
    with raises_refusal(KinematicsCode.WRONG_MANUAL_FACTOR, kind=KinematicsError):
        scaled(tmp_path, own_setup().replace("1.1 1 1", "100 100 100"))


@pytest.mark.shared
def test_a_published_patient_is_scaled_and_the_figures_are_printed(tmp_path: Path, station: Station) -> None:
    subject = SHARED / "subject"
    words = ("--setup", subject / "scale_setup.xml", "--model", subject / "generic.osim")
    files = ("--markers", subject / "S8R_side.trc", "--output", tmp_path / "scaled.osim")
    code, printed = run_verb(station, *words, *files, verb="scale")
    assert code == 0, printed
    assert "thorax: 1.3853 × 1.1226 × 1.1226" in printed
    assert "mass of the model 30.00 kg" in printed
    assert PersonCode.HAND_MASS in printed


@pytest.mark.parametrize(
    ("body", "codes"), [("hand", [PersonCode.HAND_MASS]), ("ulna", [PersonCode.SEGMENT_MASS]), ("", [])]
)
def test_a_load_is_the_likely_reason_of_a_heavy_hand_alone(body: str, codes: list[PersonCode]) -> None:
    bodies = tuple(replace(one, mass=7.0 * one.mass) if one.name == body else one for one in MODEL.bodies)
    found = mass_findings(replace(MODEL, bodies=bodies))
    assert [finding.code for finding in found] == codes
    assert ["load in the hand" in str(finding) for finding in found] == [code is PersonCode.HAND_MASS for code in codes]


def placed(folder: Path, span: str, file: str = "trial.trc", more: str = "") -> ScaledBody:
    """Scaled by the first 0.1 s of trial.trc, with the markers placed at a pose of another file or time."""
    text = own_setup("0 0.1").replace("1.1 1 1", "1 1 1")
    placer = PLACER.format(tasks=TASKS, file=file, range=span, more=more)
    (folder / "scale.xml").write_text(text.replace("</ScaleTool>", placer), encoding="utf-8")
    return scale_body(ScaleInputs(folder / "scale.xml", "bundled"))


def test_markers_are_placed_in_the_time_and_the_file_of_the_marker_placer(tmp_path: Path) -> None:
    trial(tmp_path, frames=30)
    whole = read_trc(tmp_path / "trial.trc")
    shifted = whole.positions.copy()
    shifted[20:, whole.labels.index(on_humerus()[0])] += 15.0
    late = replace(whole, positions=shifted)
    (tmp_path / "trial.trc").write_text(write_trc(late, "t"), encoding="utf-8")
    cut = replace(late, time_s=late.time_s[20:], positions=shifted[20:], residuals=late.residuals[20:])
    (tmp_path / "pose.trc").write_text(write_trc(cut, "t"), encoding="utf-8")
    early, by_time, by_file = (
        {marker.name: marker.location for marker in placed(tmp_path, *where).model.markers}
        for where in (("0 0.1",), ("0.2 0.3",), ("", "pose.trc"))
    )
    moved = np.linalg.norm(by_time[on_humerus()[0]] - early[on_humerus()[0]])
    assert moved == pytest.approx(0.015 * 3**0.5, abs=0.01)
    for name, location in by_time.items():
        np.testing.assert_allclose(by_file[name], location, atol=1e-12)


def test_what_the_set_up_has_and_is_not_used_is_a_finding(tmp_path: Path) -> None:
    trial(tmp_path, frames=30)
    more = "<max_marker_movement>{}</max_marker_movement><output_marker_file>x</output_marker_file><sort>fast</sort>"
    found = placed(tmp_path, "0 0.05", more=more.format(0.1)).findings
    (figures,) = [finding.figures for finding in found if finding.code == KinematicsCode.UNUSED_ELEMENTS]
    elements = [part.split(">")[0] for part in str(figures["elements"]).split(", ")]
    assert elements == ["<max_marker_movement", "<sort"]
    found = placed(tmp_path, "0 0.05", "C:\\lab\\trial.trc", more.format(-1).replace("<sort>fast</sort>", "")).findings
    codes = [finding.code for finding in found]
    assert KinematicsCode.UNUSED_ELEMENTS not in codes and KinematicsCode.FILE_ELSEWHERE in codes
    with raises_refusal(SolverCode.UNREADABLE_FILE, naming="scale.xml, line 9, names the markers' file"):
        placed(tmp_path, "0 0.05", "C:\\lab\\gone.trc")


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ('<BodyScale name="humerus">', '<BodyScale name="patella_r"><axes>Y</axes></BodyScale>{}', "patella_r"),
        ("<segment>clavicle<", "<segment>femur_l<", "femur_l"),
        ("</Measurement></objects>", "</Measurement>{more}</objects>", "measurement other (of_no_body)"),
    ],
)
def test_a_body_or_a_marker_that_the_model_lacks_is_a_finding(tmp_path: Path, old: str, new: str, named: str) -> None:
    body = "<BodyScaleSet><objects><BodyScale name='ulna'><axes>Y</axes></BodyScale></objects></BodyScaleSet>"
    pairs = f"<MarkerPairSet><objects>{PAIR.format(one=on_humerus()[0], other='of_no_body')}</objects></MarkerPairSet>"
    other = f"<Measurement name='other'>{pairs}{body}</Measurement>"
    made = scaled(tmp_path, own_setup().replace(old, new.replace("{}", old).replace("{more}", other)))
    (finding,) = [finding for finding in made.findings if finding.code == KinematicsCode.NOT_IN_MODEL]
    assert finding.figures["names"] == named
    assert made.factors["humerus"] == pytest.approx([1.0, 1.0, 1.0])


def test_markers_on_bodies_that_the_model_lacks_are_findings(tmp_path: Path) -> None:
    marker = "<Marker name='{}'><socket_parent_frame>/bodyset/patella_r</socket_parent_frame><location/></Marker>"
    model = Xml.tostring(osim_document(MODEL), encoding="unicode").replace(
        "</Marker>", f"</Marker>{marker.format('PAT')}", 1
    )
    (tmp_path / "model.osim").write_text(model, encoding="utf-8")
    objects = f"<MarkerSet><objects>{marker.format('KNE')}</objects></MarkerSet>"
    (tmp_path / "set.xml").write_text(f"<OpenSimDocument Version='40000'>{objects}</OpenSimDocument>")
    maker = "<GenericModelMaker><marker_set_file>set.xml</marker_set_file></GenericModelMaker><ModelScaler>"
    made = scaled(tmp_path, own_setup().replace("<ModelScaler>", maker), str(tmp_path / "model.osim"))
    found = [finding.figures["markers"] for finding in made.findings if finding.code == KinematicsCode.UNATTACHED]
    assert found == ["PAT", "KNE"]
    solved = solve_postures(IkInputs(str(tmp_path / "model.osim"), tmp_path / "trial.trc", None))
    assert KinematicsCode.UNATTACHED in [finding.code for finding in solved.findings]


def test_a_document_whose_root_is_the_tool_is_read(tmp_path: Path) -> None:
    text = own_setup("").replace('<OpenSimDocument Version="40000">', "").replace("</OpenSimDocument>", "")
    assert scaled(tmp_path, text).factors["humerus"] == pytest.approx([1, 1, 1])


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A trial, a model, and both set-ups, which name them, in the working directory."""
    monkeypatch.chdir(tmp_path)
    trial(tmp_path, frames=5)
    Xml.ElementTree(osim_document(MODEL)).write(tmp_path / "generic.osim")
    tasks = "".join(TASK.format(name=marker.name, weight=1) for marker in MODEL.markers)
    coordinate = '<IKCoordinateTask name="elbow_flexion"><value_type>from_file</value_type><weight>0.1</weight>'
    text = IK_SETUP.format(range="-1 9", tasks=f"{tasks}{coordinate}</IKCoordinateTask>")
    named = "<model_file>generic.osim</model_file><coordinate_file>elbow.sto</coordinate_file>"
    (tmp_path / "ik.xml").write_text(text.replace("<IKTaskSet>", f"{named}<IKTaskSet>"))
    rows = "".join(f"{0.01 * k:.2f}\t0.5\n" for k in range(6))
    (tmp_path / "elbow.sto").write_text(f"elbow\nversion=1\ninDegrees=no\nendheader\ntime\telbow_flexion\n{rows}")
    text = own_setup()
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
def test_an_output_that_would_replace_a_file_is_refused(station: Station, lab: Path, words: tuple[str, ...]) -> None:
    (lab / "folder.mot").mkdir()
    before = files(lab)
    ran = station(*words)
    assert (ran.code, ran.out) == (WRONG_USAGE, ""), ran.err
    assert files(lab) == before


@pytest.mark.parametrize("words", [("ik", "--output", "q.mot", "--setup"), ("scale", "--output", "p.osim", "--setup")])
def test_outputs_replace_those_of_the_last_run(station: Station, lab: Path, words: tuple[str, ...]) -> None:
    for _ in range(2):
        ran = station(*words, f"{words[0]}.xml", "--write-setup", "used.xml")
        assert ran.code == DONE, ran.err
    assert (lab / "used.xml").exists() and (lab / words[2]).exists()

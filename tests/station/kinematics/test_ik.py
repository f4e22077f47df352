"""station ik, on the command line: from a TRC and a set-up to a motion that the other verbs read."""

import json
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from recordings.exchange.sample_tables import MarkerTable
from recordings.exchange.trc import write_trc
from solver.bundled import bundled_model
from solver.errors import SolverCode
from solver.inverse_kinematics.solve import assemble
from solver.motion import MotionError, read_motion
from solver.osim.tool_setups import read_ik_setup
from solver.time_series_table import read_table
from station.kinematics.ik import IkInputs, solve_postures
from tests.refusals import raises_refusal
from tests.solver.inverse_kinematics.marked import random_postures, seen_from
from tests.solver.references import NO_WEIGHT, SHARED
from tests.station.command import Station
from tests.station.wearer import SOFT_TISSUE_MM, SPECS, WearerSession

MODEL = bundled_model()
SETUP = """<?xml version="1.0"?>
<OpenSimDocument Version="40000"><InverseKinematicsTool>
<time_range>{range}</time_range><marker_file>trial.trc</marker_file>
<IKTaskSet><objects>{tasks}</objects></IKTaskSet>
</InverseKinematicsTool></OpenSimDocument>"""
TASK = '<IKMarkerTask name="{name}"><apply>true</apply><weight>{weight}</weight></IKMarkerTask>'
POSE, FREE, TIGHT = SPECS
MOST_RMS_DEG = 3.0  # of axial rotation, which upper-arm markers alone hold worst; the others reach 1.3


@cache
def smooth_motion(frames: int) -> np.ndarray:
    """Coordinates between two postures; the constraint is open by little there, and is closed."""
    first, last = random_postures(MODEL, 2, 0.1, 3)
    part = np.linspace(0.0, 1.0, frames)[:, None]
    return np.array([assemble(MODEL, posture) for posture in first + part * (last - first)])


def trial(folder: Path, frames: int = 30, hidden: int | None = None) -> np.ndarray:
    """Writes trial.trc with the markers of the bundled model on a smooth motion, and returns its coordinates."""
    truth = smooth_motion(frames)
    positions = 1e3 * seen_from(MODEL, truth)
    if hidden is not None:
        positions[hidden] = np.nan
    time = np.arange(frames) / 100
    labels = tuple(marker.name for marker in MODEL.markers)
    table = MarkerTable(labels, 100.0, time, positions, np.zeros(positions.shape[:2]))
    (folder / "trial.trc").write_text(write_trc(table, "trial.trc"), encoding="utf-8")
    return truth


def write_setup(path: Path, range_s: str) -> None:
    """A set-up with every marker of the model at the same weight."""
    tasks = "".join(TASK.format(name=marker.name, weight=1) for marker in MODEL.markers)
    path.write_text(SETUP.format(range=range_s, tasks=tasks), encoding="utf-8")


def run(station: Station, *words: object, verb: str = "ik") -> tuple[int, str]:
    """Exit code, and what was printed on both streams."""
    ran = station(verb, *words)
    return ran.code, ran.out + ran.err


def files(folder: Path) -> tuple[object, ...]:
    return ("--model", "bundled", "--markers", folder / "trial.trc", "--output", folder / "q.mot")


def test_markers_at_their_places_give_the_motion_back(tmp_path: Path, station: Station) -> None:
    truth = trial(tmp_path)
    code, printed = run(station, *files(tmp_path))
    assert code == 0
    assert "30 frames, 30 solved" in printed
    found = read_motion(tmp_path / "q.mot", MODEL)
    moved = seen_from(MODEL, found.coordinates) - seen_from(MODEL, truth)
    assert np.abs(moved).max() < 1e-8
    free = [name not in printed for name in MODEL.coordinate_names]
    np.testing.assert_allclose(found.coordinates[:, free], truth[:, free], atol=1e-7)


def test_a_smoothed_trial_comes_with_speeds_and_accelerations(tmp_path: Path, station: Station) -> None:
    truth = trial(tmp_path, frames=60)
    code, printed = run(station, *files(tmp_path), "--smooth", "--noise-mm", "0.1")
    assert code == 0, printed
    table = pd.read_csv(tmp_path / "q_ik_kinematics.csv")
    k = MODEL.coordinate_index("shoulder_elv")
    assert np.abs(table["shoulder_elv_rad"] - truth[:, k]).max() < 1e-3
    speed = np.gradient(truth[:, k], 0.01)
    assert np.abs(table["shoulder_elv_rad_per_s"] - speed)[5:-5].max() < 0.02
    assert (table["sd_shoulder_elv_rad_per_s2"] > 0).all()
    with raises_refusal(SolverCode.NO_FRAMES, kind=MotionError):  # one frame is too short
        solve_postures(IkInputs("bundled", tmp_path / "trial.trc", None, start=0.1, end=0.1, is_smoothed=True))


@pytest.mark.parametrize(
    ("start", "end", "text"), [(5.0, None, "from 5 s on"), (None, -1.0, "up to -1 s"), (5.0, 6.0, "from 5 to 6 s")]
)
def test_a_range_without_a_frame_is_named_as_it_was_given(
    start: float | None, end: float | None, text: str, tmp_path: Path
) -> None:
    trial(tmp_path)
    with raises_refusal(SolverCode.NO_FRAMES, kind=MotionError, naming=f"no frame {text};"):
        solve_postures(IkInputs("bundled", tmp_path / "trial.trc", None, start=start, end=end))


def test_the_set_up_names_the_markers_and_the_time(tmp_path: Path, station: Station) -> None:
    trial(tmp_path)
    names = [marker.name for marker in MODEL.markers]
    tasks = "".join(TASK.format(name=name, weight=1 + k) for k, name in enumerate([*names, "of no model"]))
    (tmp_path / "setup.xml").write_text(SETUP.format(range="0.1 0.2", tasks=tasks), encoding="utf-8")
    words = ("--setup", tmp_path / "setup.xml", "--model", "bundled", "--output", tmp_path / "q.csv")
    code, printed = run(station, *words)
    assert code == 0, printed
    columns, table, _ = read_table(tmp_path / "q.csv")
    assert columns[0] == "time"
    np.testing.assert_allclose(table[[0, -1], 0], [0.1, 0.2])


@pytest.mark.parametrize(
    ("words", "solved", "is_overridden"),
    [
        ((), (0.1, 0.2), False),
        (("--from", "0.05"), (0.05, 0.2), True),
        (("--from", "0", "--to", "0.25"), (0.0, 0.25), True),
        (("--from", "0.1", "--to", "0.2"), (0.1, 0.2), False),
    ],
)
def test_the_command_line_overrides_the_time_range_of_the_set_up_with_a_finding(
    words: tuple[str, ...], solved: tuple[float, float], is_overridden: bool, tmp_path: Path, station: Station
) -> None:
    trial(tmp_path)
    write_setup(tmp_path / "setup.xml", "0.1 0.2")
    given = ("--setup", tmp_path / "setup.xml", "--model", "bundled", "--output", tmp_path / "q.mot", *words)
    code, printed = run(station, *given)
    assert code == 0
    np.testing.assert_allclose(read_motion(tmp_path / "q.mot", MODEL).time[[0, -1]], solved)
    findings = json.loads((tmp_path / "q_ik.json").read_text())["findings"]
    codes = [found["code"] for found in findings]
    assert ("setup.time_range_overridden" in codes) == ("0.1 to 0.2 s" in printed) == is_overridden


@pytest.mark.parametrize(("range_s", "is_reported"), [("0.1 0.295", False), ("0 5", True), ("-3 0.1", True)])
@pytest.mark.parametrize("by_setup", [True, False])
def test_a_short_file_is_reported(
    range_s: str, is_reported: bool, by_setup: bool, tmp_path: Path, station: Station
) -> None:
    trial(tmp_path)
    start, end = range_s.split()
    write_setup(setup := tmp_path / "setup.xml", range_s)
    given = ("--setup", setup) if by_setup else ("--markers", tmp_path / "trial.trc", "--from", start, "--to", end)
    code, printed = run(station, "--model", "bundled", "--output", tmp_path / "q.mot", *given)
    assert code == 0
    findings = {found["code"]: found for found in json.loads((tmp_path / "q_ik.json").read_text())["findings"]}
    assert ("markers.range_not_covered" in findings) == ("it lasts from 0 to 0.29 s" in printed) == is_reported


def test_a_frame_without_markers_is_left_out_reported_and_code_3(tmp_path: Path, station: Station) -> None:
    trial(tmp_path, hidden=29)
    code, printed = run(station, *files(tmp_path))
    assert code == 3
    assert "frames without markers: 1, the first at 0.29 s" in printed
    assert len(read_motion(tmp_path / "q.mot", MODEL).time) == 29


@pytest.mark.parametrize(
    ("tasks", "words", "expected"),
    [
        ("", (), "has no task that is applied"),
        (TASK.format(name="of no model", weight=1), (), "[markers.none_in_common]"),
        (TASK.format(name="C7", weight=1) + TASK.format(name="CLAV", weight=-1), (), "[model_unusable.not_positive]"),
        (TASK.format(name=100_000 * "A", weight=-1), (), "[model_unusable.not_positive]"),
        (TASK.format(name=100_000 * "A B", weight=-1), (), "[model_unusable.not_positive]"),
        (f"<IKMarkerTask file='{100_000 * 'A'}.xml'/>", (), "[model_unusable.unreadable_file]"),
        (TASK.format(name="C7", weight="nan"), (), "[model_unusable.malformed_element]"),
        (TASK.format(name="C7", weight=0), (), "[model_unusable.no_markers_in_common]"),
        (TASK.format(name="of no model", weight=1), ("--from", "5"), "no frame from 5 to 9 s"),
        (TASK.format(name="of no model", weight=1), ("--from", "10"), "no frame from 10 to 9 s"),
        (TASK.format(name="of no model", weight=1), ("--from", "5", "--to", "4"), "should be before the end 4 s"),
        ('<IKCoordinateTask name="x"><weight>-2</weight></IKCoordinateTask>', (), "[model_unusable.not_positive]"),
        ('<IKCoordinateTask name="x"><value_type>guessed</value_type></IKCoordinateTask>', (), "value_type guessed"),
    ],
)
def test_a_wrong_set_up_is_one_sentence(
    tasks: str, words: tuple[str, ...], expected: str, tmp_path: Path, station: Station
) -> None:
    trial(tmp_path, frames=6)
    (tmp_path / "setup.xml").write_text(SETUP.format(range="-1 9", tasks=tasks), encoding="utf-8")
    output = tmp_path / "q.mot"
    given = ("--setup", tmp_path / "setup.xml", "--model", "bundled", "--output", output, *words)
    code, printed = run(station, *given)
    assert (code, output.exists()) == (1, False)
    assert expected in printed
    assert len(printed.strip().splitlines()) == 1
    assert len(printed) < 1500, "a name from the file fills no screen"


def test_a_file_of_too_long_a_name_is_one_that_is_not_there(tmp_path: Path, station: Station) -> None:
    named = f"<marker_file>{100_000 * 'A'}</marker_file><IKTaskSet>"
    text = SETUP.format(range="0 1", tasks=TASK.format(name="C7", weight=1)).replace("<IKTaskSet>", named)
    (tmp_path / "setup.xml").write_text(text)
    given = ("--setup", tmp_path / "setup.xml", "--model", "bundled", "--output", tmp_path / "q.mot")
    code, printed = run(station, *given)
    assert code == 1 and "[model_unusable.unreadable_file]" in printed and len(printed) < 1500


@pytest.mark.shared
def test_a_published_set_up_is_read_with_the_names_of_its_tasks(station: Station, tmp_path: Path) -> None:
    setup = read_ik_setup(SHARED / "markers" / "ik_setup.xml")
    assert setup.markers["ai"] == 0.5
    words = ("--setup", SHARED / "markers" / "ik_setup.xml", "--model", NO_WEIGHT, "--to", "0.5")
    trc = SHARED / "markers" / "FLX01.trc"
    code, printed = run(station, *words, "--markers", trc, "--output", tmp_path / "q.mot")
    assert code == 0, printed
    assert "no visible marker determines elbow_flexion, pro_sup (frames: 51)" in printed
    assert "it is taken for the origin" in printed


@pytest.mark.parametrize("given", ["", " ", "-inf inf"])
def test_an_empty_time_range_is_the_whole_trial(tmp_path: Path, given: str) -> None:
    write_setup(tmp_path / "setup.xml", given)
    assert read_ik_setup(tmp_path / "setup.xml").time_range == (-np.inf, np.inf)


def test_elements_that_change_nothing_here_and_another_tool_in_the_document_are_named(tmp_path: Path) -> None:
    task = TASK.format(name="C7", weight=1) + "<IKOrientationTask name='imu'><weight>1</weight></IKOrientationTask>"
    off = "<IKOrientationTask name='off'><apply>false</apply><weight>1</weight></IKOrientationTask>"
    more = "<constraint_weight>{}</constraint_weight><accuracy>1e-5</accuracy><report_errors>true</report_errors>"
    tool = "<AnalyzeTool name='second'><start_time>0</start_time></AnalyzeTool></OpenSimDocument>"
    text = SETUP.format(range="0 1", tasks=task + off).replace("</OpenSimDocument>", tool)
    for weight, named in (("20", ["<constraint_weight> 20"]), ("Inf", [])):
        (tmp_path / "setup.xml").write_text(text.replace("</IKTaskSet>", "</IKTaskSet>" + more.format(weight)))
        found = {part.split(" (")[0] for part in read_ik_setup(tmp_path / "setup.xml").unused}
        assert found == {"<IKOrientationTask> imu", "<AnalyzeTool> second", *named}


@pytest.mark.parametrize("spec", [pytest.param(POSE, marks=pytest.mark.slow), TIGHT], ids=["pose", "motion"])
def test_known_joint_angles_come_back_within_the_soft_tissue_noise(
    station: Station, wearer: WearerSession, spec: object, tmp_path: Path
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

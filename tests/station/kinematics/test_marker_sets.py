"""Marker sets by name, and a lab's own. Markers that do not go with the model are refused, odd ones are findings."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from recordings.exchange.sample_tables import MarkerTable
from recordings.exchange.trc import read_trc, write_trc
from solver.bundled import bundled_model
from solver.errors import CoverageCode
from solver.inverse_kinematics.solve import TrackingTasks
from solver.osim.model_reader import read_osim
from solver.osim.tool_setups import read_ik_setup
from station.kinematics.ik import IkInputs, solve_postures
from station.kinematics.marker_checks import KinematicsError, find_in_markers
from station.kinematics.marker_sets import MarkerSetError, place_marker_set, read_marker_set
from station.kinematics.scale import ScaledBody, ScaleInputs, scale_body
from station.messages.kinematics_messages import KinematicsCode
from tests.refusals import raises_refusal
from tests.solver.references import SHARED
from tests.station.command import Station, assert_refused
from tests.station.kinematics.test_ik import TASK, run, trial, write_setup
from tests.station.kinematics.test_scale import PAIR, SETUP, on_humerus

MODEL = bundled_model()
OWN = """
title = "ours"
source = "the lab's protocol, 2026"
[markers]
STRN = { body = "thorax", location_m = [0.02, -0.05, 0.0] }
ELBL = { body = "humerus", same_as = ["EpL"] }
KNEE = { body = "humerus" }
HEEL = { body = "calcn" }
"""
BODIES = [("ac", "RShoulderTop", "scapula"), ("EpL", "RElbowOut", "humerus"), ("EpM", "RElbowIn", "humerus")]
Change = Callable[[MarkerTable], MarkerTable]
NAMES = [marker.name for marker in bundled_model().markers]
UNSEEN = [m.name for m in bundled_model().markers if m.body == bundled_model().body_index("scapula")][2:]
"""So that two markers of the scapula are left."""


@pytest.mark.parametrize("name", ["isb", "thoracoscapular", "qualisys_sports"])
def test_every_published_set_names_its_source_and_bodies_of_the_model(name: str) -> None:
    marker_set = read_marker_set(name)
    assert marker_set.source
    assert all(site.landmark for site in marker_set.markers.values())
    model, names, findings = place_marker_set(MODEL, name)
    assert KinematicsCode.ELSEWHERE not in [finding.code for finding in findings]
    assert len(names) >= 9
    for label in names:
        body = MODEL.bodies[model.marker(label).body].name
        assert body == marker_set.markers[label].body


def test_labels_of_isb_are_at_the_landmarks_of_the_model() -> None:
    model, _, _ = place_marker_set(MODEL, "isb")
    for label, name in (("IJ", "ij"), ("AA", "aa"), ("EL", "EpL")):
        np.testing.assert_array_equal(model.marker(label).location, MODEL.marker(name).location)


@pytest.mark.shared
def test_a_wrist_marker_that_a_published_model_has_on_the_ulna_stays_there_and_is_reported(tmp_path: Path) -> None:
    own = tmp_path / "own.toml"
    own.write_text('[markers]\nRS2 = { body = "radius" }\nEL = { body = "humerus" }', encoding="utf-8")
    patient = read_osim(SHARED / "subject" / "S8R_side_as_solved.osim")
    model, _, findings = place_marker_set(patient, str(own))
    assert {finding.code: finding.figures["markers"] for finding in findings}[KinematicsCode.ELSEWHERE] == "RS2"
    assert patient.bodies[model.marker("RS2").body].name == "ulna"


def test_a_labs_own_set_is_followed_and_markers_without_a_place_or_a_body_are_findings(tmp_path: Path) -> None:
    own = tmp_path / "own.toml"
    own.write_text(OWN, encoding="utf-8")
    names = {"ij": "STRN", "EpL": "ELBL", "EpM": "KNEE"}
    path = written_trial(
        tmp_path, lambda table: replace(table, labels=tuple(names.get(label, label) for label in table.labels))
    )
    whole = own.read_text(encoding="utf-8")
    others = [marker for marker in MODEL.markers if marker.name not in names]
    lines = [f'"{marker.name}" = {{ body = "{MODEL.bodies[marker.body].name}" }}' for marker in others]
    own.write_text(whole + "\n".join(lines), encoding="utf-8")
    solved = solve_postures(IkInputs("bundled", path, None, marker_set=str(own)))
    followed = [marker.name for marker in solved.tasks.markers]
    assert "ELBL" in followed and "KNEE" not in followed
    found = {each.code: each.figures for each in solved.findings}
    assert found[KinematicsCode.WITHOUT_PLACE]["markers"] == "KNEE"
    assert found[KinematicsCode.UNATTACHED] == {"file": str(own), "markers": "HEEL"}


@pytest.mark.parametrize(
    ("name", "text", "code"),
    [
        ("vicon", None, KinematicsCode.UNKNOWN_SET),
        ("own.toml", None, KinematicsCode.WRONG_SET),
        ("own.toml", "markers = 3", KinematicsCode.WRONG_SET),
        ("own.toml", '[markers]\nKNEE = { body = "femur" }', KinematicsCode.NO_BODY),
    ],
)
def test_a_set_that_is_none_is_refused(name: str, text: str | None, code: KinematicsCode, tmp_path: Path) -> None:
    path = str(tmp_path / name) if name.endswith(".toml") else name
    if text is not None:
        Path(path).write_text(text, encoding="utf-8")
    with raises_refusal(code, kind=MarkerSetError):
        place_marker_set(MODEL, path)


def test_one_marker_on_the_scapula_is_a_finding(tmp_path: Path) -> None:
    names = {"ac": "RShoulderTop", "EpL": "RElbowOut", "EpM": "RElbowIn"}

    def renamed(table: MarkerTable) -> MarkerTable:
        kept = [table.labels.index(label) for label in ("ij", "c7", "t8", *names)]
        labels = tuple(names.get(table.labels[index], table.labels[index]) for index in kept)
        return replace(table, labels=labels, positions=table.positions[:, kept], residuals=table.residuals[:, kept])

    path = written_trial(tmp_path, renamed)
    own = tmp_path / "own.toml"
    sites = {"ij": "thorax", "c7": "thorax", "t8": "thorax"}
    lines = [f'{label} = {{ body = "{body}" }}' for label, body in sites.items()]
    lines += [f'{ours} = {{ body = "{body}", same_as = ["{model}"] }}' for model, ours, body in BODIES]
    own.write_text("[markers]\n" + "\n".join(lines), encoding="utf-8")
    solved = solve_postures(IkInputs("bundled", path, None, marker_set=str(own)))
    assert CoverageCode.NO_SCAPULA_MARKERS in {finding.code for finding in solved.findings}


def test_what_was_solved_is_written_as_a_set_up_that_solves_the_same(tmp_path: Path, station: Station) -> None:
    trial(tmp_path, frames=6)
    words = ("--model", "bundled", "--markers", tmp_path / "trial.trc", "--output", tmp_path / "q.csv")
    code, _ = run(station, *words, "--from", "0.01", "--write-setup", tmp_path / "ik.xml")
    assert code == 0
    setup = read_ik_setup(tmp_path / "ik.xml")
    assert setup.time_range == (0.01, 0.05)
    assert setup.marker_file == tmp_path / "trial.trc"
    assert set(setup.markers) == {marker.name for marker in MODEL.markers}
    again = solve_postures(IkInputs("bundled", None, tmp_path / "ik.xml"))
    assert len(again.time) == 5


def shifted(table: MarkerTable, at: Any, by: object) -> MarkerTable:
    positions = table.positions.copy()
    positions[at] += by
    return replace(table, positions=positions)


def beside_another_person(table: MarkerTable) -> MarkerTable:
    labels = [f"{person}_{label}" for person in ("Anna", "Ben") for label in table.labels]
    positions = np.concatenate([table.positions, table.positions + 500.0], axis=1)
    return replace(table, labels=tuple(labels), positions=positions, residuals=np.zeros(positions.shape[:2]))


def unknown(table: MarkerTable) -> MarkerTable:
    return replace(table, labels=tuple(f"M{k}" for k in range(len(table.labels))))


BAD: dict[str, tuple[Change, KinematicsCode]] = {
    "mirrored": (lambda table: replace(table, positions=table.positions * [1, 1, -1]), KinematicsCode.MIRRORED),
    "halved": (lambda table: shifted(table, np.s_[:, ::2], np.nan), KinematicsCode.MARKERS_MISSING),
    "two persons": (lambda table: shifted(table, np.s_[:, ::2], [600.0, 0.0, 200.0]), KinematicsCode.NO_FIT),
    "another person": (beside_another_person, KinematicsCode.SEVERAL_PERSONS),
    "twice": (
        lambda table: replace(beside_another_person(table), labels=2 * table.labels),
        KinematicsCode.SEVERAL_PERSONS,
    ),
    "metres": (lambda table: replace(table, positions=1e-3 * table.positions), KinematicsCode.WRONG_SIZE),
    "unknown": (unknown, KinematicsCode.NONE_IN_COMMON),
    "unknown but one": (
        lambda table: replace(table, labels=(table.labels[0], *unknown(table).labels[1:])),
        KinematicsCode.ONE_IN_COMMON,
    ),
}


def written_trial(folder: Path, change: Change, frames: int = 8) -> Path:
    trial(folder, frames=frames)
    path = folder / "trial.trc"
    path.write_text(write_trc(change(read_trc(path, tracked=NAMES)), path.name), encoding="utf-8")
    return path


@pytest.mark.parametrize("bad", BAD)
def test_markers_that_do_not_go_with_the_model_are_refused(bad: str, tmp_path: Path) -> None:
    change, code = BAD[bad]
    with raises_refusal(code, kind=KinematicsError):
        solve_postures(IkInputs("bundled", written_trial(tmp_path, change), None))


def scale_arm(folder: Path, change: Change, *others: str) -> ScaledBody:
    """Scaled by the distances of the first marker on the humerus from these."""
    pairs = "".join(PAIR.format(one=on_humerus()[0], other=name) for name in others)
    (folder / "scale.xml").write_text(SETUP.format(pairs=pairs, axes="Y", range="-1 9"), encoding="utf-8")
    return scale_body(ScaleInputs(folder / "scale.xml", "bundled", written_trial(folder, change)))


@pytest.mark.parametrize("bad", ["mirrored", "two persons", "another person", "unknown"])
def test_a_body_is_not_scaled_by_them_either(bad: str, tmp_path: Path) -> None:
    change, code = BAD[bad]
    with raises_refusal(code, kind=KinematicsError):
        scale_arm(tmp_path, change, *(name for name in NAMES if name != on_humerus()[0]))


def test_a_pair_of_markers_that_is_much_too_far_apart_scales_nothing(tmp_path: Path) -> None:
    other = on_humerus()[1]

    def apart(table: MarkerTable) -> MarkerTable:
        return shifted(table, np.s_[:, table.labels.index(other)], [0.0, -335.0, 0.0])

    with raises_refusal(KinematicsCode.WRONG_FACTOR, kind=KinematicsError):
        scale_arm(tmp_path, apart, other)


def test_the_verb_ends_with_1_in_one_line_and_writes_nothing(tmp_path: Path, station: Station) -> None:
    path = written_trial(tmp_path, BAD["mirrored"][0])
    ran = station("ik", "--model", "bundled", "--markers", path, "--output", tmp_path / "q.mot")
    assert_refused(ran, 1, KinematicsCode.MIRRORED)
    assert [found.name for found in tmp_path.iterdir()] == ["trial.trc"]


def test_markers_exchanged_for_a_fifth_of_a_second_are_a_finding(tmp_path: Path, station: Station) -> None:
    one, other = (NAMES.index(name) for name in ("EpL", "ai"))

    def exchanged(table: MarkerTable) -> MarkerTable:
        positions = table.positions.copy()
        positions[20:40, [one, other]] = table.positions[20:40, [other, one]]
        return replace(table, positions=positions)

    path = written_trial(tmp_path, exchanged, frames=60)
    code, _ = run(station, "--model", "bundled", "--markers", path, "--output", tmp_path / "q.mot")
    assert code == 3
    found = figures_of_one(KinematicsCode.EXCHANGED, tmp_path / "q_ik.json")
    assert {found["one"], found["other"]} == {"EpL", "ai"}
    assert (found["from_s"], found["to_s"]) == pytest.approx((0.2, 0.4))


def test_a_pair_that_is_exchanged_again_and_again_is_one_finding() -> None:
    markers, time = bundled_model().markers, np.arange(200) / 100
    places = np.random.default_rng(3).normal(size=(len(markers), 3))
    observed = places + 0.01 * np.sin(time)[:, None, None]
    for start in range(10, 190, 20):
        observed[start : start + 5, [2, 4]] = observed[start : start + 5, [4, 2]]
    tasks = TrackingTasks(markers, np.ones(len(markers)))
    (finding,) = find_in_markers(time, tasks, observed)
    assert finding.code == KinematicsCode.EXCHANGED
    assert finding.figures["count"] == 9
    assert (finding.figures["from_s"], finding.figures["to_s"]) == pytest.approx((0.1, 1.75))


def figures_of_one(code: KinematicsCode, report: Path) -> dict[str, Any]:
    """Figures of the only finding with this code in the report of `station ik`."""
    findings = json.loads(report.read_text(encoding="utf-8"))["findings"]
    (found,) = [finding["figures"] for finding in findings if finding["code"] == code]
    return found


def hidden(*labels: str) -> Change:
    return lambda table: shifted(table, np.s_[:, [table.labels.index(label) for label in labels]], np.nan)


def test_a_marker_that_no_frame_shows_is_a_finding_and_does_not_cover_its_segment(tmp_path: Path) -> None:
    def misspelt(table: MarkerTable) -> MarkerTable:
        return replace(table, labels=tuple("AAA" if name == "aa" else name for name in table.labels))

    write_setup(tmp_path / "ik.xml", "-1 9")
    for change, never_seen, is_covered in (
        (lambda table: table, [], True),
        (misspelt, ["aa"], True),
        (hidden(*UNSEEN), sorted(UNSEEN), False),
    ):
        solved = solve_postures(IkInputs("bundled", written_trial(tmp_path, change), tmp_path / "ik.xml"))
        found = {finding.code: finding.figures for finding in solved.findings}
        assert found.get(KinematicsCode.NEVER_SEEN) == ({"markers": ", ".join(never_seen)} if never_seen else None)
        assert (CoverageCode.FEW_SCAPULA_MARKERS not in found) == is_covered


def test_a_body_is_scaled_with_a_finding_on_a_marker_that_no_frame_shows(tmp_path: Path) -> None:
    one = on_humerus()[0]
    pairs = "".join(PAIR.format(one=one, other=name) for name in NAMES if name not in (one, *UNSEEN))
    placed = "".join(TASK.format(name=name, weight=1) for name in NAMES)
    placer = (
        f"<MarkerPlacer><time_range>-1 9</time_range><IKTaskSet><objects>{placed}</objects></IKTaskSet></MarkerPlacer>"
    )
    text = SETUP.format(pairs=pairs, axes="Y", range="-1 9").replace("</ScaleTool>", f"{placer}</ScaleTool>")
    (tmp_path / "scale.xml").write_text(text, encoding="utf-8")

    def still(table: MarkerTable) -> MarkerTable:
        return hidden(*UNSEEN)(replace(table, positions=np.repeat(table.positions[:1], 8, axis=0)))

    body = scale_body(ScaleInputs(tmp_path / "scale.xml", "bundled", written_trial(tmp_path, still)))
    found = {finding.code: finding.figures for finding in body.findings}
    assert found[KinematicsCode.NEVER_SEEN] == {"markers": ", ".join(sorted(UNSEEN))}
    assert CoverageCode.FEW_SCAPULA_MARKERS in found


def test_one_position_far_from_the_body_is_a_finding_with_its_time(tmp_path: Path, station: Station) -> None:
    far = np.s_[20, NAMES.index("aa")]
    path = written_trial(tmp_path, lambda table: shifted(table, far, 9999.0), frames=60)
    code, _ = run(station, "--model", "bundled", "--markers", path, "--output", tmp_path / "q.mot")
    assert code == 3
    found = figures_of_one(KinematicsCode.FAR, tmp_path / "q_ik.json")
    assert (found["marker"], found["frames"]) == ("aa", 1)
    assert found["first_s"] == pytest.approx(0.2)


def test_a_prefix_chooses_one_of_two_persons_and_the_only_one_is_taken_off(tmp_path: Path) -> None:
    trial(tmp_path, frames=8)
    alone = solve_postures(IkInputs("bundled", tmp_path / "trial.trc", None))
    path = written_trial(tmp_path, beside_another_person)
    chosen = solve_postures(IkInputs("bundled", path, None, prefix="Anna_"))
    np.testing.assert_allclose(chosen.solution.coordinates, alone.solution.coordinates, atol=1e-9)

    path = written_trial(
        tmp_path, lambda table: replace(table, labels=tuple(f"Anna_{label}" for label in table.labels))
    )
    only = solve_postures(IkInputs("bundled", path, None))
    np.testing.assert_allclose(only.solution.coordinates, alone.solution.coordinates, atol=1e-9)
    assert any("Anna_" in note for note in only.notes)


@pytest.mark.parametrize("change", [lambda table: table, beside_another_person])
def test_a_prefix_that_no_label_has_is_refused(change: Change, tmp_path: Path) -> None:
    """Before, labels without it were taken, and the origin among them was lost."""
    path = written_trial(tmp_path, change)
    with raises_refusal(KinematicsCode.NO_SUCH_PREFIX, kind=KinematicsError):
        solve_postures(IkInputs("bundled", path, None, prefix="Anne_"))


def test_a_file_with_z_up_is_a_finding_and_is_turned_on_request(tmp_path: Path) -> None:
    trial(tmp_path, frames=8)
    alone = solve_postures(IkInputs("bundled", tmp_path / "trial.trc", None))
    path = written_trial(tmp_path, lambda table: replace(table, positions=table.positions[:, :, [2, 0, 1]]))
    lying = solve_postures(IkInputs("bundled", path, None))
    assert KinematicsCode.TILTED in {finding.code for finding in lying.findings}
    upright = solve_postures(IkInputs("bundled", path, None, vertical="z"))
    assert KinematicsCode.TILTED not in {finding.code for finding in upright.findings}
    np.testing.assert_allclose(upright.solution.cost, alone.solution.cost, atol=1e-12)

"""Motions that contradict the model: the wrong coordinates are named with their values, and no others."""

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import cuffstation as cs
from solver.model import Model
from solver.motion import Kinematics, Motion, differentiate, read_motion
from solver.osim.loads_document import read_external_loads
from solver.osim.model_reader import read_osim
from solver.time_series_table import read_table, write_table
from station.assessment.given_motion import (
    ANGLE_TOLERANCE,
    MotionCut,
    MuscleInputs,
    load_checks,
    motion_checks,
    motion_findings,
    read_given_motion,
)
from station.messages.assessment_messages import AssessmentCode
from tests.solver.legs import LEG, PELVIS, Step, step_angles, step_in
from tests.solver.published import TRIALS, trial
from tests.station.command import Station

OFF = "<appliesForce>false</appliesForce>"
ALL = (*PELVIS, *LEG, "patella_angle")
ANGLES = tuple(name for name in ALL if not name.startswith("pelvis_t") or name == "pelvis_tilt")
MISSING = {"without_data": "toe_angle"}  # which is locked


@pytest.fixture(scope="module")
def step(tmp_path_factory: pytest.TempPathFactory) -> Step:
    return step_in(tmp_path_factory.mktemp("step"))


def write_angles(path: Path, unit: float, *columns: str, header: str = "") -> Path:
    """The step with these columns times `unit`, under a header of radians."""
    time = np.arange(81) / 100
    table = step_angles(time)
    rows = np.column_stack([time, *(table[name] * (unit if name in columns else 1.0) for name in ALL)])
    lines = [f"step\nversion=1\nnRows={len(rows)}\nnColumns={len(ALL) + 1}\n{header or 'inDegrees=no'}\nendheader"]
    lines += ["\t".join(("time", *ALL)), *("\t".join(map(repr, map(float, row))) for row in rows)]
    path.write_text("\n".join(lines) + "\n")
    return path


def flexed(model: Model, angle: np.ndarray) -> np.ndarray:
    """Coordinates of every frame: this flexion of the hip, and the defaults."""
    angles = np.tile(model.default_coordinates, (len(angle), 1))
    angles[:, model.coordinate_index("hip_flexion")] = angle
    return angles


def minimum_jerk(part: np.ndarray) -> np.ndarray:
    """A reach from 0 to 1 (Flash and Hogan 1985)."""
    return 10 * part**3 - 15 * part**4 + 6 * part**5


def kinematics_of(step: Step, path: Path, cutoff: float | None = None) -> Kinematics:
    return differentiate(read_motion(path, read_osim(step.model), with_defaults=True), cutoff)


@pytest.mark.parametrize(
    ("moments", "note"),
    [
        ((0.001, 1.0, 0.001), "foot 0.001, 0.001, 1 kg m²"),
        ((0.001, 0.01, 0.001), ""),  # as of published models
        ((0.0, 1.0, 0.0), ""),  # of a body that moves in a plane
    ],
)
def test_impossible_moments_of_inertia_are_named(step: Step, moments: tuple[float, float, float], note: str) -> None:
    model = read_osim(step.model)
    bodies = tuple(replace(one, inertia=np.diag(moments)) if one.name == "foot" else one for one in model.bodies)
    notes = motion_checks(replace(model, bodies=bodies), kinematics_of(step, step.motion))
    assert notes == MISSING | ({"impossible_inertia": note} if note else {})


@pytest.mark.parametrize("cutoff", [None, 3.0, 6.0])
def test_a_right_motion_has_no_notes_also_after_a_filter(step: Step, cutoff: float | None) -> None:
    assert motion_checks(read_osim(step.model), kinematics_of(step, step.motion, cutoff)) == MISSING
    assert motion_findings({}) == []


@pytest.mark.parametrize(
    ("frequency", "seconds", "cutoff", "is_low"),
    [(0.5, 4.0, 3, False), (0.8, 4.0, 3, True), (1.2, 2.0, 6, False), (1.2, 2.0, None, False)],
)
def test_a_low_cutoff_is_named(step: Step, frequency: float, seconds: float, cutoff: int | None, is_low: bool) -> None:
    """The mean frequency of a sine is its frequency."""
    model, time = read_osim(step.model), np.arange(0, seconds, 0.01)
    angles = flexed(model, 0.4 * np.sin(2 * np.pi * frequency * time))
    noise = np.random.default_rng(3).normal(0.0, 0.01, len(time))
    angles[:, model.coordinate_index("hip_adduction")] = noise
    notes = motion_checks(model, differentiate(Motion(model.coordinate_names, time, angles), cutoff))
    found = re.fullmatch(rf"cut-off {cutoff} Hz, mean frequency of the angles (.*) Hz", notes.get("low_cutoff", ""))
    assert (found is not None) == is_low
    assert found is None or float(found[1]) == pytest.approx(frequency, rel=0.05)


@pytest.mark.parametrize(
    ("duration", "rest", "cutoff"),
    [(0.5, 0.5, 3), (0.5, 3.0, 3), (0.5, 0.0, 3), (0.5, 0.5, 6), (1.5, 0.5, 3), (3.0, 0.0, 3)],
)
def test_the_cutoff_is_low_if_a_reach_loses_a_tenth(step: Step, duration: float, rest: float, cutoff: int) -> None:
    """The accelerations of the reach are known. Rest is before and after."""
    model, time = read_osim(step.model), np.arange(0, duration + 2.0, 0.01)
    part = np.clip((time - 1.0) / duration, 0.0, 1.0)
    noise = np.random.default_rng(3).normal(0.0, 2e-3, len(time))
    true = (60 * part - 180 * part**2 + 120 * part**3) / duration**2
    hip, angles = model.coordinate_index("hip_flexion"), flexed(model, minimum_jerk(part))
    kept = (1.0 - rest, 1.0 + duration + rest)
    motion = Motion(model.coordinate_names, time, angles)
    filtered, whole = (differentiate(motion, float(cutoff), *limits) for limits in (kept, (None, None)))
    lost = np.linalg.norm(whole.accelerations[:, hip] - true) / np.linalg.norm(true)
    angles[:, hip] += noise
    notes = [motion_checks(model, one) for one in (filtered, differentiate(motion, float(cutoff), *kept))]
    assert [("low_cutoff" in found) for found in notes] == [lost > 0.1] * 2


@pytest.mark.shared
@pytest.mark.parametrize(("name", "weight"), [(name, weight) for name, weight, _ in TRIALS])
def test_the_filter_of_the_published_study_is_right_for_its_lifts(name: str, weight: str) -> None:
    model, kinematics = trial(name, weight)
    assert kinematics.cutoff == 3.0
    assert "low_cutoff" not in motion_checks(model, kinematics)


def test_a_piece_of_a_slow_motion_and_one_at_rest_have_no_low_cutoff(step: Step) -> None:
    """0.2 s of a lift of 6 s is a ramp, whose angles vary little about their mean."""
    model, time = read_osim(step.model), np.arange(0, 6, 0.01)
    angles = flexed(model, 0.5 - 0.5 * np.cos(np.pi * time / 3))
    piece = differentiate(Motion(model.coordinate_names, time, angles), 3.0, 1.0, 1.2)
    assert "low_cutoff" not in motion_checks(model, piece)
    # nor one in which nothing moves
    noise = np.random.default_rng(3).normal(0.0, 1e-9, (len(time), len(model.coordinates)))
    still = Motion(model.coordinate_names, time, model.default_coordinates + noise)
    assert "low_cutoff" not in motion_checks(model, differentiate(still, 3.0))


@pytest.mark.parametrize("every", [1, 10, 40])
def test_the_cutoff_is_low_whatever_frames_are_solved(step: Step, tmp_path: Path, every: int) -> None:
    """A reach of 0.5 s, whose rest of 0.3 s before and after has no frame among those that are solved."""
    model, time = read_osim(step.model), np.arange(0, 1.1, 0.01)
    part = np.clip((time - 0.3) / 0.5, 0.0, 1.0)
    write_table(tmp_path / "reach.sto", model.coordinate_names, time, flexed(model, minimum_jerk(part)))
    inputs, cut = MuscleInputs(tmp_path / "reach.sto", str(step.model)), MotionCut(3.0, every=every)
    assert "low_cutoff" in read_given_motion(inputs, cut).notes


def test_a_patella_in_degrees_violates_its_coupler_by_the_difference(step: Step, tmp_path: Path) -> None:
    path = write_angles(tmp_path / "beta.sto", 180 / np.pi, "patella_angle")
    angle = step_angles(np.arange(81) / 100)["patella_angle"]
    notes = motion_checks(read_osim(step.model), kinematics_of(step, path))
    expected = np.abs(angle * (180 / np.pi - 1)).max()
    assert notes == MISSING | {"violates_constraint": f"patella_angle {expected:.3g} rad"}


@pytest.mark.parametrize(("share", "is_named"), [(0.9, False), (1.1, True)])
def test_a_lock_is_violated_beyond_the_tolerance(step: Step, share: float, is_named: bool) -> None:
    model, kinematics = read_osim(step.model), kinematics_of(step, step.motion)
    positions = kinematics.positions.copy()
    positions[7, model.coordinate_index("toe_angle")] = -share * ANGLE_TOLERANCE
    notes = motion_checks(model, replace(kinematics, positions=positions))
    assert ("toe_angle" in notes.get("violates_constraint", "")) == is_named


def test_degrees_under_a_header_of_radians_are_beyond_the_range(step: Step, tmp_path: Path) -> None:
    wrong = write_angles(tmp_path / "wrong.mot", 180 / np.pi, *ANGLES)
    notes = motion_checks(read_osim(step.model), kinematics_of(step, wrong))
    worst, *_ = notes["beyond_range"].split(", ")
    knee = np.degrees(step_angles(np.arange(81) / 100)["knee_angle"]).min()
    assert worst == f"knee_angle {knee:.3g} rad"
    assert "pelvis_t" not in notes["beyond_range"]  # at most 6 of a range of ±10
    right = write_angles(tmp_path / "right.mot", 180 / np.pi, *ANGLES, header="inDegrees=yes")
    assert motion_checks(read_osim(step.model), kinematics_of(step, right)) == MISSING


@pytest.mark.parametrize(
    ("limits", "unit", "is_named"),
    [
        ((-10, 10), 1e3, True),
        ((-10, 10), 1, False),
        ((-99999.9, 99999.9), 1e3, True),
        ((0.5, 1.2), 10, True),
        ((-3.14, 3.14), 36, True),  # as of a coordinate at 36 mm
    ],
)
def test_a_translation_in_millimetres_is_named(
    step: Step, tmp_path: Path, limits: tuple[float, float], unit: float, is_named: bool
) -> None:
    model = read_osim(step.model)
    ranges = {"pelvis_ty": limits}
    coordinates = tuple(replace(one, range=ranges.get(one.name, one.range)) for one in model.coordinates)
    path = write_angles(tmp_path / "mm.sto", unit, "pelvis_ty")
    notes = motion_checks(replace(model, coordinates=coordinates), kinematics_of(step, path))
    heights = unit * step_angles(np.arange(81) / 100)["pelvis_ty"]
    expected = {"translation_beyond_range": f"pelvis_ty {heights.max():.3g} m"}
    assert notes == MISSING | (expected if is_named else {})
    codes = [finding.code for finding in motion_findings(notes)]
    assert codes == [AssessmentCode.WITHOUT_DATA] + [AssessmentCode.TRANSLATION_BEYOND_RANGE] * is_named


def test_a_translation_in_millimetres_is_named_also_in_a_model_that_opensim_scaled(step: Step, tmp_path: Path) -> None:
    line = "<LinearFunction><coefficients>1 0</coefficients></LinearFunction>"
    scaled = f"<MultiplierFunction><function>{line}</function><scale>1</scale></MultiplierFunction>"
    head, axis, tail = step.model.read_text().partition("<coordinates>pelvis_ty</coordinates><axis>0 1 0</axis>")
    model = tmp_path / "scaled.osim"
    model.write_text(head + axis + tail.replace(line, scaled, 1))
    assert next(one for one in read_osim(model).coordinates if one.name == "pelvis_ty").motion == "coupled"
    motion = read_motion(write_angles(tmp_path / "mm.sto", 1e3, "pelvis_ty"), read_osim(model), with_defaults=True)
    notes = motion_checks(read_osim(model), differentiate(motion, None))
    assert notes == MISSING | {"translation_beyond_range": "pelvis_ty 945 m"}


@pytest.mark.parametrize(("unit", "is_named"), [(1.0, True), (180 / np.pi, False)])
def test_radians_under_a_header_of_degrees_are_named(step: Step, tmp_path: Path, unit: float, is_named: bool) -> None:
    path = write_angles(tmp_path / "step.mot", unit, *ANGLES, header="inDegrees=yes")
    largest = max(np.abs(step_angles(np.arange(81) / 100)[name]).max() for name in ANGLES)
    notes = motion_checks(read_osim(step.model), kinematics_of(step, path))
    assert notes.get("radians_as_degrees") == (f"{largest:.3g}" if is_named else None)
    codes = [finding.code for finding in motion_findings(notes)]
    assert (AssessmentCode.RADIANS_AS_DEGREES in codes) == is_named


def test_loads_in_millimetres_on_the_ground_or_of_unused_files_are_named(tmp_path: Path) -> None:
    step = step_in(tmp_path)
    model, kinematics = read_osim(step.model), kinematics_of(step, step.motion)
    loads = read_external_loads(step.loads, model, kinematics.time)
    assert load_checks(step.loads, loads, model, kinematics) == {}
    wrong = replace(loads[0], point=1e3 * loads[0].point)
    notes = load_checks(step.loads, [wrong], model, kinematics)
    name, distance, *where = notes["load_far_from_body"].split()
    assert (name, *where) == ("plate", "m", "from", "foot")
    is_pressed = wrong.force[:, 1] > 0.1 * wrong.force[:, 1].max()  # the foot is within 2 m of the ground's origin
    assert float(distance) == pytest.approx(np.linalg.norm(wrong.point, axis=1)[is_pressed].max(), abs=40.0)
    assert [finding.code for finding in motion_findings(notes)] == [AssessmentCode.LOAD_FAR_FROM_BODY]
    text = step.loads.read_text()
    kept = "<external_loads_model_kinematics_file>a.mot</external_loads_model_kinematics_file><datafile>C:\\lab\\"
    step.loads.write_text(re.sub(r"(<applied_to_body>)[^<]+", r"\1ground", text).replace("<datafile>", kept))
    loads = read_external_loads(step.loads, model, kinematics.time)
    codes = [finding.code for finding in motion_findings(load_checks(step.loads, loads, model, kinematics))]
    assert codes == [AssessmentCode.LOAD_ON_GROUND, AssessmentCode.LOADS_DATA_ELSEWHERE, AssessmentCode.LOADS_UNUSED]


def by_both_verbs(station: Station, step: Step, motion: Path, *words: object) -> Iterator[tuple[str, str]]:
    """What `station id` and `station rmr` say on stderr, and what they write."""
    solving = ("--joint", "thigh_joint", "--no-glenoid", "--actuators", step.actuators)
    for verb, options in (("id", ()), ("rmr", solving)):
        output = step.motion.with_name(f"{verb}_of_{motion.stem}.sto")
        ran = station(verb, "--model", step.model, "--motion", motion, *words, *options, "--output", output)
        assert ran.code == 0, ran.err
        yield ran.err, output.read_text()


@pytest.mark.parametrize(
    ("start", "end", "missing"),
    [(0.78, 2, "to 2 s, "), (-1, 0.02, "from -1 s, "), (0.79, 0.805, ""), (-0.005, 0.01, "")],
)
def test_both_verbs_report_a_short_motion(station: Station, step: Step, start: float, end: float, missing: str) -> None:
    note = f"{missing}the motion lasts from 0 to 0.8 s"
    for err, written in by_both_verbs(station, step, step.motion, "--from", start, "--to", end):
        assert (note in err) == (f"range_not_covered={note}" in written) == bool(missing)
        assert bool(missing) == ("range_not_covered" in written)


def test_both_verbs_report_and_store_what_is_wrong_with_motion_and_loads(station: Station, tmp_path: Path) -> None:
    """Degrees under a header of radians in uneven steps, two rows less than the header has, and a load that is off."""
    step = step_in(tmp_path)
    right = tmp_path / "right.sto"
    right.write_text("\n".join(step.motion.read_text().splitlines()[:-2]) + "\n")
    findings = cs.load_motion(cs.load_model(step.model), right).findings
    assert [finding.code for finding in findings] == [AssessmentCode.WITHOUT_DATA, AssessmentCode.ROW_COUNTS]
    angles = (name for name in ALL if not name.startswith("pelvis"))
    names, table, _ = read_table(motion := write_angles(tmp_path / "wrong.sto", 180 / np.pi, *angles))
    write_table(motion, names[1:], table[:, 0] + np.where(np.arange(81) % 2, 2e-3, 0.0), table[:, 1:])
    motion.write_text("\n".join(motion.read_text().splitlines()[:-2]) + "\n")
    step.loads.write_text(step.loads.read_text().replace("</ExternalForce>", f"{OFF}</ExternalForce>"))
    words = ("--external-loads", step.loads, "--from", 0.2, "--to", 0.22)
    for err, written in by_both_verbs(station, step, motion, *words):
        for said in ("patella_angle", "knee_angle", "inDegrees=yes", "nRows 81, found 79", "0.008 to 0.012 s"):
            assert said in err
        assert "No external load is applied: loads.xml" in err
        for note in ("violates_constraint=patella_angle", "beyond_range=", "row_counts=nRows 81, found 79"):
            assert note in written
        assert "no_load_applied=loads.xml" in written and "resampled_from_s=0.008 to 0.012" in written


def test_elastic_tendons_refuse_to_leave_out_frames(station: Station, step: Step, tmp_path: Path) -> None:
    output = tmp_path / "a.csv"
    ran = station("rmr", "--model", step.model, "--tendons", "elastic", "--every", 5, "--output", output)
    assert ran.code == 2
    assert "--every" in ran.err
    static = station("rmr", "--model", step.model, "--tendons", "elastic", "--static-optimisation", "--output", output)
    assert static.code == 2
    assert "--static-optimisation" in static.err
    assert not output.exists()

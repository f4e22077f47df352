"""Motions that contradict the model: the wrong coordinates are named with their values, and no others."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from solver.motion import Kinematics, differentiate, read_motion
from solver.osim.reader import read_osim
from station.assessment.motion_checks import ANGLE_TOLERANCE, describe_motion_checks, motion_checks
from tests.solver.legs import LEG, PELVIS, Step, step_angles, step_in
from tests.station.command import Ran

Station = Callable[..., Ran]
ALL = (*PELVIS, *LEG, "patella_angle")


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


def kinematics_of(step: Step, path: Path, cutoff: float | None = None) -> Kinematics:
    return differentiate(read_motion(path, read_osim(step.model), with_defaults=True), cutoff)


@pytest.mark.parametrize("cutoff", [None, 3.0, 6.0])
def test_a_right_motion_has_no_notes_also_after_a_filter(step: Step, cutoff: float | None) -> None:
    assert motion_checks(read_osim(step.model), kinematics_of(step, step.motion, cutoff)) == {}
    assert describe_motion_checks({}) == []


def test_a_patella_in_degrees_violates_its_coupler_by_the_difference(step: Step, tmp_path: Path) -> None:
    path = write_angles(tmp_path / "beta.sto", 180 / np.pi, "patella_angle")
    angle = step_angles(np.arange(81) / 100)["patella_angle"]
    notes = motion_checks(read_osim(step.model), kinematics_of(step, path))
    expected = np.abs(angle * (180 / np.pi - 1)).max()
    assert notes == {"violates_constraint": f"patella_angle {expected:.3g} rad"}


@pytest.mark.parametrize(("share", "is_named"), [(0.9, False), (1.1, True)])
def test_a_lock_is_violated_beyond_the_tolerance(step: Step, share: float, is_named: bool) -> None:
    model, kinematics = read_osim(step.model), kinematics_of(step, step.motion)
    positions = kinematics.positions.copy()
    positions[7, model.coordinate_index("toe_angle")] = -share * ANGLE_TOLERANCE
    notes = motion_checks(model, replace(kinematics, positions=positions))
    assert ("toe_angle" in notes.get("violates_constraint", "")) == is_named


def test_degrees_under_a_header_of_radians_are_beyond_the_range_and_a_header_of_degrees_is_right(
    step: Step, tmp_path: Path
) -> None:
    angles = tuple(name for name in ALL if not name.startswith("pelvis_t") or name == "pelvis_tilt")
    wrong = write_angles(tmp_path / "wrong.mot", 180 / np.pi, *angles)
    notes = motion_checks(read_osim(step.model), kinematics_of(step, wrong))
    worst, *_ = notes["beyond_range"].split(", ")
    knee = np.degrees(step_angles(np.arange(81) / 100)["knee_angle"]).min()
    assert worst == f"knee_angle {knee:.3g} rad"
    assert "pelvis_t" not in notes["beyond_range"]  # at most 6 of a range of ±10
    right = write_angles(tmp_path / "right.mot", 180 / np.pi, *angles, header="inDegrees=yes")
    assert motion_checks(read_osim(step.model), kinematics_of(step, right)) == {}


def test_both_verbs_warn_and_keep_the_notes(station: Station, step: Step, tmp_path: Path) -> None:
    angles = tuple(name for name in ALL if not name.startswith("pelvis"))
    motion = write_angles(tmp_path / "wrong.sto", 180 / np.pi, *angles)
    common = ("--model", step.model, "--motion", motion, "--from", 0.2, "--to", 0.22)
    moments, output = tmp_path / "id.sto", tmp_path / "a.csv"
    ran = station("id", *common, "--output", moments)
    assert ran.code == 0
    solving = ("--joint", "thigh_joint", "--no-glenoid", "--actuators", step.actuators)
    solved = station("rmr", *common, *solving, "--output", output)
    for err, table in ((ran.err, moments), (solved.err, output)):
        for name in ("patella_angle", "knee_angle", "inDegrees=yes"):
            assert name in err
        assert "violates_constraint=patella_angle" in table.read_text()
        assert "beyond_range=" in table.read_text()


def test_elastic_tendons_refuse_to_leave_out_frames(station: Station, step: Step, tmp_path: Path) -> None:
    output = tmp_path / "a.csv"
    ran = station("rmr", "--model", step.model, "--tendons", "elastic", "--every", 5, "--output", output)
    assert ran.code == 2
    assert "--every" in ran.err
    assert not output.exists()

"""The in-vivo table: published figures from the published files themselves, ours within the limits, faults by code."""

import csv
import io
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.interpolate import CubicSpline

from recordings.errors import RecordingCode
from solver.redundancy.mechanics import force_agreement
from station.exit_code import DONE, FAILED, LOSSY, WRONG_USAGE
from station.messages.assessment_messages import AssessmentCode
from station.messages.setup_messages import FolderCode
from station.messages.study_messages import ValidationCode
from station.validation.lifts import (
    GLENOID,
    PUBLISHED_VARIANTS,
    SolvedVariant,
    ValidationFileError,
    find_lifts,
    lift_findings,
    read_lift,
    read_published_force,
    solve_variant,
    validate_folder,
    verdicts,
    write_validation,
)
from tests.conftest import SHARED
from tests.refusals import raises_refusal
from tests.station.command import Station, assert_refused

SUBJECT = SHARED / "subject"
VARIANTS = ("none", "circle", "ellipse")
PUBLISHED = {
    ("S8R_side", "none"): (35.7, 63.8),
    ("S8R_side", "circle"): (17.9, 41.6),
    ("S8R_side", "ellipse"): (19.1, 44.8),
    ("S8R_back", "none"): (15.1, 55.8),
    ("S8R_back", "circle"): (32.1, 25.8),
    ("S8R_back", "ellipse"): (27.6, 30.3),
}
"""RMSE of the published forces [% of body weight], and their median angle to the measured one [deg], with the posture
of the scapula by OpenSim 4.6.
"""
OWN_LIMITS = {"S8R_side": 20.0, "S8R_back": 41.0}


@pytest.fixture(scope="module")
def solved() -> list[SolvedVariant]:
    found, refused = validate_folder(SUBJECT)
    assert not refused
    return found


def by_pandas(lift: str, variant: str) -> tuple[float, float]:
    """RMSE [N] and r of a published force, by pandas alone."""
    published = pd.read_csv(SUBJECT / f"{lift}_published_{variant}.txt")
    text = (SUBJECT / f"{lift}_measured_force.txt").read_text(encoding="latin-1")
    rows = text[text.index("[0/1]") + len("[0/1]") :]
    measured = pd.read_csv(io.StringIO(rows), sep=r"\s+", header=None)
    measured = measured[measured[measured.columns[-1]] == 1].reset_index(drop=True)
    size = (published[["Fx", "Fy", "Fz"]] ** 2).sum(axis=1) ** 0.5
    truth = pd.Series(np.interp(published["time"], measured[0] - measured[0][0], measured[4]))
    return float(((size - truth) ** 2).mean() ** 0.5), float(size.corr(truth))


def change_rows(path: Path, change: Callable[[list[str]], list[str]]) -> None:
    """Of an OpenSim table, its titles and every row."""
    head, mark, table = path.read_text(encoding="utf-8").partition("endheader\n")
    rows = ["\t".join(change(row.split())) for row in table.splitlines()]
    path.write_text("\n".join([head + mark.strip(), *rows]) + "\n", encoding="utf-8")


def keep_lines(path: Path, count: int) -> None:
    """Cut a text file behind its first lines."""
    path.write_text("\n".join(path.read_text(encoding="utf-8").splitlines()[:count]) + "\n", encoding="utf-8")


@pytest.mark.shared
def test_the_published_figures_are_those_of_the_published_files(solved: list[SolvedVariant]) -> None:
    found = {(one.lift, one.variant): one for one in solved if one.published}
    assert set(found) == set(PUBLISHED)
    for (lift, variant), of in found.items():
        rmse, correlation = by_pandas(lift, variant)
        percent, angle_deg = PUBLISHED[lift, variant]
        assert of.published.rmse == pytest.approx(rmse, rel=1e-9)
        assert of.published.correlation == pytest.approx(correlation, abs=1e-9)
        assert of.published_rmse_percent == pytest.approx(percent, abs=0.05)
        assert np.degrees(of.angle) == pytest.approx(angle_deg, abs=1.0)


@pytest.mark.shared
def test_variants_are_the_published_ones_and_the_defaults_agree_with_the_force(solved: list[SolvedVariant]) -> None:
    for found in solved:
        assert found.unsolved == 0
        if found.variant in VARIANTS:
            assert found.median_difference is not None and found.published_rmse_percent is not None
            assert found.median_difference <= 5.0
            assert found.rmse_percent <= found.published_rmse_percent + 1.0
            assert found.is_within_limits
    assert [verdict.code for verdict in verdicts(solved)] == [ValidationCode.WITHIN_LIMITS]
    found = {one.lift: one for one in solved if one.variant == "defaults"}
    for lift, limit in OWN_LIMITS.items():
        assert found[lift].rmse_percent <= limit
        assert found[lift].agreement.correlation >= 0.94
        assert found[lift].is_within_limits is None


@pytest.mark.shared
def test_verdicts_have_codes(solved: list[SolvedVariant]) -> None:
    """What cannot be compared with a publication is not judged."""

    def codes(**changes: object) -> list[ValidationCode]:
        return [verdict.code for verdict in verdicts([replace(solved[0], **changes)])]  # type: ignore[arg-type]

    assert codes() == [ValidationCode.WITHIN_LIMITS]
    assert codes(median_difference=5.1) == [ValidationCode.BEYOND_LIMITS]
    agreement = solved[0].agreement
    assert codes(published=None, median_difference=None) == [ValidationCode.NOTHING_PUBLISHED]
    assert codes(is_whole=False) == [ValidationCode.PARTLY_PUBLISHED, ValidationCode.WITHIN_LIMITS]
    assert codes(unsolved=3) == [ValidationCode.UNSOLVED, ValidationCode.WITHIN_LIMITS]
    lower = replace(agreement, correlation=0.5)
    assert codes(agreement=lower) == [ValidationCode.LOW_CORRELATION, ValidationCode.WITHIN_LIMITS]
    larger = replace(agreement, rmse=agreement.rmse + 0.02 * solved[0].body_weight)
    assert codes(agreement=larger) == [ValidationCode.BEYOND_LIMITS]


@pytest.mark.shared
def test_a_published_solution_of_another_time_is_refused() -> None:
    lift = read_lift(SUBJECT, "S8R_back", ("none",))
    published = lift.published["none"]
    later = replace(lift, published={"none": replace(published, time=published.time + 100.0)})
    with raises_refusal(ValidationCode.TIMES_DIFFER, kind=ValidationFileError):
        solve_variant(later, PUBLISHED_VARIANTS[0])


@pytest.mark.shared
def test_the_csv_has_a_row_per_lift_and_variant(solved: list[SolvedVariant], tmp_path: Path) -> None:
    write_validation(tmp_path / "validation.csv", solved)
    rows = list(csv.DictReader((tmp_path / "validation.csv").read_text(encoding="utf-8").splitlines()))
    assert [(row["lift"], row["variant"]) for row in rows] == [(one.lift, one.variant) for one in solved]
    for row, variant in zip(rows, solved, strict=True):
        assert float(row["rmse_percent_of_body_weight"]) == pytest.approx(variant.rmse_percent, rel=1e-5)
        assert (row["median_difference_from_published_n"] == "") == (variant.published is None)


@pytest.mark.shared
def test_the_command_fails_beyond_the_limits_and_reports_a_cut_motion(station: Station, tmp_path: Path) -> None:
    copied(tmp_path, "S8R_back")
    ran = station("validate", tmp_path, "--plot", tmp_path / "forces.svg")
    assert ran.code == DONE
    assert (tmp_path / "forces.svg").read_text(encoding="utf-8").count("<svg") == 1
    (tmp_path / "S8R_back_published_none.txt").write_bytes((SUBJECT / "S8R_back_published_circle.txt").read_bytes())
    assert station("validate", tmp_path).code == FAILED
    keep_lines(tmp_path / "S8R_back.mot", 100)
    solved, _ = validate_folder(tmp_path)
    assert [verdict.code for verdict in verdicts(solved)][:3] == 3 * [ValidationCode.PARTLY_PUBLISHED]
    assert AssessmentCode.ROW_COUNTS in {finding.code for finding in solved[0].findings}


@pytest.mark.shared
def test_a_lift_with_another_name_and_order_of_columns_is_the_same(solved: list[SolvedVariant], tmp_path: Path) -> None:
    """Without the record relative to the glenoid, the size is that of the implant's record."""
    copied(tmp_path, "S8R_side", "P2_front")
    (tmp_path / f"P2_front{GLENOID}").unlink()
    change_rows(tmp_path / "P2_front.mot", lambda row: [row[0], *row[:0:-1]])
    for path in tmp_path.glob("*published*"):
        table = pd.read_csv(path)
        table[table.columns[::-1]].to_csv(path, index=False)
    found, refused = validate_folder(tmp_path)
    assert not refused
    for ours, expected in zip(found, [variant for variant in solved if variant.lift == "S8R_side"], strict=True):
        assert (ours.lift, ours.variant) == ("P2_front", expected.variant)
        assert ours.median_difference == pytest.approx(expected.median_difference, abs=1e-6)
        assert ours.rmse_percent == pytest.approx(expected.rmse_percent, abs=0.1)
        assert np.isnan(ours.angle)


@pytest.mark.shared
def test_a_lift_that_is_refused_leaves_the_others(station: Station, tmp_path: Path) -> None:
    copied(tmp_path, "S8R_back")
    copied(tmp_path, "S8R_side", "S8R_front")
    record = tmp_path / "S8R_front_measured_force.txt"
    record.write_bytes(record.read_bytes()[:40_000])
    found, refused = validate_folder(tmp_path)
    assert {variant.lift for variant in found} == {"S8R_back"}
    assert [(lift.name, lift.error.code) for lift in refused] == [("S8R_front", RecordingCode.FOREIGN_CUT)]
    assert refused[0].message.code is ValidationCode.LIFT_LEFT_OUT
    assert station("validate", tmp_path).code == FAILED


@pytest.mark.shared
def test_a_cut_published_solution_is_compared_over_its_own_time(station: Station, tmp_path: Path) -> None:
    """All figures of its row are of the frames that have a published force."""
    copied(tmp_path, "S8R_back")
    keep_lines(tmp_path / "S8R_back_published_circle.txt", 60)
    solved, _ = validate_folder(tmp_path)
    codes = [verdict.code for verdict in verdicts(solved)]
    assert codes == [ValidationCode.PARTLY_PUBLISHED, ValidationCode.WITHIN_LIMITS]
    (circle,) = [one for one in solved if one.variant == "circle"]
    assert circle.compared == 59
    expected = force_agreement(circle.force[:59], circle.measured_force[:59])
    assert circle.agreement == expected
    ran = station("validate", tmp_path, "--output", tmp_path / "validation.csv")
    assert ran.code == LOSSY
    rows = csv.DictReader((tmp_path / "validation.csv").read_text(encoding="utf-8").splitlines())
    assert [row["compared"] for row in rows] == ["171", "59", "171", "171"]


@pytest.mark.shared
@pytest.mark.parametrize("rate_hz", [37.0, 100.0])
def test_a_motion_of_another_sampling_is_compared_in_every_frame(rate_hz: float) -> None:
    lift = read_lift(SUBJECT, "S8R_back", ("circle",))
    time = np.arange(0.0, lift.motion.time[-1], 1.0 / rate_hz)
    angles = CubicSpline(lift.motion.time, lift.motion.coordinates)(time)
    motion = replace(lift.motion, time=time, coordinates=angles)
    found = solve_variant(replace(lift, motion=motion), PUBLISHED_VARIANTS[1])
    assert found.compared == len(time) and found.is_whole and found.is_within_limits


@pytest.mark.shared
def test_the_size_is_compared_where_the_direction_is_not_known(tmp_path: Path, solved: list[SolvedVariant]) -> None:
    """Marker 3 in the glenoid's record, or its early end, hides the direction and not the size."""
    copied(tmp_path, "S8R_side")
    record = tmp_path / f"S8R_side{GLENOID}"
    whole = record.read_text(encoding="latin-1").splitlines()
    hidden = [row.removesuffix("1") + "3" if 130 <= number < 214 else row for number, row in enumerate(whole)]
    for rows in (hidden, whole[:250]):
        record.write_text("\n".join(rows) + "\n", encoding="latin-1")
        found, _ = validate_folder(tmp_path)
        for ours, expected in zip(found, [one for one in solved if one.lift == "S8R_side"], strict=True):
            assert ours.agreement == expected.agreement
            assert ours.compared == len(ours.time)
            assert np.isfinite(ours.angle) and ours.angle != expected.angle


@pytest.mark.shared
def test_files_whose_names_or_markers_are_unusual_are_named(tmp_path: Path) -> None:
    copied(tmp_path, "S8R_back")
    (tmp_path / f"S8R_back{GLENOID}").unlink()
    (tmp_path / "S8R_back_published_none.txt").rename(tmp_path / "S8R_back_published_zero.txt")
    record = tmp_path / "S8R_back_measured_force.txt"
    text = record.read_text(encoding="latin-1")
    record.write_text(re.sub(r"\t0(\r?\n)", r"\t1\1", text), encoding="latin-1")
    assert [note.code for note in read_lift(tmp_path, "S8R_back", VARIANTS).notes] == [
        ValidationCode.START_NOT_MARKED,
        ValidationCode.PUBLISHED_MISSING,
        ValidationCode.PUBLISHED_UNUSED,
    ]
    assert ValidationCode.LOW_CORRELATION in {one.code for one in verdicts(validate_folder(tmp_path)[0])}
    assert read_lift(SUBJECT, "S8R_back", VARIANTS).notes == ()


@pytest.mark.shared
def test_degrees_under_a_header_of_radians_are_a_finding_of_the_lift(tmp_path: Path) -> None:
    copied(tmp_path, "S8R_back")
    motion = tmp_path / "S8R_back.mot"
    assert AssessmentCode.BEYOND_RANGE not in {one.code for one in lift_findings(read_lift(tmp_path, "S8R_back", ()))}
    text = motion.read_text(encoding="utf-8")
    assert "inDegrees=yes" in text
    motion.write_text(text.replace("inDegrees=yes", "inDegrees=no"), encoding="utf-8")
    assert AssessmentCode.BEYOND_RANGE in {one.code for one in lift_findings(read_lift(tmp_path, "S8R_back", ()))}


@pytest.mark.shared
def test_a_lift_with_wrong_files_is_refused(tmp_path: Path) -> None:
    copied(tmp_path, "S8R_back")
    record = tmp_path / "S8R_back_measured_force.txt"
    whole = record.read_text(encoding="latin-1")
    record.write_text(whole.replace("BodyWeight", "Weight"), encoding="latin-1")
    with raises_refusal(ValidationCode.NO_BODY_WEIGHT, kind=ValidationFileError):
        read_lift(tmp_path, "S8R_back", ())
    record.write_bytes((SUBJECT / "S8R_side_measured_force.txt").read_bytes())
    with raises_refusal(ValidationCode.DIFFERENT_FORCES, kind=ValidationFileError):
        read_lift(tmp_path, "S8R_back", ())
    record.write_text(whole, encoding="latin-1")
    later = lambda row: row if row[0] == "time" else [f"{float(row[0]) + 7:g}", *row[1:]]  # noqa: E731
    change_rows(tmp_path / "S8R_back.mot", later)
    with raises_refusal(ValidationCode.NOT_COVERED, kind=ValidationFileError):
        read_lift(tmp_path, "S8R_back", ())


def test_a_folder_without_a_whole_lift_is_refused(station: Station, tmp_path: Path) -> None:
    assert_refused(station("validate", tmp_path / "none"), FAILED, FolderCode.NOT_A_FOLDER)
    assert_refused(station("validate", tmp_path), FAILED, ValidationCode.NO_LIFT)
    (tmp_path / "P1_side_as_solved.osim").touch()
    assert find_lifts(tmp_path) == ["P1_side"]
    assert_refused(station("validate", tmp_path), FAILED, ValidationCode.FILES_MISSING)


@pytest.mark.parametrize("option", ["--output", "--plot"])
def test_an_output_that_cannot_be_written_is_refused(station: Station, tmp_path: Path, option: str) -> None:
    suffix = {"--output": ".csv", "--plot": ".svg"}[option]
    (tmp_path / f"folder{suffix}").mkdir()
    (tmp_path / "file").touch()
    for output in (tmp_path / f"folder{suffix}", tmp_path / "file" / f"results{suffix}"):
        assert station("validate", tmp_path, option, output).code == WRONG_USAGE


@pytest.mark.parametrize("seed", range(3))
def test_a_published_solution_is_read_by_its_titles(tmp_path: Path, seed: int) -> None:
    generator = np.random.default_rng(seed)
    names = ["Fgx", "Fz", "BIC_long", "Fx", "Fy"]
    columns = [names[place] for place in generator.permutation(5)]
    table = pd.DataFrame(generator.normal(size=(20, 5)), columns=columns)
    table.insert(0, "time", np.arange(20) / 50)
    path = tmp_path / "published.txt"
    table.to_csv(path, index=False)
    read = read_published_force(path)
    np.testing.assert_array_equal(read.force, table[["Fx", "Fy", "Fz"]].to_numpy())
    table.assign(Fx=table["Fx"].where(table.index != 4)).to_csv(path, index=False)
    with raises_refusal(RecordingCode.FOREIGN_NOT_A_NUMBER, naming="line 6"):
        read_published_force(path)
    table.drop(columns="Fy").to_csv(path, index=False)
    with raises_refusal(RecordingCode.FOREIGN_MISSING_COLUMN):
        read_published_force(path)
    table.assign(time=0.0).to_csv(path, index=False)
    with raises_refusal(RecordingCode.FOREIGN_TIME_NOT_RISING):
        read_published_force(path)


@pytest.mark.parametrize("lost", [1, 25], ids=["before the last number", "within a force"])
def test_a_published_solution_that_was_cut_within_a_row_is_refused_with_its_line(tmp_path: Path, lost: int) -> None:
    """The last number of such a row may be wrong, and is not missing."""
    path = tmp_path / "published.txt"
    rows = [f"{frame / 50:.3f},1.25,2.5,3.75,0.0625,0.03125,0.015625" for frame in range(20)]
    text = "\n".join(["time,Fx,Fy,Fz,BIC_long,BIC_brevis,TRIlong", *rows])
    path.write_text(text[: -lost - len("0.015625")], encoding="utf-8")
    with raises_refusal(RecordingCode.FOREIGN_CUT, naming="line 21"):
        read_published_force(path)


def copied(folder: Path, lift: str, name: str | None = None) -> None:
    for path in SUBJECT.glob(f"{lift}*"):
        shutil.copyfile(path, folder / path.name.replace(lift, name or lift))

"""Joint forces as Orthoload publishes them: seeded records come back, bad ones are refused."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from recordings.errors import RecordingCode
from recordings.exchange.joint_force import read_joint_force
from tests.conftest import SHARED
from tests.refusals import raises_refusal

Array = NDArray[np.float64]

IMPLANT = "Time\tFx\tFy\tFz\tF\tMx\tMy\tMz\tMarker\n[s]\t[N]\t[N]\t[N]\t[N]\t[Nm]\t[Nm]\t[Nm]\t[0/1]\n"
GLENOID = (
    "Time\tFgx\tFgy\tFgz\tFg\tMgx\tMgy\tMgz\tMg\tMarker\n[s]\t[N]\t[N]\t[N]\t[N]\t[Nm]\t[Nm]\t[Nm]\t[Nm]    [0/1/2/3]\n"
)


def drawn(seed: int, samples: int = 40) -> tuple[Array, Array, Array]:
    """Uneven times, forces and markers, rounded as in the files; markers begin and end with 0."""
    generator = np.random.default_rng(seed)
    time = np.round(np.cumsum(generator.uniform(0.008, 0.011, samples)), 3)
    marker = np.zeros(samples)
    marker[samples // 4 : -samples // 5] = 1
    return time, np.round(generator.normal(0, 300, (samples, 3)), 2), marker


def text_of(time: Array, force: Array, marker: Array, *, is_comma: bool = False, weight: str = "830,5") -> str:
    header = f"Comment\t2,4 kg\nBodyWeight [N]:\t{weight}\n\nNumber of Data Sets =\t{len(time)}\n\n{IMPLANT}\n"
    rows = [
        f"{t:.3f}\t" + "".join(f"{part:09.2f}\t" for part in (*f, np.linalg.norm(f))) + f"0.46\t0.03\t0.10\t{m:.0f}\n"
        for t, f, m in zip(time, force, marker, strict=True)
    ]
    body = "".join(rows)
    return header + (body.replace(".", ",") if is_comma else body)


def written(folder: Path, text: str) -> Path:
    path = folder / "force.txt"
    path.write_bytes(text.replace("\n", "\r\n").encode("latin-1"))
    return path


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("is_comma", [False, True])
def test_a_record_is_read_from_its_first_to_its_last_marked_sample(
    tmp_path: Path, seed: int, *, is_comma: bool
) -> None:
    time, force, marker = drawn(seed)
    read = read_joint_force(written(tmp_path, text_of(time, force, marker, is_comma=is_comma)))
    kept = np.flatnonzero(marker)
    np.testing.assert_allclose(read.time_s, time[kept] - time[kept[0]], atol=1e-12)
    np.testing.assert_array_equal(read.force, force[kept])
    np.testing.assert_allclose(read.resultant, np.linalg.norm(force[kept], axis=1), atol=0.006)
    assert read.body_weight == 830.5


@pytest.mark.parametrize("line", ["Body Weight [N]:\t830,5", "Bodyweight[N]: 830.5", "BodyWeight [N]:\t \t830,5\t"])
def test_the_body_weight_is_read_in_other_spellings(tmp_path: Path, line: str) -> None:
    text = text_of(*drawn(0)).replace("BodyWeight [N]:\t830,5", line)
    assert read_joint_force(written(tmp_path, text)).body_weight == 830.5


def test_a_record_is_cut_where_its_first_sample_is_marked(tmp_path: Path) -> None:
    time, force, marker = drawn(0)
    assert not read_joint_force(written(tmp_path, text_of(time, force, marker))).is_cut
    marker[0] = 1
    assert read_joint_force(written(tmp_path, text_of(time, force, marker))).is_cut


def test_a_sample_without_kinematics_is_left_out_and_one_with_a_jump_is_kept(tmp_path: Path) -> None:
    """Relative to the glenoid, the force is unknown where the posture is."""
    time, force, marker = drawn(0)
    marker[15:18] = [2, 0, 3]
    text = text_of(time, force, marker).replace(f"{force[17, 0]:09.2f}", "NaN")
    read = read_joint_force(written(tmp_path, text))
    kept = np.flatnonzero(marker)
    expected = np.delete(np.arange(kept[0], kept[-1] + 1), 17 - kept[0])
    np.testing.assert_array_equal(read.force, force[expected])


def test_time_begins_at_the_first_marked_sample_and_a_gap_is_not_interpolated(tmp_path: Path) -> None:
    time, force, marker = drawn(0)
    first = int(np.flatnonzero(marker)[0])
    marker[[first, *range(18, 26)]] = 3
    read = read_joint_force(written(tmp_path, text_of(time, force, marker)))
    inside = time[18:26] - time[first]
    np.testing.assert_allclose(read.time_s[0], time[first + 1] - time[first], atol=1e-12)
    assert np.isnan(read.at(inside)[1]).all() and np.isnan(read.at(inside)[0]).all()
    known = read.at(read.time_s)
    np.testing.assert_allclose(known[0], read.force, atol=1e-9)
    middle = 0.5 * (read.time_s[3:5].sum())
    np.testing.assert_allclose(read.at(np.array([middle]))[1], 0.5 * read.resultant[3:5].sum(), rtol=1e-12)
    read = read_joint_force(written(tmp_path, text_of(*drawn(0))))
    outside = np.array([read.time_s[0] - 0.06, read.time_s[-1] + 0.06])
    assert np.isnan(read.at(outside)[1]).all()


def test_a_record_relative_to_the_glenoid_has_no_body_weight(tmp_path: Path) -> None:
    samples = ("0.934\t-88.72\t-119.37\t-136.89\t202.14", "0.944\t-73.40\t-125.40\t-142.84\t203.75")
    rows = "".join(f"{sample}\t0\t0\t0\t0\t1\n" for sample in samples)
    read = read_joint_force(written(tmp_path, f"Patient: S8R\nTime:\nstarts at 1\n{GLENOID}{rows}"))
    np.testing.assert_allclose(read.time_s, [0, 0.01], atol=1e-12)
    assert (read.body_weight, read.resultant.tolist()) == (None, [202.14, 203.75])


@pytest.mark.parametrize(
    ("before", "after", "code"),
    [
        (IMPLANT, "", RecordingCode.FOREIGN_NO_HEADER),
        ("\tFz\t", "\tFy\t", RecordingCode.FOREIGN_MISSING_COLUMN),
        ("\tMarker", "\tTrigger", RecordingCode.FOREIGN_MISSING_COLUMN),
        ("830,5", "unknown", RecordingCode.FOREIGN_NOT_A_NUMBER),
        ("830,5", "-830", RecordingCode.FOREIGN_NOT_A_NUMBER),
        ("BodyWeight [N]:\t830,5", "BodyWeight [kg]:\t84,6", RecordingCode.FOREIGN_UNIT),
        ("BodyWeight [N]", "BodyWeight", RecordingCode.FOREIGN_UNIT),
        ("830,5", "84,6", RecordingCode.FOREIGN_UNIT),
        ("830,5", "8305", RecordingCode.FOREIGN_UNIT),
        ("[s]\t[N]", "[ms]\t[N]", RecordingCode.FOREIGN_UNIT),
        ("[N]\t[N]\t[N]\t[N]", "[N]\t[N]\t[N]\t[kN]", RecordingCode.FOREIGN_UNIT),
        ("Sets =\t40", "Sets =\t400", RecordingCode.FOREIGN_CUT),
        ("\t0\n", "\n", RecordingCode.FOREIGN_NOT_A_NUMBER),
        ("\t1\n", "\t0\n", RecordingCode.FOREIGN_NO_MOTION),
    ],
)
def test_a_bad_record_is_refused_with_its_code(tmp_path: Path, before: str, after: str, code: RecordingCode) -> None:
    text = text_of(*drawn(0))
    assert before in text
    with raises_refusal(code):
        read_joint_force(written(tmp_path, text.replace(before, after)))


def test_a_record_that_was_cut_within_its_last_row_is_refused_with_its_line(tmp_path: Path) -> None:
    """Between samples without kinematics and empty lines; relative to the glenoid, no count is announced."""
    time, force, marker = drawn(0)
    marker[2:6] = 3
    whole = text_of(time, force, marker).replace("Number of Data Sets", "Samples").rstrip("\n")
    last = len(whole.splitlines())
    with raises_refusal(RecordingCode.FOREIGN_NOT_A_NUMBER, naming=f"line {last},"):
        read_joint_force(written(tmp_path, whole[:-12]))


def test_times_that_go_back_and_a_resultant_of_other_components_are_refused(tmp_path: Path) -> None:
    time, force, marker = drawn(0)
    with raises_refusal(RecordingCode.FOREIGN_TIME_NOT_RISING):
        read_joint_force(written(tmp_path, text_of(time[::-1], force, marker)))
    text = text_of(time, force, marker)
    row = text.splitlines()[-3]
    cells = row.split("\t")
    cells[4] = f"{float(cells[4]) + 0.1:09.2f}"
    with raises_refusal(RecordingCode.FOREIGN_CONTRADICTORY):
        read_joint_force(written(tmp_path, text.replace(row, "\t".join(cells))))


@pytest.mark.shared
@pytest.mark.parametrize(("lift", "samples", "peak"), [("side", 1025, 1678.71), ("back", 814, 857.55)])
def test_the_public_records_are_read_as_numpy_reads_them(lift: str, samples: int, peak: float) -> None:
    """The peak is that in the header of the implant's record."""
    implant = SHARED / "subject" / f"S8R_{lift}_measured_force.txt"
    glenoid = SHARED / "subject" / f"S8R_{lift}_measured_force_glenoid.txt"
    found = read_joint_force(implant), read_joint_force(glenoid)
    for path, read, skipped in zip((implant, glenoid), found, (33, 27), strict=True):
        table = np.genfromtxt(path, delimiter="\t", skip_header=skipped, encoding="latin-1")
        table = table[np.isfinite(table[:, -1]) & (table[:, -1] == 1)]
        assert len(read.time_s) == len(table) == samples
        np.testing.assert_allclose(read.time_s, table[:, 0] - table[0, 0], atol=1e-12)
        np.testing.assert_array_equal(np.column_stack([read.force, read.resultant]), table[:, 1:5])
    assert found[0].resultant.max() == pytest.approx(peak, abs=0.01)
    assert (found[0].body_weight, found[1].body_weight) == (830.0, None)
    assert np.abs(found[0].resultant - found[1].resultant).max() < 0.9

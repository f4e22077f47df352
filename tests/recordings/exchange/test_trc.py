import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from recordings.errors import RecordingCode
from recordings.exchange.trc import read_trc, write_trc
from tests.recordings.exchange.walk import FRAMES, same, walk
from tests.refusals import raises_refusal

MARKERS = Path(__file__).parents[3].parent / "shared" / "data" / "markers"


def file(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "trial.trc"
    path.write_text(text, encoding="utf-8")
    return path


def test_what_was_written_reads_the_same_to_the_last_bit(tmp_path: Path) -> None:
    assert same(read_trc(file(tmp_path, write_trc(walk(), "trial.trc"))), walk())


@pytest.mark.parametrize(("unit", "said", "scale"), [("m", "", 1000.0), ("cm", "", 10.0), ("mm", "m", 1000.0)])
def test_positions_are_in_the_unit_of_the_header_or_in_the_given_one(
    tmp_path: Path, unit: str, said: str, scale: float
) -> None:
    read = read_trc(file(tmp_path, write_trc(walk(), "t").replace("\tmm\t", f"\t{unit}\t")), said)
    assert read.positions[0, 0] == pytest.approx(scale * walk().positions[0, 0])


@pytest.mark.parametrize(
    ("old", "new", "code", "naming"),
    [
        ("PathFileType", "Path", RecordingCode.FOREIGN_WRONG_TYPE, "PathFileType"),
        (f"\t{FRAMES}\t3\tmm", f"\t{FRAMES}\t4\tmm", RecordingCode.FOREIGN_CUT, "NumMarkers"),
        ("\tmm\t", "\tfoot\t", RecordingCode.FOREIGN_UNIT, "'foot'"),
        ("\n7\t0.06\t", "\n7\tsoon\t", RecordingCode.FOREIGN_NOT_A_NUMBER, "line 13, has 'soon' in column 2"),
        ("\n7\t0.06\t", "\n7\t0.05\t", RecordingCode.FOREIGN_TIME_NOT_RISING, "line 13"),
        ("100\t100\t", "fast\t100\t", RecordingCode.FOREIGN_NO_RATE, "'fast'"),
        ("\n7\t0.06\t", "\n6.5\t0.055\t1.5\t2\n7\t0.06\t", RecordingCode.FOREIGN_CUT, "line 13, ends within"),
    ],
)
def test_a_file_that_is_none_is_refused_in_a_sentence(
    tmp_path: Path, old: str, new: str, code: RecordingCode, naming: str
) -> None:
    text = write_trc(walk(), "t")
    assert old in text
    with raises_refusal(code, naming):
        read_trc(file(tmp_path, text.replace(old, new, 1)))


COUNTS = f"\t{FRAMES}\t3\tmm"


@pytest.mark.parametrize(
    ("old", "new", "note"),
    [
        *(
            (COUNTS, f"\t{announced}\t3\tmm", f"announces NumFrames {announced} and holds {FRAMES}")
            for announced in (41, 3514, 7)  # as in OpenSim's own bone-pin file, which announces 3514 and holds 1991
        ),
        (COUNTS, f"\t{FRAMES}\t2\tmm", "announces NumMarkers 2 and names 3"),
        ("\n100\t100\t", "\n250\t250\t", "states 250 frames a second"),
        ("\n100\t100\t", "\n\t100\t", ""),
    ],
)
def test_a_header_that_contradicts_the_rows_is_noted_and_every_frame_marker_and_time_is_read(
    tmp_path: Path, old: str, new: str, note: str
) -> None:
    read = read_trc(file(tmp_path, write_trc(walk(), "t").replace(old, new, 1)))
    assert same(read, walk())
    assert not note or note in read.notes[0]


@pytest.mark.parametrize("cut", [1, 3, 30])
def test_a_file_that_ends_within_a_row_is_read_without_that_row(tmp_path: Path, cut: int) -> None:
    read = read_trc(file(tmp_path, write_trc(walk(), "t").replace(f"\t{FRAMES}\t3\tmm", "\t41\t3\tmm", 1)[:-cut]))
    expected = walk()
    assert same(read, replace(expected, time_s=expected.time_s[:-1], positions=expected.positions[:-1]))
    assert "announces NumFrames 41 and ends within row 40: 39 are read" in read.notes[0]


@pytest.mark.parametrize("printed", ["-nan(ind)", "nan(snan)", "1.#QNAN", "-1.#IND00", "1.#INF", "NaN"])
def test_what_c_prints_for_a_number_that_is_none_is_missing(tmp_path: Path, printed: str) -> None:
    header, rows = write_trc(walk(), "t").split("\n\n")
    rows = rows.replace("\t\t\t", f"\t{printed}\t{printed}\t{printed}")
    assert printed in rows
    read = read_trc(file(tmp_path, f"{header}\n\n{rows}"))
    assert same(read, walk())
    assert bool(read.notes) == (printed != "NaN")
    assert not read.notes or printed in read.notes[0]


@pytest.mark.parametrize("lines", [5, 6])
def test_a_header_without_rows_is_too_short_and_not_of_another_type(lines: int, tmp_path: Path) -> None:
    text = "\n".join(write_trc(walk(), "t").split("\n")[:lines]) + "\n"
    with raises_refusal(RecordingCode.FOREIGN_TOO_SHORT, "no row"):
        read_trc(file(tmp_path, text))


def at_origin(*labels: str) -> str:
    positions = walk().positions.copy()
    for label in labels:
        positions[:, walk().labels.index(label)] = 0.0
    return write_trc(replace(walk(), positions=positions), "t")


def test_the_only_marker_at_zero_in_every_frame_is_the_origin_where_it_is_tracked(tmp_path: Path) -> None:
    path = file(tmp_path, at_origin("LShoulderTop"))
    assert read_trc(path).missing[:, 0].all()
    assert read_trc(path, tracked=["cuff_1"]).missing[:, 0].all()
    read = read_trc(path, tracked=["LShoulderTop", "cuff_1"])
    assert (read.positions[:, 0] == 0.0).all()
    assert "LShoulderTop, and no other marker, at (0, 0, 0)" in read.notes[0]
    both = read_trc(file(tmp_path, at_origin("LShoulderTop", "LElbowOut")), tracked=["LShoulderTop", "LElbowOut"])
    assert both.missing[:, :2].all() and not both.notes


@pytest.mark.parametrize("empty", [np.nan, 0.0])
def test_frames_without_markers_leave_the_origin_where_it_is(empty: float, tmp_path: Path) -> None:
    positions = walk().positions.copy()
    positions[:, 0] = 0.0
    positions[3:6] = empty
    path = file(tmp_path, write_trc(replace(walk(), positions=positions), "t"))
    read = read_trc(path, tracked=[walk().labels[0]])
    shown = np.delete(np.arange(FRAMES), [3, 4, 5])
    assert (read.positions[shown, 0] == 0.0).all()
    assert read.missing[3:6].all()


@pytest.mark.shared
@pytest.mark.skipif(not MARKERS.is_dir(), reason="needs the public marker files")
@pytest.mark.parametrize("trial", ["FLX01", "ABD02", "SHRUG01"])
def test_the_published_trials_have_their_origin_in_the_jugular_notch(trial: str) -> None:
    tracked = re.findall('<IKMarkerTask name="([^"]+)"', (MARKERS / "ik_setup.xml").read_text())
    read = read_trc(MARKERS / f"{trial}.trc", tracked=tracked)
    assert "ij" in tracked
    assert (read.positions[:, read.labels.index("ij")] == 0.0).all()
    assert "ij, and no other marker" in read.notes[0]


@pytest.mark.oracle
def test_opensim_reads_it_and_sees_the_same_gaps(tmp_path: Path) -> None:
    opensim = pytest.importorskip("opensim")
    read = opensim.TimeSeriesTableVec3(str(file(tmp_path, write_trc(walk(), "trial.trc"))))
    assert read.getNumRows() == FRAMES
    for label, marker in zip(walk().labels, walk().positions.transpose(1, 0, 2), strict=True):
        column = read.getDependentColumn(label)
        assert [column[i][0] for i in range(FRAMES)] == pytest.approx(marker[:, 0].tolist(), nan_ok=True)


def retabbed(text: str, separator: str) -> str:
    """The lines below the first with another separator."""
    return text.replace("\t", separator).replace(separator, "\t", 3)


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_columns_may_be_separated_by_commas_or_semicolons_and_an_empty_unit_is_millimetres(
    tmp_path: Path, separator: str
) -> None:
    text = write_trc(walk(), "t")
    assert same(read_trc(file(tmp_path, retabbed(text.replace("\tmm\t", "\t\t"), separator))), walk())


def test_blanks_separate_columns_where_no_marker_is_missing_also_with_decimal_commas(tmp_path: Path) -> None:
    whole = replace(walk(), positions=np.nan_to_num(walk().positions, nan=7.0))
    text = "\n".join(" ".join(line.split()) for line in write_trc(whole, "t").split("\n"))
    read = read_trc(file(tmp_path, text))
    assert read.labels == whole.labels and np.array_equal(read.positions, whole.positions)
    with raises_refusal(RecordingCode.FOREIGN_TITLES, "expected 11"):
        read_trc(file(tmp_path, text.replace(" 7.0 7.0 7.0", "", 1)))
    table = replace(walk(), positions=np.where(walk().missing[..., None], 0.0, walk().positions))
    header, rows = write_trc(table, "t").split("\n\n")
    read = read_trc(file(tmp_path, f"{header}\n\n{rows.replace('.', ',').replace(chr(9), ' ')}"))
    assert same(read, walk())


@pytest.mark.parametrize("change", ["1.0", "tabs", "cr", "crcrlf", "utf-16", "latin-1"])
def test_other_programs_write_the_same_rows_otherwise(tmp_path: Path, change: str) -> None:
    text, path = write_trc(walk(), "t"), tmp_path / "trial.trc"
    if change == "1.0":
        text = re.sub(r"^(\d+)\t(?=[\d.]+\t[-\d.]+\t)", r"\1.0\t", text, flags=re.MULTILINE)
        text = text.replace(f"\n100\t100\t{FRAMES}.0", f"\n100\t100\t{FRAMES}")
    text = text + "\t\t\n" * 3 if change == "tabs" else text
    text = text.replace("\n", {"cr": "\r", "crcrlf": "\r\r\n"}.get(change, "\n"))
    label = "LElb\x85w" if change == "latin-1" else "LElbowOut"
    path.write_bytes(text.replace("LElbowOut", label).encode(change if "-" in change else "utf-8"))
    read = read_trc(path)
    assert read.labels[1] == label
    assert same(replace(read, labels=walk().labels), walk())


def test_a_marker_without_a_name_does_not_shift_those_behind_it(tmp_path: Path) -> None:
    text = write_trc(walk(), "t").replace("LElbowOut", "", 1).replace("\t3\tmm", "\t2\tmm", 1)
    read = read_trc(file(tmp_path, text))
    assert read.labels == ("LShoulderTop", "cuff_1")
    assert np.array_equal(read.positions, walk().positions[:, [0, 2]], equal_nan=True)


def test_numbers_of_no_marker_are_left_out_between_tabs_and_refused_otherwise(tmp_path: Path) -> None:
    text = write_trc(walk(), "t").replace("\tcuff_1\t", "\t\t", 1).replace("\t3\tmm", "\t2\tmm", 1)
    read = read_trc(file(tmp_path, text))
    assert np.array_equal(read.positions, walk().positions[:, :2], equal_nan=True)
    assert "without a name" in read.notes[0]
    with raises_refusal(RecordingCode.FOREIGN_TITLES, "expected 8"):
        read_trc(file(tmp_path, retabbed(text, ",")))


@pytest.mark.parametrize(("unit", "in_second"), [("ms", 1000.0), ("µs", 1e6), ("min", 1 / 60), ("frames", 100.0)])
def test_times_of_another_unit_are_named_by_the_rate(tmp_path: Path, unit: str, in_second: float) -> None:
    path = file(tmp_path, write_trc(replace(walk(), time_s=in_second * walk().time_s), "t"))
    with raises_refusal(RecordingCode.FOREIGN_CONTRADICTORY, f"times in {unit};"):
        read_trc(path)

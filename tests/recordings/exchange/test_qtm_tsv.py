from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from recordings.errors import RecordingCode
from recordings.exchange.qtm_tsv import read_qtm_tsv, write_qtm_tsv
from tests.recordings.exchange.walk import FRAMES, same, walk
from tests.refusals import raises_refusal

HEADER = "NO_OF_FRAMES\t3\nNO_OF_CAMERAS\t12\nNO_OF_MARKERS\t2\nFREQUENCY\t100\nDESCRIPTION\t--\nDATA_INCLUDED\t3D\n"
NAMES = "MARKER_NAMES\ta\tb\n"
ROWS = ["1.5\t2\t3\t4\t5\t6", "1.6\t2\t3\t0.000\t0.000\t0.000", "1.7\t2\t3\t\t\t"]
CAPTURED = datetime(2025, 3, 4, 12, 30, 1, tzinfo=UTC)
EXPECTED_A = [1.5, 1.6, 1.7]
BAD = "line 9, has 'x' in column 3"


def export(tmp_path: Path, *parts: str) -> Path:
    path = tmp_path / "trial.tsv"
    path.write_bytes("".join(parts).encode())
    return path


def lines(rows: list[str]) -> str:
    return "\r\n".join(rows) + "\r\n"


COUNTED = [f"{i + 1}\t{i / 100:.5f}\t{row}" for i, row in enumerate(ROWS)]
TITLES = "a X\ta Y\ta Z\tb X\tb Y\tb Z\n"
TABBED = "MARKER_NAMES\ta\tb\t\nTRAJECTORY_TYPES\tMeasured\tMixed\n"
VARIANTS = {
    "as it is": (HEADER + NAMES, ROWS, 0.0),
    "every line ends in a tab": (HEADER + TABBED, [row + "\t" for row in ROWS], 0.0),
    "with frame numbers of a cut capture": (HEADER + NAMES, [f"{i + 101}\t{r}" for i, r in enumerate(ROWS)], 1.0),
    "with frames and times": (HEADER + NAMES, COUNTED, 0.0),
    "with times": (HEADER + NAMES, [f"{0.5 + i / 100:.5f}\t{row}" for i, row in enumerate(ROWS)], 0.5),
    "with titles": (HEADER + NAMES + "Frame\tTime\t" + TITLES, COUNTED, 0.0),
    "with titles of the markers alone": (HEADER + NAMES + TITLES, ROWS, 0.0),
    "with decimal commas": (HEADER.replace("100", "100,0") + NAMES, [row.replace(".", ",") for row in ROWS], 0.0),
    "of format 2 with an event": ("FILE_VERSION\t2.0.0\nEVENT\tSync\t1\t0.0\n" + HEADER + NAMES, ROWS, 0.0),
    "with an external time base": (HEADER.replace("100", "EXT") + NAMES, COUNTED, 0.0),
    "with null for nothing": (HEADER + NAMES, [*ROWS[:2], "1.7\t2\t3\tnull\tnull\tnull"], 0.0),
}


@pytest.mark.parametrize(("header", "rows", "first_time"), VARIANTS.values(), ids=VARIANTS)
def test_every_variant_of_the_export_reads_the_same(
    tmp_path: Path, header: str, rows: list[str], first_time: float
) -> None:
    read = read_qtm_tsv(export(tmp_path, header, lines(rows)))
    assert read.labels == ("a", "b")
    assert read.rate_hz == pytest.approx(100)
    assert read.positions[:, 0, 0].tolist() == EXPECTED_A
    assert read.missing.tolist() == [[False, False], [False, True], [False, True]]
    assert read.time_s == pytest.approx(first_time + np.arange(3) / 100)


@pytest.mark.parametrize(
    ("text", "code", "naming"),
    [
        (lines(ROWS), RecordingCode.FOREIGN_NO_HEADER, "MARKER_NAMES"),
        (HEADER + "MARKER_NAMES\n" + lines(ROWS), RecordingCode.FOREIGN_NO_MARKERS, ""),
        (HEADER + "MARKER_NAMES\ta\n" + lines(ROWS), RecordingCode.FOREIGN_CUT, "NO_OF_MARKERS"),
        (HEADER + NAMES + lines(ROWS[:2]), RecordingCode.FOREIGN_CUT, "NO_OF_FRAMES"),
        (HEADER + NAMES, RecordingCode.FOREIGN_CUT, "NO_OF_FRAMES"),
        (HEADER + NAMES + lines([row + "\t7\t8\t9" for row in ROWS]), RecordingCode.FOREIGN_TITLES, "9 columns for 2"),
        (HEADER + NAMES + lines([ROWS[0], "1.6\t2\tx\t4\t5\t6", ROWS[2]]), RecordingCode.FOREIGN_NOT_A_NUMBER, BAD),
        (
            HEADER + NAMES + lines([ROWS[0], "1.6\t2\t3\t0.0", ROWS[2]]),
            RecordingCode.FOREIGN_CUT,
            "line 9, ends within",
        ),
        (HEADER.replace("100", "EXT") + NAMES + lines(ROWS), RecordingCode.FOREIGN_NO_RATE, ""),
        (HEADER + NAMES + lines([COUNTED[0], *COUNTED[2:] * 2]), RecordingCode.FOREIGN_TIME_NOT_RISING, "line 10"),
    ],
)
def test_an_export_that_is_none_is_refused_in_a_sentence(
    tmp_path: Path, text: str, code: RecordingCode, naming: str
) -> None:
    with raises_refusal(code, naming):
        read_qtm_tsv(export(tmp_path, text))


def test_metres_are_read_as_metres_if_the_unit_is_given(tmp_path: Path) -> None:
    read = read_qtm_tsv(export(tmp_path, HEADER, NAMES, lines(ROWS)), "m")
    assert read.positions[0, 0].tolist() == [1500.0, 2000.0, 3000.0]


def test_what_was_written_reads_the_same_to_the_last_bit_under_qtm_s_header(tmp_path: Path) -> None:
    text = write_qtm_tsv(walk(first=0.25))
    assert f"NO_OF_FRAMES\t{FRAMES}" in text
    assert same(read_qtm_tsv(export(tmp_path, text)), walk(first=0.25))
    keys = [line.split("\t")[0] for line in write_qtm_tsv(walk(), CAPTURED).splitlines()[:12]]
    counts = ["NO_OF_FRAMES", "NO_OF_CAMERAS", "NO_OF_MARKERS", "FREQUENCY", "NO_OF_ANALOG", "ANALOG_FREQUENCY"]
    texts = ["DESCRIPTION", "TIME_STAMP", "DATA_INCLUDED", "MARKER_NAMES", "TRAJECTORY_TYPES", "Frame"]
    assert keys == counts + texts
    assert "TIME_STAMP\t2025-03-04, 12:30:01\n" in write_qtm_tsv(walk(), CAPTURED)


def test_a_name_that_occurs_twice_is_numbered(tmp_path: Path) -> None:
    read = read_qtm_tsv(export(tmp_path, HEADER, "MARKER_NAMES\ta\ta\n", lines(ROWS)))
    assert read.labels == ("a#1", "a#2")
    assert "import it with --label a#1=a" in read.notes[0]


@pytest.mark.parametrize("hidden", ["\t\t\t\t\t", "nan\tnan\tnan\tnan\tnan\tnan", "null\tnull\tnull\tnull\tnull\tnull"])
@pytest.mark.parametrize("titles", ["", "a X\ta Y\ta Z\tb X\tb Y\tb Z\n"])
def test_frames_without_a_marker_are_frames_at_either_end(tmp_path: Path, hidden: str, titles: str) -> None:
    header = HEADER.replace("NO_OF_FRAMES\t3", "NO_OF_FRAMES\t7")
    read = read_qtm_tsv(export(tmp_path, header, NAMES, titles, lines([hidden, hidden, *ROWS, hidden, hidden])))
    assert read.missing[:, 0].tolist() == [True, True, False, False, False, True, True]
    assert read.positions[2:5, 0, 0].tolist() == EXPECTED_A
    assert read.time_s == pytest.approx(np.arange(7) / 100)


def test_lines_of_tabs_beyond_the_announced_frames_are_no_frames(tmp_path: Path) -> None:
    read = read_qtm_tsv(export(tmp_path, HEADER, NAMES, lines([*ROWS, "\t\t", "\t\t\t\t\t"])))
    assert read.positions[:, 0, 0].tolist() == EXPECTED_A


@pytest.mark.parametrize("last", ["4\t5\t6", "\t\t"])
def test_a_tab_behind_every_row_is_no_column_of_frames_and_times(tmp_path: Path, last: str) -> None:
    rows = [f"{i + 1}\t{i / 100}\t{1.5 + i / 10}\t2\t3\t{last}\t" for i in range(3)]
    read = read_qtm_tsv(export(tmp_path, HEADER, NAMES, lines(rows)))
    assert read.time_s == pytest.approx([0.0, 0.01, 0.02])
    assert read.positions[:, 0, 0].tolist() == EXPECTED_A
    assert read.missing[:, 1].all() == last.isspace()

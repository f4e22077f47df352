from __future__ import annotations

from pathlib import Path

import pytest

from recordings.errors import ForeignFile
from recordings.exchange.trc import read_trc, write_trc
from tests.recordings.exchange.walk import FRAMES, same, walk


def file(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "trial.trc"
    path.write_text(text, encoding="utf-8")
    return path


def test_what_was_written_reads_the_same_to_the_last_bit(tmp_path: Path) -> None:
    assert same(read_trc(file(tmp_path, write_trc(walk(), "trial.trc"))), walk())


@pytest.mark.parametrize(("unit", "said", "scale"), [("m", "", 1000.0), ("cm", "", 10.0), ("mm", "m", 1000.0)])
def test_positions_are_in_the_unit_of_the_header_or_in_the_one_that_is_said(
    tmp_path: Path, unit: str, said: str, scale: float
) -> None:
    read = read_trc(file(tmp_path, write_trc(walk(), "t").replace("\tmm\t", f"\t{unit}\t")), said)
    assert read.positions[0, 0] == pytest.approx(scale * walk().positions[0, 0])


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("PathFileType", "Path", "does not begin with PathFileType"),
        (f"\t{FRAMES}\t3\tmm", "\t41\t3\tmm", f"announces NumFrames 41 and holds {FRAMES}"),
        (f"\t{FRAMES}\t3\tmm", f"\t{FRAMES}\t4\tmm", "announces NumMarkers 4 and names 3"),
        ("\tmm\t", "\tfoot\t", "has positions in 'foot', expected mm, cm, m; give --mocap-unit"),
        ("LElbowOut", "LShoulderTop", "names the marker 'LShoulderTop' twice"),
        ("\n7\t0.06\t", "\n7\tsoon\t", "line 13, has 'soon' in column 2"),
        ("\n7\t0.06\t", "\n7\t0.05\t", "has 0.05 s again in line 13"),
        ("100\t100\t", "fast\t100\t", "has DataRate 'fast'"),
    ],
)
def test_a_file_that_is_none_is_refused_in_a_sentence(tmp_path: Path, old: str, new: str, words: str) -> None:
    text = write_trc(walk(), "t")
    assert old in text
    with pytest.raises(ForeignFile, match=words):
        read_trc(file(tmp_path, text.replace(old, new, 1)))


@pytest.mark.oracle
def test_opensim_reads_it_and_sees_the_same_gaps(tmp_path: Path) -> None:
    opensim = pytest.importorskip("opensim")
    read = opensim.TimeSeriesTableVec3(str(file(tmp_path, write_trc(walk(), "trial.trc"))))
    assert read.getNumRows() == FRAMES
    for label, marker in zip(walk().labels, walk().positions.transpose(1, 0, 2), strict=True):
        column = read.getDependentColumn(label)
        assert [column[i][0] for i in range(FRAMES)] == pytest.approx(marker[:, 0].tolist(), nan_ok=True)

from __future__ import annotations

from pathlib import Path

import ezc3d
import numpy as np
import pytest

from recordings.errors import ForeignFile
from recordings.exchange.c3d import read_c3d_markers, read_c3d_signals, write_c3d
from tests.recordings.exchange.walk import FRAMES, same, walk

FORCE = np.sin(np.arange(10 * FRAMES) / 7)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "trial.c3d"
    write_c3d(path, walk(), {"force_n": FORCE, "sync_v": 5 * (FORCE > 0)}, {"force_n": "N", "sync_v": "V"})
    return path


def rewritten(path: Path, change) -> Path:
    c3d = ezc3d.c3d(str(path))
    change(c3d)
    c3d.write(str(path))
    return path


def test_markers_come_back_within_single_precision(file: Path) -> None:
    assert same(read_c3d_markers(file), walk(), tolerance_mm=1e-4)


def test_analog_channels_come_back_with_their_units_on_the_markers_clock(file: Path) -> None:
    read = read_c3d_signals(file, ["force_n", "elsewhere"])
    assert read.names == ("force_n", "sync_v")
    assert read.units == {"force_n": "N"}
    assert read.signals["force_n"] == pytest.approx(FORCE, abs=1e-6)
    assert read.time_s == pytest.approx(np.arange(10 * FRAMES) / 1000)


def test_a_marker_of_negative_residual_is_missing_and_zeros_beside_it_are_no_position(file: Path) -> None:
    def hide(c3d: ezc3d.c3d) -> None:
        c3d["data"]["points"][:3, 0, 4] = 0.0
        c3d["data"]["meta_points"]["residuals"][0, 0, 4] = -1

    assert read_c3d_markers(rewritten(file, hide)).missing[4, 0]


def test_metres_and_a_capture_that_was_cut_are_understood(file: Path) -> None:
    def change(c3d: ezc3d.c3d) -> None:
        c3d["parameters"]["POINT"]["UNITS"]["value"] = ["m"]
        c3d["data"]["points"][:3] /= 1000
        c3d["header"]["points"]["first_frame"] = 50

    read = read_c3d_markers(rewritten(file, change))
    assert same(read, walk(first=0.5), tolerance_mm=1e-3)
    assert read_c3d_signals(file, ["force_n"]).time_s[0] == pytest.approx(0.5)


def test_unlabelled_trajectories_are_passed_over(file: Path) -> None:
    def change(c3d: ezc3d.c3d) -> None:
        c3d["parameters"]["POINT"]["LABELS"]["value"] = ["LShoulderTop", "*17", ""]

    assert read_c3d_markers(rewritten(file, change)).labels == ("LShoulderTop",)


def test_files_that_are_none_are_refused_in_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(ForeignFile, match="there is no such file"):
        read_c3d_markers(tmp_path / "none.c3d")
    (tmp_path / "text.c3d").write_text("NO_OF_FRAMES\t3\n" * 100, encoding="utf-8")
    with pytest.raises(ForeignFile, match=r"text\.c3d cannot be read as C3D"):
        read_c3d_markers(tmp_path / "text.c3d")
    write_c3d(tmp_path / "silent.c3d", walk(), {}, {})
    with pytest.raises(ForeignFile, match="holds no analog channel"):
        read_c3d_signals(tmp_path / "silent.c3d", ["force_n"])


def test_a_file_whose_points_nobody_labelled_holds_no_markers(file: Path) -> None:
    def change(c3d: ezc3d.c3d) -> None:
        c3d["parameters"]["POINT"]["LABELS"]["value"] = ["*1", "*2", "*3"]

    with pytest.raises(ForeignFile, match="names no markers"):
        read_c3d_markers(rewritten(file, change))


def test_every_cut_of_a_file_is_a_sentence_or_what_was_in_it(file: Path, tmp_path: Path) -> None:
    whole, cut = file.read_bytes(), tmp_path / "cut.c3d"
    for size in range(0, len(whole), 997):
        cut.write_bytes(whole[:size])
        try:
            read = read_c3d_markers(cut)
        except ForeignFile:
            continue
        assert len(read.labels) == 3

from __future__ import annotations

import sys
from pathlib import Path

import ezc3d
import numpy as np
import pytest

from recordings.errors import ForeignFile, RecordingCode
from recordings.exchange.c3d import read_c3d_markers, read_c3d_signals
from recordings.exchange.c3d_writer import write_c3d
from recordings.exchange.tables import MarkerTable
from tests.recordings.exchange.raw_c3d import CHANNELS, POSITIONS, SCALE, write_raw_c3d
from tests.recordings.exchange.walk import FRAMES, same, walk
from tests.recordings.refusals import raises_refusal

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
    with raises_refusal(RecordingCode.FOREIGN_UNREADABLE, "none.c3d"):
        read_c3d_markers(tmp_path / "none.c3d")
    (tmp_path / "text.c3d").write_text("NO_OF_FRAMES\t3\n" * 100, encoding="utf-8")
    with raises_refusal(RecordingCode.FOREIGN_WRONG_TYPE, "text.c3d"):
        read_c3d_markers(tmp_path / "text.c3d")
    write_c3d(tmp_path / "silent.c3d", walk(), {}, {})
    with raises_refusal(RecordingCode.FOREIGN_NO_CHANNEL, "silent.c3d"):
        read_c3d_signals(tmp_path / "silent.c3d", ["force_n"])


def test_a_file_without_labels_holds_no_markers(file: Path) -> None:
    def change(c3d: ezc3d.c3d) -> None:
        c3d["parameters"]["POINT"]["LABELS"]["value"] = ["*1", "*2", "*3"]

    with raises_refusal(RecordingCode.FOREIGN_NO_MARKERS):
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


def test_labels_beyond_the_points_are_of_nothing(tmp_path: Path) -> None:
    # as in c3d.org's samples 01 and 08: 30 labels for 26 points
    read = read_c3d_markers(write_raw_c3d(tmp_path / "more.c3d", ["a", "b", "c", "late", "later"]))
    assert read.labels == ("a", "b", "c")
    assert read.positions == pytest.approx(SCALE * POSITIONS, abs=1e-4)
    fewer = read_c3d_markers(write_raw_c3d(tmp_path / "fewer.c3d", ["a", "b"]))
    assert fewer.labels == ("a", "b")


def test_without_the_reader_package_reading_is_refused_and_writing_works(
    file: Path, tmp_path: Path, monkeypatch
) -> None:
    monkeypatch.setitem(sys.modules, "ezc3d", None)
    with raises_refusal(RecordingCode.FOREIGN_NEEDS_PACKAGE, "ezc3d"):
        read_c3d_markers(file)
    write_c3d(tmp_path / "again.c3d", walk(), {}, {})
    assert (tmp_path / "again.c3d").stat().st_size > 2048


def test_a_wanted_channel_that_occurs_twice_is_refused(file: Path) -> None:
    def repeat_the_name(c3d) -> None:
        c3d["parameters"]["ANALOG"]["LABELS"]["value"] = ["force_n", "force_n"]

    rewritten(file, repeat_the_name)
    with raises_refusal(RecordingCode.FOREIGN_REPEATED_NAME, "'force_n' twice"):
        read_c3d_signals(file, ["force_n"])
    assert read_c3d_signals(file, ["sync_v"]).signals == {}


def test_a_label_that_occurs_twice_is_numbered_with_a_note(tmp_path: Path) -> None:
    read = read_c3d_markers(write_raw_c3d(tmp_path / "twice.c3d", ["RTHI", "RKNE", "RTHI"]))
    assert read.labels == ("RTHI#1", "RKNE", "RTHI#2")
    assert read.positions == pytest.approx(SCALE * POSITIONS, abs=1e-4)
    (note,) = read.notes
    assert "more than one marker RTHI" in note and "--label RTHI#1=RTHI" in note


def test_frames_that_the_header_lays_out_otherwise_are_not_read(tmp_path: Path) -> None:
    # as in c3d.org's sample 28: the parameters know of no analog values, and every frame after the first is shifted
    file = write_raw_c3d(tmp_path / "shifted.c3d", used_analog=0)
    with raises_refusal(RecordingCode.FOREIGN_CONTRADICTORY, "3 points and 8 analog values"):
        read_c3d_markers(file)
    with raises_refusal(RecordingCode.FOREIGN_CONTRADICTORY):
        read_c3d_signals(file, ["f1"])


def test_a_header_that_counts_channels_is_overruled_by_the_file_s_size(tmp_path: Path) -> None:
    # as in c3d.org's sample 24
    read = read_c3d_markers(write_raw_c3d(tmp_path / "channels.c3d", header_analog=CHANNELS))
    assert read.positions == pytest.approx(SCALE * POSITIONS, abs=1e-4)


def test_a_file_that_lost_its_end_is_cut(tmp_path: Path) -> None:
    file = write_raw_c3d(tmp_path / "cut.c3d")
    file.write_bytes(file.read_bytes()[:-10])
    with raises_refusal(RecordingCode.FOREIGN_CUT, "59"):
        read_c3d_markers(file)


@pytest.mark.parametrize("place", [512 + 4, 512 + 40, 512 + 100])
def test_sentences_are_ours(tmp_path: Path, place: int) -> None:
    with raises_refusal(RecordingCode.FOREIGN_WRONG_TYPE, "SGI"):
        read_c3d_markers(write_raw_c3d(tmp_path / "sgi.c3d", processor=86))
    file = write_raw_c3d(tmp_path / "damaged.c3d")
    raw = bytearray(file.read_bytes())
    raw[place : place + 40] = b"\x7f" * 40
    file.write_bytes(raw)
    with pytest.raises(ForeignFile) as caught:
        read_c3d_markers(file)
    for word in ("GitHub", "ignoreBadFormatting", "iostream", "parameterIdx"):
        assert word not in str(caught.value)


@pytest.mark.parametrize("frames", [FRAMES, pytest.param(70_000, marks=pytest.mark.slow)])
def test_a_second_reader_finds_markers_and_a_single_channel(tmp_path: Path, frames: int) -> None:
    c3d = pytest.importorskip("c3d", reason="needs the package c3d: install the extra test")
    turns = -(-frames // FRAMES)
    whole = walk()
    positions, residuals = (np.concatenate([part] * turns)[:frames] for part in (whole.positions, whole.residuals))
    table = MarkerTable(whole.labels, whole.rate_hz, np.arange(frames) / 100, positions, residuals)
    force = np.resize(FORCE, 10 * frames)
    write_c3d(tmp_path / "one.c3d", table, {"force_n": force}, {"force_n": "N"})
    points, channels = [], []
    with (tmp_path / "one.c3d").open("rb") as file:
        reader = c3d.Reader(file)
        for _, seen, analog in reader.read_frames(copy=True):
            points.append(seen)
            channels.append(analog[0])
    found = np.array(points)
    missing = found[..., 3] < 0
    assert (missing == table.missing).all()
    np.testing.assert_allclose(found[~missing][:, :3], positions[~missing], rtol=0, atol=1e-3)
    half_a_unit = 0.5 * abs(float(reader.point_scale))
    np.testing.assert_allclose(found[~missing][:, 3], residuals[~missing], rtol=0, atol=half_a_unit)
    np.testing.assert_allclose(np.concatenate(channels), force, rtol=0, atol=1e-6)
    assert [label.strip() for label in reader.point_labels] == list(table.labels)
